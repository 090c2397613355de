// @ts-check
// The live stream into the state.
import { get } from "./api.js";
import { click, loss } from "./sounds.js";
import { base, changed, state } from "./state.js";

let source = null;
let retry = 0;
const AGAIN_MS = 2000;
// The service says something every 5 s at least. A cut cable ends no socket: then two beats are missed.
const STALE_MS = 10_000;
let heard = 0;
let watch = 0;
// What stands in the service as it was after the last command: a page that never saw a short one asks for it too.
let coming = Promise.resolve();

export function listen() {
  deaf();
  source = new EventSource(`${base()}/stream`);
  const hear = (kind, take) =>
    source.addEventListener(kind, (event) => {
      alive();
      take(JSON.parse(event.data), event);
    });
  if (!state.stale) heard = Date.now();
  watch = setInterval(doubt, 1000);
  source.onopen = () => {
    if (state.offline) again();
    state.offline = false;
    changed("frame");
  };
  source.onerror = () => {
    state.offline = true;
    changed("frame");
    get("/api/v1/me").catch(() => {});
    // A service that just begins refuses the stream: then the browser does not try again by itself.
    if (source.readyState === EventSource.CLOSED) retry = setTimeout(listen, AGAIN_MS);
  };
  hear("beat", () => {});
  hear("picture", picture);
  hear("state", picture);
  hear("said", said);
  hear("reading", reading);
  hear("ambient", (data) => {
    state.ambient = { ...data, at: Date.now() };
    changed("ambient");
  });
  hear("waiting", (data) => {
    state.waiting = { ...data, since: state.waiting?.since ?? Date.now(), at: Date.now() };
    changed("waiting");
  });
  hear("stands", (data) => {
    state.positions = data.positions;
    changed("stands");
  });
  hear("taken", taken);
  hear("ended", again);
  // More windows of this person listen than may: this one is the oldest and does not ask again by itself.
  hear("replaced", () => {
    deaf();
    state.offline = state.replaced = true;
    changed("frame");
  });
  // What was lost stands in the picture that follows, but for the readings of the plot.
  hear("lost", (data) => {
    state.lost += data.frames;
    readings();
    again();
  });
}

const again = () => {
  coming = refresh().catch(() => {});
};

function alive() {
  heard = Date.now();
  if (!state.stale) return;
  state.stale = 0;
  again();
  changed("frame");
}

// How old what is shown is, once it is too old to be believed; a stream that is open but silent is opened again.
function doubt() {
  const silent = Date.now() - heard;
  if (silent < STALE_MS) return;
  const first = !state.stale;
  state.stale = Math.round(silent / 1000);
  changed("frame");
  if (first && source.readyState !== EventSource.CLOSED)
    get("/api/v1/me").then(
      () => state.stale && listen(),
      () => {},
    );
}

export function deaf() {
  clearTimeout(retry);
  clearInterval(watch);
  source?.close();
}

function picture(data) {
  const before = state.status;
  state.status = data;
  state.ask = data.run?.ask ?? null;
  state.moves = data.run?.moves ?? [];
  state.pictured = Date.now();
  if (data.run) state.steps = data.run.steps;
  if (data.ambient) airOf(data.ambient);
  standing(data.positions);
  if (data.run && data.run.started_utc !== before?.run?.started_utc) begin();
  const shown = () => changed("frame", "status", "jobs");
  // What a command came to is asked for first: nobody is shown its end with the answer of the one before.
  if (before?.run && !data.run) coming.then(shown);
  else changed("frame", "status");
}

// Air of a picture: the moment it was read is by the service's clock, and so is the picture's.
export function airOf(found) {
  if (!state.ambient.at || found.utc !== state.ambient.utc)
    state.ambient = {
      ...found,
      at: Date.now() - Math.max(0, Date.parse(state.status.now_utc) - Date.parse(found.utc)),
    };
}

/** Where axes stand by a picture. */
export function standing(positions) {
  state.positions = positions ?? {};
  changed("stands");
}

function begin() {
  state.said = [];
  state.waiting = null;
  state.beam = "";
  readings();
}

function readings() {
  get(`${base()}/taken`).then(
    (found) => {
      state.taken = found;
      changed("taken");
    },
    () => {},
  );
}

function said(data) {
  state.said = [...state.said.slice(-199), data];
  // As the service's own picture has it: what is said to move after an ask belongs to the next one.
  const moves = data.kind === "move" || data.event === "DisableMoves";
  if (moves) state.moves = [...(state.ask ? [] : state.moves), data];
  if (data.kind === "ask") state.ask = data;
  else if (data.kind !== "detail") Object.assign(state, { ask: null, moves: moves ? state.moves : [] });
  // A new step waits anew.
  if (data.kind !== "detail") state.waiting = null;
  if (data.event === "PushPhaseChanged") state.steps = [...state.steps, [data.fields.axis, data.fields.step]];
  if (data.event === "BeamLost") loss();
  // What is true of a table has changed, long before the command ends.
  if (data.event === "TableStateChanged" && state.status?.run)
    state.status.run.tables = [
      ...(state.status.run.tables ?? []).filter(([name]) => name !== data.fields.axis),
      [data.fields.axis, data.fields.state],
    ];
  if (["TableStateChanged", "PushEnded"].includes(data.event)) again();
  changed("frame", "said");
}

function reading(data, event) {
  state.readings[data.instrument] = { ...data, at: Date.now(), number: Number(event.lastEventId) };
  state.active = data.instrument;
  const beam = data.signal < 0.5 ? "lost" : "";
  if (beam !== state.beam) {
    if (beam) loss();
    state.beam = beam;
    changed("frame");
  }
  changed("reading");
}

function taken(data) {
  state.taken = [...state.taken, data];
  state.waiting = null;
  click();
  changed("taken");
}

// What stands in the service and does not come by the stream.
export async function refresh() {
  const [tables, jobs] = await Promise.all([get(`${base()}/tables`), get(`${base()}/jobs`)]);
  Object.assign(state, { tables, jobs });
  await arm();
  changed("frame", "status", "jobs");
}

// Which runs somebody has approved; the newest of them is what the machine is armed for.
async function arm() {
  const { runs } = await get(`${base()}/runs?most=20`);
  const able = runs.filter((one) => !one.problem && one.stages.includes("proposal")).slice(0, 5);
  const given = await Promise.all(able.map((one) => get(`${base()}/runs/${encodeURIComponent(one.run_id)}/approvals`)));
  const valid = given.map((every) => every.filter((one) => Date.parse(one.expires_utc) > Date.now()));
  const found = able
    .map((one, at) => [one.run_id, valid[at]])
    .filter(([, every]) => every.length)
    .map(([run, every]) => [
      run,
      {
        by: [...new Set(every.map((one) => one.by))],
        until: Math.min(...every.map((one) => Date.parse(one.expires_utc))),
      },
    ]);
  state.approved = Object.fromEntries(found);
  state.armed = found[0]?.[1] ?? null;
}
