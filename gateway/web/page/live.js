// The live stream into the state.
import { get } from "./api.js";
import { click, loss } from "./sounds.js";
import { base, changed, state } from "./state.js";

let source = null;

export function listen(expired) {
  source?.close();
  source = new EventSource(`${base()}/stream`);
  const hear = (kind, take) => source.addEventListener(kind, (event) => take(JSON.parse(event.data), event));
  source.onopen = () => { state.offline = false; changed("frame"); };
  source.onerror = () => {
    state.offline = true;
    changed("frame");
    get("/api/v1/me").catch((error) => { if (error.status === 401) { source.close(); expired(); } });
  };
  hear("picture", picture);
  hear("state", picture);
  hear("said", said);
  hear("reading", reading);
  hear("ambient", (data) => { state.ambient = { ...data, at: Date.now() }; changed("ambient"); });
  hear("waiting", (data) => { state.waiting = data; changed("waiting"); });
  hear("taken", taken);
  hear("lost", (data) => { state.lost += data.frames; refresh(); });
}

export const deaf = () => source?.close();

function picture(data) {
  const before = state.status;
  state.status = data;
  state.ask = data.run?.ask ?? null;
  if (data.run) state.steps = data.run.steps;
  if (data.run && data.run.started_utc !== before?.run?.started_utc) begin();
  if (before?.run && !data.run) refresh();
  changed("frame", "status");
}

function begin() {
  state.said = [];
  state.waiting = null;
  get(`${base()}/taken`).then((found) => { state.taken = found; changed("taken"); }, () => {});
}

function said(data) {
  state.said = [...state.said.slice(-199), data];
  if (data.kind === "ask") state.ask = data;
  else if (data.kind !== "detail") state.ask = null;
  if (data.code === "P-PUSH-STEP") state.steps = [...state.steps, [data.fields.axis, data.fields.step]];
  if (data.code === "P-CAP-BEAM") loss();
  changed("frame", "said");
}

function reading(data, event) {
  state.readings[data.instrument] = { ...data, at: Date.now(), number: Number(event.lastEventId) };
  state.active = data.instrument;
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

async function arm() {
  const run = state.status?.last_runs.find((one) => !one.problem && ["proposed", "approved"].includes(one.state));
  state.proposal = run?.run_id ?? null;
  const given = run ? await get(`${base()}/runs/${encodeURIComponent(run.run_id)}/approvals`) : [];
  const valid = given.filter((one) => Date.parse(one.expires_utc) > Date.now());
  state.armed = valid.length ? { by: [...new Set(valid.map((one) => one.by))], until: Math.min(...valid.map((one) => Date.parse(one.expires_utc))) } : null;
}
