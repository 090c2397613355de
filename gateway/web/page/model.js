// @ts-check
// The errors of the machine with their bands, what each does to the tooth, and the flank as it would be with others.
import { get } from "./api.js";
import { chart } from "./chart.js";
import { band, level, limits, line } from "./charts.js";
import { failed, h, s, same, show, turn, write } from "./dom.js";
import { number, signed, unit, when } from "./figures.js";
import { unrolled } from "./flankmap.js";
import { base, chosen, on, state } from "./state.js";
import { message, prose, stateOf, t, told } from "./words.js";

export const model = { open };
const asked = { run: "", error: "", sizes: {}, steps: {}, tables: false };
const at = (path) => get(`${base()}/runs/${encodeURIComponent(asked.run)}/${path}`);

function open(root) {
  const [head, body] = [h("div", { class: "panel choose" }), h("div", { class: "two" })];
  show(root, head, body);
  const draw = () => drawAll(head, body).catch((error) => failed(body, told(error)));
  draw();
  return on("status", draw);
}

// A run's errors never change: what a person has set stays as it is until another run is there or is chosen.
async function drawAll(head, body) {
  const { runs } = await get(`${base()}/runs?most=50`);
  const able = runs.filter((one) => !one.problem && one.stages.includes("errors"));
  if (!able.length)
    return (
      same(body) ||
      show(body, h("p", { class: "empty" }, t(state.plan.setups.length ? "model.none" : "model.no_setups")))
    );
  const run = chosen(asked, able);
  if (asked.run !== run.run_id) Object.assign(asked, { run: run.run_id, sizes: {}, steps: {} });
  if (same(body, run.run_id, able.length)) return;
  const choose = (event) => {
    Object.assign(asked, { run: event.target.value, sizes: {}, steps: {} });
    drawAll(head, body);
  };
  show(
    head,
    h(
      "label",
      { class: "inline" },
      t("evaluate.run"),
      h(
        "select",
        { id: "pick-run", onchange: choose },
        able.map((one) =>
          h("option", { value: one.run_id, selected: one === run }, `${when(one.created_utc)} · ${stateOf(one)}`),
        ),
      ),
    ),
    h("span", { class: "gap" }),
    h(
      "button",
      {
        id: "as-measured",
        onclick: () => {
          Object.assign(asked, { sizes: {}, steps: {}, tables: false });
          delete body.dataset.key;
          drawAll(head, body);
        },
      },
      t("model.as_measured"),
    ),
  );
  const put = turn(body);
  const found = await at("model");
  if (put()) drawRun(body, found);
}

function drawRun(body, found) {
  const curve = h("div", { class: "panel plots curve" });
  const flank = found.tooth && flankOf(found.tooth);
  const rows = ordered(found);
  const pick = (name) => {
    asked.error = name;
    for (const one of body.querySelectorAll("button.error"))
      one.setAttribute("aria-pressed", String(one.textContent === name));
    curveOf(
      curve,
      found.errors.find((one) => one.name === name),
    );
  };
  show(
    body,
    h(
      "div",
      { class: "panel errors" },
      h(
        "h2",
        {},
        t("model.errors", { count: rows.filter((one) => one.state === "measured").length, all: rows.length }),
      ),
      table(rows, found, { pick, flank }),
      setups(found.tooth),
      found.said.map((one) => h("p", { class: "muted" }, message(one))),
    ),
    h(
      "div",
      { class: "stack fill", tabindex: 0, role: "region", "aria-label": t("model.flank") },
      flank ? flank.panel : h("p", { class: "panel empty" }, told(found.why)),
      curve,
      found.tooth && next(found.tooth),
    ),
  );
  pick(rows.some((one) => one.name === asked.error) ? asked.error : rows[0].name);
  flank?.ask();
}

