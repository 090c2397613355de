// @ts-check
// Measuring: the reading, what it waits for, the targets, the plot as it grows, and the mounting.
import { get, post } from "./api.js";
import { plotOf } from "./captureplot.js";
import { targetList } from "./capturetargets.js";
import { confirmed, machineTyped, shown, textAsked } from "./dialogs.js";
import { h, same, show, write } from "./dom.js";
import { environmentNow, showEnvironment } from "./environment.js";
import { clock, number, signed, unit } from "./figures.js";
import { machineNow, mounting } from "./drawing.js";
import { riskAsked, riskParts } from "./push.js";
import { beamMissing, mounts, seesBeam, stuckFor, untested } from "./sentence.js";
import { devOf, unitOf } from "./readings.js";
import { base, may, on, state } from "./state.js";
import { recorded, t, told } from "./words.js";

export const capture = { open };

function open(root) {
  const parts = {
    plot: h("div", { class: "panel live" }),
    machine: h("div", { class: "panel machine-now" }),
    air: h("div", { class: "panel air" }),
    over: h("div", { class: "panel over-time" }),
    read: h("div", { class: "panel read" }),
    wait: h("div", { class: "panel wait" }),
    list: h("div", { class: "panel targets", tabindex: 0, "aria-label": t("capture.targets"), role: "region" }),
    keys: h("div", { class: "panel commands" }),
  };
  // Where both do not fit, one of them.
  const which = (name) => {
    root.dataset.shows = name;
    for (const one of shows.children) one.setAttribute("aria-pressed", String(one.id === `show-${name}`));
  };
  const showing = (name) =>
    h(
      "button",
      { id: `show-${name}`, onclick: () => which(name) },
      t(name === "plot" ? "capture.curve" : "capture.machine"),
    );
  const shows = h(
    "div",
    { class: "tabs shows", role: "group", "aria-label": t("capture.shows") },
    ["plot", "machine"].map(showing),
  );
  which(state.ask && mounts(state.ask) ? "machine" : "plot");
  show(
    root,
    h("div", { class: "left" }, shows, parts.plot, h("div", { class: "beside" }, parts.machine, parts.over), parts.air),
    h("div", { class: "right" }, parts.read, parts.wait, parts.list, parts.keys),
  );
  const reading = readout(parts.read);
  const machine = machineNow(parts.machine);
  const draws = {
    plot: () => plotOf(parts.plot),
    machine: machine.draw,
    air: airPanel(parts.air),
    wait: waitPanel(parts.wait),
    list: () => targetList(parts.list),
    keys: () => commands(parts.keys),
  };
  const ends = [
    machine.end,
    overTime(parts.over),
    on("stands", machine.follow),
    // At rest the timer is enough: what is painted ten times a second keeps a processor busy.
    on("reading", () => state.status.run && reading()),
    on("ambient", draws.air),
    on("waiting", draws.wait),
    on("taken", () => {
      draws.plot();
      draws.list();
      draws.wait();
    }),
    on("frame", () => {
      draws.keys();
      draws.wait();
      machine.draw();
    }),
    on("status", () => {
      draws.plot();
      draws.list();
    }),
  ];
  for (const draw of [reading, ...Object.values(draws)]) draw();
  const timer = setInterval(() => {
    reading();
    draws.air();
    draws.wait();
  }, 1000);
  return () => {
    clearInterval(timer);
    for (const end of ends) end();
  };
}

// The unit of a channel stands at the end of its name.
export function channelUnit(name) {
  const found = /_(mm|um|deg|arcsec|mrad|urad)$/.exec(name ?? "");
  return found ? found[1] : "";
}

const DIGITS = { mm: 4, um: 2, deg: 4, arcsec: 2 };

// A command reads one instrument at a time; where none is at work every instrument tells: the first axis' own is shown.
function instrumentNow() {
  const own = state.plan.axes[0].instrument;
  return state.status.run || !(own in state.readings) ? state.active : own;
}

