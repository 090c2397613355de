// @ts-check
// What is laid over the curves of a run: other runs of the same axis, and what other standards count.
import { h } from "./dom.js";
import { array, when } from "./figures.js";
import { stateOf, t } from "./words.js";

/** So many at a time have a colour each. */
export const MOST = 5;

/**
 * A menu of boxes to tick.
 * @param {{id: string, groups: {name: string, none: string, options: [string, string][]}[], chosen: string[],
 *   change: (chosen: string[]) => void}} what `options` are key and text; `chosen` keys in the order of their colours
 */
export function overlayMenu({ id, groups, chosen, change }) {
  const full = chosen.length >= MOST;
  const tick = (key, text) => {
    const box = h("input", { type: "checkbox", "data-over": key, disabled: full && !chosen.includes(key) });
    box.checked = chosen.includes(key);
    box.addEventListener("change", () => change(box.checked ? [...chosen, key] : chosen.filter((one) => one !== key)));
    const place = chosen.indexOf(key);
    const mark = h("i", { class: place < 0 ? null : `more${place + 1}`, "aria-hidden": "true" }, place < 0 ? "" : "━");
    return h("label", { class: "inline tickbox" }, box, mark, text);
  };
  const group = ({ name, none, options }) =>
    h(
      "fieldset",
      {},
      h("legend", {}, name),
      options.length ? options.map(([key, text]) => tick(key, text)) : h("p", { class: "muted" }, none),
    );
  return h(
    "details",
    { class: "menu over" },
    h("summary", { id, class: "key" }, `${t("overlay.open")}${chosen.length ? ` (${chosen.length})` : ""} ▾`),
    h(
      "div",
      { class: "panel" },
      h("p", { class: "muted" }, t("overlay.most", { count: MOST })),
      groups.map(group),
      chosen.length > 0 && h("button", { id: `${id}-clear`, onclick: () => change([]) }, t("overlay.clear")),
    ),
  );
}

/** Runs that stored this axis, as options: key is run and phase. */
export function runOptions(runs, axis, [own, ownPhase]) {
  const phases = (run) => ["before", "after"].filter((phase) => run.stages.includes(`evaluation-${axis}-${phase}`));
  return runs.flatMap((run) =>
    phases(run)
      .filter((phase) => run.run_id !== own || phase !== ownPhase)
      .map((phase) => [
        `${run.run_id} ${phase}`,
        `${when(run.created_utc)} · ${t(`phase.${phase}`)} · ${stateOf(run)}`,
      ]),
  );
}

/** Means of both directions under one name: one press hides both. */
export function runCurves(name, place, evaluation) {
  const x = array(evaluation.targets);
  const usual = { name, look: `more${place + 1}`, follows: true, x };
  return [
    { ...usual, y: array(evaluation.mean_up) },
    { ...usual, dashed: true, y: array(evaluation.mean_down) },
  ];
}

/** A standard's band by its two edges: several filled ones would hide each other. */
export function bandCurves(place, targets, { standard, low, high }) {
  const value = (one) => one ?? NaN;
  const usual = { name: standard, look: `more${place + 1}`, dashed: true, follows: true, x: targets };
  return [
    { ...usual, y: low.map(value) },
    { ...usual, y: high.map(value) },
  ];
}
