// @ts-check
// A run's figures: curves with mean and band, figures with U against limits, and what stands behind a number.
import { get } from "./api.js";
import { chart } from "./chart.js";
import { shown } from "./dialogs.js";
import { showEnvironmentOf } from "./environment.js";
import { failed, h, same, show, turn } from "./dom.js";
import { array, number, signed, unit, when } from "./figures.js";
import { bandCurves, overlayMenu, runCurves, runOptions } from "./overlay.js";
import { base, chosen, on, state } from "./state.js";
import { recorded, stateOf, t, told } from "./words.js";

export const evaluate = { open };
// `over` are keys of what is laid over: run and phase, or a standard's name behind a colon.
const asked = { run: "", axis: "", phase: "", standard: "", over: [] };
const at = (path) => get(`${base()}/runs/${encodeURIComponent(asked.run)}/${path}`);
const kept = new Map();

// Records never change, so each is asked for once.
export async function record(run, stage) {
  const key = `${state.site} ${run} ${stage}`;
  if (!kept.has(key)) kept.set(key, (await get(`${base()}/runs/${encodeURIComponent(run)}/stages/${stage}`)).record);
  return kept.get(key);
}

export async function measuredRuns() {
  const { runs } = await get(`${base()}/runs?most=50`);
  return runs.filter((one) => !one.problem && one.stages.some((stage) => stage.startsWith("evaluation-")));
}

function open(root) {
  const head = h("div", { class: "panel choose" });
  const body = h("div", { class: "two" });
  show(root, head, body);
  const draw = () => drawAll(head, body).catch((error) => failed(body, told(error)));
  draw();
  return on("status", draw);
}

async function drawAll(head, body) {
  const runs = await measuredRuns();
  if (!runs.length) return same(body) || show(body, h("p", { class: "empty" }, t("evaluate.none")));
  const run = chosen(asked, runs);
  const sets = run.stages
    .filter((stage) => stage.startsWith("evaluation-"))
    .map((stage) => stage.slice(11).match(/^(.*)-([^-]+)$/))
    .filter(Boolean);
  asked.run = run.run_id;
  const set = sets.find(([, axis, phase]) => axis === asked.axis && phase === asked.phase) ?? sets[0];
  [, asked.axis, asked.phase] = set;
  if (
    same(
      body,
      runs.map((one) => [one.run_id, one.state, one.stages.length]),
      asked,
      kept_.count,
    )
  )
    return null;
  const put = turn(body);
  const standards = await get("/api/v1/standards");
  const again = () => drawAll(head, body);
  const pick = (name, options, value) =>
    h(
      "label",
      { class: "inline" },
      t(`evaluate.${name}`),
      h(
        "select",
        {
          id: `pick-${name}`,
          onchange: (event) => {
            choose(name, event.target.value);
            again();
          },
        },
        options.map(([key, text]) => h("option", { value: key, selected: key === value }, text)),
      ),
    );
  show(
    head,
    pick(
      "run",
      runs.map((one) => [one.run_id, `${when(one.created_utc)} · ${stateOf(one)}`]),
      asked.run,
    ),
    pick(
      "axis",
      sets.map(([, axis, phase]) => [`${axis} ${phase}`, `${axis} · ${t(`phase.${phase}`)}`]),
      `${asked.axis} ${asked.phase}`,
    ),
    pick("standard", [["", t("evaluate.stored")], ...standards.map((one) => [one.name, one.name])], asked.standard),
    toleranceOf(again),
    overlayOf(runs, standards, again),
    h("button", { id: "environment", onclick: () => showEnvironmentOf(asked.run) }, t("environment.open")),
  );
  const evaluation = await record(asked.run, `evaluation-${asked.axis}-${asked.phase}`);
  const capture = await record(asked.run, `capture-${asked.axis}-${asked.phase}`);
  const figures = await figuresNow();
  put(
    h("div", { class: "panel plots" }, curve(evaluation, capture, await overCurves(runs))),
    h(
      "div",
      { class: "panel figures" },
      table(figures, { evaluation, capture, standard: standards.find((one) => one.name === figures.standard) }),
    ),
  );
}

function overlayOf(runs, standards, again) {
  const own = runOptions(runs, asked.axis, [asked.run, asked.phase]);
  asked.over = asked.over.filter((one) => one.startsWith(":") || own.some(([key]) => key === one));
  return overlayMenu({
    id: "overlay",
    groups: [
      { name: t("overlay.runs"), none: t("overlay.none"), options: own },
      { name: t("overlay.standards"), none: "", options: standards.map((one) => [`:${one.name}`, one.name]) },
    ],
    chosen: asked.over,
    change: (over) => {
      asked.over = over;
      again().then(() => {
        document.querySelector("details.over")?.setAttribute("open", "");
      });
    },
  });
}

