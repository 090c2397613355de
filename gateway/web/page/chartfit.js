// @ts-check
// Lines through a curve: best fit and end points, drawn or taken off for looking. The record keeps what was measured.
export const FITS = ["none", "best", "ends", "without_best", "without_ends"];

// Least squares y = a + b x over all points; the mean alone where all stand at one place.
export function bestLine(xs, ys) {
  const known = xs.map((x, n) => [x, ys[n]]).filter(([, y]) => Number.isFinite(y));
  const mean = (values) => values.reduce((sum, one) => sum + one, 0) / values.length;
  const [mx, my] = [mean(known.map(([x]) => x)), mean(known.map(([, y]) => y))];
  const across = known.reduce((sum, [x]) => sum + (x - mx) ** 2, 0);
  const slope = across > 0 ? known.reduce((sum, [x, y]) => sum + (x - mx) * (y - my), 0) / across : 0;
  return { at: (x) => my + slope * (x - mx), slope };
}

// Through the means at the first and the last place.
export function endLine(xs, ys) {
  const known = xs.map((x, n) => [x, ys[n]]).filter(([, y]) => Number.isFinite(y));
  const places = known.map(([x]) => x);
  const [low, high] = [Math.min(...places), Math.max(...places)];
  const mean = (place) => {
    const own = known.filter(([x]) => x === place);
    return own.reduce((sum, [, y]) => sum + y, 0) / own.length;
  };
  const slope = high > low ? (mean(high) - mean(low)) / (high - low) : 0;
  return { at: (x) => mean(low) + slope * (x - low), slope };
}

// The curves with a line drawn, or less the line that belongs to all that are fitted together.
export function fitted(curves, fit, t) {
  const own = curves.filter((one) => one.fit);
  const xs = own.flatMap((one) => one.x);
  if (fit === "none" || new Set(xs).size < 2) return curves;
  const line = (fit.endsWith("best") ? bestLine : endLine)(
    xs,
    own.flatMap((one) => one.y),
  );
  if (fit.startsWith("without")) {
    const less = (one, ys) => ys.map((y, n) => y - line.at(one.x[n]));
    return curves.map((one) =>
      one.fit || one.follows ? { ...one, y: less(one, one.y), high: one.high && less(one, one.high) } : one,
    );
  }
  const ends = [Math.min(...xs), Math.max(...xs)];
  return [...curves, { name: t(`chart.fit_${fit}`), look: "difference", dashed: true, x: ends, y: ends.map(line.at) }];
}