// The error that spoils the tooth most comes first; without a gear they stand in the usual order.
function ordered(found) {
  const places = (found.tooth?.ranking ?? []).map((one) => one.error);
  const place = (one) => (places.includes(one.name) ? places.indexOf(one.name) : places.length);
  return [...found.errors].sort((a, b) => place(a) - place(b));
}

function table(rows, found, { pick, flank }) {
  const most = Math.max(...(found.tooth?.ranking ?? []).map((one) => one.high_um), 1e-9);
  const heads = ["model.error", "model.curve", "model.range", ...(found.tooth ? ["model.effect", "model.try"] : [])];
  return h(
    "table",
    { class: "errors" },
    h(
      "thead",
      {},
      h(
        "tr",
        {},
        heads.map((one) => h("th", { class: one === "model.range" ? "num" : null }, t(one))),
      ),
    ),
    h(
      "tbody",
      {},
      rows.map((row) =>
        h(
          "tr",
          { "data-error": row.name },
          h(
            "td",
            {},
            h("button", { class: "error", "aria-pressed": "false", onclick: () => pick(row.name) }, row.name),
          ),
          h("td", {}, spark(row)),
          h("td", { class: "num range" }, range(row)),
          found.tooth && [
            h(
              "td",
              { class: "effect" },
              effect(
                found.tooth.ranking.find((one) => one.error === row.name),
                most,
              ),
              cure(found.tooth.cures.find((one) => one.error === row.name)),
            ),
            slider(row, found.tooth.sizes[row.name], flank),
          ],
        ),
      ),
    ),
  );
}

// The flank beside is made of these as well: they are set by hand, and no error of an axis.
function setups(tooth) {
  if (!tooth?.setup) return null;
  const { x_um: x, c_arcsec: c, dressing_um: dressing } = tooth.setup;
  return h(
    "div",
    { id: "setup-values" },
    h("h3", {}, t("tooth.setup")),
    h(
      "dl",
      { class: "facts" },
      [
        ["tooth.x", x, "µm"],
        ["tooth.c", c, "″"],
        ["tooth.dressing", dressing, "µm"],
      ].map(([name, value, of]) => h("div", {}, h("dt", {}, t(name)), h("dd", {}, `${signed(value)} ${of}`))),
    ),
    h("p", { class: "muted" }, t("model.setup_too")),
  );
}

const range = (row) => [
  h(
    "span",
    { "data-low": row.name },
    row.state === "measured" && row.curve === null ? number(row.low) : `${number(row.low)} … ${number(row.high)}`,
  ),
  h("br"),
  h(
    "small",
    {},
    row.state === "measured" ? `U ${number(row.U)} ${unit(row.unit)}` : `${unit(row.unit)} · ${t("model.assumed")}`,
  ),
];

function spark(row) {
  if (!row.curve) return h("span", { class: "muted" }, row.state === "measured" ? t("model.constant") : "");
  const { at: xs, value, U } = row.curve;
  const y = limits([...value.map((one, i) => one + U[i]), ...value.map((one, i) => one - U[i]), 0], 0.02);
  const place = {
    px: (one) => (100 * (one - xs[0])) / (xs[xs.length - 1] - xs[0]),
    py: (one) => 32 - (32 * (one - y[0])) / (y[1] - y[0]),
    inner: { left: 0, right: 100 },
  };
  return s(
    "svg",
    { class: "spark", viewBox: "0 0 100 32", preserveAspectRatio: "none", "aria-hidden": "true" },
    level(0, place, "grid"),
    band(
      xs,
      value.map((one, i) => one - U[i]),
      value.map((one, i) => one + U[i]),
      place,
      "new",
    ),
    line(xs, value, place, "new"),
  );
}

