// @ts-check
// A chart as a file: PNG of what is seen, SVG to be printed at any size, CSV of every number.
import { ticks } from "./charts.js";
import { h, s } from "./dom.js";
import { number } from "./figures.js";

const nameOf = (now) => (now.what.file ?? now.what.title).replace(/[^\p{L}\p{N}.-]+/gu, "-").replace(/^-|-$/g, "");

function saved(name, blob) {
  const link = h("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

export function exported(now, kind) {
  if (!now.plot) return;
  if (kind === "csv") saved(`${nameOf(now)}.csv`, new Blob([table(now)], { type: "text/csv" }));
  else if (kind === "svg") saved(`${nameOf(now)}.svg`, new Blob([drawing(now)], { type: "image/svg+xml" }));
  else picture(now).toBlob((blob) => saved(`${nameOf(now)}.png`, blob), "image/png");
}

// The numbers as they are, a point for the decimal sign: for other programs, not for reading.
export function table({ what, curves }) {
  const cell = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const rows = curves.flatMap((one) =>
    one.x.flatMap((x, n) => {
      const values =
        one.kind === "band"
          ? [
              ["low", one.y[n]],
              ["high", one.high[n]],
            ]
          : [["", one.y[n]]];
      return values
        .filter(([, value]) => Number.isFinite(value))
        .map(([part, value]) => [cell(one.name), part, x, value].join(","));
    }),
  );
  const head = [`curve of ${what.title}`, "part", `${what.xName} [${what.xUnit}]`, `${what.yName} [${what.yUnit}]`];
  return `${head.map(cell).join(",")}\n${rows.join("\n")}\n`;
}

// The canvas has no ground and no words of its own beyond its axes: title and legend go along.
function picture(now) {
  const { canvas } = now.plot.ctx;
  const ratio = devicePixelRatio;
  const head = 26 * ratio;
  const shown = now.curves.filter((one) => !now.hidden.has(one.name));
  const names = [...new Map(shown.map((one) => [one.name, one])).values()];
  const made = Object.assign(document.createElement("canvas"), {
    width: canvas.width,
    height: canvas.height + 2 * head,
  });
  const pen = made.getContext("2d");
  const style = getComputedStyle(document.documentElement);
  Object.assign(pen, {
    fillStyle: style.getPropertyValue("--panel"),
    font: `600 ${14 * ratio}px sans-serif`,
    textBaseline: "middle",
  });
  pen.fillRect(0, 0, made.width, made.height);
  pen.fillStyle = style.getPropertyValue("--ink");
  pen.fillText(now.what.title, 8 * ratio, head / 2);
  pen.drawImage(canvas, 0, head);
  pen.font = `${12 * ratio}px sans-serif`;
  let left = 8 * ratio;
  for (const one of names) {
    pen.fillStyle = style.getPropertyValue(`--${one.look}`);
    pen.fillText(`■ ${one.name}`, left, made.height - head / 2);
    left += pen.measureText(`■ ${one.name}   `).width;
  }
  return made;
}

const WIDTH = 900;
const HEIGHT = 480;
const ROOM = { left: 76, right: 20, top: 44, bottom: 78 };

export function drawing(now) {
  const { what, plot, hidden } = now;
  const colour = (look) => getComputedStyle(document.documentElement).getPropertyValue(`--${look}`).trim();
  const {
    x: { min: x0, max: x1 },
    y: { min: y0, max: y1 },
  } = plot.scales;
  const px = (x) => ROOM.left + ((x - x0) / (x1 - x0)) * (WIDTH - ROOM.left - ROOM.right);
  const py = (y) => HEIGHT - ROOM.bottom - ((y - y0) / (y1 - y0)) * (HEIGHT - ROOM.top - ROOM.bottom);
  const [across, up] = [ticks(x0, x1, 9), ticks(y0, y1, 7)];
  const text = (x, y, words, more = {}) =>
    s("text", { x, y, "font-size": 13, "text-anchor": "middle", fill: "#222222", ...more }, words);
  const [bottom, middle] = [HEIGHT - ROOM.bottom, (ROOM.top + HEIGHT - ROOM.bottom) / 2];
  const shown = now.curves.filter((one) => !hidden.has(one.name));
  const names = [...new Map(shown.map((one) => [one.name, one])).values()];
  const node = s(
    "svg",
    {
      xmlns: "http://www.w3.org/2000/svg",
      viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
      width: WIDTH,
      height: HEIGHT,
      "font-family": "sans-serif",
    },
    s("rect", { width: WIDTH, height: HEIGHT, fill: "#ffffff" }),
    text(ROOM.left, 26, what.title, { "text-anchor": "start", "font-size": 16, "font-weight": 600 }),
    s(
      "clipPath",
      { id: "inside" },
      s("rect", { x: ROOM.left, y: ROOM.top, width: WIDTH - ROOM.left - ROOM.right, height: bottom - ROOM.top }),
    ),
    across.at.map((at) => [
      s("line", { x1: px(at), x2: px(at), y1: ROOM.top, y2: bottom, stroke: "#dddddd" }),
      text(px(at), bottom + 18, number(at, across.digits)),
    ]),
    up.at.map((at) => [
      s("line", {
        x1: ROOM.left,
        x2: WIDTH - ROOM.right,
        y1: py(at),
        y2: py(at),
        stroke: at === 0 ? "#222222" : "#dddddd",
      }),
      text(ROOM.left - 8, py(at) + 4, number(at, up.digits), { "text-anchor": "end" }),
    ]),
    text((ROOM.left + WIDTH - ROOM.right) / 2, bottom + 40, `${what.xName} [${what.xUnit}]`),
    text(20, middle, `${what.yName} [${what.yUnit}]`, { transform: `rotate(-90 20 ${middle})` }),
    s(
      "g",
      { "clip-path": "url(#inside)" },
      shown.map((one) => shapes(one, px, py, colour(one.look))),
    ),
    names.map((one, n) =>
      text(ROOM.left + 190 * n, HEIGHT - 14, `■ ${one.name}`, { "text-anchor": "start", fill: colour(one.look) }),
    ),
  );
  return new XMLSerializer().serializeToString(node);
}

function shapes(one, px, py, colour) {
  const points = (ys) => one.x.map((x, n) => [px(x), py(ys[n])]).filter(([, y]) => Number.isFinite(y));
  const joined = (list) => list.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");
  if (one.kind === "band")
    return s("polygon", {
      points: joined([...points(one.y), ...points(one.high).reverse()]),
      fill: colour,
      "fill-opacity": 0.18,
    });
  const size = one.approach < 0 ? -5 : 5;
  if (one.kind === "points")
    return points(one.y).map(([x, y]) =>
      s("path", {
        d: `M${(x + size).toFixed(1)},${y.toFixed(1)} l${-1.7 * size},-5 v10 z`,
        fill: one.approach < 0 ? "none" : colour,
        stroke: colour,
      }),
    );
  const places = points(one.y);
  if (places.length === 1)
    return s("rect", {
      x: places[0][0] - 40,
      width: 80,
      y: Math.min(places[0][1], py(0)),
      height: Math.abs(py(0) - places[0][1]),
      fill: colour,
    });
  return s("polyline", {
    points: joined(places),
    fill: "none",
    stroke: colour,
    "stroke-width": 2,
    "stroke-dasharray": one.dashed ? "7 4" : null,
  });
}