// While an axis is measured its last corrected deviation is large; what the instrument shows is small and named.
function readout(box) {
  const big = h("span", { class: "digits", id: "reading" });
  const small = h("span", { class: "unit" });
  const about = h("span", { class: "uncertainty", id: "reading-u" });
  const which = h("span", { class: "which" });
  const beam = h("strong", { class: "beam" });
  const bar = h("meter", { min: 0, max: 1, low: 0.5, high: 0.9, optimum: 1, "aria-label": t("capture.signal") });
  const raw = h("span", { class: "raw", id: "raw" });
  const seen = h("small", { class: "sequence", id: "sequence" });
  show(
    box,
    h("div", { class: "row" }, which, beam, bar),
    h("div", { class: "row big" }, big, small, about),
    h("div", { class: "row" }, raw, seen),
  );
  return () => {
    const data = state.readings[instrumentNow()];
    const last = state.status.run ? state.taken[state.taken.length - 1] : null;
    const fresh = data && Date.now() - data.at < 2000;
    const kind = channelUnit(data?.channels[0]);
    const shows = fresh ? signed(data.last[0], DIGITS[kind] ?? 3) : "– – –";
    const [lost, sees] = [fresh && data.signal < 0.5, data && seesBeam(data.instrument)];
    write(big, last ? signed(devOf(last), 2) : shows);
    write(small, last ? unit(unitOf(last.axis)) : fresh ? unit(kind) : "");
    write(about, last ? `± ${number(last.expanded, 2)} ${t("capture.provisional")}` : "");
    write(
      which,
      last
        ? `${last.axis} ${number(last.target, 3)} ${last.approach > 0 ? "▷" : "◁"}`
        : data
          ? `${data.instrument} · ${t("capture.raw")}`
          : t("capture.no_reading"),
    );
    write(
      beam,
      !data
        ? ""
        : !fresh
          ? `○ ${t("capture.silent")}`
          : lost
            ? beamMissing()
              ? `✖ ${t("capture.beam_lost")}`
              : `○ ${t("capture.no_light")}`
            : sees
              ? `✔ ${t("capture.beam_ok")}`
              : `○ ${t("capture.beam_unseen")}`,
    );
    beam.className = `beam ${lost && beamMissing() ? "bad" : lost || !sees || !fresh ? "unknown" : ""}`;
    big.className = !last && lost ? "digits stale" : "digits";
    bar.hidden = Boolean(data) && !sees;
    bar.value = fresh ? data.signal : 0;
    write(raw, data && last ? `${data.instrument} · ${t("capture.raw")}: ${shows} ${fresh ? unit(kind) : ""}` : "");
    write(seen, data ? `#${data.sequence}` : "");
  };
}

// Values that change are written into what stands: a panel that is made anew each second keeps a processor busy.
function airPanel(box) {
  const cells = ["air", "pressure", "humidity", "material", "read"].map((name) => [name, h("b", {})]);
  const cell = ([name, value]) => h("div", { class: "cell" }, h("small", {}, t(`capture.${name}`)), value);
  show(box, cells.map(cell), h("button", { id: "environment", onclick: showEnvironment }, t("environment.open")));
  return () => {
    const data = state.ambient;
    const material = data.material_degc?.length ? data.material_degc.map((one) => number(one, 2)).join(" · ") : "–";
    const texts = {
      air: `${number(data.air_degc, 2)} °C`,
      pressure: `${number(data.pressure_hpa, 1)} hPa`,
      humidity: `${number(data.humidity_pct, 0)} %`,
      material: `${material} °C`,
      read: data.at
        ? t("capture.age", { seconds: Math.round((data.age_s ?? 0) + (Date.now() - data.at) / 1000) })
        : t("capture.no_air"),
    };
    for (const [name, value] of cells) write(value, texts[name]);
  };
}

// Where there is room, temperatures over the command stand on the screen.
function overTime(box) {
  let end = () => {};
  let over = false;
  if (matchMedia(ROOMY).matches)
    environmentNow(["temperature"]).then(
      (found) => {
        end = found.end;
        if (over) end();
        else show(box, found.box);
      },
      () => {},
    );
  return () => {
    over = true;
    end();
  };
}
const ROOMY = "(min-width: 1700px)";

function waitPanel(box) {
  const [line, passed] = [h("strong", {}), h("span", { class: "num" })];
  const bar = h("progress", { max: 1, value: 0 });
  const rest = h("div", { class: "row togo" });
  show(box, h("div", { class: "row" }, line, passed), bar, rest);
  return () => {
    const run = state.status.run;
    const now = run ? state.waiting : null;
    write(line, waitsFor(run, now));
    write(passed, now ? `${number(now.done_s, 1)} / ${number(now.needed_s, 1)} s` : "");
    bar.setAttribute("aria-label", line.textContent);
    Object.assign(bar, { max: now?.needed_s || 1, value: now?.done_s ?? 0 });
    const stuck = now ? stuckFor() : 0;
    const said = stuck > 0 ? [t("capture.stuck", { seconds: stuck })] : togo(run);
    if (same(rest, said, stuck > 0)) return;
    const warn = (text) => h("strong", { class: "warn", id: "stuck", role: "status" }, `▲ ${text}`);
    show(rest, stuck > 0 ? said.map(warn) : said.map((text) => h("span", {}, text)));
  };
}

