// A finished English sentence of a record or of the service, told in the person's language: the text of the catalogue
// it was made of is found again, with what was filled in. What is found nowhere stays as it is.
const FIELD = /\{(\w+)(?:![a-z])?(?::[^}]*)?\}/g;
const LEAST = 6;
// A text that goes on another one ("; did you mean ...") begins behind what joins them: there a sentence is looked at again.
const JOINT = /^[;,；，] ?/;
const BOUNDARY = /(?:[.;:!?] +|, |\n| -> | → |[(“"])/g;

const literal = (text) => text.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
const large = (text) => text.charAt(0).toUpperCase() + text.slice(1);

function pattern(code, part, text, terms) {
  const names = [];
  let [source, at, weight, first] = ["", 0, 0, null];
  const take = (piece) => { weight += piece.replace(/[^\p{L}]/gu, "").length; source += literal(piece); first ??= piece; };
  for (const field of text.matchAll(FIELD)) {
    take(text.slice(at, field.index));
    at = field.index + field[0].length;
    if (field[1] in terms) { take(terms[field[1]]); continue; }
    names.push(field[1]);
    // What a text begins with is no sentence of its own: that one is told by itself.
    source += source ? "(.{0,600}?)" : "((?:(?![.!?] ).){0,600}?)";
  }
  take(text.slice(at));
  const end = at === text.length && names.length ? "(?=[.;] |\\.?$| ->)" : "(?=[.,;:)]|\\s|$)";
  return weight < LEAST ? null : { code, part, names, weight, first: first.toLowerCase(), test: new RegExp(source + end, "iys") };
}

function boundary(text, at) {
  BOUNDARY.lastIndex = at;
  const next = BOUNDARY.exec(text);
  return next ? next.index + next[0].length : text.length;
}

export function teller(english, terms, fill) {
  const every = Object.entries(english).flatMap(([code, parts]) => parts.map((text, part) => text && pattern(code, part, text.replace(JOINT, ""), terms)));
  const patterns = every.filter(Boolean).sort((one, other) => other.weight - one.weight);
  const kept = new Map();
  const found = (text, small, at) => {
    for (const one of patterns) {
      if (!small.startsWith(one.first, at)) continue;
      one.test.lastIndex = at;
      const hit = one.test.exec(text);
      if (hit) return [one, hit];
    }
    return null;
  };
  const retell = (text) => {
    const small = text.toLowerCase();
    let [made, at] = ["", 0];
    while (at < text.length) {
      const hit = found(text, small, at);
      if (hit) {
        const [{ code, part, names }, match] = hit;
        const own = fill(code, part, Object.fromEntries(names.map((name, n) => [name, match[n + 1]]))).replace(JOINT, "");
        made += text[at] !== small[at] ? large(own) : own;
        at += match[0].length;
      }
      const end = hit && !/\w/.test(text[at] ?? " ") ? at + /^(?:->|[^\p{L}\p{N}<`-])*/u.exec(text.slice(at))[0].length : boundary(text, at);
      made += text.slice(at, end);
      at = end;
    }
    return made;
  };
  return (text) => {
    if (!text.includes(" ")) return text;
    if (!kept.has(text)) kept.set(text, retell(text));
    return kept.get(text);
  };
}
