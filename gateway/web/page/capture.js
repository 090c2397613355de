// @ts-check
// Measuring: the reading, what it waits for, the targets, the plot as it grows, and the mounting.
import { get, post } from "./api.js";
import { plotOf } from "./captureplot.js";
import { targetList } from "./capturetargets.js";
import { confirmed, machineTyped, shown, textAsked } from "./dialogs.js";
import { h, same, show, write } from "./dom.js";
import { clock, number, signed, unit } from "./figures.js";
import { mounting } from "./drawing.js";
import { riskAsked, riskParts } from "./push.js";
import { beamMissing, seesBeam, stuckFor, untested } from "./sentence.js";
import { devOf, unitOf } from "./readings.js";
import { base, may, on, state } from "./state.js";
import { recorded, t, told } from "./words.js";

export const capture = { open };

function open(root) {
  const parts = {
    plot: h("div", { class: "panel live" }),
    air: h("div", { class: "panel air" }),
    read: h("div", { class: "panel read" }),
    wait: h("div", { class: "panel wait" }),
    list: h("div", { class: "panel targets", tabindex: 0, "aria-label": t("capture.targets"), role: "region" }),
    keys: h("div", { class: "panel commands" }),
  };
  show(
    root,
    h("div", { class: "left" }, parts.plot, parts.air),
    h("div", { class: "right" }, parts.read, parts.wait, parts.list, parts.keys),
  );
  const reading = readout(parts.read);
  const draws = {
    plot: () => plotOf(parts.plot),
    air: () => air(parts.air),
    wait: () => waiting(parts.wait),
    list: () => targetList(parts.list),
    keys: () => commands(parts.keys),
  };
  const ends = [
    on("reading", reading),
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

function air(box) {
  const data = state.ambient;
  const value = (label, text) => h("div", { class: "cell" }, h("small", {}, label), h("b", {}, text));
  const age = data.at
    ? t("capture.age", { seconds: Math.round((data.age_s ?? 0) + (Date.now() - data.at) / 1000) })
    : t("capture.no_air");
  if (same(box, data, age)) return;
  const material = data.material_degc?.length ? data.material_degc.map((one) => number(one, 2)).join(" · ") : null;
  show(
    box,
    value(t("capture.air"), `${number(data.air_degc, 2)} °C`),
    value(t("capture.pressure"), `${number(data.pressure_hpa, 1)} hPa`),
    value(t("capture.humidity"), `${number(data.humidity_pct, 0)} %`),
    value(t("capture.material"), `${material ?? "–"} °C`),
    value(t("capture.read"), age),
  );
}

function waiting(box) {
  const run = state.status.run;
  const now = run ? state.waiting : null;
  const line = !run
    ? t("capture.idle")
    : state.ask
      ? t("capture.asked")
      : run.kind === "self-test"
        ? t("capture.still")
        : now
          ? t("capture.waits", { what: recorded(now.missing) })
          : t("capture.goes_on");
  show(
    box,
    h(
      "div",
      { class: "row" },
      h("strong", {}, line),
      now && h("span", { class: "num" }, `${number(now.done_s, 1)} / ${number(now.needed_s, 1)} s`),
    ),
    now
      ? h("progress", { max: now.needed_s || 1, value: now.done_s, "aria-label": line })
      : h("progress", { max: 1, value: 0, "aria-label": line }),
    h(
      "div",
      { class: "row togo" },
      ...(now && stuckFor() > 0
        ? [
            h(
              "strong",
              { class: "warn", id: "stuck", role: "status" },
              `▲ ${t("capture.stuck", { seconds: stuckFor() })}`,
            ),
          ]
        : togo(run)),
    ),
  );
}

// By the service's own reckoning; while nobody is asked for anything it runs down between two words of it.
function togo(run) {
  if (!run) return [h("span", {}, "")];
  const passed = state.ask ? 0 : (Date.now() - state.pictured) / 1000;
  const about = (name, seconds) =>
    typeof seconds === "number" &&
    h("span", {}, `${t(`capture.${name}`)}: ${t("capture.about", { time: clock(Math.max(0, seconds - passed)) })}`);
  const setup = state.said.filter((one) => one.fields.number && one.kind === "step").slice(-1)[0];
  return [
    about("setup_left", run.program_left_s),
    about("day_left", run.left_s),
    setup && h("span", {}, t("capture.setup_of", { number: setup.fields.number, total: setup.fields.total })),
  ];
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
        disabled: Boolean(run) || !allowed,
        onclick: give(path, body, t(`capture.${id.replace("-", "_")}`), t(`capture.${id.replace("-", "_")}_what`)),
      },
      t(`capture.${id.replace("-", "_")}`),
    );
  show(
    box,
    key_("self-test", "self-test", { axis: "" }),
    key_("measure-axes", "run", {}),
    state.plan.setups.length > 0 && key_("measure-errors", "measure", { setups: [], resume: "" }),
    state.plan.setups.length > 0 && state.file.work && key_("tooth-loop", "close", {}),
    state.plan.setups.length > 0 &&
      state.file.work &&
      h(
        "button",
        { id: "close-loop", disabled: Boolean(run) || !allowed, onclick: closeLoop },
        t("capture.close_loop"),
      ),
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
