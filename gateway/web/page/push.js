// @ts-check
// Into the control: what will move, who agrees, the nine steps, and the ways back, always in reach.
import { post } from "./api.js";
import { confirmed, machineTyped, secondPerson, shown } from "./dialogs.js";
import { largest, nameOf, proposals } from "./correct.js";
import { record } from "./evaluate.js";
import { failed, h, same, show } from "./dom.js";
import { when } from "./figures.js";
import { heldWords, writing } from "./sentence.js";
import { lamps } from "./lamps.js";
import { refresh } from "./live.js";
import { field } from "./signin.js";
import { base, changed, chosen, may, on, state } from "./state.js";
import { capital, message, recorded, say, stateOf, t, told } from "./words.js";

export const push = { open };
const asked = { run: "" };
// So many tables stand beside each other: the lamps below them stay in sight.
const MANY = 4;

function open(root) {
  const parts = {
    plan: h("div", { class: "panel" }),
    steps: h("div", { class: "panel" }),
    back: h("div", { class: "panel back" }),
    answer: h("div", { class: "panel answer", "aria-live": "polite" }),
  };
  show(
    root,
    h(
      "div",
      { class: "two" },
      h("div", { class: "stack" }, parts.plan, parts.steps),
      h("div", { class: "stack" }, parts.back, parts.answer),
    ),
  );
  const drawPlan = () => plan(parts.plan).catch((error) => failed(parts.plan, told(error)));
  const draw = () => {
    steps(parts.steps);
    back(parts.back);
    answer(parts.answer);
  };
  drawPlan();
  draw();
  // While a command is at work the keys are off, from its first picture on.
  let busy = Boolean(state.status.run);
  const began = () => {
    if (Boolean(state.status.run) === busy) return;
    busy = !busy;
    drawPlan();
  };
  const ends = [
    on("status", began),
    on("frame", () => {
      drawPlan();
      draw();
    }),
    on("jobs", () => {
      drawPlan();
      draw();
    }),
    on("said", draw),
  ];
  return () => {
    for (const end of ends) end();
  };
}

const replaces = (one) =>
  t("push.replaces", {
    points: one.new.deviations.length,
    axis: one.axis,
    most: largest(one),
    old: t(one.old_enabled ? "correct.was_on" : "correct.was_off"),
  });

async function plan(box) {
  const runs = await proposals();
  if (!runs.length) return same(box) || show(box, h("p", { class: "empty" }, t("correct.none")));
  const run = chosen(asked, runs);
  asked.run = run.run_id;
  const proposal = await record(run.run_id, "proposal");
  const busy = Boolean(state.status.run);
  const needed = mustAgree(run.run_id);
  const agreed = state.approved[run.run_id]?.until > Date.now();
  const looked = Boolean(lastLook(run.run_id)?.ended_utc) && !lastLook(run.run_id).error;
  const acts = actsNow(proposal);
  // Nothing is written over a table that nobody stands for: first it is put right.
  const settled = state.tables?.settled !== false && !state.status.held.length && !state.status.left.length;
  if (
    same(
      box,
      settled,
      runs.map((one) => [one.run_id, one.state]),
      run.run_id,
      busy,
      may("operator"),
      looked,
      needed,
      acts,
      agreed && state.approved[run.run_id].by,
    )
  )
    return;
  show(
    box,
    h(
      "div",
      { class: "row head" },
      h("h2", {}, t("push.plan")),
      h(
        "label",
        { class: "inline" },
        t("evaluate.run"),
        h(
          "select",
          {
            id: "pick-run",
            onchange: (event) => {
              asked.run = event.target.value;
              plan(box);
            },
          },
          runs.map((one) =>
            h("option", { value: one.run_id, selected: one === run }, `${when(one.created_utc)} · ${stateOf(one)}`),
          ),
        ),
      ),
    ),
    h(
      "ul",
      { class: `moves${proposal.changes.length > MANY ? " many" : ""}` },
      proposal.changes.map((one) => h("li", {}, h("b", {}, nameOf(one)), ` ${recorded(one.skipped) || replaces(one)}`)),
    ),
    acts
      ? h("p", { class: "good", id: "acts-now" }, `● ${t("push.acts_now")}`)
      : [
          h("p", {}, t(needed > 1 ? "push.two" : "push.one")),
          needed > 1 &&
            h(
              "p",
              { id: "approved" },
              agreed
                ? `✔ ${t("push.approved_by", { names: state.approved[run.run_id].by.join(", ") })}`
                : `○ ${t("push.not_approved")}`,
            ),
          h(
            "div",
            { class: "keys start three" },
            h(
              "button",
              { id: "show-plan", disabled: busy || !may("operator"), onclick: () => give("push", { run: run.run_id }) },
              `1 · ${t("push.show")}`,
            ),
            // One step after the other: first what it will do, then who agrees where two must, then the write.
            needed > 1 &&
              h(
                "button",
                { id: "approve", disabled: busy || !looked, onclick: () => approve(run.run_id) },
                `2 · ${t("push.approve")}`,
              ),
            h(
              "button",
              {
                id: "write",
                class: "primary",
                disabled: busy || !settled || !looked || (needed > 1 && !agreed) || !may("operator"),
                title: settled ? (looked ? null : t("push.look_first")) : t("push.not_settled"),
                onclick: () => write(run.run_id),
              },
              `${needed > 1 ? 3 : 2} · ${t("push.write")}`,
            ),
          ),
        ],
  );
}

