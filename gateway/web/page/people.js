// @ts-check
// Accounts: who may do what at this service; for the role service.
import { get, put, remove } from "./api.js";
import { h, show } from "./dom.js";
import { day } from "./figures.js";
import { field } from "./signin.js";
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

function tokens(all) {
  const ends = all
    .map((one) => one.ends_utc)
    .filter(Boolean)
    .sort();
  return ends.length ? t("people.tokens", { count: all.length, day: day(ends[0]) }) : "";
}
