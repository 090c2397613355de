// @ts-check
// A chart one can work with: zoom, pan, touch and keys, a cursor with the values of all curves, a legend that hides.
import { exported } from "./chartexport.js";
import { fitted, FITS } from "./chartfit.js";
import { handled } from "./chartinput.js";
import { ticks } from "./charts.js";
import { h, same, show, write } from "./dom.js";
import { number, signed } from "./figures.js";
import { t } from "./words.js";

// The library is one file of its own, loaded with the first chart.
let library = null;
const load = () =>
  (library ??= new Promise((done, fail) => {
    const sheet = h("link", { rel: "stylesheet", href: asset("uPlot.min.css") });
    const script = h("script", { src: asset("uPlot.iife.min.js"), onload: () => done(window.uPlot), onerror: fail });
    document.head.append(sheet, script);
  }));

// Vendored files are served beside the modules, by the name of the same build.
export const asset = (name) => new URL(`../vendor/${name}`, import.meta.url).href;

const colourOf = (look) => getComputedStyle(document.documentElement).getPropertyValue(`--${look}`).trim() || "#1c1c1c";
/**
 * @typedef {object} Curve
 * @property {string} name what it is called in legend and files; curves of one name are hidden together
 * @property {string} look the colour's role: up, down, old, new, difference
 * @property {number[]} x
 * @property {number[]} y
 * @property {string} [kind] "line" (as without one), "points", or "band" from `y` to `high`
 * @property {number[]} [high]
 * @property {boolean} [dashed]
 * @property {number} [approach] +1 and -1 for points: the form of a point tells its direction
 * @property {boolean} [fit] whether lines are fitted to it
 * @property {boolean} [follows] whether a line that is taken off its neighbours is taken off it, too
 */

/**
 * A chart in a box of its own.
 * @param {{title: string, file?: string, xName: string, xUnit: string, yName: string, yUnit: string, curves: Curve[],
 *   fits?: boolean, fit?: string, upright?: number|null, zero?: boolean, across?: number[]}} what `across` are the ends
 *   of the abscissa at least, `upright` where a line stands
 */
export function chart(what) {
  const box = h("figure", {
    class: "chart",
    tabindex: 0,
    role: "group",
    "aria-label": `${what.title}. ${t("chart.keys")}`,
  });
  const parts = {
    tools: h("div", { class: "chart-tools" }),
    place: h("div", { class: "chart-place" }),
    legend: h("div", { class: "chart-legend" }),
  };
  show(box, h("div", { class: "row head" }, h("h2", {}, what.title), parts.tools), parts.place, parts.legend);
  const now = { what, box, parts, hidden: new Set(), fit: what.fit ?? "none", plot: null, at: null };
  const draw = () => load().then((uPlot) => drawn(now, uPlot));
  tools(now, draw);
  handled(now);
  new ResizeObserver(() => (now.plot ? now.plot.setSize(sizeOf(now)) : draw())).observe(parts.place);
  // Other curves in the same chart: what is hidden, fitted and zoomed stays.
  box.redraw = (next) => {
    now.what = { ...now.what, ...next };
    draw();
  };
  box.chart = now;
  return box;
}

// A line of fewer points than this marks each of them.
const FEW = 60;
const single = (now) => new Set(now.data[0]).size === 1;

const sizeOf = ({ parts: { place } }) => ({
  width: Math.max(place.clientWidth, 160),
  height: Math.max(place.clientHeight, 120),
});

function tools(now, draw) {
  const choose = (event) => {
    now.fit = event.target.value;
    now.scales = null;
    draw();
  };
  const fit =
    now.what.fits &&
    h(
      "select",
      { class: "fit", "aria-label": t("chart.fit"), onchange: choose },
      FITS.map((one) => h("option", { value: one, selected: one === now.fit }, t(`chart.fit_${one}`))),
    );
  const key = (kind, name) =>
    h(
      "button",
      {
        class: "small",
        "data-save": kind,
        "aria-label": t("chart.save_as", { kind: name }),
        onclick: () => exported(now, kind),
      },
      name,
    );
  show(
    now.parts.tools,
    fit,
    h(
      "button",
      {
        class: "small",
        "data-reset": "",
        "aria-label": t("chart.reset"),
        title: t("chart.reset"),
        onclick: () => now.reset?.(),
      },
      "⤢",
    ),
    key("png", "PNG"),
    key("svg", "SVG"),
    key("csv", "CSV"),
  );
}