// Each in its own colour, in the order of choice.
async function overCurves(runs) {
  const standards = asked.over.filter((one) => one.startsWith(":")).map((one) => one.slice(1));
  const query = new URLSearchParams({ phase: asked.phase, standards: standards.join(",") });
  const bands = standards.length ? await at(`bands/${encodeURIComponent(asked.axis)}?${query}`) : null;
  const curves = asked.over.map(async (key, place) => {
    if (key.startsWith(":")) return bandCurves(place, bands.targets, bands.bands[standards.indexOf(key.slice(1))]);
    const [run, phase] = key.split(" ");
    const { created_utc: utc } = runs.find((one) => one.run_id === run);
    return runCurves(
      `${when(utc)} · ${t(`phase.${phase}`)}`,
      place,
      await record(run, `evaluation-${asked.axis}-${phase}`),
    );
  });
  return (await Promise.all(curves)).flat();
}

// A band of a person's own, drawn and never judged by.
function toleranceOf(again) {
  const changed = (event) => {
    localStorage.setItem(`tolerance ${asked.axis}`, event.target.value);
    kept_.count += 1;
    again();
  };
  return h(
    "label",
    { class: "inline" },
    t("capture.tolerance"),
    h("input", {
      id: "tolerance",
      type: "number",
      min: 0,
      step: 0.5,
      inputmode: "decimal",
      value: localStorage.getItem(`tolerance ${asked.axis}`) ?? "",
      onchange: changed,
    }),
  );
}
const kept_ = { count: 0 };

function choose(name, value) {
  if (name === "axis") [asked.axis, asked.phase] = value.split(" ");
  else asked[name] = value;
}

const limitKey = () => `limits ${asked.axis} ${asked.standard}`;
const limitsKept = () => JSON.parse(localStorage.getItem(limitKey()) ?? "{}");
const limitText = () =>
  Object.entries(limitsKept())
    .map(([name, value]) => `${name}:${value}`)
    .join(",");

const figuresNow = () => {
  const { axis, phase, standard } = asked;
  return at(`figures/${encodeURIComponent(axis)}?${new URLSearchParams({ phase, standard, limits: limitText() })}`);
};

// Mean of each direction with its band of 2 s, every reading, and the limits that a person set.
export function curvesOf(evaluation, capture) {
  const [x, up, down] = [array(evaluation.targets), array(evaluation.mean_up), array(evaluation.mean_down)];
  const [su, sd] = [array(evaluation.s_up), array(evaluation.s_down)];
  const add = (means, spreads, times) => means.map((one, i) => one + times * spreads[i]);
  const band = (look, means, spreads) => ({
    name: `${t(`chart.${look}`)} ± 2 s`,
    look,
    kind: "band",
    follows: true,
    x,
    y: add(means, spreads, -2),
    high: add(means, spreads, 2),
  });
  const readings = capture ? array(capture.deviations) : [];
  const xs = capture ? array(capture.targets) : [];
  const points = (look, way) => ({
    name: `${t(`chart.${look}`)}: ${t("chart.readings")}`,
    look,
    kind: "points",
    approach: way === 0 ? 1 : -1,
    follows: true,
    x: readings.flatMap((one, i) => one.map(() => xs[i])),
    y: readings.flatMap((one) => one.map((pair) => pair[way])),
  });
  const both = {
    name: t("chart.both"),
    look: "new",
    dashed: true,
    fit: true,
    x,
    y: up.map((one, i) => (one + down[i]) / 2),
  };
  return [
    band("up", up, su),
    band("down", down, sd),
    ...(readings.length ? [points("up", 0), points("down", 1)] : []),
    { name: t("chart.up"), look: "up", follows: true, x, y: up },
    { name: t("chart.down"), look: "down", follows: true, dashed: true, x, y: down },
    both,
  ];
}

export function curve(evaluation, capture, over = []) {
  const half = Number(localStorage.getItem(`tolerance ${capture?.axis}`) ?? 0);
  const x = array(evaluation.targets);
  const ends = [Math.min(...x), Math.max(...x)];
  const tolerance =
    half > 0
      ? [{ name: t("chart.tolerance"), look: "good", kind: "band", x: ends, y: [-half, -half], high: [half, half] }]
      : [];
  return chart({
    title: `${capture?.component ?? ""} · ${capture?.axis ?? ""}`,
    xName: t("chart.target"),
    xUnit: unit(capture?.axis_unit ?? ""),
    yName: t("chart.deviation"),
    yUnit: unit(evaluation.unit),
    fits: true,
    curves: [...tolerance, ...over, ...curvesOf(evaluation, capture)],
  });
}

