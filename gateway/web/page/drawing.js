// A mounting as a drawing: bed, moving axis, instrument, optics, and the direction that counts as positive.
import { h, s, show } from "./dom.js";
import { state } from "./state.js";
import { t } from "./words.js";

// Every mounting of the plan: axes first, each with what is mounted for it.
export function mountings() {
  const own = state.plan.axes.map((one) => ({ key: `${one.component}-${one.axis}`, component: one.component, axis: one.axis, instrument: one.instrument }));
  const more = state.plan.setups.filter((one) => !own.some((other) => other.component === one.component && other.axis === one.axis));
  return [...own, ...more.map((one) => ({ key: one.setup, component: one.component, axis: one.axis, instrument: one.instrument }))];
}

export function mounting(wanted) {
  const every = mountings();
  const said = state.ask ?? state.said.slice(-1)[0];
  const asked = every.find((one) => one.component === said?.fields?.component) ?? every.find((one) => one.axis === state.status.run?.axis);
  const place = h("div", { class: "sheet" });
  const choose = h("select", { id: "which-mounting", onchange: () => draw(choose.value) }, every.map((one) => h("option", { value: one.key }, `${one.component} · ${one.axis} · ${one.instrument}`)));
  const draw = (key) => { const one = every.find((other) => other.key === key) ?? every[0]; choose.value = one.key; show(place, picture(one), facts(one)); };
  draw(wanted ?? asked?.key);
  return h("div", { class: "mounting" }, h("div", { class: "row noprint" }, h("label", { class: "inline" }, t("drawing.which"), choose), h("button", { id: "print", onclick: () => print() }, t("drawing.print"))), place);
}

const setupOf = (one) => (state.file.setups ?? []).find((other) => other.axis === one.axis && other.component === one.component);

function facts(one) {
  const axis = state.file.axes.find((other) => other.name === one.axis);
  const offset = setupOf(one)?.offset_mm;
  const instrument = state.file.instruments.find((other) => other.name === one.instrument);
  const rows = [[t("drawing.measures"), `${one.component}: ${t(`component.${motion(one.component)}`, { axis: one.axis, about: one.component[1] })}`],
    [t("drawing.instrument"), `${one.instrument} (${instrument?.driver ?? ""}${instrument?.serial ? `, ${instrument.serial}` : ""})`],
    [t("drawing.travel"), `${axis.travel[0]} … ${axis.travel[1]} ${axis.kind === "rotary" ? "°" : "mm"}`],
    offset && [t("drawing.offset"), `X ${offset[0]}, Y ${offset[1]}, Z ${offset[2]} mm`], [t("drawing.positive"), t(axis.kind === "rotary" ? "drawing.positive_rotary" : "drawing.positive_linear", { axis: axis.letter })]];
  return h("dl", { class: "facts" }, rows.filter(Boolean).map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", {}, text))));
}

function motion(component) {
  const [, about, along] = component;
  if ("0" === along || component[1] === "0" || "ABC".includes(component[0])) return "location";
  if ("ABC".includes(about)) return about === along ? "position" : "tilt";
  return about === along ? "position" : "straight";
}

function picture(one) {
  const axis = state.file.axes.find((other) => other.name === one.axis);
  const kind = motion(one.component);
  const parts = axis.kind === "rotary" ? rotary(axis, kind) : linear(axis, kind);
  return s("svg", { viewBox: "0 0 720 330", class: "drawing", role: "img", "aria-label": t("drawing.label", { component: one.component, axis: one.axis }) },
    s("rect", { class: "bed", x: 30, y: 262, width: 660, height: 34 }), s("text", { class: "caption", x: 46, y: 285 }, t("drawing.bed")), ...parts,
    s("text", { class: "caption title", x: 30, y: 32 }, `${one.component}  ·  ${one.axis}`));
}

const label = (x, y, text, look = "") => s("text", { class: `caption ${look}`, x, y }, text);
const arrow = (x1, x2, y) => [s("line", { class: "positive", x1, x2, y1: y, y2: y }), s("path", { class: "tip", d: `M${x2},${y} l-16,-8 v16 z` })];

function linear(axis, kind) {
  const optics = kind === "straight" ? "straight" : kind === "tilt" ? "angle" : "length";
  return [s("rect", { class: "slide", x: 380, y: 222, width: 170, height: 40 }), label(394, 248, `${axis.letter} · ${t("drawing.slide")}`),
    s("rect", { class: "laser", x: 44, y: 132, width: 96, height: 44 }), label(44, 122, t("drawing.laser")), s("rect", { class: "stand", x: 84, y: 176, width: 14, height: 86 }),
    s("line", { class: "light", x1: 140, x2: 446, y1: 154, y2: 154 }), s("rect", { class: "optic", x: 222, y: 132, width: 42, height: 44 }), s("rect", { class: "stand", x: 236, y: 176, width: 14, height: 86 }), label(180, 122, t(`drawing.fixed_${optics}`)),
    s("path", { class: "optic", d: "M446,128 h30 l14,26 l-14,26 h-30 z" }), s("rect", { class: "stand", x: 456, y: 180, width: 14, height: 42 }), label(420, 118, t(`drawing.moving_${optics}`)),
    ...arrow(400, 540, 76), label(556, 82, `+${axis.letter}`, "title")];
}

function rotary(axis, kind) {
  const own = kind === "position";
  return [s("ellipse", { class: "slide", cx: 440, cy: 236, rx: 150, ry: 34 }), s("rect", { class: "slide", x: 290, y: 236, width: 300, height: 26 }), label(400, 256, `${axis.letter} · ${t("drawing.table")}`),
    s("rect", { class: "laser", x: 44, y: 132, width: 96, height: 44 }), label(44, 122, t("drawing.laser")), s("rect", { class: "stand", x: 84, y: 176, width: 14, height: 86 }),
    own ? s("line", { class: "light", x1: 140, x2: 404, y1: 154, y2: 154 }) : s("line", { class: "stand", x1: 140, x2: 404, y1: 154, y2: 154 }),
    own ? s("rect", { class: "optic", x: 396, y: 130, width: 88, height: 76 }) : s("circle", { class: "optic", cx: 440, cy: 156, r: 34 }), s("rect", { class: "stand", x: 428, y: own ? 206 : 190, width: 24, height: own ? 10 : 24 }),
    label(500, 160, t(own ? "drawing.calibrator" : "drawing.artefact")),
    s("path", { class: "positive turn", d: "M330,86 a120,30 0 0 0 220,0" }), s("path", { class: "tip", d: "M550,86 l-18,4 l12,14 z" }), label(566, 92, `+${axis.letter}`, "title")];
}