// All places of all curves in one ascending list, each curve with a value or nothing at each of them.
export function aligned(curves) {
  const columns = curves.flatMap((one) =>
    one.kind === "band"
      ? [
          [one, one.y],
          [one, one.high],
        ]
      : [[one, one.y]],
  );
  const most = new Map();
  for (const [one] of columns) {
    const seen = new Map();
    for (const x of one.x) seen.set(x, (seen.get(x) ?? 0) + 1);
    for (const [x, count] of seen) most.set(x, Math.max(most.get(x) ?? 0, count));
  }
  const xs = [...most.keys()].sort((a, b) => a - b).flatMap((x) => Array(most.get(x)).fill(x));
  const first = new Map();
  xs.forEach((x, at) => {
    if (!first.has(x)) first.set(x, at);
  });
  const values = columns.map(([one, ys]) => {
    const [column, used] = [Array(xs.length).fill(null), new Map()];
    one.x.forEach((x, n) => {
      const at = first.get(x) + (used.get(x) ?? 0);
      used.set(x, (used.get(x) ?? 0) + 1);
      if (Number.isFinite(ys[n])) column[at] = ys[n];
    });
    return column;
  });
  return { xs, values, columns };
}

// All that a plot is built of but its numbers.
function formOf(now, columns) {
  const curves = columns.map(([{ name, look, kind, dashed, approach }, ys]) =>
    [name, look, kind, dashed, approach, ys.length < FEW].join(),
  );
  const { title, xName, xUnit, yName, yUnit, upright } = now.what;
  const { look, words } = document.documentElement.dataset;
  return JSON.stringify([
    curves,
    single(now),
    [...now.hidden],
    look,
    words,
    title,
    xName,
    xUnit,
    yName,
    yUnit,
    upright === undefined,
  ]);
}

function drawn(now, UPlot) {
  const { what, parts } = now;
  const curves = what.fits ? fitted(what.curves, now.fit, t) : what.curves;
  const { xs, values, columns } = aligned(curves);
  now.curves = curves;
  now.data = [xs, ...values];
  // The same curves with other numbers: the plot stays, and takes them.
  const form = formOf(now, columns);
  if (now.plot && now.form === form) {
    now.auto = !now.zoomed;
    now.plot.setData(now.data, !now.zoomed);
    return told(now);
  }
  now.form = form;
  const scales = now.plot && now.zoomed ? { x: { ...now.plot.scales.x }, y: { ...now.plot.scales.y } } : null;
  now.auto = true;
  now.plot?.destroy();
  now.plot = new UPlot(options(now, UPlot, columns), now.data, parts.place);
  if (scales)
    now.plot.batch(() => {
      for (const name of ["x", "y"]) now.plot.setScale(name, { min: scales[name].min, max: scales[name].max });
    });
  legend(now, curves);
  told(now);
}

