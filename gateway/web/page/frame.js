// @ts-check
// What is always visible: machine, control, tables, consent, who; the one sentence; the screens; the stop key.
import { post } from "./api.js";
import { confirmed, shown } from "./dialogs.js";
import { h, same, show } from "./dom.js";
import { clock, day } from "./figures.js";
import { languages } from "./signin.js";
import { screens } from "./screens.js";
import { hush, quiet } from "./sounds.js";
import { base, changed, may, on, state } from "./state.js";
import { atWork, sentence, surelyOn, writing } from "./sentence.js";
import { recorded, t, told } from "./words.js";

export function build({ again, load }) {
  const bar = {
    machine: h("div", { class: "machine" }),
    told: h("div", { class: "chips" }),
    menu: h("div", { class: "person" }),
  };
  const top = h("header", { class: "top" }, Object.values(bar));
  const now = h("section", { class: "now", "aria-live": "polite", id: "now" });
  const rail = h("nav", { class: "rail", "aria-label": t("frame.steps") });
  const body = h("main", { class: "screen", id: "screen", tabindex: "-1" });
  const foot = { work: h("div", { class: "work" }), stop: h("div", { class: "stopping" }) };
  const low = h("footer", { class: "low" }, Object.values(foot));
  const redraw = () => {
    drawRail(rail, go);
    open(body);
    drawLow(foot);
    drawTop(bar, { again, load, redraw });
    drawNow(now);
  };
  const turnTo = (name) => {
    state.screen = name;
    redraw();
    body.focus({ preventScroll: true });
  };
  const go = (name) => {
    location.hash = name;
    turnTo(name);
  };
  const wanted = () => (location.hash.slice(1) in screens ? location.hash.slice(1) : FIRST);
  state.screen = wanted();
  turn = go;
  // The browser's own back key.
  const back = () => {
    if (wanted() !== state.screen) turnTo(wanted());
  };
  addEventListener("hashchange", back);
  for (const end of ends) end();
  const timer = setInterval(() => {
    tick(top);
    drawNow(now);
  }, 1000);
  ends = [
    on("frame", () => {
      drawRail(rail, go);
      drawTop(bar, { again, load, redraw });
      drawNow(now);
      drawLow(foot);
    }),
    () => clearInterval(timer),
    () => removeEventListener("hashchange", back),
  ];
  redraw();
  const skip = h(
    "a",
    {
      class: "skip",
      href: "#screen",
      onclick: (event) => {
        event.preventDefault();
        body.focus();
      },
    },
    t("frame.skip"),
  );
  const shut = (event) => closed(event);
  for (const kind of ["keydown", "pointerdown"]) addEventListener(kind, shut);
  ends.push(() => {
    for (const kind of ["keydown", "pointerdown"]) removeEventListener(kind, shut);
  });
  return [skip, top, now, rail, body, low];
}

// A menu closes by Escape and by a press beside it.
function closed(event) {
  for (const one of document.querySelectorAll("details.menu[open]")) {
    if (event.type === "keydown" ? event.key !== "Escape" : one.contains(event.target)) continue;
    one.removeAttribute("open");
    if (event.type === "keydown") one.querySelector("summary").focus();
  }
}

// What of a day is done, and what has nothing to work on yet.
const MEASURED = ["measured", "partial", "proposed", "better", "unchanged", "worse", "pushed", "not-pushed"];
function stepOf(name) {
  const states = state.status.last_runs.filter((one) => !one.problem).map((one) => one.state);
  const some = (...wanted) => states.some((one) => wanted.includes(one));
  const proposed = some(...MEASURED.slice(2));
  const done = {
    connect: state.status.devices.every((one) => ["open", "in use"].includes(one.state)),
    capture: some(...MEASURED),
    evaluate: some(...MEASURED),
    model: false,
    correct: proposed,
    push: (state.tables?.tables ?? []).some((one) => one.acts === "on"),
    report: some("better", "unchanged", "worse"),
  };
  const locked = {
    evaluate: !done.capture,
    model: !state.plan.setups.length,
    correct: !proposed,
    push: !proposed && !done.push,
    report: !done.capture,
  };
  return done[name] ? "done" : locked[name] ? "locked" : "";
}

// So many letters of the large sentence stand in one line of the small screen; Chinese ones take twice the room.
const LINE = 66;
const FIRST = "capture";
let close = () => {};
// A frame that another one takes the place of draws no more.
let ends = [];

function open(body) {
  close();
  body.className = `screen ${state.screen}`;
  close = screens[state.screen].open(body) ?? (() => {});
}

