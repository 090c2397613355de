// @ts-check
// Before and after of each axis with what was proved, the report, exports, runs compared.
import { post } from "./api.js";
import { shown } from "./dialogs.js";
import { curve, measuredRuns, record } from "./evaluate.js";
import { failed, h, same, show, turn } from "./dom.js";
import { array, number, unit, when } from "./figures.js";
import { chart } from "./chart.js";
import { overlayMenu, runCurves, runOptions } from "./overlay.js";
import { base, changed, chosen, may, on, state } from "./state.js";
import { verifiedTooth } from "./tooth.js";
import { trends } from "./trends.js";
import { prose, stateOf, t, told } from "./words.js";

export const report = { open };
const asked = { run: "", axis: "", tooth: false, over: [] };

function open(root) {
  const [head, body] = [h("div", { class: "panel choose" }), h("div", { class: "two" })];
  show(root, head, body);
  const draw = () => drawAll(head, body).catch((error) => failed(body, told(error)));
  draw();
  return on("jobs", draw);
}

async function drawAll(head, body) {
  const runs = await measuredRuns();
  if (!runs.length) return same(body) || show(body, h("p", { class: "empty" }, t("evaluate.none")));
  const run = chosen(asked, runs, runs.find((one) => one.stages.includes("verdict")) ?? runs[0]);
  asked.run = run.run_id;
  const axes = [
    ...new Set(
      run.stages.filter((one) => one.startsWith("evaluation-")).map((one) => one.slice(11).replace(/-[^-]+$/, "")),
    ),
  ];
  if (!axes.includes(asked.axis)) [asked.axis] = axes;
  const inspected = run.stages.includes("inspected-before");
  const tooth = asked.tooth && inspected;
  const busy = state.status.run?.run_id === run.run_id;
  if (
    same(
      body,
      runs.map((one) => [one.run_id, one.state, one.stages.length, one.report]),
      asked,
      busy,
    )
  )
    return null;
  const put = turn(body);
  const again = () => drawAll(head, body);
  const link = (name, text) => linkTo(run.run_id, name, text);
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
      { class: "tabs", role: "group", "aria-label": t("evaluate.axis") },
      axes.map((one) =>
        h(
          "button",
          {
            "aria-pressed": String(!tooth && one === asked.axis),
            onclick: () => {
              Object.assign(asked, { axis: one, tooth: false });
              again();
            },
          },
          one,
        ),
      ),
      inspected &&
        h(
          "button",
          {
            id: "tooth",
            "aria-pressed": String(tooth),
            onclick: () => {
              asked.tooth = true;
              again();
            },
          },
          t("tooth.tooth"),
        ),
    ),
    !tooth && overlayOf(runs, run, again),
    h("span", { class: "gap" }),
    h("button", { id: "trends", onclick: trends }, t("trends.open")),
    h(
      "button",
      { id: "make-report", disabled: busy || !may("operator"), onclick: () => made(run.run_id) },
      t("report.make"),
    ),
    run.report && [
      link("report", t("report.open")),
      link("files/report.json", "JSON"),
      link("files/results.csv", "CSV"),
    ],
  );
  if (tooth) return put(...(await verifiedTooth(run)));
  const [before, after] = [await kept(run, "before"), await kept(run, "after")];
  const verdict = run.stages.includes("verdict") ? await record(run.run_id, "verdict") : null;
  const own = verdict?.axes.find((one) => one.axis === asked.axis);
  put(
    h("div", { class: "panel plots" }, verdict && band(verdict, own), compared(before, after, await overCurves(runs))),
    h(
      "div",
      { class: "panel", tabindex: 0, role: "region", "aria-label": t("frame.report") },
      figures(before, after),
      own && [
        h("h2", {}, t("report.reasons")),
        h(
          "ul",
          { class: "lines verdict-words" },
          [own.words].flat().map((one) => h("li", {}, prose([one].flat()))),
        ),
      ],
    ),
  );
}

async function kept(run, phase) {
  const stage = `evaluation-${asked.axis}-${phase}`;
  return run.stages.includes(stage)
    ? {
        evaluation: await record(run.run_id, stage),
        capture: await record(run.run_id, stage.replace("evaluation", "capture")),
      }
    : null;
}

const linkTo = (run, name, text) =>
  h(
    "a",
    { class: "key", href: `${base()}/runs/${encodeURIComponent(run)}/${name}`, target: "_blank", rel: "noopener" },
    text,
  );