function options(now, UPlot, columns) {
  const { what } = now;
  const alone = single(now);
  const series = [
    {},
    ...columns.map(([one]) =>
      seriesOf(one, { single: alone, edge: one.kind === "band", UPlot, shown: !now.hidden.has(one.name) }),
    ),
  ];
  const bands = columns.flatMap(([one], n) =>
    one.kind === "band" && columns[n - 1]?.[0] === one
      ? [{ series: [n + 1, n], fill: `color-mix(in srgb, ${colourOf(one.look)} 18%, transparent)` }]
      : [],
  );
  const axis = (side, name, unit) => ({
    scale: side,
    stroke: colourOf("quiet"),
    grid: { stroke: colourOf("grid"), width: 1 },
    ticks: { stroke: colourOf("grid"), width: 1 },
    font: `13px ${getComputedStyle(document.body).fontFamily}`,
    labelFont: `13px ${getComputedStyle(document.body).fontFamily}`,
    label: unit ? `${name} [${unit}]` : name,
    labelSize: 20,
    // As wide as its longest number, in a font of 13 px.
    size: (_plot, values) =>
      side === "y" ? Math.max(44, 18 + 8 * Math.max(...(values ?? [""]).map((one) => one.length))) : 34,
    splits: (plot, _axis, low, high) =>
      ticks(
        low,
        high,
        (side === "x" ? plot.bbox.width : plot.bbox.height) / devicePixelRatio / (side === "x" ? 80 : 44),
      ).at,
    values: (_plot, splits) => splits.map((one) => number(one, digitsOf(splits))),
  });
  return {
    ...sizeOf(now),
    series,
    bands,
    legend: { show: false },
    axes: [axis("x", what.xName, what.xUnit), axis("y", what.yName, what.yUnit)],
    padding: [10, 14, 0, 0],
    scales: {
      x: {
        time: false,
        range: (_plot, low, high) =>
          now.auto
            ? roomy(
                Math.min(low ?? 0, ...(now.what.across ?? [])),
                Math.max(high ?? 1, ...(now.what.across ?? [])),
                alone && !now.what.across ? 1 : 0.03,
              )
            : [low, high],
      },
      y: { range: (_plot, low, high) => (now.auto ? withZero(what, low, high) : [low, high]) },
    },
    cursor: { drag: { x: true, y: true, uni: 24, setScale: true }, points: { size: 9 }, focus: { prox: 24 } },
    hooks: {
      setCursor: [() => told(now)],
      setScale: [
        (plot, name) => {
          if (plot.status) now.zoomed = isZoomed(now, plot, name);
        },
      ],
      drawClear: [(plot) => ground(plot)],
      draw: [
        (plot) => {
          now.auto = false;
          marks(plot, now.what);
        },
      ],
    },
  };
}

// As many digits as tell two neighbours apart.
const digitsOf = (splits) =>
  splits[1] > splits[0] ? Math.min(9, Math.max(0, -Math.floor(Math.log10(splits[1] - splits[0]) + 1e-9))) : 2;

const roomy = (low, high, part) => {
  const more = (high - low || 1) * part;
  return [(low ?? 0) - more, (high ?? 1) + more];
};

function withZero(what, low, high) {
  if (low === null || low === undefined) return [-5, 5];
  if (what.zero === false) return low === high ? [low - 0.5, high + 0.5] : roomy(low, high, 0.06);
  const [a, b] = [Math.min(low, 0), Math.max(high, 0)];
  return roomy(a, b === a ? a + 1 : b, 0.06);
}

function isZoomed(now, plot, name) {
  if (now.resetting) return false;
  const [low, high] =
    name === "x"
      ? roomy(now.data[0][0], now.data[0][now.data[0].length - 1], 0.03)
      : [plot.scales.y.min, plot.scales.y.max];
  return now.zoomed || (name === "x" && (plot.scales.x.min > low + 1e-9 || plot.scales.x.max < high - 1e-9));
}

function ground(plot) {
  plot.ctx.save();
  plot.ctx.fillStyle = colourOf("field");
  plot.ctx.fillRect(plot.bbox.left, plot.bbox.top, plot.bbox.width, plot.bbox.height);
  plot.ctx.restore();
}

function marks(plot, what) {
  const pen = plot.ctx;
  pen.save();
  pen.strokeStyle = colourOf("ink");
  pen.lineWidth = devicePixelRatio;
  const y = plot.valToPos(0, "y", true);
  if (y >= plot.bbox.top && y <= plot.bbox.top + plot.bbox.height)
    line(pen, plot.bbox.left, y, plot.bbox.left + plot.bbox.width, y);
  if (Number.isFinite(what.upright)) {
    const x = plot.valToPos(what.upright, "x", true);
    pen.setLineDash([3 * devicePixelRatio, 4 * devicePixelRatio]);
    if (x >= plot.bbox.left && x <= plot.bbox.left + plot.bbox.width)
      line(pen, x, plot.bbox.top, x, plot.bbox.top + plot.bbox.height);
  }
  pen.restore();
}

function line(pen, x1, y1, x2, y2) {
  pen.beginPath();
  pen.moveTo(x1, y1);
  pen.lineTo(x2, y2);
  pen.stroke();
}

