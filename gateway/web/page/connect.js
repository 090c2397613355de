// @ts-check
// The devices, and the doctor's lines about the road to the control, each with its fix.
import { post } from "./api.js";
import { shown } from "./dialogs.js";
import { h, same, show } from "./dom.js";
import { when } from "./figures.js";
import { accounts, ownFactor } from "./people.js";
import { base, may, on, state } from "./state.js";
import { identity, trust } from "./trust.js";
import { say, t, told } from "./words.js";

export const connect = { open };
const MARK = { open: "✔", "in use": "▶", lost: "▲", failed: "✖", closed: "○", ok: "✔", failed_check: "✖" };

function open(root) {
  const parts = {
    devices: h("div", { class: "panel" }),
    doctor: h("div", { class: "panel" }),
    factor: h("div", { class: "panel" }),
    people: h("div", { class: "panel" }),
    trust: h("div", { class: "panel" }),
    identity: h("div", { class: "panel" }),
  };
  show(
    root,
    h(
      "div",
      { class: "two" },
      h(
        "div",
        { class: "stack" },
        parts.devices,
        may("service") ? [parts.trust, parts.identity, parts.people] : null,
        parts.factor,
      ),
      parts.doctor,
    ),
  );
  const draw = () => {
    devices(parts.devices);
    doctor(parts.doctor);
  };
  draw();
  ownFactor(parts.factor);
  if (may("service")) {
    trust(parts.trust);
    identity(parts.identity);
    accounts(parts.people);
  }
  const ends = [on("frame", draw), on("jobs", draw)];
  return () => {
    for (const end of ends) end();
  };
}

function devices(box) {
  if (same(box, state.status.devices)) return;
  show(
    box,
    h("h2", {}, t("connect.devices")),
    h(
      "table",
      { class: "devices" },
      h(
        "thead",
        {},
        h(
          "tr",
          {},
          [t("connect.state"), t("connect.name"), t("connect.driver"), t("push.since")].map((one) => h("th", {}, one)),
        ),
      ),
      h(
        "tbody",
        {},
        state.status.devices.map((one) => [
          h(
            "tr",
            {},
            h(
              "td",
              { class: `state ${one.state.replace(" ", "-")}` },
              `${MARK[one.state]} ${t(`device.${one.state.replace(" ", "_")}`)}`,
            ),
            h("td", {}, h("b", {}, one.name)),
            h("td", {}, one.driver),
            h("td", {}, when(one.since_utc)),
          ),
          one.error &&
            h(
              "tr",
              {},
              h(
                "td",
                { colspan: 4, class: "fault" },
                told(one.error),
                h("p", { class: "fix" }, `→ ${t("connect.again")}`),
              ),
            ),
        ]),
      ),
    ),
  );
}

// What is said of several axes in the same words stands once, with their names.
function grouped(lines) {
  const found = new Map();
  for (const one of lines) {
    const said = [
      one.check,
      one.code,
      one.outcome,
      { ...one.fields, axis: "" },
      one.fix && say(one.code, one.fields, 1, one.fix),
    ];
    const known = one.fields?.axis && found.get(JSON.stringify(said));
    if (known) known.fields.axis += `, ${one.fields.axis}`;
    else found.set(JSON.stringify(one.fields?.axis ? said : [found.size]), { ...one, fields: { ...one.fields } });
  }
  return [...found.values()];
}

function doctor(box) {
  const job = state.jobs.find((one) => one.kind === "doctor");
  const busy = Boolean(state.status.run);
  if (same(box, job?.job, job?.state, busy)) return;
  const lines = grouped(job?.data?.lines ?? []);
  const bad = lines.filter((one) => one.outcome !== "ok");
  const examine = () =>
    post(`${base()}/commands/doctor`).catch((error) =>
      shown(t("connect.examine"), [h("p", { class: "fault" }, told(error))]),
    );
  show(
    box,
    h("h2", {}, t("connect.doctor")),
    h(
      "button",
      { id: "doctor", class: "primary", disabled: busy || !may("operator", "service"), onclick: examine },
      t("connect.examine"),
    ),
    job?.error && h("p", { class: "fault", role: "alert" }, told(job.error)),
    !lines.length && !job?.error && h("p", { class: "empty" }, t("connect.examine_what")),
    lines.length > 0 &&
      h(
        "p",
        {},
        bad.length ? `▲ ${t("connect.bad", { count: bad.length })}` : `✔ ${t("connect.well", { count: lines.length })}`,
      ),
    h(
      "ul",
      { class: "checks" },
      [...bad, ...lines.filter((one) => one.outcome === "ok")].map((one) =>
        h(
          "li",
          { class: one.outcome === "ok" ? "ok" : "bad" },
          h("span", { class: "mark", "aria-hidden": "true" }, one.outcome === "ok" ? "✔" : "✖"),
          h(
            "div",
            {},
            h("b", {}, checkName(one.check)),
            ` ${say(one.code, one.fields, 0, one.what)}`,
            one.fix && h("p", { class: "fix" }, `→ ${say(one.code, one.fields, 1, one.fix)}`),
          ),
        ),
      ),
    ),
  );
}

// An axis' own name is none of the catalogue's.
function checkName(name) {
  const found = t(`check.${name.toLowerCase().replace(/[ -]/g, "_")}`);
  return found.startsWith("[") ? name : found;
}
