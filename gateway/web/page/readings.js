// @ts-check
// The readings of the plot: which belong together, and what each deviates by.
import { state } from "./state.js";

export const axisOf = (name) => state.plan.axes.find((one) => one.axis === name);
export const unitOf = (name) => part(name)[0]?.unit ?? (axisOf(name)?.unit === "deg" ? "arcsec" : "um");

// The readings of an axis that belong together: those of the newest part of the command.
export function part(name) {
  const own = state.taken.filter((one) => one.axis === name);
  const newest = own[own.length - 1]?.part;
  return own.filter((one) => one.part === newest);
}

// A reading of the plot, zero where Evaluate has it: at the first reading, of a rotary axis at its reference.
export function devOf(one) {
  return one.deviation - zeroOf(one);
}

function zeroOf(one) {
  const { reference, targets } = axisOf(one.axis) ?? {};
  if (typeof reference !== "number") return 0;
  const nearest = targets.reduce((best, at) => (Math.abs(at - reference) < Math.abs(best - reference) ? at : best));
  const there = part(one.axis).filter((other) => Math.abs(other.target - nearest) < 1e-6);
  return there.length ? there.reduce((sum, other) => sum + other.deviation, 0) / there.length : 0;
}

export function shownAxis() {
  return state.taken[state.taken.length - 1]?.axis ?? state.status.run?.axis ?? state.plan.axes[0].axis;
}