function drawRail(rail, go) {
  const steps = Object.keys(screens).map((name) => [name, stepOf(name)]);
  if (same(rail, state.screen, steps)) return;
  show(
    rail,
    steps.map(([name, how], at) =>
      h(
        "button",
        {
          class: `step ${how}`,
          id: `go-${name}`,
          "aria-current": state.screen === name ? "page" : null,
          onclick: () => go(name),
        },
        h("span", { class: "number", "aria-hidden": "true" }, how === "done" ? "✓" : at + 1),
        h("span", {}, t(`frame.${name}`), how && h("span", { class: "hidden" }, `, ${t(`frame.step_${how}`)}`)),
      ),
    ),
  );
}

const MARK = {
  running: "▶",
  ready: "✔",
  attention: "▲",
  "still-on": "✖",
  open: "✔",
  "in use": "▶",
  lost: "▲",
  failed: "✖",
  closed: "○",
};
export const mark = (name) => h("span", { "aria-hidden": "true", class: "mark" }, MARK[name] ?? "?");

// Machine and menu stay while what is told between them changes.
function drawTop({ machine: place, told: chips, menu: person }, more) {
  const status = state.status;
  if (!same(place, state.site, state.sites, state.tables?.serial))
    show(place, machine(more), h("small", {}, state.tables?.serial ?? ""));
  if (!same(person, state.me.name)) show(person, menu(more));
  if (
    same(
      chips,
      status?.state,
      status?.run?.tables,
      status?.devices,
      status?.control,
      status?.held,
      status?.left,
      status?.alarms,
      state.tables?.tables?.map((one) => [one.id, one.acts]),
      state.armed,
      state.offline,
    )
  )
    return;
  const control = status.devices.find((one) => one.name === "controller") ?? status.devices[0];
  show(
    chips,
    status.simulated && h("strong", { class: "chip simulated" }, t("frame.simulated")),
    status.unprotected &&
      h("strong", { class: "chip bad unprotected", title: recorded(status.unprotected) }, t("frame.unprotected")),
    !status.held.length && !state.offline && stands(status),
    control &&
      !state.offline &&
      chip(
        control.state.replace(" ", "-"),
        t("frame.control"),
        [mark(control.state), ` ${standing(control, status.control)}`],
        control.driver,
      ),
    status.control?.alarms.length > 0 &&
      chip("bad", t("frame.alarms"), [`▲ ${status.control.alarms.slice(0, 3).join(" ")}`]),
    status.left.length > 0 && h("span", { class: "chip attention" }, `▲ ${t("frame.left")}`),
    tables(),
    held(),
    h("span", { class: "gap" }),
    consent(),
  );
}

// After a command the devices are opened again of themselves: that asks for nobody's attention.
function stands(status) {
  const opening = status.state === "attention" && !sentence().loud;
  return opening
    ? h("span", { class: "chip state opening" }, `○ ${t("state.opening")}`)
    : h("span", { class: `chip state ${status.state}` }, mark(status.state), ` ${t(`state.${status.state}`)}`);
}

// How the control stands: channel and mode where it was asked, else whether it answers.
const standing = (device, seen) =>
  seen && device.state === "open"
    ? `${seen.mode} · ${t(`channel.${seen.channel}`)}`
    : t(`device.${device.state.replace(" ", "_")}`);

// A small name above, what is the case below.
const chip = (look, name, value, title = null) =>
  h("span", { class: `chip two-lines ${look}`, title }, h("small", {}, name), h("span", {}, value));

function machine({ load, again }) {
  if (state.sites.length < 2) return h("strong", { id: "machine" }, state.site);
  const choose = async (event) => {
    state.site = event.target.value;
    await load();
    again();
  };
  return h(
    "select",
    { id: "machine", "aria-label": t("frame.machine"), onchange: choose },
    state.sites.map((one) => h("option", { value: one.site, selected: one.site === state.site }, one.site)),
  );
}

function tables() {
  const known = state.tables?.tables ?? [];
  if (!known.length) return h("span", { class: "chip" }, t("frame.no_tables"));
  const differs = Object.keys(state.tables.alarms ?? {});
  return h(
    "span",
    {
      class: `chip tables ${differs.length ? "bad" : ""}`,
      title: known.map((one) => `${one.table} ${one.id} ${one.utc}`).join("\n"),
    },
    known
      .slice(0, 3)
      .map((one) =>
        h(
          "span",
          { class: "table" },
          h("span", {}, h("b", {}, one.table), ` ${one.id.slice(0, 4)}`),
          h("small", {}, `${day(one.utc)}${one.acts === "on" ? "" : ` ${t(`push.acts_${one.acts}`)}`}`),
        ),
      ),
    known.length > 3 && h("small", {}, `+${known.length - 3}`),
    differs.length > 0 && h("b", {}, ` ▲ ${t("frame.differs")}`),
  );
}

