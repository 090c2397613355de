// @ts-check
// A whole gear unrolled: spaces along, face width up; blue is below, red above nominal, white at zero.
import { number } from "./figures.js";

const BELOW = [33, 102, 172];
const ABOVE = [178, 24, 43];

export function unrolled(canvas, { deviation_um: spaces, largest_um: largest, z_mm: heights }) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
  if (!width || !height) return;
  Object.assign(canvas, { width, height });
  const pen = canvas.getContext("2d");
  const style = getComputedStyle(canvas);
  const em = parseFloat(style.fontSize) * ratio;
  const [left, right, top, bottom] = [3 * em, width - 4.5 * em, em / 2, height - 1.8 * em];
  const scale = largest || 1;
  const [cell, row] = [(right - left) / (spaces.length * spaces[0].length), (bottom - top) / heights.length];
  spaces.forEach((space, k) =>
    space.forEach((profile, i) =>
      profile.forEach((value, z) => {
        pen.fillStyle = colour(value / scale);
        pen.fillRect(left + (k * space.length + i) * cell, bottom - (z + 1) * row, cell + 0.6, row + 0.6);
      }),
    ),
  );
  Object.assign(pen, {
    fillStyle: style.color,
    strokeStyle: style.color,
    font: `${em * 0.85}px ${style.fontFamily}`,
    textAlign: "center",
    textBaseline: "middle",
    lineWidth: ratio * 0.25,
  });
  const step = Math.ceil(spaces.length / Math.max(2, (right - left) / (4 * em)));
  for (let k = 0; k < spaces.length; k += step)
    pen.fillText(String(k), left + (k + 0.5) * cell * spaces[0].length, bottom + em * 0.9);
  for (let k = 1; k < spaces.length; k += 1) pen.strokeRect(left + k * cell * spaces[0].length, top, 0, bottom - top);
  pen.textAlign = "right";
  for (const z of [0, heights.length - 1])
    pen.fillText(number(heights[z], 1), left - em * 0.4, bottom - (z + 0.5) * row);
  scaleOf(pen, { left: right + em * 0.6, top, bottom, em, scale });
}

function scaleOf(pen, { left, top, bottom, em, scale }) {
  const ink = pen.fillStyle;
  for (let y = 0; y < bottom - top; y += 1) {
    pen.fillStyle = colour(1 - (2 * y) / (bottom - top));
    pen.fillRect(left, top + y, em * 0.8, 1.5);
  }
  Object.assign(pen, { fillStyle: ink, textAlign: "left" });
  for (const [value, y] of [
    [scale, top + em * 0.4],
    [0, (top + bottom) / 2],
    [-scale, bottom - em * 0.4],
  ])
    pen.fillText(number(value, 1), left + em, y);
}

function colour(value) {
  const part = Math.min(1, Math.abs(value));
  const end = value < 0 ? BELOW : ABOVE;
  return `rgb(${end.map((one) => Math.round(255 + (one - 255) * part)).join(",")})`;
}
