// @ts-check
// What the page knows now; whoever draws is told once for each change, at most once a frame.
export const state = {
  me: null,
  site: "",
  sites: [],
  status: null,
  plan: null,
  file: null,
  tables: null,
  jobs: [],
  screen: "capture",
  ask: null,
  moves: [],
  said: [],
  steps: [],
  readings: {},
  ambient: {},
  positions: {},
  waiting: null,
  taken: [],
  lost: 0,
  offline: false,
  stale: 0,
  pictured: 0,
  replaced: false,
  armed: null,
  approved: {},
  beam: "",
  limits: {},
  at: performance.now(),
};
const listeners = new Map();
let due = new Set();

export function on(topic, draw) {
  if (!listeners.has(topic)) listeners.set(topic, new Set());
  listeners.get(topic).add(draw);
  return () => listeners.get(topic).delete(draw);
}

export function changed(...topics) {
  if (!due.size) setTimeout(tell, 16);
  for (const topic of topics) due.add(topic);
}

function tell() {
  const topics = due;
  due = new Set();
  const draws = new Set([...topics].flatMap((topic) => [...(listeners.get(topic) ?? [])]));
  // One that fails leaves the others their turn, and is a fault of the page that its console tells.
  for (const draw of draws) {
    try {
      draw();
    } catch (error) {
      reportError(error);
    }
  }
}

export const base = () => `/api/v1/sites/${encodeURIComponent(state.site)}`;
export const may = (...roles) => roles.some((role) => state.me?.roles.includes(role));

// The run that a person chose, until a newer one is there: nobody goes on with yesterday's without a choice of today.
export function chosen(asked, runs, usual = runs[0]) {
  if (asked.newest !== runs[0].run_id) Object.assign(asked, { newest: runs[0].run_id, run: "" });
  return runs.find((one) => one.run_id === asked.run) ?? usual;
}