function held() {
  if (writing())
    return h(
      "strong",
      { class: "chip", id: "writing", role: "status" },
      `▶ ${t("frame.writing")}: ${atWork()
        .map(([name, acts]) => `${name} ${t(`push.table_${acts}`)}`)
        .join(", ")}`,
    );
  if (!state.status.held.length) return null;
  const loud = state.status.held.some((one) => one.loud);
  const acts = state.status.held.some((one) => one.loud && surelyOn(one)) ? "frame.held_on" : "frame.held_maybe";
  return h(
    "strong",
    { class: `chip ${loud ? "bad" : "attention"}`, role: "alert" },
    `✖ ${t(loud ? acts : "frame.held")}`,
  );
}

function consent() {
  const left = state.armed ? (state.armed.until - Date.now()) / 1000 : 0;
  return left > 0
    ? h(
        "strong",
        { class: "chip armed", id: "armed" },
        `${t("frame.armed")} `,
        h("span", { class: "countdown" }, clock(left)),
      )
    : h("strong", { class: "chip", id: "armed" }, t("frame.read_only"));
}

function tick(top) {
  const at = top.querySelector(".countdown");
  if (!at || !state.armed) return;
  const left = (state.armed.until - Date.now()) / 1000;
  at.textContent = clock(left);
  if (left <= 0) {
    state.armed = null;
    changed("frame", "status");
  }
}

function menu({ again, redraw }) {
  const leave = () => post("/api/v1/logout").then(again, again);
  const look = () => {
    const next = document.documentElement.dataset.look === "dark" ? "light" : "dark";
    document.documentElement.dataset.look = next;
    localStorage.setItem("look", next);
    redraw();
  };
  const sound = (event) => {
    hush(!quiet());
    event.currentTarget.textContent = told_();
  };
  const told_ = () => `${quiet() ? "♪ ✕" : "♪"} ${t("frame.sound")}`;
  return h(
    "details",
    { class: "menu" },
    h("summary", { id: "who", class: "key" }, `${state.me.name} ☰`),
    h(
      "div",
      { class: "panel" },
      languages(() => {
        changed("frame");
        redraw();
      }),
      h("button", { id: "sound", onclick: sound }, told_()),
      h("button", { id: "look", onclick: look }, `◐ ${t("frame.look")}`),
      h("button", { id: "leave", onclick: leave }, t("frame.leave")),
    ),
  );
}

let turn = (/** @type {string} */ _screen) => {};
function drawNow(now) {
  document.documentElement.classList.toggle("stale", Boolean(state.stale || state.offline));
  const { loud, head, more, to } = sentence();
  const key = to && to !== state.screen ? to : "";
  if (same(now, loud, head, more, key)) return;
  const line = document.documentElement.lang === "zh" ? LINE / 2 : LINE;
  now.className = `now ${loud}${head.length > line ? " long" : ""}`;
  show(
    now,
    h("h1", {}, head),
    more && h("p", {}, more),
    key && h("button", { class: "primary", id: "now-key", onclick: () => turn(key) }, t(`frame.${key}`)),
  );
}

function drawLow({ work, stop: place }) {
  const run = state.status.run;
  if (!same(place, run?.kind, may("operator", "service")))
    show(
      place,
      h("small", { id: "no-emergency" }, t("frame.no_emergency")),
      h(
        "button",
        {
          class: "stop",
          id: "stop",
          disabled: !run || !may("operator", "service"),
          "aria-describedby": "no-emergency",
          onclick: stop,
        },
        `■ ${stops(run)}`,
      ),
    );
  if (same(work, run?.kind, run?.done, run?.total, run?.who, run?.axis, run?.stage)) return;
  const progress = run?.total
    ? h("progress", { max: run.total, value: run.done, "aria-label": t("frame.progress") })
    : null;
  show(
    work,
    run
      ? [t(`kind.${run.kind.replace("-", "_")}`), run.who, `${run.axis} ${run.stage}`.trim()]
          .filter(Boolean)
          .join(" · ")
      : t("frame.idle"),
    progress,
    run?.total ? ` ${run.done} / ${run.total}` : "",
  );
}

// What the key ends: a rollback or a push is no measuring.
const MEASURES = ["run", "measure"];
const stops = (run) => t(run && !MEASURES.includes(run.kind) ? "frame.stop_command" : "frame.stop");

async function stop() {
  const name = stops(state.status.run);
  if (!(await confirmed(name, t("frame.stop_what")))) return;
  post(`${base()}/stop`).catch((error) => shown(name, [h("p", { class: "fault" }, told(error))]));
}
