// Small drawings of curves, bands, points and steps on two axes; SVG, no library.
import { s } from "./dom.js";
import { number } from "./figures.js";

// Room around the curves, in heights of the root's letters: numbers stay as large as all other text.
const ROOM = { left: 4.2, right: 1, top: 0.8, bottom: 2.8 };
const letter = () => parseFloat(getComputedStyle(document.documentElement).fontSize);

// A round step so that about `count` of them fill the span.
export function ticks(low, high, count) {
  const span = high - low || 1;
  const raw = span / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= raw);
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + step * 1e-9; at += step) found.push(Math.abs(at) < step * 1e-9 ? 0 : at);
  return { at: found, digits: Math.max(0, -Math.floor(Math.log10(step))) };
}

export function limits(values, room = 0.08) {
  const finite = values.filter((one) => Number.isFinite(one));
  if (!finite.length) return [-1, 1];
  const [low, high] = [Math.min(...finite), Math.max(...finite)];
  const more = (high - low || 1) * room;
  return [low - more, high + more];
}

// A picture that fills its place, drawn anew when that changes. `x` and `y` are [low, high]; `nodes` draws what is in it.
export function plot({ label, ...what }) {
  const picture = s("svg", { class: "plot", role: "img", "aria-label": label });
  new ResizeObserver(() => drawn(picture, what)).observe(picture);
  return picture;
}

function drawn(picture, { x, y, xName, yName, nodes }) {
  const [{ clientWidth: width, clientHeight: height }, em] = [picture, letter()];
  if (!width || !height) return;
  const inner = { left: ROOM.left * em, right: width - ROOM.right * em, top: ROOM.top * em, bottom: height - ROOM.bottom * em };
  const px = (value) => inner.left + ((value - x[0]) / (x[1] - x[0])) * (inner.right - inner.left);
  const py = (value) => inner.bottom - ((value - y[0]) / (y[1] - y[0])) * (inner.bottom - inner.top);
  const [across, up] = [ticks(...x, Math.max(2, Math.round((inner.right - inner.left) / (6 * em)))), ticks(...y, Math.max(2, Math.round((inner.bottom - inner.top) / (3.5 * em))))];
  picture.setAttribute("viewBox", `0 0 ${width} ${height}`);
  picture.replaceChildren(
    ...up.at.flatMap((at) => [s("line", { class: at === 0 ? "zero" : "grid", x1: inner.left, x2: inner.right, y1: py(at), y2: py(at) }),
      s("text", { x: inner.left - em / 2, y: py(at) + em / 4, class: "tick end" }, number(at, up.digits))]),
    ...across.at.flatMap((at) => [s("line", { class: "grid", x1: px(at), x2: px(at), y1: inner.top, y2: inner.bottom }),
      s("text", { x: px(at), y: inner.bottom + em, class: "tick middle" }, number(at, across.digits))]),
    s("rect", { class: "border", x: inner.left, y: inner.top, width: inner.right - inner.left, height: inner.bottom - inner.top }),
    s("text", { x: (inner.left + inner.right) / 2, y: height - em / 2, class: "name middle" }, xName),
    s("text", { x: em, y: (inner.top + inner.bottom) / 2, class: "name middle", transform: `rotate(-90 ${em} ${(inner.top + inner.bottom) / 2})` }, yName),
    ...nodes({ px, py, inner }).filter(Boolean));
}

const points = (xs, ys, px, py) => xs.map((one, at) => [px(one), py(ys[at])]).filter(([, y]) => Number.isFinite(y)).map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`);

export const line = (xs, ys, { px, py }, look) => s("polyline", { class: `line ${look}`, points: points(xs, ys, px, py).join(" ") });

export const band = (xs, low, high, { px, py }, look) =>
  s("polygon", { class: `band ${look}`, points: [...points(xs, low, px, py), ...points(xs, high, px, py).reverse()].join(" ") });

// ▷ up, ◁ down: form tells the direction, not colour alone.
export function mark(x, y, approach, { px, py }, look, size = 5) {
  const [a, b] = [px(x), py(y)];
  const tip = approach > 0 ? size : -size;
  return s("path", { class: `reading ${look}`, d: `M${(a + tip).toFixed(1)},${b.toFixed(1)} l${-1.7 * tip},${-size} v${2 * size} z` });
}

export const upright = (x, { px, inner }, look) => s("line", { class: look, x1: px(x), x2: px(x), y1: inner.top, y2: inner.bottom });

export const level = (y, { py, inner }, look) => s("line", { class: look, x1: inner.left, x2: inner.right, y1: py(y), y2: py(y) });
