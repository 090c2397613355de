// @ts-check
// The wheel by an inspected part: what is wheel, dresser, set-up, axes; its profile now and dressed; points to take.
import { get } from "./api.js";
import { chart } from "./chart.js";
import { h, s } from "./dom.js";
import { number, signed } from "./figures.js";
import { base } from "./state.js";
import { message, t } from "./words.js";

const asked = { part: "" };
const PREFIX = "separated-";

export const partsOf = (run) =>
  run.stages.filter((one) => one.startsWith(PREFIX)).map((one) => one.slice(PREFIX.length));

const place = (run, more) => `${base()}/runs/${encodeURIComponent(run.run_id)}/wheel/${more}`;

export async function wheelOf(run, again) {
  const parts = partsOf(run);
  if (!parts.includes(asked.part)) asked.part = parts[parts.length - 1];
  const found = await get(place(run, encodeURIComponent(asked.part)));
  return [
    h("div", { class: "panel plots" }, profile(found)),
    h(
      "div",
      { class: "panel", tabindex: 0, role: "region", "aria-label": t("wheel.causes") },
      pick(parts, again),
      h("h2", {}, t("wheel.causes")),
      bars(found.separation),
      setup(found.separation),
      order(found.order),
      found.verdict &&
        h(
          "p",
          { class: "verdict-words", id: "wheel-verdict" },
          t(found.verdict.held ? "wheel.held" : "wheel.missed", {
            before: number(found.verdict.before_um),
            after: number(found.verdict.after_um),
          }),
        ),
      taking(run, found),
    ),
  ];
}

function pick(parts, again) {
  const choose = (event) => {
    asked.part = event.target.value;
    again();
  };
  return h(
    "label",
    { class: "inline" },
    t("wheel.part"),
    h(
      "select",
      { id: "pick-part", onchange: choose },
      parts.map((one) => h("option", { value: one, selected: one === asked.part }, one)),
    ),
  );
}

// RMS of each cause as a bar with its u (k = 1); the number is the record's.
function bars({ shares }) {
  const rows = Object.entries(shares);
  const most = Math.max(...rows.map(([, one]) => one.rms_um + one.u_um), 1e-9);
  const x = (value) => (100 * Math.max(0, value)) / most;
  return h(
    "table",
    { class: "errors" },
    h(
      "thead",
      {},
      h(
        "tr",
        {},
        h("th", {}, t("wheel.cause")),
        h("th", { class: "num" }, "RMS [µm]"),
        h("th", { class: "num" }, "u [µm]"),
        h("th", {}, ""),
      ),
    ),
    h(
      "tbody",
      {},
      rows.map(([name, one]) =>
        h(
          "tr",
          { "data-share": name },
          h("th", { scope: "row" }, t(`cause.${name}`)),
          h("td", { class: "num" }, number(one.rms_um)),
          h("td", { class: "num" }, number(one.u_um)),
          h(
            "td",
            { class: "effect" },
            s(
              "svg",
              { class: "bar", viewBox: "0 0 100 8", preserveAspectRatio: "none", "aria-hidden": "true" },
              s("rect", { class: "whole", x: 0, y: 1, width: x(one.rms_um), height: 6 }),
              s("line", {
                class: "interval",
                x1: x(one.rms_um - one.u_um),
                x2: x(one.rms_um + one.u_um),
                y1: 4,
                y2: 4,
              }),
            ),
          ),
        ),
      ),
    ),
  );
}

function setup({ setup: values }) {
  const shown = [
    ["tooth.x", values.x_um, "µm"],
    ["tooth.dressing", values.dressing_um, "µm"],
    ["wheel.swivel", values.swivel_arcsec, "″"],
  ].filter(([, one]) => one && one.u !== null);
  return [
    h("h3", {}, t("wheel.setup")),
    h(
      "dl",
      { class: "facts" },
      shown.map(([name, one, of]) =>
        h("div", {}, h("dt", {}, t(name)), h("dd", {}, `${signed(one.value)} ${of} (u ${number(one.u)})`)),
      ),
    ),
  ];
}

const STEPS = {
  "as ground": "wheel.as_ground",
  "set-up": "wheel.with_setup",
  tables: "wheel.tables",
  wheel: "wheel.dressed",
};

function order(found) {
  if (!found) return null;
  return [
    h("h3", {}, t("wheel.order")),
    h(
      "table",
      { id: "corrections" },
      h(
        "tbody",
        {},
        found.steps.map((one) =>
          h(
            "tr",
            {},
            h("th", { scope: "row" }, t(STEPS[one.name])),
            h("td", { class: "num" }, `${number(one.flank_um)} µm (u ${number(one.u_um)})`),
            h(
              "td",
              { class: "num" },
              one.transmission_arcsec === null
                ? ""
                : `${number(one.transmission_arcsec, 1)} ″ (u ${number(one.transmission_u_arcsec, 1)})`,
            ),
          ),
        ),
      ),
    ),
    h(
      "p",
      { class: "muted" },
      t("wheel.floor", { floor: number(found.floor_um), with: number(found.undressed_floor_um) }),
    ),
  ];
}

function profile(found) {
  const band = (name, look, of) => ({
    name,
    look,
    kind: "band",
    follows: true,
    x: found.theta_deg,
    y: of.um.map((one, at) => one - 2 * of.u_um[at]),
    high: of.um.map((one, at) => one + 2 * of.u_um[at]),
  });
  const line = (name, look, of) => ({ name, look, x: found.theta_deg, y: of.um });
  const curves = [band(t("wheel.old"), "old", found.old), line(t("wheel.old"), "old", found.old)];
  if (found.new) curves.push(band(t("wheel.new"), "new", found.new), line(t("wheel.new"), "new", found.new));
  return chart({
    title: t("wheel.profile"),
    file: `wheel-${found.part}`,
    xName: t("wheel.angle"),
    xUnit: "°",
    yName: t("wheel.surplus"),
    yUnit: "µm",
    zero: true,
    curves,
  });
}

function taking(run, found) {
  if (!found.points) return h("p", { class: "muted", id: "no-points" }, found.why ? message(found.why) : "");
  const most = found.points.correction_um.reduce((top, one) => Math.max(top, Math.abs(one)), 0);
  const link = (kind, name) =>
    h(
      "a",
      {
        class: "key",
        id: `points-${kind}`,
        href: place(run, `${encodeURIComponent(found.part)}/points.${kind}`),
        download: `wheel-${found.part}.${kind}`,
      },
      name,
    );
  return [
    h("h3", {}, t("wheel.points")),
    h("p", {}, t("wheel.points_said", { points: found.points.correction_um.length, most: number(most) })),
    h("div", { class: "row" }, link("csv", "CSV"), link("dxf", "DXF")),
  ];
}
