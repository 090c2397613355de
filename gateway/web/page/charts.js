// @ts-check
// What every drawing of curves shares: round steps at an axis, limits, and lines of the small ones; SVG.
import { s } from "./dom.js";

const ROUND = [1, 2, 5];
const LEAST = 3;

// Round steps, so that at least three of them stand at an axis; more where there is room.
export function ticks(low, high, room) {
  const span = high - low || 1;
  if (!Number.isFinite(span)) return { at: [], digits: 0 };
  const begin = Math.ceil(Math.log10(Math.abs(span)));
  for (let power = begin; power > begin - 4; power -= 1) {
    for (const base of [...ROUND].reverse()) {
      const step = base * 10 ** power;
      const [first, last] = [Math.ceil(low / step - 1e-9), Math.floor(high / step + 1e-9)];
      const count = last - first + 1;
      if (count < Math.max(LEAST, room / 2)) continue;
      const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
      return { at: Array.from({ length: count }, (_one, n) => (first + n) * step), digits };
    }
  }
  return { at: [low, (low + high) / 2, high], digits: 3 };
}

export function limits(values, room = 0.08) {
  const finite = values.filter((one) => Number.isFinite(one));
  if (!finite.length) return [-1, 1];
  const [low, high] = [Math.min(...finite), Math.max(...finite)];
  const more = (high - low || 1) * room;
  return [low - more, high + more];
}

const points = (xs, ys, px, py) =>
  xs
    .map((one, at) => [px(one), py(ys[at])])
    .filter(([, y]) => Number.isFinite(y))
    .map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`);

export const line = (xs, ys, { px, py }, look) =>
  s("polyline", { class: `line ${look}`, points: points(xs, ys, px, py).join(" ") });

export const band = (xs, low, high, { px, py }, look) =>
  s("polygon", {
    class: `band ${look}`,
    points: [...points(xs, low, px, py), ...points(xs, high, px, py).reverse()].join(" "),
  });

export const level = (y, { py, inner }, look) =>
  s("line", { class: look, x1: inner.left, x2: inner.right, y1: py(y), y2: py(y) });
