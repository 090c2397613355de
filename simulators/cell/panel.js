// Presses what is pressed and shows how the machine stands, twice a second.
const at = (id) => document.getElementById(id);
const CHANNEL = [["●", "reset"], ["▶", "runs"], ["❚❚", "stands"]];
const LANGUAGES = { en: "English", zh: "中文", de: "Deutsch" };
let texts = {};
const t = (key) => texts[`panel.${key}`] ?? `[${key}]`;

async function speak(code) {
  texts = await (await fetch(`/words/${code}.json`)).json();
  localStorage.setItem("language", code);
  document.documentElement.lang = code;
  document.title = t("title");
  for (const one of document.querySelectorAll("[data-text]")) one.textContent = t(one.dataset.text);
  for (const one of document.querySelectorAll("[data-label]")) one.setAttribute("aria-label", t(one.dataset.label));
  at("language").replaceChildren(...Object.entries(LANGUAGES).map(([value, textContent]) => Object.assign(document.createElement("option"), { value, textContent, selected: value === code })));
}

// What the operator did, in the words of this panel's own keys; what stands on a key of the control stays as it is.
const DID = { mounted: ["mounted", "mounted"], "nothing to mount for": ["not mounted", "not_mounted"], "took the part off": ["taken", "take"], "clamped a blank": ["clamped", "blank"], "no blank to clamp": ["no blank", "nothing"], "no part to take off": ["no part", "nothing"],
  "went on with the self-test": ["tested", "went_on"], "RELEASE ON": ["on", "release_on"], "RELEASE OFF": ["off", "release_off"], CONFIRM: ["confirm", "confirm"], "POWER OFF AND ON": ["power", "power"] };
function did(text) {
  const known = Object.keys(DID).find((one) => text.startsWith(one));
  return known ? [t(DID[known][1]), text.slice(known.length).replace(" on ", " ").trim()].filter(Boolean).join(": ") : text;
}

async function give(line, name) {
  const answer = await (await fetch("/do", { method: "POST", headers: { "content-type": "text/plain" }, body: line })).json();
  at("said").textContent = answer.error ? `✖ ${answer.error}` : `✔ ${name}`;
  await look();
}

function options(box, names) {
  if (box.dataset.of === names.join()) return;
  box.dataset.of = names.join();
  box.replaceChildren(...names.map((name) => Object.assign(document.createElement("option"), { value: name, textContent: name })));
}

async function look() {
  let now;
  try {
    now = await (await fetch("/machine")).json();
  } catch {
    at("message").textContent = t("gone");
    return;
  }
  at("name").textContent = now.name;
  at("message").textContent = now.message || t("no_message");
  const facts = { [t("channel")]: `${CHANNEL[now.channel][0]} ${t(CHANNEL[now.channel][1])}`, [t("mode")]: now.mode, [t("program")]: now.selected.split("/").pop() || "–", [t("alarms")]: now.alarms.join(" ") || t("none"),
    ...Object.fromEntries(Object.entries(now.positions).map(([axis, value]) => [axis, value.toFixed(3)])), [t("last")]: did(now.operator.at(-1) ?? "–") };
  at("facts").replaceChildren(...Object.entries(facts).map(([name, value]) => {
    const pair = document.createElement("div");
    pair.append(Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: value }));
    return pair;
  }));
  at("auto").checked = now.auto;
  options(at("mounting"), now.mountings);
  options(at("instrument"), now.instruments);
  const asked = /TRUEFLANK SETUP (\S+) ON (\S+)/.exec(now.message);
  if (asked && at("mounting").dataset.asked !== now.message) {
    at("mounting").dataset.asked = now.message;
    at("mounting").value = now.mountings.find((one) => one.startsWith(`${asked[1]} ${asked[2]}`)) ?? at("mounting").value;
  }
}

for (const key of document.querySelectorAll("[data-do]")) key.onclick = () => give(key.dataset.do, key.textContent);
for (const key of document.querySelectorAll("[data-instrument]")) key.onclick = () => give(`${key.dataset.instrument} ${at("instrument").value}`, `${key.textContent}: ${at("instrument").value}`);
at("mount").onclick = () => give(`mount ${at("mounting").value}`, `${t("mounted")}: ${at("mounting").value}`);
at("auto").onchange = (event) => give(`auto ${event.target.checked ? "on" : "off"}`, `${t("auto")}: ${event.target.checked ? t("yes") : t("no")}`);
at("language").onchange = (event) => speak(event.target.value).then(look);
const kept = localStorage.getItem("language") ?? navigator.language.slice(0, 2);
await speak(kept in LANGUAGES ? kept : "en");
await look();
setInterval(look, 500);
