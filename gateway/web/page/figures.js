// @ts-check
// Numbers, times and units as people read them.
const UNITS = { um: "µm", degC: "°C", arcsec: "″", deg: "°" };

export const unit = (name) => UNITS[name] ?? name ?? "";

const decimal = (text) => (document.documentElement.lang === "de" ? text.replace(".", ",") : text);

export function number(value, digits = 2) {
  if (value === null || value === undefined || !Number.isFinite(Number(value))) return "–";
  const text = Number(value).toFixed(digits);
  return decimal(Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−"));
}

export function signed(value, digits = 2) {
  const text = number(value, digits);
  return Number(value) > 0 && Number(Number(value).toFixed(digits)) !== 0 ? `+${text}` : text;
}

// A moment as the clock on the wall beside the screen has it; records hold UTC.
export function when(utc) {
  if (!utc) return "–";
  const at = new Date(utc);
  const two = (value) => String(value).padStart(2, "0");
  const date = [at.getFullYear(), two(at.getMonth() + 1), two(at.getDate())].join("-");
  return `${date} ${two(at.getHours())}:${two(at.getMinutes())}`;
}

export const day = (utc) => when(utc).slice(0, 10);

export function clock(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  const [hours, minutes, rest] = [Math.floor(whole / 3600), Math.floor((whole % 3600) / 60), whole % 60];
  const two = (value) => String(value).padStart(2, "0");
  return hours ? `${hours}:${two(minutes)}:${two(rest)}` : `${minutes}:${two(rest)}`;
}

// An array of a record: a plain list, or values with their shape.
export function array(value) {
  if (Array.isArray(value)) return value;
  if (!value?.shape) return [];
  return value.shape.reduceRight((flat, size, at) => (at === 0 ? flat : chunks(flat, size)), value.values);
}

function chunks(flat, size) {
  const found = [];
  for (let at = 0; at < flat.length; at += size) found.push(flat.slice(at, at + size));
  return found;
}
