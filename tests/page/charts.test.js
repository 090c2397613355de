// What decides in charts: round steps, lines through a curve, columns that belong together. Expected by hand.
import assert from "node:assert/strict";
import { test } from "node:test";
import { bestLine, endLine, fitted } from "../../gateway/web/page/chartfit.js";
import { ticks } from "../../gateway/web/page/charts.js";

const near = (found, wanted) => assert.ok(Math.abs(found - wanted) < 1e-9, `${found} for ${wanted}`);

test("a best line has the slope of the normal equations", () => {
  const line = bestLine([0, 1, 2, 3], [1, 3, 2, 5]);
  near(line.slope, 1.1);
  near(line.at(0), 1.1);
});

test("a best line leaves gaps out, and is level where all points stand at one place", () => {
  near(bestLine([0, 1, 2], [0, NaN, 4]).slope, 2);
  const one = bestLine([5, 5], [1, 3]);
  assert.deepEqual([one.slope, one.at(0)], [0, 2]);
});

test("an end line goes through the means at both ends", () => {
  const line = endLine([0, 0, 5, 10, 10], [1, 3, 99, 6, 8]);
  near(line.at(0), 2);
  near(line.at(10), 7);
});

test("without its line a curve keeps its form, and what follows it loses the same", () => {
  const own = { name: "mean", fit: true, x: [0, 10], y: [1, 5] };
  const band = { name: "band", follows: true, x: [0, 10], y: [0, 4], high: [2, 6] };
  const other = { name: "limit", x: [0, 10], y: [9, 9] };
  const [mean, less, left] = fitted([own, band, other], "without_ends", String);
  assert.deepEqual(
    [mean.y, less.y, less.high, left.y],
    [
      [0, 0],
      [-1, -1],
      [1, 1],
      [9, 9],
    ],
  );
});

test("an axis has three round steps at least, within its ends", () => {
  for (const [low, high] of [
    [0, 1],
    [-3e-4, 2e-4],
    [99.2, 100.1],
    [-400, 12],
    [1e6, 1e6 + 3],
  ]) {
    const { at } = ticks(low, high, 1);
    assert.ok(at.length >= 3, `${low} ${high}: ${at}`);
    assert.ok(at[0] >= low - 1e-6 && at[at.length - 1] <= high + 1e-6, `${low} ${high}: ${at}`);
  }
});
