// @ts-check
// The one large sentence: what to do now, and what more there is to know about it.
import { state } from "./state.js";
import { capital, recorded, say, t, told, toldApart } from "./words.js";

// A push that is at work has not been held: its tables are told as they stand.
const AT_WORK = ["begun", "writing", "written", "on"];
export const atWork = () => (state.status?.run?.tables ?? []).filter(([, acts]) => AT_WORK.includes(acts));
export const writing = () => atWork().length > 0;

// The screen that a sentence speaks of: its key stands beside it.
const SCREEN = {
  "now.correct": "correct",
  "now.verify": "report",
  "now.changed": "push",
  "now.self_test": "capture",
  "now.measure": "capture",
  "now.held_on": "push",
  "now.held_maybe": "push",
  "now.held": "push",
  "now.device": "connect",
};
const heads = (key) => ({ head: t(key), to: SCREEN[key] });

export function sentence() {
  const found = chosen();
  return { ...found, head: capital(found.head) };
}

/** @returns {{loud: string, head: string, more?: string, to?: string}} */
function chosen() {
  const { status, ask } = state;
  const held = status.held.find((one) => one.loud && surelyOn(one)) ?? status.held.find((one) => one.loud);
  if (state.replaced) return { loud: "attention", head: t("frame.replaced") };
  if (state.offline) return { loud: "attention", head: t("frame.offline"), more: toldApart({ code: "OFFLINE" })[1] };
  if (state.stale)
    return {
      loud: "attention",
      head: t("frame.stale", { seconds: state.stale }),
      more: toldApart({ code: "OFFLINE" })[1],
    };
  if (status.run && beamMissing() && !mounts(ask))
    return {
      loud: "bad",
      head: t("now.beam"),
      more: ask ? capital(say(ask.code, ask.fields, 0, ask.words)) : newest(),
    };
  if (status.run && ask)
    return {
      loud: "ask",
      head: capital(say(ask.code, ask.fields, 0, ask.words)),
      more: moving() || (held && !writing() ? heldWords(held) : ""),
    };
  if (status.run && writing()) return { loud: "", head: t("now.writing"), more: newest() };
  // Whoever recovers a held push is asked to press: that stands above what is wrong until then.
  if (held) return { loud: "bad", ...heads(surelyOn(held) ? "now.held_on" : "now.held_maybe"), more: heldWords(held) };
  if (status.run && stuckFor())
    return {
      loud: "attention",
      head: t("now.stuck"),
      more: t("capture.waits", { what: recorded(state.waiting.missing) }),
    };
  if (status.run) return { loud: "", head: t("now.wait"), more: newest() };
  if (status.left.length) {
    const [head, more] = toldApart(status.left[0]);
    return { loud: "attention", head, more };
  }
  if (status.trouble) return { loud: "attention", ...parts(status.trouble) };
  // What is closed is just being opened again, after a command.
  const away = status.devices.find(
    (one) => ["lost", "failed"].includes(one.state) || (one.state === "closed" && one.error),
  );
  if (away)
    return { loud: "attention", head: t("now.device", { name: away.name }), to: "connect", more: told(away.error) };
  if (status.held.length) return { loud: "attention", ...heads("now.held"), more: heldWords(status.held[0]) };
  if (status.alarms.length) return { loud: "attention", head: recorded(status.alarms[0]), more: recorded(status.due) };
  if (status.failure) return { loud: "attention", ...parts(status.failure) };
  return { loud: "", ...heads(next()), more: recorded(status.due) };
}

// Runs that came to something: one that failed, was stopped or only looked changes nothing about what to do next.
const last = () =>
  state.status.last_runs.filter(
    (one) =>
      !one.problem &&
      ![
        "failed",
        "stopped",
        "refused",
        "running",
        "opened",
        "self-testing",
        "recovered",
        "verified",
        "guarded",
      ].includes(one.state),
  );
export const untested = () => !last().length;

// Whatever a run had judged, tables act now that were switched after it: taken back, put on again, off.
const switched = (one) => one.state === "recovered" || /^(rollback|disable)-/.test(one.state);

function next() {
  if (untested()) return state.screen === "capture" ? "now.self_test_here" : "now.self_test";
  const latest = last().find((one) => one.state !== "self-tested");
  if (!latest) return state.screen === "capture" ? "now.measure_here" : "now.measure";
  if (latest.state === "proposed") return "now.correct";
  const since = state.status.last_runs.slice(0, state.status.last_runs.indexOf(latest) + 1);
  if (since.some(switched)) return "now.changed";
  if (["better", "unchanged", "worse"].includes(latest.state)) return "now.verify";
  return "now.ready";
}

function newest() {
  const word = state.said[state.said.length - 1];
  return word ? capital(say(word.code, word.fields, 0, word.words)) : recorded(state.status.run.words);
}

// While optics are mounted no light comes back: that is lost only where it was there before.
const MOUNT = ["MountingRequested", "SetupJogRequested", "SetupProgramSelected"];
export const mounts = (ask) =>
  ask && MOUNT.includes(ask.event) && !state.said.slice(-6).some((one) => one.event === "BeamLost");

// Light is missed only where a reading is taken now, or where the service says that it lost the beam: optics are
// changed between readings, and then none comes back.
const NOW_MS = 3000;
const reads = () => state.waiting && !state.ask && Date.now() - state.waiting.at < NOW_MS;
export const beamMissing = () =>
  state.beam === "lost" && (reads() || state.said.slice(-6).some((one) => one.event === "BeamLost"));

// Whether an instrument can tell a broken beam at all: a counter cannot.
export const seesBeam = (name) => state.status.devices.find((one) => one.name === name)?.sees_beam !== false;

// A wait is stuck when it takes this much longer than it needs by itself; one that is told no more is over.
const LONG_MS = 8000;
export function stuckFor() {
  if (!reads()) return 0;
  const waited = Date.now() - state.waiting.since;
  return waited < LONG_MS + 1000 * state.waiting.needed_s ? 0 : Math.round(waited / 1000);
}

// What will move from where to where when the person does what is asked, and what stands still; Push tells all of many.
const MOST = 4;
function moving() {
  const moves = state.moves.map((one) => say(one.code, one.fields, 0, one.words));
  const more = moves.length > MOST ? [t("now.more_moves", { count: moves.length - MOST + 1 })] : [];
  return [...moves.slice(0, more.length ? MOST - 1 : MOST), ...more]
    .map(whole)
    .join(document.documentElement.lang === "zh" ? "" : " ");
}

const whole = (text) => `${capital(text).replace(/[.。]$/, "")}${document.documentElement.lang === "zh" ? "。" : "."}`;

// What happened, large; what to do about it, below.
function parts(error) {
  const [head, more] = toldApart(error);
  return { head, more };
}

// Whether the journal knows that it is on; of a write that was interrupted nobody knows before the control is asked.
export const surelyOn = (one) => !one.code.endsWith("UNKNOWN");

export const heldWords = (one) => say(one.code, one.fields, 0, one.words);
