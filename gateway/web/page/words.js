// @ts-check
// Every sentence in the person's language, from the one catalogue of the product.
import { unit } from "./figures.js";

let texts = { page: {}, codes: {}, terms: {} };
export const LANGUAGES = { en: "English", zh: "中文", de: "Deutsch" };

export function language() {
  const kept = localStorage.getItem("language") ?? navigator.language.slice(0, 2);
  return kept in LANGUAGES ? kept : "en";
}

const kept = (kind, code) =>
  fetch(new URL(`../${kind}/${code}.json`, import.meta.url)).then(
    (answer) => {
      if (!answer.ok) throw { code: "OFFLINE", what: "OFFLINE", do: "", fields: {} };
      return answer.json();
    },
    () => {
      throw { code: "OFFLINE", what: "OFFLINE", do: "", fields: {} };
    },
  );

// The page's own words first: the catalogue, ten times as much, is there soon after; `whenMore` hears of it.
let whenMore_ = () => {};
export const whenMore = (act) => {
  whenMore_ = act;
};

export async function speak(code) {
  const codes = kept("codes", code);
  texts = { ...(await kept("words", code)), codes: {} };
  localStorage.setItem("language", code);
  Object.assign(document.documentElement, { lang: code });
  document.documentElement.dataset.words = "";
  codes.then(
    (found) => {
      if (document.documentElement.lang !== code) return;
      texts = { ...texts, codes: found };
      document.documentElement.dataset.words = "all";
      whenMore_();
    },
    () => {},
  );
}

// "um" is also a German word: there it is a unit only behind a number or in front of a sign.
const UNIT = {
  de: /(?<=[\d)>] ?|\bin )um(?![\w\-="`])|(?<![\w\-./="`])degC(?![\w\-="`])|(?<=[\d)}] ?)(?:arcsec|deg)(?!\w)/g,
  usual: /(?<![\w\-./="`])(?:um|degC)(?![\w\-="`])|(?<=[\d)}] ?)(?:arcsec|deg)(?!\w)/g,
};
const shown = (text) => text.replace(UNIT[document.documentElement.lang] ?? UNIT.usual, unit);

// A format of the catalogue: {name}, {name:.2f}, {name:+.1f}, {name:g}.
function filled(text, fields) {
  return text.replace(/\{(\w+)(?:![a-z])?(?::([^}]*))?\}/g, (_all, name, form) => {
    const given = fields?.[name] ?? texts.terms[name];
    // Words of a record, for which the page has its own.
    const value =
      name === "outcome" && `ended.${given}` in texts.page
        ? t(`ended.${given}`)
        : name === "phase" && `phase.${given}` in texts.page
          ? t(`phase.${given}`)
          : given;
    if (value === undefined) return `<${name}>`;
    if (form?.includes("#")) return counted(value, form);
    if (form === "prose") return prose(Array.isArray(value) ? value : [value]);
    if (value !== null && typeof value === "object") return written(value);
    if (typeof value === "number" && !form) return decimal(String(value));
    if (!form || !Number.isFinite(Number(value))) return String(value);
    const digits = /\.(\d)f/.exec(form)?.[1];
    return decimal(withSign(Number(value), digits ? Number(digits) : null, form.startsWith("+")));
  });
}

const tongue = () => document.documentElement.lang;
const decimal = (text) => (tongue() === "de" ? text.replace(/(?<=\d)\.(?=\d)/g, ",") : text);

function withSign(value, digits, signed) {
  const plain = (digits === null ? String(Number(value.toPrecision(6))) : value.toFixed(digits)).replace("-", "−");
  return signed && value >= 0 ? `+${plain}` : plain;
}

// {count:# target|# targets}: forms in the order of the language's plural categories, as drivers/message.py has them.
function counted(value, form) {
  const [number, of] = typeof value === "object" ? [value.value, value.unit] : [Number(value), ""];
  if (!Number.isFinite(number)) return String(value);
  const forms = form.split("|").slice(0, tongue() === "zh" ? 1 : 2);
  return (number === 1 ? forms[0] : forms[forms.length - 1]).replace("#", `${decimal(String(number))} ${of}`.trim());
}

// A field that is more than a number or a name: several, a moment, a quantity, or a message within a message.
function written(value) {
  if (Array.isArray(value)) {
    const sentences = value.length > 0 && value.every((one) => one?.code !== undefined);
    return value
      .map((one) => (one !== null && typeof one === "object" ? written(one) : String(one)))
      .join(tongue() === "zh" ? (sentences ? "；" : "、") : sentences ? "; " : ", ");
  }
  if (value.code !== undefined) return message(value);
  if (value.utc !== undefined) return value.utc;
  if (value.number !== undefined) return value.number;
  const number =
    typeof value.value === "number" ? withSign(value.value, value.decimals ?? null, value.signed) : value.value.number;
  return shown(`${decimal(number)} ${value.unit}`.trim());
}

// A message of a record or of an error: its text, and what to do; codes and places are for logs. One without a code was
// finished by an older version and is shown as it was stored.
export function message({ code, fields, form }) {
  if (!code) return String(fields.text ?? "");
  const advice = form === "error" ? say(code, fields, 1) : "";
  return [say(code, fields), advice].filter(Boolean).join(" → ");
}

// What a record says: a message, or the sentence that an older version stored ("" for nothing).
export const recorded = (one) => (one !== null && typeof one === "object" ? message(one) : String(one ?? ""));

// Several sentences of a record, one after another.
export const prose = (said) =>
  Array.isArray(said) ? said.map(message).join(tongue() === "zh" ? "" : " ") : recorded(said);

export function t(key, fields) {
  const text = texts.page[key];
  return text === undefined ? `[${key}]` : filled(text, fields);
}

export function say(code, fields, part = 0, otherwise = "") {
  const known = texts.codes[code];
  const own = t(`instead.${code}_${part ? "do" : "what"}`, fields);
  if (!own.startsWith("[")) return own;
  return known ? shown(filled(known[part], fields)) : otherwise || code;
}

// As a sentence begins; a key of a file, and an address, stay as they are written.
export const capital = (text) =>
  /^\w+(?:\.\w|:\/\/)/.test(text) ? text : text.charAt(0).toUpperCase() + text.slice(1);

// What a run came to, in its state's word.
export function stateOf(run) {
  const found = t(`runstate.${run.state}`);
  return found.startsWith("[") ? run.state : found;
}

export const kindOf = (code) => texts.codes[code]?.[2] ?? "result";

// An error record of the service: what happened, and what to do.
export function told(error) {
  return error
    ? toldApart(error)
        .filter(Boolean)
        .join(document.documentElement.lang === "zh" ? "" : " ")
    : "";
}

export function toldApart(error) {
  // What happened on a wire says nothing without whose wire it is.
  const whose =
    error.code.startsWith("E-LINK-") && error.where
      ? `${error.where}${document.documentElement.lang === "zh" ? "：" : ": "}`
      : "";
  const parts = [whose + say(error.code, error.fields, 0, error.what), say(error.code, error.fields, 1, error.do)];
  return parts.map(
    (one) => one && `${capital(one).replace(/[.。]$/, "")}${document.documentElement.lang === "zh" ? "。" : "."}`,
  );
}