// Whether every table of this proposal is on: pushed after it was made, and an axis' own table with its very points.
const inControl = ({ axis, new: table }) =>
  (state.tables?.tables ?? []).find(
    (one) =>
      one.axis === axis &&
      one.kind === table.kind &&
      (table.kind !== "cross" || one.table.endsWith(String(table.index))),
  );

function actsNow({ changes, created_utc: made }) {
  const wanted = changes.filter((one) => !one.skipped);
  const acts = (change, seen) =>
    seen?.acts === "on" &&
    Date.parse(seen.utc) > Date.parse(made) &&
    (!seen.deviations || same_(seen.deviations, change.new.deviations));
  return wanted.length > 0 && wanted.every((one) => acts(one, inControl(one)));
}
const same_ = (one, other) =>
  one.length === other.length && one.every((value, at) => Math.abs(value - other[at]) < 1e-6);

async function give(path, body) {
  try {
    await post(`${base()}/commands/${path}`, body);
  } catch (error) {
    shown(t("push.refused"), [h("p", { class: "fault" }, told(error))]);
  }
}

// A second person signs beside the first; whoever is signed in and may approve can do so with the own name.
async function approve(run) {
  const made = await secondPerson(t("push.approve"), [h("p", {}, t("push.approve_what"))], async (by) => {
    const machine = state.site;
    return post(`${base()}/runs/${encodeURIComponent(run)}/approve`, { machine, by });
  });
  if (made) await refresh();
  changed("jobs");
}

async function write(run) {
  const risk = riskAsked(run);
  const moves = toldOnce(newestPlan(run), Boolean(risk));
  const machine = await machineTyped(
    t("push.write"),
    [
      h("p", {}, t("push.write_what")),
      riskParts(risk),
      moves.length > 0 && h("h3", {}, t("push.last_look", { at: lookedAt(run) })),
      moves.length > 0 &&
        h(
          "ul",
          { class: "moves" },
          moves.map((one) => h("li", {}, message(one))),
        ),
    ],
    state.site,
  );
  if (machine) give("push", { run, apply: true, machine, risk: risk ? risk.value.trim() : "" });
}

// One person alone on a connection that others can read and change types that they take this risk.
const RISK = "unprotected";
export const riskParts = (risk) =>
  risk && [
    h("p", { class: "warn" }, `▲ ${recorded(state.status.unprotected)}`),
    field(t("push.risk", { word: RISK }), risk),
  ];
export const riskAsked = (run) =>
  state.status.unprotected &&
  mustAgree(run) < 2 &&
  h("input", { id: "typed-risk", autocomplete: "off", spellcheck: "false" });

// What the last look at this plan told: which way things will move, and what is against it.
const lastLook = (run) => state.jobs.find((one) => one.kind === "push" && one.run_id === run);
// That the connection is open to others is said of each table, and by the start: one is enough, none beside the risk.
const ofRoad = (one) =>
  one?.fields?.road !== undefined ||
  Object.values(one?.fields ?? {})
    .flat()
    .some((inner) => inner?.code !== undefined && ofRoad(inner));
