// @ts-check
// A mounting as a drawing: bed, moving axis, instrument, optics, and the direction that counts as positive.
import { h, s, show } from "./dom.js";
import { machinery } from "./machinery.js";
import { state } from "./state.js";
import { t } from "./words.js";

// Every mounting of the plan: axes first, each with what is mounted for it.
export function mountings() {
  const own = state.plan.axes.map((one) => ({
    key: `${one.component}-${one.axis}`,
    component: one.component,
    axis: one.axis,
    instrument: one.instrument,
  }));
  const more = state.plan.setups.filter(
    (one) => !own.some((other) => other.component === one.component && other.axis === one.axis),
  );
  return [
    ...own,
    ...more.map((one) => ({ key: one.setup, component: one.component, axis: one.axis, instrument: one.instrument })),
  ];
}

export function mounting(wanted) {
  const every = mountings();
  const said = state.ask ?? state.said.slice(-1)[0];
  const asked =
    every.find((one) => one.component === said?.fields?.component) ??
    every.find((one) => one.axis === state.status.run?.axis);
  const place = h("div", { class: "sheet" });
  const choose = h(
    "select",
    { id: "which-mounting", onchange: () => draw(choose.value) },
    every.map((one) => h("option", { value: one.key }, `${one.component} · ${one.axis} · ${one.instrument}`)),
  );
  const draw = (key) => {
    const one = every.find((other) => other.key === key) ?? every[0];
    choose.value = one.key;
    show(place, picture(one), facts(one));
  };
  draw(wanted ?? asked?.key);
  return h(
    "div",
    { class: "mounting" },
    h(
      "div",
      { class: "row noprint" },
      h("label", { class: "inline" }, t("drawing.which"), choose),
      h("button", { id: "print", onclick: () => print() }, t("drawing.print")),
    ),
    place,
  );
}

const setupOf = (one) =>
  (state.file.setups ?? []).find((other) => other.axis === one.axis && other.component === one.component);

function facts(one) {
  const axis = state.file.axes.find((other) => other.name === one.axis);
  const offset = setupOf(one)?.offset_mm;
  const instrument = state.file.instruments.find((other) => other.name === one.instrument);
  const rows = [
    [
      t("drawing.measures"),
      `${one.component}: ${t(`component.${motion(one.component)}`, { axis: one.axis, about: one.component[1] })}`,
    ],
    [
      t("drawing.instrument"),
      `${one.instrument} (${instrument?.driver ?? ""}${instrument?.serial ? `, ${instrument.serial}` : ""})`,
    ],
    [
      t("drawing.travel"),
      `${axis.travel[0]} … ${axis.travel[1]} ${axis.kind === "rotary" ? "°" : "mm"}`.replaceAll("-", "−"),
    ],
    offset && [t("drawing.offset"), `X ${offset[0]}, Y ${offset[1]}, Z ${offset[2]} mm`.replaceAll("-", "−")],
    [
      t("drawing.positive"),
      t(axis.kind === "rotary" ? "drawing.positive_rotary" : "drawing.positive_linear", { axis: axis.letter }),
    ],
  ];
  return h(
    "dl",
    { class: "facts" },
    rows.filter(Boolean).map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", {}, text))),
  );
}

function motion(component) {
  const [, about, along] = component;
  if ("0" === along || component[1] === "0" || "ABC".includes(component[0])) return "location";
  if ("ABC".includes(about)) return about === along ? "position" : "tilt";
  return about === along ? "position" : "straight";
}

function picture(one) {
  const axis = state.file.axes.find((other) => other.name === one.axis);
  return s(
    "svg",
    {
      viewBox: "0 0 760 420",
      class: "drawing",
      role: "img",
      "aria-label": t("drawing.label", { component: one.component, axis: one.axis }),
    },
    ...machinery(axis, motion(one.component)),
    s("text", { class: "caption title", x: 24, y: 32 }, `${one.component}  ·  ${one.axis}`),
  );
}