// Morris mu* with its interval as a bar; the number is the record's.
function effect(rank, most) {
  if (!rank) return h("span", { class: "muted" }, "–");
  const x = (value) => (100 * value) / most;
  const places = rank.rank[0] === rank.rank[1] ? `${rank.rank[0]}` : `${rank.rank[0]}–${rank.rank[1]}`;
  return [
    h(
      "span",
      { class: "tag" },
      h("b", { "data-effect": rank.error }, number(rank.mu_star_um)),
      ` µm · ${t("model.rank", { places })}`,
    ),
    s(
      "svg",
      { class: "bar", viewBox: "0 0 100 8", preserveAspectRatio: "none", "aria-hidden": "true" },
      s("rect", { class: "whole", x: 0, y: 1, width: x(rank.mu_star_um), height: 6 }),
      s("line", { class: "interval", x1: x(rank.low_um), x2: x(rank.high_um), y1: 4, y2: 4 }),
    ),
  ];
}

const CURES = {
  "mechanical only": "cure.mechanical",
  "none needed": "cure.none",
  "X zero": "cure.x_zero",
  "C zero": "cure.c_zero",
  "dressing offset": "cure.dressing",
};

// What cures an error, in words; a table stands by its name.
function cureOf(by) {
  const [, own, part] = /^(.*?)( in part)?$/.exec(by);
  return `${own in CURES ? t(CURES[own]) : own}${part ? ` ${t("cure.in_part")}` : ""}`;
}

const cure = (one) =>
  one &&
  h("small", {}, h("b", { class: "tag" }, cureOf(one.by)), ` · ${t("model.left", { left: number(one.floor_um) })}`);

function slider(row, size, flank) {
  if (!size) return h("td", {}, h("span", { class: "muted" }, "–"));
  const value = asked.sizes[row.name] ?? size.at;
  const told_ = h("output", { class: "num" }, `× ${number(value)}`);
  const moved = (event) => {
    asked.sizes[row.name] = Number(event.target.value);
    write(told_, `× ${number(asked.sizes[row.name])}`);
    flank.ask();
  };
  return h(
    "td",
    { class: "try" },
    h("input", {
      type: "range",
      min: size.low,
      max: size.high,
      step: 0.05,
      value,
      "aria-label": t("model.times", { name: row.name }),
      "data-try": row.name,
      oninput: moved,
    }),
    told_,
  );
}

// The newest question is answered; those that were overtaken are never asked. Both flanks have one scale, so that what
// is paler is better.
function flankOf(tooth) {
  const canvas = h("canvas", { class: "flank", role: "img", "aria-label": t("model.flank") });
  const [rms, largest] = [h("b", { id: "flank-rms" }), h("b", { id: "flank-largest" })];
  const said = h("p", { class: "fault", role: "alert" });
  const which = ["without", "with"].map((name) =>
    h("button", { id: `flank-${name}`, onclick: () => turnTo(name === "with") }, t(`model.${name}_tables`)),
  );
  const turnTo = (tables) => {
    asked.tables = tables;
    which.forEach((one, n) => one.setAttribute("aria-pressed", String(asked.tables === (n === 1))));
    ask();
  };
  const panel = h(
    "div",
    { class: "panel flank" },
    h(
      "div",
      { class: "row head" },
      h("div", { class: "tabs", role: "group", "aria-label": t("model.flank") }, which),
      h("span", {}, "RMS ", rms, ` µm · ${t("model.largest")} `, largest, " µm"),
    ),
    canvas,
    tooth.spacings.map((one) => spacing(one, () => turnTo(true))),
    h("p", { class: "muted" }, `${tooth.gear}. ${t("model.unrolled")} ${t("model.spacing_what")}`),
    said,
  );
  let [busy, again, last] = [false, false, null];
  const draw = () => last && unrolled(canvas, { ...(last.tables ?? last), largest_um: last.largest_um });
  new ResizeObserver(draw).observe(canvas);
  const ask = async () => {
    again = true;
    if (busy) return;
    busy = true;
    while (again) {
      again = false;
      const pairs = (values) =>
        Object.entries(values)
          .map(([name, value]) => `${name}:${value}`)
          .join(",");
      const sizes = pairs(asked.sizes);
      const query = { sizes, ...(asked.tables ? { tables: "true", steps: pairs(asked.steps) } : {}) };
      try {
        last = await at(`flank?${new URLSearchParams(query)}`);
        said.textContent = "";
        draw();
        const shown = last.tables ?? last;
        write(rms, number(shown.rms_um));
        write(largest, number(shown.largest_um));
        Object.assign(panel.dataset, { sizes, steps: query.steps ?? "none" });
      } catch (error) {
        said.textContent = told(error);
      }
    }
    busy = false;
  };
  return { panel, ask: () => turnTo(asked.tables) };
}

