// @ts-check
// A figure over time and when each axis is due, of this machine and of all machines in the index.
import { get } from "./api.js";
import { chart } from "./chart.js";
import { shown } from "./dialogs.js";
import { h, show } from "./dom.js";
import { day, number, unit, when } from "./figures.js";
import { base, state } from "./state.js";
import { t, told } from "./words.js";

const AXIS = ["E", "R", "B", "A", "M"];
const FLANK = ["rms"];
const DAY_MS = 86_400_000;

export async function trends() {
  let measured;
  try {
    ({ measured } = await get(`${base()}/due`));
  } catch (error) {
    return shown(t("trends.title"), [h("p", { class: "fault" }, told(error))]);
  }
  if (!measured.length) return shown(t("trends.title"), [h("p", { class: "empty" }, t("trends.none"))]);
  const place = h("div", { class: "trend" });
  const pick = (one, parameter) =>
    drawn(place, one, parameter).catch((error) => show(place, h("p", { class: "fault" }, told(error))));
  const choose = h(
    "select",
    { id: "trend-of", onchange: () => pick(...wanted(measured, choose.value)) },
    measured.flatMap((one, at) =>
      (one.subject === "flank" ? FLANK : AXIS).map((name) =>
        h("option", { value: `${at} ${name}` }, `${one.site} · ${named(one)} · ${name}`),
      ),
    ),
  );
  pick(...wanted(measured, choose.value));
  return shown(t("trends.title"), [due(measured), h("label", { class: "inline" }, t("trends.figure"), choose), place]);
}

const named = (one) => (one.subject === "flank" ? t("tooth.flank") : one.subject);
const wanted = (measured, text) => [measured[Number(text.split(" ")[0])], text.split(" ")[1]];

function due(measured) {
  const word = (one) => h("td", { class: one.due ? "fault" : null }, `${one.due ? "▲" : "✔"} ${day(one.due_utc)}`);
  return h(
    "div",
    { class: "scroll", tabindex: 0, role: "region", "aria-label": t("trends.due") },
    h(
      "table",
      { class: "due" },
      h(
        "thead",
        {},
        h(
          "tr",
          {},
          [t("frame.machine"), t("trends.serial"), t("evaluate.axis"), t("trends.last"), t("trends.due")].map((one) =>
            h("th", {}, one),
          ),
        ),
      ),
      h(
        "tbody",
        {},
        measured.map((one) =>
          h(
            "tr",
            {},
            h("td", {}, one.site === state.site ? h("b", {}, one.site) : one.site),
            h("td", {}, one.serial),
            h("td", {}, named(one)),
            h("td", {}, when(one.utc)),
            word(one),
          ),
        ),
      ),
    ),
  );
}

// Every point is a stored figure with its U as a band; ◁ before, ▷ after a correction.
async function drawn(place, one, parameter) {
  const { points } = await get(
    `${base()}/trend?${new URLSearchParams({ parameter, serial: one.serial, subject: one.subject })}`,
  );
  if (!points.length) return show(place, h("p", { class: "empty" }, t("trends.none")));
  const days = points.map((point) => (Date.parse(point.created_utc) - Date.parse(points[0].created_utc)) / DAY_MS);
  const [low, high] = [
    points.map((point) => point.value - (point.expanded ?? 0)),
    points.map((point) => point.value + (point.expanded ?? 0)),
  ];
  const newest = points[points.length - 1];
  const of = (phase) =>
    points.map((point, at) => [point, at]).filter(([point]) => (point.phase === "after") === (phase === "after"));
  const curves = ["before", "after"]
    .map((phase) => ({
      name: t(`phase.${phase}`),
      look: phase === "after" ? "up" : "down",
      kind: "points",
      approach: phase === "after" ? 1 : -1,
      x: of(phase).map(([, at]) => days[at]),
      y: of(phase).map(([point]) => point.value),
    }))
    .filter((curve) => curve.x.length);
  return show(
    place,
    h(
      "span",
      {},
      `${one.site} · ${named(one)} · ${parameter}: `,
      h("b", { id: "trend-newest" }, number(newest.value)),
      ` ${unit(newest.unit)} (${t(`phase.${newest.phase}`)})`,
    ),
    chart({
      title: `${named(one)} ${parameter}`,
      xName: t("trends.days", { from: day(points[0].created_utc) }),
      xUnit: "d",
      yName: parameter,
      yUnit: unit(newest.unit),
      curves: [{ name: "± U", look: "new", kind: "band", x: days, y: low, high }, ...curves],
    }),
  );
}
