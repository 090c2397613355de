// @ts-check
// Old and new tables as the control interpolates them, their difference, what was found, and what the axis will show.
import { get } from "./api.js";
import { chart } from "./chart.js";
import { failed, h, same, show, turn } from "./dom.js";
import { array, number, unit, when } from "./figures.js";
import { record } from "./evaluate.js";
import { base, chosen, on, state } from "./state.js";
import { predictedTooth } from "./tooth.js";
import { partsOf, wheelOf } from "./wheel.js";
import { recorded, stateOf, t, told } from "./words.js";

export const correct = { open };
const asked = { run: "", change: 0, tooth: false, wheel: false };

export async function proposals() {
  const { runs } = await get(`${base()}/runs?most=50`);
  return runs.filter((one) => !one.problem && one.stages.includes("proposal"));
}

const NAMES = { axis: (change) => change.axis, reversal: (change) => `${change.axis}-reversal` };
export const nameOf = (change) =>
  (NAMES[change.new.kind] ?? ((one) => `${one.axis}(${one.new.input_axis}) ${one.new.index}`))(change);

// A run that only separated an inspected part has a wheel to show and no tables.
async function shownRuns() {
  const { runs } = await get(`${base()}/runs?most=50`);
  return runs.filter((one) => !one.problem && (one.stages.includes("proposal") || partsOf(one).length));
}

// Where a table has its points; between them the control goes straight, beyond them it keeps the last value.
export function grid(table) {
  if (table.places?.length) return table.places;
  return table.deviations.map((_one, at) => table.minimum + at * table.step);
}

export function valueAt(table, position) {
  const places = grid(table);
  if (places.length < 2) return table.deviations[0] ?? 0;
  if (position <= places[0]) return table.deviations[0];
  const behind = places.findIndex((one) => one >= position);
  if (behind < 0) return table.deviations[places.length - 1];
  const part = (position - places[behind - 1]) / (places[behind] - places[behind - 1]);
  return table.deviations[behind - 1] + part * (table.deviations[behind] - table.deviations[behind - 1]);
}

function open(root) {
  const [head, body] = [h("div", { class: "panel choose" }), h("div", { class: "two" })];
  show(root, head, body);
  const draw = () => drawAll(head, body).catch((error) => failed(body, told(error)));
  draw();
  return on("status", draw);
}

async function drawAll(head, body) {
  const runs = await shownRuns();
  if (!runs.length) return same(body) || show(body, h("p", { class: "empty" }, t("correct.none")));
  const run = chosen(asked, runs);
  asked.run = run.run_id;
  const proposal = run.stages.includes("proposal") ? await record(run.run_id, "proposal") : { changes: [] };
  asked.change = Math.max(0, Math.min(asked.change, proposal.changes.length - 1));
  if (
    same(
      body,
      runs.map((one) => [one.run_id, one.state, one.stages.length]),
      asked,
    )
  )
    return null;
  const put = turn(body);
  const again = () => drawAll(head, body);
  const wheel = partsOf(run).length > 0 && (asked.wheel || !proposal.changes.length);
  const tooth = !wheel && asked.tooth && run.stages.includes("tooth");
  show(
    head,
    h(
      "label",
      { class: "inline" },
      t("evaluate.run"),
      h(
        "select",
        {
          id: "pick-run",
          onchange: (event) => {
            asked.run = event.target.value;
            again();
          },
        },
        runs.map((one) =>
          h("option", { value: one.run_id, selected: one === run }, `${when(one.created_utc)} · ${stateOf(one)}`),
        ),
      ),
    ),
    h(
      "div",
      { class: "tabs", role: "group", "aria-label": t("correct.tables") },
      proposal.changes.map((one, at) =>
        h(
          "button",
          {
            "aria-pressed": String(!tooth && !wheel && at === asked.change),
            onclick: () => {
              Object.assign(asked, { change: at, tooth: false, wheel: false });
              again();
            },
          },
          nameOf(one),
        ),
      ),
      run.stages.includes("tooth") &&
        h(
          "button",
          {
            id: "tooth",
            "aria-pressed": String(tooth),
            onclick: () => {
              Object.assign(asked, { tooth: true, wheel: false });
              again();
            },
          },
          t("tooth.tooth"),
        ),
      partsOf(run).length > 0 &&
        h(
          "button",
          {
            id: "wheel",
            "aria-pressed": String(wheel),
            onclick: () => {
              asked.wheel = true;
              again();
            },
          },
          t("wheel.wheel"),
        ),
    ),
  );
  if (tooth) return put(...(await predictedTooth(run)));
  if (wheel) {
    const again_ = () => {
      delete body.dataset.key;
      drawAll(head, body).catch((error) => failed(body, told(error)));
    };
    return put(...(await wheelOf(run, again_)));
  }
  const change = proposal.changes[asked.change];
  const axis = state.plan.axes.find((one) => one.axis === change.new.input_axis) ?? state.plan.axes[0];
  if (!change.new.deviations.length || change.skipped)
    return put(h("div", { class: "panel" }, h("p", { class: "empty" }, recorded(change.skipped) || t("correct.none"))));
  put(
    h("div", { class: "panel plots" }, tables(change, axis), predicted(change, axis)),
    h(
      "div",
      { class: "panel", tabindex: 0, role: "region", "aria-label": t("correct.facts") },
      facts(change, axis, proposal),
    ),
  );
}