// How far apart the points of the tables over an axis stand, in steps that divide their range.
function spacing({ axis, unit: of, step, steps }, moved) {
  const nearest = (wanted) =>
    steps.reduce((best, one, n) => (Math.abs(one - wanted) < Math.abs(steps[best] - wanted) ? n : best), 0);
  const digits = (value) => (Number.isInteger(value) ? 0 : value < 1 ? 3 : 2);
  const span = step * Math.round(spanOf(axis) / step);
  const says = (value) =>
    t("model.spacing_is", {
      step: `${number(value, digits(value))} ${unit(of)}`,
      points: Math.round(span / value) + 1,
    });
  const chosen_ = asked.steps[axis] ?? step;
  const said = h("output", { class: "num", "aria-live": "off" }, says(chosen_));
  const slide = h("input", {
    type: "range",
    min: 0,
    max: steps.length - 1,
    step: 1,
    value: nearest(chosen_),
    "data-spacing": axis,
    "aria-label": t("model.spacing", { axis }),
  });
  slide.addEventListener("input", () => {
    asked.steps[axis] = steps[Number(slide.value)];
    write(said, says(asked.steps[axis]));
    slide.setAttribute("aria-valuetext", said.textContent);
    moved();
  });
  return h("label", { class: "spacing" }, t("model.spacing", { axis }), said, slide);
}

// The range of an axis' tables, as the site file has it.
function spanOf(letter) {
  const { table: grid } = state.file.axes.find((one) => one.letter === letter);
  return grid.maximum - grid.minimum;
}

function curveOf(box, row) {
  const said =
    row.state === "measured"
      ? `${number(row.low)} ± ${number(row.U)} ${unit(row.unit)}`
      : `± ${number(row.high)} ${unit(row.unit)}`;
  if (!row.curve) return show(box, h("h2", {}, row.name), h("p", {}, said), h("p", { class: "muted" }, prose(row.how)));
  const { at: xs, value, U } = row.curve;
  const [low, high] = [value.map((one, i) => one - U[i]), value.map((one, i) => one + U[i])];
  return show(
    box,
    chart({
      title: `${row.name} · ${row.curve.axis}`,
      xName: row.curve.axis,
      xUnit: unit(row.curve.unit),
      yName: row.name,
      yUnit: unit(row.unit),
      fits: true,
      curves: [
        { name: t("model.band"), look: "new", kind: "band", follows: true, x: xs, y: low, high },
        { name: row.name, look: "new", fit: true, x: xs, y: value },
      ],
    }),
  );
}

function next(tooth) {
  const limit = number(tooth.threshold_um, 1);
  const useful = tooth.next.filter((one) => !one.measured && one.change_um > tooth.threshold_um).slice(0, 4);
  return h(
    "div",
    { class: "panel next" },
    h("h2", {}, t("model.next")),
    !useful.length && h("p", {}, t("model.enough", { limit })),
    useful.length > 0 &&
      h(
        "ul",
        { class: "lines" },
        useful.map((one) =>
          h(
            "li",
            {},
            h("b", { "data-next": one.name }, one.name),
            ` ${t("model.may_change", { change: number(one.change_um) })}`,
          ),
        ),
      ),
  );
}