const VERDICT = { pass: ["✔", "pass"], fail: ["✖", "fail"], "not decidable": ["?", "open"] };

function table(figures, { evaluation, capture, standard }) {
  const u = unit(figures.unit);
  const limit = (row) =>
    h("input", {
      type: "number",
      min: 0,
      step: 0.1,
      inputmode: "decimal",
      id: `limit-${row.parameter}`,
      "aria-label": t("evaluate.limit_of", { name: row.parameter }),
      value: row.limit ?? "",
      onchange: (event) => {
        const found = limitsKept();
        if (Number(event.target.value) > 0) found[row.parameter] = Number(event.target.value);
        else delete found[row.parameter];
        localStorage.setItem(limitKey(), JSON.stringify(found));
        figuresNow().then(
          (judged) => {
            for (const one of judged.rows) show(verdicts.get(one.parameter), verdict(one));
          },
          (error) => shown(t("evaluate.limit"), [h("p", { class: "fault" }, told(error))]),
        );
      },
    });
  const verdicts = new Map(figures.rows.map((row) => [row.parameter, h("td", {})]));
  const verdict = (row) => {
    if (!row.verdict) return h("span", { class: "muted" }, "–");
    const [symbol, look] = VERDICT[row.verdict];
    return h("span", { class: `verdict ${look}` }, `${symbol} ${t(`verdict.${look}`)}`);
  };
  return [
    h("h2", {}, figures.standard),
    h(
      "table",
      {},
      h(
        "thead",
        {},
        h(
          "tr",
          {},
          h("th", {}, t("evaluate.figure")),
          h("th", { class: "num" }, `[${u}]`),
          h("th", { class: "num" }, "U (k=2)"),
          h("th", {}, t("evaluate.limit")),
          h("th", {}, t("evaluate.verdict")),
        ),
      ),
      h(
        "tbody",
        {},
        [...figures.rows]
          .sort((a, b) => rank(a) - rank(b))
          .map((row) =>
            h(
              "tr",
              {},
              h("th", { scope: "row" }, symbol(row.parameter)),
              h(
                "td",
                { class: "num" },
                h(
                  "button",
                  {
                    class: "number",
                    "data-figure": row.parameter,
                    "aria-label": t("evaluate.behind", { name: row.parameter }),
                    onclick: () => behind(row, { evaluation, capture, u, figures, standard }),
                  },
                  number(row.value),
                ),
              ),
              h("td", { class: "num" }, number(row.U)),
              h("td", {}, limit(row)),
              show(verdicts.get(row.parameter), verdict(row)),
            ),
          ),
      ),
    ),
    figures.flags.length > 0 &&
      h(
        "details",
        {},
        h("summary", {}, t("evaluate.notes", { count: figures.flags.length })),
        h(
          "ul",
          {},
          figures.flags.map((one) => h("li", {}, recorded(one))),
        ),
      ),
    h("p", { class: "muted" }, recorded(figures.rule)),
  ];
}

// As the standard writes them, the five of both directions first.
const FIRST = ["E", "R", "B", "A", "M", "E_up", "E_down", "R_up", "R_down", "B_mean", "A_up", "A_down"];
const rank = (row) => (FIRST.includes(row.parameter) ? FIRST.indexOf(row.parameter) : FIRST.length);
const symbol = (name) => name.replace("_up", "↑").replace("_down", "↓").replace("B_mean", "B̄");

const FORMULA = {
  E: "E = max(x̄ᵢ↑, x̄ᵢ↓) − min(x̄ᵢ↑, x̄ᵢ↓)",
  E_up: "E↑ = max(x̄ᵢ↑) − min(x̄ᵢ↑)",
  E_down: "E↓ = max(x̄ᵢ↓) − min(x̄ᵢ↓)",
  M: "M = max(x̄ᵢ) − min(x̄ᵢ),  x̄ᵢ = (x̄ᵢ↑ + x̄ᵢ↓) / 2",
  B: "B = max |Bᵢ|,  Bᵢ = x̄ᵢ↑ − x̄ᵢ↓",
  B_mean: "B̄ = Σ Bᵢ / m",
  R: "R = max(2 sᵢ↑ + 2 sᵢ↓ + |Bᵢ|, 4 sᵢ↑, 4 sᵢ↓)",
  R_up: "R↑ = max(4 sᵢ↑)",
  R_down: "R↓ = max(4 sᵢ↓)",
  A: "A = max(x̄ᵢ + 2 sᵢ) − min(x̄ᵢ − 2 sᵢ),  ↑ ↓",
  A_up: "A↑ = max(x̄ᵢ↑ + 2 sᵢ↑) − min(x̄ᵢ↑ − 2 sᵢ↑)",
  A_down: "A↓ = max(x̄ᵢ↓ + 2 sᵢ↓) − min(x̄ᵢ↓ − 2 sᵢ↓)",
};

