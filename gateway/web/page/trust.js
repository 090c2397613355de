// @ts-check
// The control's certificate: shown, compared with the control's own display by a person, pinned by its thumbprint.
// And what the machine is known by, with each change that a person accepted.
import { get, post } from "./api.js";
import { h, show } from "./dom.js";
import { when } from "./figures.js";
import { field } from "./signin.js";
import { base } from "./state.js";
import { t, told } from "./words.js";

export function trust(box) {
  const said = h("p", { class: "fault", role: "alert" });
  const seen = h("div", { class: "stack" });
  const look = () => get(`${base()}/trust`).then((view) => draw(view), fail);
  const fail = (error) => {
    said.textContent = told(error);
  };
  const draw = (view) => {
    said.textContent = "";
    const state = view.equal
      ? ["good", `✔ ${t("trust.equal")}`]
      : view.pinned
        ? ["fault", `✖ ${t("trust.changed")}`]
        : ["warn", `▲ ${t("trust.none")}`];
    show(
      seen,
      h("p", { class: state[0], id: "trusted" }, state[1]),
      certificate(t("trust.shown"), view.shown),
      view.pinned && !view.equal && certificate(t("trust.pinned"), view.pinned),
      view.accepted_by &&
        view.pinned &&
        h("p", {}, t("trust.by", { name: view.accepted_by, date: when(view.accepted_utc) })),
      !view.equal && form(),
    );
  };
  const form = () => {
    const send = (event) => {
      event.preventDefault();
      post(`${base()}/trust`, { thumbprint: new FormData(event.target).get("thumbprint") }).then(draw, fail);
    };
    return h(
      "form",
      { class: "stack", id: "accept", onsubmit: send },
      h("p", {}, t("trust.compare")),
      field(
        t("trust.typed"),
        h("input", { name: "thumbprint", autocomplete: "off", spellcheck: "false", required: true }),
      ),
      h("button", { class: "primary" }, t("trust.accept")),
    );
  };
  show(box, h("h2", {}, t("trust.title")), h("button", { id: "trust", onclick: look }, t("trust.look")), seen, said);
}

const certificate = (title, one) =>
  h(
    "dl",
    { class: "facts" },
    [
      [title, one.subject],
      ["SHA-256", one.sha256],
      ["SHA-1", one.sha1],
      [t("trust.valid"), `${when(one.valid_from)} – ${when(one.valid_until)}`],
    ].map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", { class: "print" }, value))),
  );

export function identity(box) {
  const draw = ({ facts, accepted }) =>
    show(
      box,
      h("h2", {}, t("identity.title")),
      h(
        "dl",
        { class: "facts" },
        Object.entries(facts).map(([fact, value]) =>
          h("div", {}, h("dt", {}, t(`identity.${fact}`)), h("dd", { class: "print" }, value)),
        ),
      ),
      accepted.length
        ? h(
            "table",
            { id: "accepted-identity" },
            h(
              "thead",
              {},
              h(
                "tr",
                {},
                ["changed", "was", "now", "who", "reason"].map((one) => h("th", {}, t(`identity.${one}`))),
              ),
            ),
            h("tbody", {}, accepted.map(change)),
          )
        : h("p", { class: "empty" }, t("identity.none")),
    );
  get(`${base()}/identity`).then(draw, (error) =>
    show(box, h("h2", {}, t("identity.title")), h("p", { class: "fault", role: "alert" }, told(error))),
  );
}

const change = (one) =>
  h(
    "tr",
    {},
    [h("b", {}, t(`identity.${one.fact}`)), one.was, one.now, `${one.who}, ${when(one.utc)}`, one.reason].map((fact) =>
      h("td", {}, fact),
    ),
  );
