// Every sentence in the person's language, from the one catalogue of the product.
import { get } from "./api.js";

let texts = { page: {}, codes: {}, terms: {} };
export const LANGUAGES = { en: "English", zh: "中文", de: "Deutsch" };

export function language() {
  const kept = localStorage.getItem("language") ?? navigator.language.slice(0, 2);
  return kept in LANGUAGES ? kept : "en";
}

export async function speak(code) {
  texts = await get(`/static/words/${code}.json`);
  localStorage.setItem("language", code);
  document.documentElement.lang = code;
}

const shown = (text) => text.replace(/(?<![\w\-./="`])(um|degC)(?![\w\-="`])/g, (found) => (found === "um" ? "µm" : "°C"));

// A format of the catalogue: {name}, {name:.2f}, {name:+.1f}, {name:g}.
function filled(text, fields) {
  return text.replace(/\{(\w+)(?:![a-z])?(?::([^}]*))?\}/g, (_all, name, form) => {
    const given = fields?.[name] ?? texts.terms[name];
    const value = name === "outcome" && `ended.${given}` in texts.page ? t(`ended.${given}`) : given;
    if (value === undefined) return `<${name}>`;
    if (!form || !Number.isFinite(Number(value))) return String(value);
    const digits = /\.(\d)f/.exec(form)?.[1];
    const plain = digits ? Number(value).toFixed(Number(digits)) : String(Number(Number(value).toPrecision(6)));
    return form.startsWith("+") && Number(value) >= 0 ? `+${plain}` : plain;
  });
}

export function t(key, fields) {
  const text = texts.page[key];
  return text === undefined ? `[${key}]` : filled(text, fields);
}

export function say(code, fields, part = 0, otherwise = "") {
  const known = texts.codes[code];
  return known ? shown(filled(known[part], fields)) : otherwise || code;
}

// A finished sentence without codes and the places beside them, which are for logs.
export const plain = (text) => shown(String(text ?? "").replace(/\b[EPRSW](-[A-Z0-9]+)+(?: \[[^\]]*\])?: /g, ""));

export const kindOf = (code) => texts.codes[code]?.[2] ?? "result";

// An error record of the service: what happened, and what to do.
export function told(error) {
  if (!error) return "";
  const what = say(error.code, error.fields, 0, error.what);
  const todo = say(error.code, error.fields, 1, error.do);
  return todo ? `${what}. ${todo[0].toUpperCase()}${todo.slice(1)}.` : `${what}.`;
}
