// @ts-check
// A mounting as a drawing: bed, moving axis, instrument, optics, and the direction that counts as positive.
import { h, s, same, show } from "./dom.js";
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

// The mounting that is asked for, or at work, or the first one.
function mountingNow() {
  const every = mountings();
  const said = state.ask ?? state.said.slice(-1)[0];
  return (
    every.find((one) => one.component === said?.fields?.component) ??
    every.find((one) => one.axis === state.status.run?.axis) ??
    every[0]
  );
}

export function mounting(wanted) {
  const every = mountings();
  const place = h("div", { class: "sheet" });
  const choose = h(
    "select",
    { id: "which-mounting", onchange: () => draw(choose.value) },
    every.map((one) => h("option", { value: one.key }, `${one.component} · ${one.axis} · ${one.instrument}`)),
  );
  const draw = (key) => {
    const one = every.find((other) => other.key === key) ?? every[0];
    choose.value = one.key;
    const { node, move } = picture(one);
    move(state.positions);
    show(place, node, facts(one));
  };
  draw(wanted ?? mountingNow().key);
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
  const { parts, place } = machinery(axis, motion(one.component));
  const node = s(
    "svg",
    {
      viewBox: "0 0 760 420",
      class: "drawing",
      role: "img",
      "aria-label": t("drawing.label", { component: one.component, axis: one.axis }),
    },
    ...parts,
    s("text", { class: "caption title", x: 24, y: 32 }, `${one.component}  ·  ${one.axis}`),
  );
  return { node, move: place };
}

/** A move is shown in so many steps of so many ms; a person who wants no motion sees its end at once. */
const STEPS = 8;
const STEP_MS = 40;

/** Positions on the way from one place to another; an axis that had none is there at once. */
export function between(from, to, part) {
  const way = ([name, end]) => [name, name in from ? from[name] + part * (end - from[name]) : end];
  return Object.fromEntries(Object.entries(to).map(way));
}

/**
 * The machine as it stands, in a panel: drawn anew for another mounting, moved with the axes.
 * @param {HTMLElement} box
 */
export function machineNow(box) {
  let [move, from, timer] = [(_positions) => {}, {}, 0];
  const follow = () => {
    clearInterval(timer);
    const [start, goal] = [from, { ...state.positions }];
    let step = matchMedia("(prefers-reduced-motion: reduce)").matches || document.hidden ? STEPS - 1 : 0;
    const next = () => {
      step += 1;
      from = between(start, goal, step / STEPS);
      move(from);
      if (step >= STEPS) clearInterval(timer);
    };
    timer = window.setInterval(next, STEP_MS);
    next();
  };
  const draw = () => {
    const one = mountingNow();
    if (same(box, one.key)) return;
    const drawn = picture(one);
    show(box, drawn.node);
    move = drawn.move;
    from = { ...state.positions };
    move(from);
  };
  return { draw, follow, end: () => clearInterval(timer) };
}