async function made(run) {
  try {
    await post(`${base()}/runs/${encodeURIComponent(run)}/report`);
    changed("jobs");
    // A browser that took its time for a report opens no window by itself: a person presses once more.
    shown(t("report.make"), [linkTo(run, "report", t("report.open"))]);
  } catch (error) {
    shown(t("report.make"), [h("p", { class: "fault" }, told(error))]);
  }
}

const LOOK = { better: "✔", unchanged: "=", worse: "✖", "not-pushed": "○" };

// One verdict stands for the axis that is shown, by the record's own rule; what else is said of it are its reasons.
const wordOf = (own) => (own.worse ? "worse" : own.improved ? "better" : "unchanged");

function band(verdict, own) {
  const word = own ? wordOf(own) : verdict.outcome;
  return h(
    "p",
    { class: `outcome ${word}`, id: "outcome" },
    `${LOOK[word]} ${own ? `${own.axis}: ` : ""}${t(`outcome.${word.replace("-", "_")}`)}`,
  );
}

function compared(before, after, over) {
  if (!after)
    return before ? curve(before.evaluation, before.capture, over) : h("p", { class: "empty" }, t("evaluate.none"));
  return overlay(
    [
      ["old", t("phase.before"), before.evaluation],
      ["new", t("phase.after"), after.evaluation],
    ],
    before.capture,
    over,
  );
}

// Other runs of the same axis over before and after of this one.
function overlayOf(runs, run, again) {
  const own = runOptions(runs, asked.axis, [run.run_id, ""]).filter(([key]) => !key.startsWith(run.run_id));
  asked.over = asked.over.filter((one) => own.some(([key]) => key === one));
  return overlayMenu({
    id: "overlay",
    groups: [{ name: t("overlay.runs"), none: t("overlay.none"), options: own }],
    chosen: asked.over,
    change: (over) => {
      asked.over = over;
      again().then(() => document.querySelector("details.over")?.setAttribute("open", ""));
    },
  });
}

async function overCurves(runs) {
  const curves = asked.over.map(async (key, place) => {
    const [run, phase] = key.split(" ");
    const { created_utc: utc } = runs.find((one) => one.run_id === run);
    const evaluation = await record(run, `evaluation-${asked.axis}-${phase}`);
    return runCurves(`${when(utc)} · ${t(`phase.${phase}`)}`, place, evaluation);
  });
  return (await Promise.all(curves)).flat();
}

function overlay(sets, capture, over) {
  const curves = sets.flatMap(([look, name, one]) =>
    [
      [array(one.mean_up), "up"],
      [array(one.mean_down), "down"],
    ].map(([y, way]) => ({
      name: `${name} ${way === "up" ? "▷" : "◁"}`,
      look,
      dashed: way === "down",
      fit: look === "new",
      follows: true,
      x: array(one.targets),
      y,
    })),
  );
  return chart({
    title: `${capture.component} · ${capture.axis}`,
    xName: t("chart.target"),
    xUnit: unit(capture.axis_unit),
    yName: t("chart.deviation"),
    yUnit: unit(sets[0][2].unit),
    fits: true,
    curves: [...over, ...curves],
  });
}

function figures(before, after) {
  if (!before) return null;
  const u = unit(before.evaluation.unit);
  const names = ["E", "R", "B", "A", "M"];
  const cell = (set, name, phase) =>
    h("td", { class: "num", "data-figure": `${name} ${phase}` }, set ? number(set.evaluation[name]) : "–");
  return [
    h("h2", {}, `${before.evaluation.standard} [${u}]`),
    h(
      "table",
      {},
      h(
        "thead",
        {},
        h(
          "tr",
          {},
          ["", t("phase.before"), "U", t("phase.after"), "U"].map((one) => h("th", { class: "num" }, one)),
        ),
      ),
      h(
        "tbody",
        {},
        names.map((name) =>
          h(
            "tr",
            {},
            h("th", { scope: "row" }, name),
            cell(before, name, "before"),
            h("td", { class: "num muted" }, number(before.evaluation.U[name])),
            cell(after, name, "after"),
            h("td", { class: "num muted" }, after ? number(after.evaluation.U[name]) : "–"),
          ),
        ),
      ),
    ),
  ];
}