function toldOnce(lines, known) {
  let seen = known;
  return lines.filter((one) => {
    if (!state.status.unprotected || !ofRoad(one)) return true;
    const first = !seen;
    seen = true;
    return first;
  });
}
// How many must agree: what the site says; else one, and two where the last look found something to be looked at twice.
function mustAgree(run) {
  if (state.file.site.approvals) return state.file.site.approvals;
  return state.approved[run]?.until > Date.now() ? 2 : Math.max(1, ...newestPlan(run).flatMap(people));
}
const people = (one) => [
  one?.fields?.have === undefined ? 1 : Number(one.fields.needed),
  ...Object.values(one?.fields ?? {})
    .flat()
    .filter((inner) => inner?.code !== undefined)
    .flatMap(people),
];
const newestPlan = (run) => lastLook(run)?.lines ?? [];
const lookedAt = (run) => when(lastLook(run).ended_utc || lastLook(run).started_utc).slice(11);

function steps(box) {
  const run = state.status.run;
  // Tables of one transaction go step by step together: they share their lamps until one of them stays behind.
  // After its end they stay as they came to be, on every page.
  const every = run ? state.steps : (state.jobs.find((one) => OWN.includes(one.kind))?.steps ?? []);
  const together = new Map();
  for (const axis of new Set(every.map(([one]) => one))) {
    const kinds = every.filter(([one]) => one === axis).map(([, kind]) => kind);
    const known = together.get(String(kinds)) ?? { names: [], kinds };
    known.names.push(axis);
    together.set(String(kinds), known);
  }
  show(
    box,
    h("h2", {}, t("push.steps")),
    together.size
      ? [...together.values()].map((one) => lamps(one.names.join(", "), one.kinds, Boolean(run)))
      : lamps("", [], false),
  );
}

function back(box) {
  const tables = state.tables?.tables ?? [];
  const whole = state.tables?.rollback ?? { back: [], stays: [] };
  const held = writing() ? [] : state.status.held;
  // What a program of ours left in the control is put right by the same key as a push that did not end.
  const open_ = held.length > 0 || state.status.left.length > 0;
  const halfway = held.some((one) => one.back);
  const busy = Boolean(state.status.run);
  if (same(box, tables, whole, held, open_, busy)) return;
  show(
    box,
    h("h2", {}, t("push.ways_back")),
    held.map((one) =>
      h(
        "p",
        { class: one.loud ? "fault" : "warn", role: "alert" },
        `${one.loud ? "✖" : "▲"} ${capital(heldWords(one))}`,
      ),
    ),
    h(
      "div",
      { class: "keys start" },
      h(
        "button",
        {
          id: "recover",
          class: open_ ? "primary" : null,
          disabled: busy || !may("operator", "service"),
          onclick: () => give("recover", {}),
        },
        t("push.recover"),
      ),
      open_ &&
        !halfway &&
        h(
          "button",
          {
            id: "recover-apply",
            class: "danger",
            disabled: busy || !may("operator", "service"),
            onclick: () => applied("recover", {}, t("push.recover_apply")),
          },
          t("push.recover_apply"),
        ),
      // A rollback that was interrupted ends as the person chooses; each key says what acts then.
      halfway &&
        ["finish", "undo"].map((choice) =>
          h(
            "button",
            {
              id: `recover-${choice}`,
              class: "danger",
              disabled: busy || !may("operator", "service"),
              onclick: () => applied("recover", { choice }, t(`push.recover_${choice}`), ends(held, choice)),
            },
            t(`push.recover_${choice}`),
          ),
        ),
      h(
        "button",
        { id: "verify", disabled: busy || !may("operator") || !tables.length, onclick: compare },
        t("push.verify"),
      ),
      // One consent may have changed tables of several axes: all of them go back with one press.
      whole.back.length > 1 &&
        h(
          "button",
          {
            id: "roll-back-all",
            disabled: busy || open_ || !may("operator"),
            onclick: () => applied("roll-back", { table: "" }, t("push.roll_back_all"), backAgain(whole)),
          },
          t("push.roll_back_all"),
        ),
    ),
    tables.length
      ? h(
          "table",
          {},
          h(
            "thead",
            {},
            h(
              "tr",
              {},
              [t("push.table"), t("push.state"), ""].map((one) => h("th", {}, one)),
            ),
          ),
          h(
            "tbody",
            {},
            tables.map((one) =>
              h(
                "tr",
                {},
                h(
                  "td",
                  {},
                  h("b", {}, one.table),
                  h("small", { class: "below" }, one.id ? `${t("push.id")} ${one.id.slice(0, 6)}` : ""),
                ),
                h(
                  "td",
                  { class: one.acts === "on" || one.acts === "off" ? null : "fault" },
                  actsWords(one),
                  h("small", { class: "below" }, when(one.utc)),
                ),
                h(
                  "td",
                  {},
                  h(
                    "div",
                    { class: "keys" },
                    h(
                      "button",
                      {
                        class: "off",
                        "data-table": one.table,
                        disabled: busy || !may("operator", "service"),
                        onclick: () => disable(one),
                      },
                      t("push.disable"),
                    ),
                    h(
                      "button",
                      {
                        class: "back",
                        "data-table": one.table,
                        disabled: busy || open_ || !may("operator") || !one.back.length,
                        onclick: () =>
                          applied(
                            "roll-back",
                            { table: one.axis },
                            `${t("push.roll_back")}: ${one.axis}`,
                            backAgain(one),
                          ),
                      },
                      t("push.roll_back"),
                    ),
                  ),
                ),
              ),
            ),
          ),
        )
      : h("p", { class: "empty" }, t("frame.no_tables")),
  );
}

