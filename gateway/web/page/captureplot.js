// @ts-check
// The deviations as they are taken: corrected with the last air and material, both directions, every repetition.
import { chart } from "./chart.js";
import { h, same, show } from "./dom.js";
import { unit } from "./figures.js";
import { axisOf, devOf, part, shownAxis, unitOf } from "./readings.js";
import { state } from "./state.js";
import { t } from "./words.js";

/** @type {[number, string][]} */
const WAYS = [
  [1, "up"],
  [-1, "down"],
];

// Points of each direction and their means; the reading's own uncertainty is a band about the mean of both.
function curvesOf(found) {
  const at = (way) => found.filter((one) => one.approach === way);
  const curves = WAYS.map(([way, look]) => ({
    name: t(`chart.${look}`),
    look,
    kind: "points",
    approach: way,
    fit: true,
    x: at(way).map((one) => one.target),
    y: at(way).map(devOf),
  }));
  const places = [...new Set(found.map((one) => one.target))].sort((a, b) => a - b);
  const known = places.map((place) => found.filter((one) => one.target === place && Number.isFinite(one.expanded)));
  const sure = places.filter((_place, n) => known[n].length);
  const mean = (list, value) => list.reduce((sum, one) => sum + value(one), 0) / list.length;
  const middle = known
    .filter((list) => list.length)
    .map((list) => [mean(list, devOf), mean(list, (one) => one.expanded)]);
  const band = {
    name: t("capture.band"),
    look: "new",
    kind: "band",
    follows: true,
    x: sure,
    y: middle.map(([one, u]) => one - u),
    high: middle.map(([one, u]) => one + u),
  };
  return [...(sure.length > 1 ? [band] : []), ...curves.filter((one) => one.x.length)];
}

export function plotOf(box) {
  const axis = axisOf(shownAxis()) ?? state.plan.axes[0];
  const found = part(axis.axis);
  const what = { curves: curvesOf(found), upright: found[found.length - 1]?.target ?? null };
  if (same(box, axis.axis, unitOf(axis.axis))) return box.querySelector(".chart").redraw(what);
  return show(
    box,
    chart({
      title: t("capture.plot", { axis: axis.axis }),
      file: `live-${axis.axis}`,
      xName: t("chart.target"),
      xUnit: unit(axis.unit),
      yName: t("chart.deviation"),
      yUnit: unit(unitOf(axis.axis)),
      fits: true,
      across: [Math.min(...axis.targets), Math.max(...axis.targets)],
      ...what,
    }),
    h("p", { class: "muted" }, t("capture.provisional_what")),
  );
}