function seriesOf(one, { single: alone, edge, UPlot, shown }) {
  const stroke = colourOf(one.look);
  const usual = {
    label: one.name,
    show: shown,
    stroke,
    width: 2,
    dash: one.dashed ? [7, 4] : undefined,
    spanGaps: true,
  };
  if (edge) return { ...usual, stroke: "transparent", width: 0, points: { show: false } };
  // A single value would be an empty plot as a line.
  if (alone && one.kind !== "points")
    return {
      ...usual,
      paths: UPlot.paths.bars({ size: [0.3, 40] }),
      fill: `color-mix(in srgb, ${stroke} 60%, transparent)`,
      points: { show: false },
    };
  if (one.kind === "points")
    return {
      ...usual,
      width: 0,
      paths: () => null,
      points: {
        show: true,
        paths: triangles(one, UPlot),
        stroke,
        fill: one.approach < 0 ? colourOf("field") : stroke,
        size: 9,
      },
    };
  return { ...usual, points: { show: one.x.length < FEW, size: 5, fill: stroke, stroke } };
}

// ▷ up, ◁ down: form tells the direction, not colour alone; with its uncertainty as a line where it has one.
function triangles(one, UPlot) {
  return (plot, index, first, last) => {
    const path = new Path2D();
    const size = 5 * devicePixelRatio * (one.approach < 0 ? -1 : 1);
    UPlot.orient(plot, index, (series, xs, ys, scaleX, scaleY, toX, toY, left, top, width, height) => {
      for (let at = first; at <= last; at += 1) {
        if (ys[at] === null) continue;
        const [x, y] = [toX(xs[at], scaleX, width, left), toY(ys[at], scaleY, height, top)];
        path.moveTo(x + size, y);
        path.lineTo(x - 0.7 * size, y - size);
        path.lineTo(x - 0.7 * size, y + size);
        path.closePath();
      }
    });
    return { stroke: path, fill: one.approach < 0 ? null : path };
  };
}

function legend(now, curves) {
  const names = [...new Map(curves.map((one) => [one.name, one])).values()];
  if (
    same(
      now.parts.legend,
      names.map((one) => [one.name, one.look]),
      [...now.hidden],
    )
  )
    return;
  const turn = (one) => {
    if (now.hidden.has(one.name)) now.hidden.delete(one.name);
    else now.hidden.add(one.name);
    load().then((uPlot) => drawn(now, uPlot));
  };
  const form = (one) =>
    one.kind === "band" ? "▒" : one.kind === "points" ? (one.approach < 0 ? "◁" : "▷") : one.dashed ? "┄" : "━";
  show(
    now.parts.legend,
    h("output", { class: "at", "aria-live": "off" }),
    names.map((one) =>
      h(
        "button",
        {
          class: "curve",
          "data-curve": one.name,
          "aria-pressed": String(!now.hidden.has(one.name)),
          onclick: () => turn(one),
        },
        h("i", { class: one.look, "aria-hidden": "true" }, form(one)),
        ` ${one.name} `,
        h("b", { class: "num" }),
      ),
    ),
  );
}

// The values of all curves under the cursor, between two points of a line what lies between.
function told(now) {
  const at = now.plot?.cursor.idx;
  const { what, data, parts } = now;
  const known = at !== null && at !== undefined;
  const place = parts.legend.querySelector(".at");
  if (place) write(place, known ? `${what.xName} ${number(data[0][at], 3)} ${what.xUnit}` : "");
  for (const key of parts.legend.querySelectorAll("button.curve")) {
    const own = now.curves.filter((one) => one.name === key.dataset.curve);
    const texts = known ? own.map((one) => valueAt(one, data[0][at])).filter(Boolean) : [];
    write(key.querySelector("b"), texts.length ? `${texts.join(" / ")} ${what.yUnit}` : "");
  }
}

function valueAt(one, x) {
  const read = (ys) => {
    const equal = one.x
      .reduce((found, place, n) => (Math.abs(place - x) < 1e-9 ? [...found, ys[n]] : found), [])
      .filter(Number.isFinite);
    if (equal.length) return equal.reduce((sum, value) => sum + value, 0) / equal.length;
    const right = one.kind === "points" ? -1 : one.x.findIndex((place) => place > x);
    if (right < 1) return NaN;
    const part = (x - one.x[right - 1]) / (one.x[right] - one.x[right - 1]);
    return ys[right - 1] + part * (ys[right] - ys[right - 1]);
  };
  const value = read(one.y);
  if (!Number.isFinite(value)) return "";
  return one.kind === "band" ? `${signed(value)} … ${signed(read(one.high))}` : signed(value);
}
