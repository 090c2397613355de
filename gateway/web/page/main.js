// @ts-check
// Begins: language, who is signed in, then the frame with its screens.
import { get, setKey, whenGone } from "./api.js";
import { h, show } from "./dom.js";
import { build } from "./frame.js";
import { airOf, deaf, listen, refresh, standing } from "./live.js";
import { setUp } from "./setup.js";
import { signIn } from "./signin.js";
import { changed, state } from "./state.js";
import { language, speak, whenMore } from "./words.js";

const root = document.getElementById("page");

function look() {
  document.documentElement.dataset.look = localStorage.getItem("look") ?? "";
}

export async function enter() {
  let me;
  whenGone(() => {});
  try {
    me = await get("/api/v1/me");
  } catch {
    deaf();
    return show(root, signIn(enter));
  }
  setKey(me.csrf ?? "");
  state.me = me;
  whenGone(enter);
  state.sites = await get("/api/v1/sites");
  if (!state.sites.length) return show(root, setUp(enter));
  const wanted = localStorage.getItem("site");
  state.site = (state.sites.find((one) => one.site === wanted) ?? state.sites[0]).site;
  await load();
  show(root, ...build({ again: enter, load }));
  listen();
  document.title = `${state.site} – trueflank`;
}

async function load() {
  const at = `/api/v1/sites/${encodeURIComponent(state.site)}`;
  localStorage.setItem("site", state.site);
  [state.status, state.plan, state.file] = await Promise.all([
    get(`${at}/status`),
    get(`${at}/plan`),
    get(`${at}/site-file`),
  ]);
  state.ask = state.status.run?.ask ?? null;
  state.moves = state.status.run?.moves ?? [];
  state.steps = state.status.run?.steps ?? [];
  state.pictured = Date.now();
  if (state.status.ambient) airOf(state.status.ambient);
  standing(state.status.positions);
  state.taken = await get(`${at}/taken`);
  await refresh();
}

look();
whenMore(() => changed("frame", "status", "jobs", "said", "waiting", "taken"));
speak(language())
  .then(enter)
  .catch((error) => show(root, h("p", { class: "fault", role: "alert" }, String(error.what ?? error))));
