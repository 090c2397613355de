// @ts-check
// Sign-in with a password or a PIN, and the first account.
import { get, post } from "./api.js";
import { h, reworded, show } from "./dom.js";
import { LANGUAGES, language, speak, t, told } from "./words.js";

export function signIn(enter) {
  const box = h("main", { class: "signin" });
  // Where nobody has an account yet nobody can sign in: the first one is what to do.
  let begins = false;
  const draw = () =>
    show(
      box,
      h(
        "div",
        { class: "row head" },
        h("h1", {}, "trueflank"),
        languages(() => reworded(box, draw)),
      ),
      begins ? first(enter) : usual(enter),
    );
  get("/healthz")
    .then(
      (found) => {
        begins = Boolean(found.first_start);
      },
      () => {},
    )
    .then(draw);
  return box;
}

export function languages(changed) {
  const choose = async (event) => {
    if (event.target.value === document.documentElement.lang) return;
    await speak(event.target.value);
    changed();
  };
  const options = Object.entries(LANGUAGES).map(([code, name]) =>
    h("option", { value: code, selected: code === language() }, name),
  );
  return h(
    "label",
    { class: "language" },
    h("span", { class: "hidden" }, t("frame.language")),
    h("select", { id: "language", onchange: choose }, options),
  );
}

function usual(enter) {
  const said = h("p", { class: "fault", role: "alert" });
  const send = (event) => {
    event.preventDefault();
    const given = Object.fromEntries(new FormData(event.target));
    const pin = /^\d{6,12}$/.test(String(given.secret));
    const code = given.code || "";
    const body = { name: given.name, [pin ? "pin" : "password"]: given.secret, code };
    post("/api/v1/login", body)
      .catch((error) => {
        if (!pin || error.status !== 401) throw error;
        return post("/api/v1/login", { name: given.name, password: given.secret, code });
      })
      .then(enter, (error) => {
        said.textContent = told(error);
        codeAsked(error, said);
      });
  };
  const secret = h("input", {
    id: "secret",
    name: "secret",
    type: "password",
    autocomplete: "current-password",
    required: true,
  });
  return h(
    "form",
    { class: "card", onsubmit: send },
    h("h2", {}, t("signin.title")),
    h(
      "div",
      { class: "pair" },
      h(
        "div",
        {},
        field(t("signin.name"), h("input", { id: "name", name: "name", autocomplete: "username", required: true })),
        field(t("signin.secret"), secret),
        said,
        h("button", { class: "primary", id: "sign-in" }, t("signin.go")),
      ),
      keypad(secret),
    ),
  );
}

export function field(label, input) {
  return h("label", { class: "field" }, h("span", {}, label), input);
}

// Where the account has a second factor, a field for its code stands before what is said of it.
export function codeAsked(error, said) {
  const form = said.parentElement;
  if (error.status !== 428 || form.querySelector("[name=code]")) return;
  const input = h("input", { name: "code", inputmode: "numeric", autocomplete: "one-time-code", maxlength: 6 });
  said.before(field(t("signin.code"), input));
  input.focus();
}

// For gloves: digits into a field.
export function keypad(input) {
  const press = (digit) => () => {
    input.value = digit === "⌫" ? input.value.slice(0, -1) : input.value + digit;
    input.dispatchEvent(new Event("input", { bubbles: true }));
  };
  const keys = [..."123456789", "⌫", "0"].map((digit) =>
    h(
      "button",
      { type: "button", class: "digit", onclick: press(digit), "aria-label": digit === "⌫" ? t("signin.back") : digit },
      digit,
    ),
  );
  return h("div", { class: "keypad", role: "group", "aria-label": t("signin.keypad") }, keys);
}

function first(enter) {
  const said = h("p", { class: "fault", role: "alert" });
  const send = (event) => {
    event.preventDefault();
    post("/api/v1/first-start", Object.fromEntries(new FormData(event.target))).then(enter, (error) => {
      said.textContent = told(error);
    });
  };
  return h(
    "section",
    { class: "card" },
    h("h2", {}, t("signin.first")),
    h(
      "form",
      { id: "first", onsubmit: send },
      h("p", {}, t("signin.token_where")),
      field(t("signin.token"), h("input", { name: "token", autocomplete: "off", required: true })),
      field(t("signin.name"), h("input", { name: "name", autocomplete: "username", required: true })),
      field(
        t("signin.new_password"),
        h("input", { name: "password", type: "password", autocomplete: "new-password", minlength: 10, required: true }),
      ),
      said,
      h("button", { class: "primary" }, t("signin.make")),
    ),
  );
}
