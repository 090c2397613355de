// @ts-check
// Questions that hold everything else up: a yes, a machine's name, a second person.
import { h } from "./dom.js";
import { codeAsked, field, keypad } from "./signin.js";
import { t, told } from "./words.js";

function ask(title, parts, keys) {
  return new Promise((answer) => {
    const box = h("dialog", { "aria-labelledby": "asked" });
    const over = (value) => {
      box.close();
      box.remove();
      answer(value);
    };
    box.append(
      h("h2", { id: "asked" }, title),
      ...parts.flat(2).filter(Boolean),
      h("div", { class: "keys" }, keys(over, box)),
    );
    box.addEventListener("cancel", () => over(null));
    document.body.append(box);
    box.showModal();
  });
}

const back = (over) => h("button", { type: "button", onclick: () => over(null) }, t("dialog.back"));

export function confirmed(title, text, yes = title) {
  return ask(title, [h("p", {}, text)], (over) => [
    back(over),
    h("button", { class: "primary", id: "yes", onclick: () => over(true) }, yes),
  ]);
}

// The machine's name, typed: consent to a write.
export function machineTyped(title, parts, name) {
  // Another name begins nothing: it is compared here, not by a command that then fails.
  const same = () => input.value.trim() === name;
  const yes = h(
    "button",
    { class: "primary danger", id: "yes", disabled: true, onclick: () => same() && over_(input.value.trim()) },
    title,
  );
  const said = h("p", { class: "muted", id: "typed-other", role: "status" });
  const typed = () => {
    yes.disabled = !same();
    said.textContent = input.value && !name.startsWith(input.value.trim()) ? t("dialog.other_name", { name }) : "";
  };
  const input = h("input", { id: "typed-machine", autocomplete: "off", spellcheck: "false", oninput: typed });
  let over_ = (/** @type {string} */ _name) => {};
  return ask(title, [...parts, field(t("dialog.type_name", { name }), input), said], (over) => {
    over_ = over;
    return [back(over), yes];
  });
}

// A second person signs with name and PIN or password; the first one stays signed in.
export function secondPerson(title, parts, send) {
  const name = h("input", { id: "second-name", autocomplete: "off" });
  const secret = h("input", { id: "second-secret", type: "password", autocomplete: "off" });
  const said = h("p", { class: "fault", role: "alert" });
  return ask(
    title,
    [
      ...parts,
      h(
        "div",
        { class: "pair" },
        h("div", {}, field(t("signin.name"), name), field(t("signin.secret"), secret), said),
        keypad(secret),
      ),
    ],
    (over, box) => [
      back(over),
      h(
        "button",
        {
          class: "primary",
          id: "yes",
          onclick: async () => {
            const pin = /^\d{6,12}$/.test(secret.value);
            try {
              const code = box.querySelector("[name=code]")?.value || "";
              over(await send({ name: name.value.trim(), [pin ? "pin" : "password"]: secret.value, code }));
            } catch (error) {
              said.textContent = told(error);
              codeAsked(error, said);
            }
          },
        },
        title,
      ),
    ],
  );
}

export function textAsked(title, label, text = "") {
  const input = h("textarea", { id: "typed-text", rows: 4 }, text);
  return ask(title, [field(label, input)], (over) => [
    back(over),
    h("button", { class: "primary", id: "yes", onclick: () => over(input.value.trim()) }, title),
  ]);
}

export function shown(title, parts) {
  return ask(title, parts, (over) => [
    h("button", { class: "primary", id: "yes", onclick: () => over(true) }, t("dialog.close")),
  ]);
}
