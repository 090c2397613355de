// A figure over time and when each axis is due, of this machine and of all machines in the index.
import { get } from "./api.js";
import { limits, mark, plot } from "./charts.js";
import { shown } from "./dialogs.js";
import { h, s, show } from "./dom.js";
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
  const pick = (one, parameter) => drawn(place, one, parameter).catch((error) => show(place, h("p", { class: "fault" }, told(error))));
  const choose = h("select", { id: "trend-of", onchange: () => pick(...wanted(measured, choose.value)) }, measured.flatMap((one, at) =>
    (one.subject === "flank" ? FLANK : AXIS).map((name) => h("option", { value: `${at} ${name}` }, `${one.site} · ${named(one)} · ${name}`))));
  pick(...wanted(measured, choose.value));
  return shown(t("trends.title"), [due(measured), h("label", { class: "inline" }, t("trends.figure"), choose), place]);
}

const named = (one) => (one.subject === "flank" ? t("tooth.flank") : one.subject);
const wanted = (measured, text) => [measured[Number(text.split(" ")[0])], text.split(" ")[1]];

function due(measured) {
  const word = (one) => h("td", { class: one.due ? "fault" : null }, `${one.due ? "▲" : "✔"} ${day(one.due_utc)}`);
  return h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": t("trends.due") }, h("table", { class: "due" }, h("thead", {}, h("tr", {}, [t("frame.machine"), t("trends.serial"), t("evaluate.axis"), t("trends.last"), t("trends.due")].map((one) => h("th", {}, one)))),
    h("tbody", {}, measured.map((one) => h("tr", {}, h("td", {}, one.site === state.site ? h("b", {}, one.site) : one.site), h("td", {}, one.serial), h("td", {}, named(one)), h("td", {}, when(one.utc)), word(one))))));
}

// Every point is a stored figure with its U as a bar; ◁ before, ▷ after a correction.
async function drawn(place, one, parameter) {
  const { points } = await get(`${base()}/trend?${new URLSearchParams({ parameter, serial: one.serial, subject: one.subject })}`);
  if (!points.length) return show(place, h("p", { class: "empty" }, t("trends.none")));
  const days = points.map((point) => (Date.parse(point.created_utc) - Date.parse(points[0].created_utc)) / DAY_MS);
  const [low, high] = [points.map((point) => point.value - (point.expanded ?? 0)), points.map((point) => point.value + (point.expanded ?? 0))];
  const bar = (at, on) => s("line", { class: "interval", x1: on.px(days[at]), x2: on.px(days[at]), y1: on.py(low[at]), y2: on.py(high[at]) });
  const nodes = (on) => points.flatMap((point, at) => [bar(at, on), mark(days[at], point.value, point.phase === "after" ? 1 : -1, on, point.phase === "after" ? "up" : "down", 6)]);
  const newest = points[points.length - 1];
  return show(place, h("div", { class: "row head" }, h("span", {}, `${one.site} · ${named(one)} · ${parameter}: `, h("b", { id: "trend-newest" }, number(newest.value)), ` ${unit(newest.unit)} (${t(`phase.${newest.phase}`)})`), h("span", { class: "legend" }, h("i", { class: "down" }, "◁"), t("phase.before"), h("i", { class: "up" }, "▷"), t("phase.after"))),
    plot({ x: limits([...days, 0, 1], 0.05), y: limits([...low, ...high, 0]), label: `${named(one)} ${parameter}`, xName: t("trends.days", { from: day(points[0].created_utc) }), yName: `${parameter} [${unit(newest.unit)}]`, nodes }));
}
