// @ts-check
// Air and material over time: of the command at work as they are read, of a stored run from its captures.
import { get } from "./api.js";
import { chart } from "./chart.js";
import { shown } from "./dialogs.js";
import { h } from "./dom.js";
import { when } from "./figures.js";
import { base, on, state } from "./state.js";
import { t, told } from "./words.js";

/**
 * @typedef {object} Air a reading of the environment; null where no sensor is connected
 * @property {string} utc
 * @property {number|null} [air_degc]
 * @property {number|null} [pressure_hpa]
 * @property {number|null} [humidity_pct]
 * @property {number[]} [material_degc]
 */

const MINUTE_MS = 60_000;

/**
 * The curves of one quantity, minutes after the first reading; a quantity that nothing measures has none.
 * @param {Air[]} airs
 * @returns {Record<"temperature"|"pressure"|"humidity", import("./chart.js").Curve[]>}
 */
export function environmentCurves(airs) {
  const begin = airs.length ? Date.parse(airs[0].utc) : 0;
  const curve = (name, look, value) => {
    const known = airs.filter((one) => Number.isFinite(value(one) ?? NaN));
    return { name, look, x: known.map((one) => (Date.parse(one.utc) - begin) / MINUTE_MS), y: known.map(value) };
  };
  const sensors = Math.max(0, ...airs.map((one) => one.material_degc?.length ?? 0));
  const materials = Array.from({ length: sensors }, (_one, n) =>
    curve(t("environment.material", { number: n + 1 }), `more${(n % MORE) + 1}`, (one) => one.material_degc?.[n]),
  );
  const some = (curves) => curves.filter((one) => one.x.length);
  return {
    temperature: some([curve(t("environment.air"), "new", (one) => one.air_degc), ...materials]),
    pressure: some([curve(t("environment.pressure"), "new", (one) => one.pressure_hpa)]),
    humidity: some([curve(t("environment.humidity"), "new", (one) => one.humidity_pct)]),
  };
}

/** How many colours there are for curves that are laid over others. */
export const MORE = 5;
/** @type {["temperature"|"pressure"|"humidity", string][]} */
const KINDS = [
  ["temperature", "°C"],
  ["pressure", "hPa"],
  ["humidity", "%"],
];

/**
 * A chart of each quantity that was measured; `redraw` shows more readings in the same charts.
 * @param {Air[]} airs
 * @param {("temperature"|"pressure"|"humidity")[]} [which]
 */
export function environmentCharts(airs, which = ["temperature", "pressure", "humidity"]) {
  const box = h("div", { class: "environment" });
  const charts = new Map();
  const redraw = (now) => {
    const curves = environmentCurves(now);
    for (const [kind, unit] of KINDS.filter(([name]) => which.includes(name) && curves[name].length)) {
      const known = charts.get(kind);
      if (known) {
        known.redraw({ curves: curves[kind] });
        continue;
      }
      const xName = t("environment.minutes", { from: when(now[0].utc) });
      const name = t(`environment.${kind}`);
      const what = { title: name, file: `environment-${kind}`, xName, xUnit: "min", yName: name, yUnit: unit };
      charts.set(kind, box.appendChild(chart({ ...what, zero: false, curves: curves[kind] })));
    }
  };
  redraw(airs);
  return { box, redraw };
}

// Readings of the command at work, and each further one as it comes, until `end` is called.
export async function environmentNow(which) {
  const airs = await get(`${base()}/air`);
  const drawn = environmentCharts(airs, which);
  const end = on("ambient", () => {
    if (airs[airs.length - 1]?.utc === state.ambient.utc || !state.ambient.utc) return;
    airs.push(state.ambient);
    drawn.redraw(airs);
  });
  return { box: drawn.box, airs, end };
}

const nothing = () => [h("p", { class: "empty" }, t("environment.none"))];

export async function showEnvironment() {
  try {
    const { box, airs, end } = await environmentNow();
    const parts = airs.length ? [box, h("p", { class: "muted" }, t("environment.what"))] : nothing();
    await shown(t("environment.title"), parts);
    end();
  } catch (error) {
    await shown(t("environment.title"), [h("p", { class: "fault" }, told(error))]);
  }
}

export async function showEnvironmentOf(run) {
  try {
    const airs = await get(`${base()}/runs/${encodeURIComponent(run)}/environment`);
    const parts = [environmentCharts(airs).box, h("p", { class: "muted" }, t("environment.what_run"))];
    await shown(t("environment.title"), airs.length ? parts : nothing());
  } catch (error) {
    await shown(t("environment.title"), [h("p", { class: "fault" }, told(error))]);
  }
}
