// Presses what is pressed and shows how the machine stands, twice a second.
const at = (id) => document.getElementById(id);
const CHANNEL = ["● reset", "▶ runs", "❚❚ stands at a stop"];

async function give(line) {
  const answer = await (await fetch("/do", { method: "POST", headers: { "content-type": "text/plain" }, body: line })).json();
  at("said").textContent = answer.error ? `✖ ${answer.error}` : `✔ ${line}`;
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
    at("message").textContent = "The machine does not answer: the training has ended.";
    return;
  }
  at("name").textContent = now.name;
  at("message").textContent = now.message || "no message";
  const facts = { Channel: CHANNEL[now.channel], Mode: now.mode, Program: now.selected.split("/").pop() || "–", Alarms: now.alarms.join(" ") || "none",
    ...Object.fromEntries(Object.entries(now.positions).map(([axis, value]) => [axis, value.toFixed(3)])), "Done last": now.operator.at(-1) ?? "–" };
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

for (const key of document.querySelectorAll("[data-do]")) key.onclick = () => give(key.dataset.do);
for (const key of document.querySelectorAll("[data-instrument]")) key.onclick = () => give(`${key.dataset.instrument} ${at("instrument").value}`);
at("mount").onclick = () => give(`mount ${at("mounting").value}`);
at("auto").onchange = (event) => give(`auto ${event.target.checked ? "on" : "off"}`);
await look();
setInterval(look, 500);
