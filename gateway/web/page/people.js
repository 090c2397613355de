// @ts-check
// Accounts: who may do what at this service; for the role service.
import { get, put, remove } from "./api.js";
import { confirmed } from "./dialogs.js";
import { h, show } from "./dom.js";
import { day } from "./figures.js";
import { field } from "./signin.js";
import { state } from "./state.js";
import { t, told } from "./words.js";

const ROLES = ["viewer", "operator", "approver", "service"];

export async function accounts(box) {
  const [users, sessions] = await Promise.all([get("/api/v1/users"), get("/api/v1/me/sessions")]);
  const said = h("p", { class: "fault", role: "alert" });
  const roles = ROLES.map((name) =>
    h(
      "label",
      { class: "inline tickbox" },
      h("input", { type: "checkbox", name, checked: name === "operator" }),
      t(`role.${name}`),
    ),
  );
  const send = (event) => {
    event.preventDefault();
    const form = new FormData(event.target);
    const body = {
      roles: ROLES.filter((name) => form.has(name)),
      password: form.get("password"),
      pin: form.get("pin"),
    };
    put(`/api/v1/users/${encodeURIComponent(String(form.get("name")).trim())}`, body).then(
      () => accounts(box),
      (error) => {
        said.textContent = told(error);
      },
    );
  };
  show(
    box,
    h("h2", {}, t("people.title")),
    h(
      "table",
      {},
      h(
        "tbody",
        {},
        users.map((one) =>
          h(
            "tr",
            {},
            h("td", {}, h("b", {}, one.name)),
            h(
              "td",
              {},
              one.roles.map((name) => t(`role.${name}`)).join(document.documentElement.lang === "zh" ? "、" : ", "),
            ),
            h("td", {}, one.pin ? "PIN ✔" : ""),
            h("td", {}, tokens(one.tokens)),
            h("td", {}, one.second_factor ? forgetKey(one, box) : ""),
          ),
        ),
      ),
    ),
    h(
      "details",
      {},
      h("summary", {}, t("people.add")),
      h(
        "form",
        { id: "add-person", onsubmit: send, class: "grid" },
        field(t("signin.name"), h("input", { name: "name", required: true, autocomplete: "off" })),
        field(
          t("signin.new_password"),
          h("input", { name: "password", type: "password", minlength: 10, autocomplete: "new-password" }),
        ),
        field(
          t("people.pin"),
          h("input", {
            name: "pin",
            type: "password",
            inputmode: "numeric",
            pattern: "\\d{6,12}",
            autocomplete: "off",
          }),
        ),
        h("div", { class: "row" }, roles),
        said,
        h("button", { class: "primary" }, t("people.save")),
      ),
    ),
    h(
      "details",
      { id: "own-sessions" },
      h("summary", {}, t("people.sessions")),
      h(
        "ul",
        {},
        sessions.map((one) =>
          h("li", {}, [one.address, one.browser, one.this && t("people.this_one")].filter(Boolean).join(" · ")),
        ),
      ),
      h(
        "button",
        {
          id: "end-others",
          disabled: sessions.length < 2,
          onclick: () => remove("/api/v1/me/sessions/others").then(() => accounts(box)),
        },
        t("people.end_others"),
      ),
    ),
  );
}

// Who has lost the authenticator: the account goes on without a second factor until a new one is set up.
function forgetKey(one, box) {
  const forget = async () => {
    const text = t("factor.forget_what", { name: one.name });
    if (!(await confirmed(t("factor.forget"), text))) return;
    await put(`/api/v1/users/${encodeURIComponent(one.name)}`, { roles: one.roles, forget_factor: true });
    await accounts(box);
  };
  return h("button", { type: "button", "data-forget": one.name, onclick: forget }, t("factor.forget"));
}

// The own second factor: set up, replaced or given up, each proved by the own secret once more.
export async function ownFactor(box) {
  const offered = await get("/api/v1/me/second-factor");
  const said = h("p", { class: "fault", role: "alert" });
  const proof = (form) => {
    const typed = String(form.get("secret"));
    const kind = /^\d{6,12}$/.test(typed) ? "pin" : "password";
    return { name: state.me.name, [kind]: typed, code: String(form.get("old") ?? "") };
  };
  const send = (secret) => (event) => {
    event.preventDefault();
    const form = new FormData(box.querySelector("form"));
    const body = { proof: proof(form), secret, code: secret ? String(form.get("code")).trim() : "" };
    put("/api/v1/me/second-factor", body).then(
      () => ownFactor(box),
      (error) => {
        said.textContent = told(error);
      },
    );
  };
  const digits = { inputmode: "numeric", autocomplete: "one-time-code", pattern: "\\d{6}", maxlength: 6 };
  const used = offered.second_factor;
  show(
    box,
    h("h2", {}, t("factor.title")),
    h("p", { id: "factor-state" }, t(used ? "factor.used" : "factor.unused")),
    h(
      "details",
      { id: "own-factor" },
      h("summary", {}, t(used ? "factor.change" : "factor.set_up")),
      h(
        "form",
        { id: "factor", class: "grid", onsubmit: send(offered.secret) },
        h("p", {}, t("factor.add")),
        h("code", { id: "factor-key", tabindex: 0 }, offered.secret.match(/.{1,4}/g).join(" ")),
        field(
          t("factor.text"),
          h("input", {
            id: "factor-uri",
            readonly: true,
            value: offered.uri,
            onfocus: (event) => event.target.select(),
          }),
        ),
        h("a", { id: "factor-link", href: offered.uri }, t("factor.here")),
        field(t("factor.code"), h("input", { name: "code", required: true, ...digits })),
        field(
          t("signin.secret"),
          h("input", { name: "secret", type: "password", required: true, autocomplete: "off" }),
        ),
        used && field(t("factor.old_code"), h("input", { name: "old", ...digits })),
        h("p", { class: "muted" }, t("factor.lost")),
        said,
        h("button", { class: "primary" }, t("factor.use")),
        used && h("button", { type: "button", id: "factor-off", onclick: send("") }, t("factor.off")),
      ),
    ),
  );
}

function tokens(all) {
  const ends = all
    .map((one) => one.ends_utc)
    .filter(Boolean)
    .sort();
  return ends.length ? t("people.tokens", { count: all.length, day: day(ends[0]) }) : "";
}
