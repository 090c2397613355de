// The deviations as they are taken: both directions, every repetition, the tolerance band, where the axis is going.
import { axisOf, devOf, part, unitOf } from "./capture.js";
import { band, limits, mark, plot, upright } from "./charts.js";
import { h, same, show } from "./dom.js";
import { unit } from "./figures.js";
import { state } from "./state.js";
import { t } from "./words.js";

export const toleranceOf = (axis) => Number(state.limits[`${axis}.tolerance`] ?? localStorage.getItem(`tolerance ${axis}`) ?? 0);

export function shownAxis() {
  return state.taken[state.taken.length - 1]?.axis ?? state.status.run?.axis ?? state.plan.axes[0].axis;
}

export function plotOf(box) {
  const name = shownAxis();
  const axis = axisOf(name) ?? state.plan.axes[0];
  const found = part(axis.axis);
  const values = found.map(devOf);
  const half = toleranceOf(axis.axis);
  const at = axis.targets;
  const x = limits([...at, ...found.map((one) => one.target)], 0.03);
  const y = limits(found.length ? [...values, 0, ...(half ? [-half, half] : [])] : [-5, 5]);
  const u = unit(unitOf(axis.axis));
  const last = found[found.length - 1];
  const nodes = (on) => [
    half ? band(x, [-half, -half], [half, half], on, "tolerance") : null,
    last && upright(last.target, on, "current"),
    ...found.map((one, number) => mark(one.target, values[number], one.approach, on, `${one.approach > 0 ? "up" : "down"} r${Math.min(one.repetition, 5)}`, one === last ? 7 : 4.5)),
  ];
  const picture = plot({ x, y, label: t("capture.plot", { axis: axis.axis }), xName: `${t("chart.target")} [${unit(axis.unit)}]`, yName: `${t("chart.deviation")} [${u}]`, nodes });
  if (same(box, axis.axis, u)) return box.lastElementChild.replaceWith(picture);
  const tolerance = h("input", { id: "tolerance", type: "number", min: 0, step: 0.5, value: half || "", inputmode: "decimal", onchange: (event) => {
    localStorage.setItem(`tolerance ${axis.axis}`, event.target.value);
    plotOf(box);
  } });
  return show(box, h("div", { class: "row head" }, h("h2", {}, t("capture.plot", { axis: axis.axis })), h("span", { class: "legend" }, h("i", { class: "up" }, "▷"), t("chart.up"), h("i", { class: "down" }, "◁"), t("chart.down")),
    h("label", { class: "inline" }, t("capture.tolerance"), tolerance, u)), picture);
}