const disable = (one) =>
  applied(
    "disable",
    { axis: one.axis, table: one.kind === "axis" ? "" : one.table.split("-").slice(1).join("-") },
    `${t("push.disable")}: ${one.table}`,
  );

// One state of each table, by one function of the service: journal and read-back.
export const ACTS = { on: "●", off: "○", differs: "▲", unknown: "✖" };
export const actsWords = (one) => `${ACTS[one.acts]} ${t(`push.acts_${one.acts}`)}`;
// Everything that goes back with one press, what acts in its place, how far that moves its axis, and what of the same
// push stays on: the figures are those of the terminal.
const backAgain = (one) => [
  ...one.back.map((each) => [
    h("b", {}, each.table),
    ` ${recorded(each.newer)} → ${recorded(each.older)}`,
    h("small", { class: "below" }, capital(say(each.move.code, each.move.fields, 0, each.move.words))),
  ]),
  ...(one.stays.length ? [t("push.stays", { tables: one.stays.join(", ") })] : []),
];
const ends = (held, choice) =>
  held
    .filter((one) => one.back)
    .map((one) =>
      t("push.acts_then", {
        table: one.fields.axis,
        acts: recorded(choice === "finish" ? one.fields.new : one.fields.old),
      }),
    );

const compare = async () => {
  if (await confirmed(t("push.verify"), t("push.verify_what"))) give("verify-table", {});
};

// First what it will do, then the machine's name.
async function applied(path, body, title, lines = []) {
  const machine = await machineTyped(
    title,
    [
      h("p", {}, t("push.back_what")),
      lines.length > 0 &&
        h(
          "ul",
          { class: "moves" },
          lines.map((one) => h("li", {}, one)),
        ),
    ],
    state.site,
  );
  if (machine) give(path, { ...body, apply: true, machine });
}

const OWN = ["push", "disable", "roll-back", "recover", "verify-table"];

function answer(box) {
  const job = state.jobs.find((one) => OWN.includes(one.kind));
  const run = state.status.run;
  const lines = run
    ? state.said.filter((one) => !["count", "detail"].includes(one.kind)).slice(-12)
    : (job?.lines ?? []);
  const error = run ? null : job?.error;
  if (same(box, lines, error, job?.job, Boolean(run))) return;
  // A look at a push is none.
  const head = run
    ? t("push.at_work")
    : job
      ? `${job.data?.refusals ? t("push.show") : t(`kind.${job.kind.replace("-", "_")}`)}: ${t(`job.${job.state}`)}`
      : t("push.no_answer");
  const once = toldOnce(error ? [error, ...lines] : lines, false);
  show(
    box,
    h("h2", {}, head),
    error && h("p", { class: "fault", id: "refused", role: "alert" }, told(once.shift())),
    h(
      "ul",
      { class: "lines" },
      once.map((one) => h("li", {}, capital(message(one)))),
    ),
  );
}