function waitsFor(run, now) {
  if (!run) return t("capture.idle");
  if (state.ask) return t("capture.asked");
  if (run.kind === "self-test") return t("capture.still");
  return now ? t("capture.waits", { what: recorded(now.missing) }) : t("capture.goes_on");
}

// By the service's own reckoning; while nobody is asked for anything it runs down between two words of it.
function togo(run) {
  if (!run) return [];
  const passed = state.ask ? 0 : (Date.now() - state.pictured) / 1000;
  const about = (name, seconds) =>
    typeof seconds === "number" &&
    `${t(`capture.${name}`)}: ${t("capture.about", { time: clock(Math.max(0, seconds - passed)) })}`;
  const setup = state.said.filter((one) => one.fields.number && one.kind === "step").slice(-1)[0];
  return [
    about("setup_left", run.program_left_s),
    about("day_left", run.left_s),
    setup && t("capture.setup_of", { number: setup.fields.number, total: setup.fields.total }),
  ].filter(Boolean);
}

function commands(box) {
  const run = state.status.run;
  const first = untested() ? "self-test" : "measure-axes";
  if (same(box, run?.kind, run?.run_id, first)) return;
  const allowed = may("operator");
  const give = (path, body, title, what) => async () => {
    if (await confirmed(title, what))
      post(`${base()}/commands/${path}`, body).catch((error) =>
        shown(title, [h("p", { class: "fault" }, told(error))]),
      );
  };
  const key_ = (id, path, body) =>
    h(
      "button",
      {
        id,
        class: id === first ? "primary" : null,
        disabled: !allowed,
        onclick: give(path, body, t(`capture.${id.replace("-", "_")}`), t(`capture.${id.replace("-", "_")}_what`)),
      },
      t(`capture.${id.replace("-", "_")}`),
    );
  // While a command is at work none can be given: its place is the readings'.
  const [setups, tooth] = [state.plan.setups.length > 0, state.plan.setups.length > 0 && state.file.work];
  show(
    box,
    !run && [
      key_("self-test", "self-test", { axis: "" }),
      key_("measure-axes", "run", {}),
      setups && key_("measure-errors", "measure", { setups: [], resume: "" }),
      tooth && key_("tooth-loop", "close", {}),
      tooth && h("button", { id: "close-loop", disabled: !allowed, onclick: closeLoop }, t("capture.close_loop")),
    ],
    h("button", { id: "mounting", onclick: () => shown(t("capture.mounting"), [mounting()]) }, t("capture.mounting")),
    h("button", { id: "note", disabled: !may("operator", "approver"), onclick: note }, t("capture.note")),
  );
}

// The whole loop writes: the machine's name is typed, and what becomes of tables that spoil the flank is ordered now.
async function closeLoop() {
  const title = t("capture.close_loop");
  const keep = h("input", { type: "checkbox", id: "keep-worse" });
  const risk = riskAsked("");
  const machine = await machineTyped(
    title,
    [
      h("p", {}, t("capture.close_loop_what")),
      riskParts(risk),
      h("label", { class: "inline tickbox" }, keep, t("capture.keep_worse")),
    ],
    state.site,
  );
  if (!machine) return;
  const body = { apply: true, machine, keep_worse: keep.checked, risk: risk ? risk.value.trim() : "" };
  post(`${base()}/commands/close`, body).catch((error) => shown(title, [h("p", { class: "fault" }, told(error))]));
}

async function note() {
  const run = state.status.run?.run_id || state.status.last_runs[0]?.run_id;
  const text = run && (await textAsked(t("capture.note"), t("capture.note_what")));
  if (text)
    post(`${base()}/runs/${encodeURIComponent(run)}/notes`, { text }).catch((error) =>
      shown(t("capture.note"), [h("p", { class: "fault" }, told(error))]),
    );
}

export const runFile = (run, name) => get(`${base()}/runs/${encodeURIComponent(run)}/${name}`);