// The places of the table that decide a figure: "row column", columns as they stand there.
function used(name, { up, down, su, sd, b }) {
  const all = up.map((_one, i) => i);
  const ways = name.endsWith("_up") ? [0] : name.endsWith("_down") ? [1] : [0, 1];
  const [means, spreads] = [
    [up, down],
    [su, sd],
  ];
  const marks = new Set();
  const mark_ = (i, ...columns) => {
    for (const column of columns) marks.add(`${i} ${column}`);
  };
  const extreme = (value, list = all.flatMap((i) => ways.map((way) => [i, way]))) =>
    list
      .filter((one) => Number.isFinite(value(one)))
      .reduce((best, one) => (best === null || value(one) > value(best) ? one : best), null) ?? [];
  const ends = (times) => [1, -1].map((sign) => extreme(([i, way]) => sign * means[way][i] + times * spreads[way][i]));
  const row = (value) =>
    extreme(
      ([i]) => value(i),
      all.map((i) => [i]),
    )[0];
  const kind = name.split("_")[0];
  if (kind === "E") for (const [i, way] of ends(0)) mark_(i, way);
  if (kind === "A") for (const [i, way] of ends(2)) mark_(i, way, way + 2);
  if (kind === "M")
    for (const sign of [1, -1])
      mark_(
        row((i) => sign * (up[i] + down[i])),
        0,
        1,
      );
  if (name === "B")
    mark_(
      row((i) => Math.abs(b[i])),
      4,
    );
  if (name === "B_mean") for (const i of all) mark_(i, 4);
  if (name === "R")
    mark_(
      row((i) => Math.max(2 * su[i] + 2 * sd[i] + Math.abs(b[i]), 4 * su[i], 4 * sd[i])),
      2,
      3,
      4,
    );
  else if (kind === "R")
    mark_(
      row((i) => spreads[ways[0]][i]),
      ways[0] + 2,
    );
  return marks;
}

// The formula and the readings it was made of.
function behind(row, { evaluation, capture, u, figures, standard }) {
  const [x, up, down, su, sd, b] = ["targets", "mean_up", "mean_down", "s_up", "s_down", "B_i"].map((name) =>
    array(evaluation[name]),
  );
  const own = figures.standard === evaluation.standard;
  const columns = [up, down, su, sd, b];
  const marked = own ? used(row.parameter, { up, down, su, sd, b }) : new Set();
  const cell = (i, column) =>
    h(
      "td",
      { class: `num ${marked.has(`${i} ${column}`) ? "used" : ""}` },
      column === 2 || column === 3 ? number(columns[column][i]) : signed(columns[column][i]),
    );
  const rows = x.map((one, i) =>
    h(
      "tr",
      {},
      h("td", { class: "num" }, number(one, 3)),
      columns.map((_one, column) => cell(i, column)),
    ),
  );
  shown(`${row.parameter} = ${number(row.value, 3)} ${u}`, [
    (own || standard?.iso) && FORMULA[row.parameter] && h("p", { class: "formula" }, FORMULA[row.parameter]),
    !own && h("p", {}, `${figures.standard} ${recorded(standard?.says)}`),
    marked.size > 0 && h("p", { class: "muted" }, t("evaluate.used")),
    h(
      "p",
      {},
      t("evaluate.readings", {
        count: array(capture.deviations).length,
        repetitions: array(capture.deviations)[0]?.length ?? 0,
      }),
    ),
    h(
      "div",
      { class: "scroll", tabindex: "0" },
      h(
        "table",
        {},
        h(
          "thead",
          {},
          h(
            "tr",
            {},
            [t("chart.target"), "x̄↑", "x̄↓", "s↑", "s↓", "B"].map((one) => h("th", { class: "num" }, one)),
          ),
        ),
        h("tbody", {}, rows),
      ),
    ),
  ]);
}