function tables(change, axis) {
  // Each point of either table: between them both go straight.
  const [first, last] = [change.new.minimum, change.new.maximum];
  const xs = [
    ...new Set([
      ...grid(change.new),
      ...(change.old_enabled ? grid(change.old).filter((one) => one >= first && one <= last) : []),
    ]),
  ].sort((a, b) => a - b);
  const fresh = xs.map((one) => valueAt(change.new, one));
  const old = xs.map((one) => (change.old_enabled ? valueAt(change.old, one) : 0));
  const difference = fresh.map((one, at) => one - old[at]);
  return chart({
    title: t("correct.table", { name: nameOf(change) }),
    xName: change.new.input_axis,
    xUnit: unit(axis.unit),
    yName: t("chart.deviation"),
    yUnit: deviationUnit(change),
    curves: [
      { name: t("correct.old"), look: "old", dashed: true, x: xs, y: old },
      { name: t("correct.new"), look: "new", x: xs, y: fresh },
      { name: t("correct.difference"), look: "difference", dashed: true, x: xs, y: difference },
    ],
  });
}

// By how much the axis moves at most once the new table acts in place of what acts now.
export function largest({ new: table, old, old_enabled: on_ }) {
  const moved = table.deviations.map((one, at) => Math.abs(one - (on_ ? valueAt(old, grid(table)[at]) : 0)));
  return `${number(Math.max(...moved))} ${deviationUnit({ new: table })}`;
}

const deviationUnit = (change) => unit(change.new.output_unit === "deg" ? "arcsec" : "um");

function predicted(change, axis) {
  const [xs, means, half] = [array(change.targets), array(change.predicted), array(change.predicted_U)];
  if (!xs.length) return null;
  const [low, high] = [means.map((one, at) => one - half[at]), means.map((one, at) => one + half[at])];
  return chart({
    title: t("correct.predicted", { axis: change.axis }),
    xName: change.new.input_axis,
    xUnit: unit(axis.unit),
    yName: t("chart.deviation"),
    yUnit: deviationUnit(change),
    fits: true,
    curves: [
      { name: "± U", look: "new", kind: "band", follows: true, x: xs, y: low, high },
      { name: t("chart.predicted"), look: "new", fit: true, x: xs, y: means },
    ],
  });
}

function facts(change, axis, proposal) {
  const table = change.new;
  const slopes = table.deviations.slice(1).map((one, at) => Math.abs(one - table.deviations[at]) / table.step);
  const u = deviationUnit(change);
  const rows = [
    [t("correct.points"), `${table.deviations.length}`],
    [
      t("correct.range"),
      [
        `${number(table.minimum, 3)} … ${number(table.maximum, 3)} ${unit(axis.unit)}`,
        `${t("correct.step")} ${number(table.step, 3)}`,
      ].join(", "),
    ],
    [t("correct.size"), `${number(Math.min(...table.deviations))} … ${number(Math.max(...table.deviations))} ${u}`],
    [t("correct.slope"), `${number(Math.max(...slopes, 0), 3)} ${u}/${unit(axis.unit)}`],
    [t("correct.most"), largest(change)],
    [t("correct.before"), t(change.old_enabled ? "correct.was_on" : "correct.was_off")],
    [t("correct.made"), when(proposal.created_utc)],
  ];
  const findings = [...change.findings, ...proposal.warnings];
  return [
    h("h2", {}, t("correct.facts")),
    h(
      "dl",
      { class: "facts" },
      rows.map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", {}, text))),
    ),
    h("h2", {}, t("correct.findings")),
    findings.length
      ? h(
          "ul",
          { class: "findings" },
          findings.map((one) => h("li", {}, `▲ ${recorded(one.message ?? one)}`)),
        )
      : h("p", {}, `✔ ${t("correct.clean")}`),
    h("p", { class: "muted" }, t("correct.setup_apart")),
  ];
}
