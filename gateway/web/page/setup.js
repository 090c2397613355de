// @ts-check
// Where the service has no site file yet: the questions of `init`, one after the other, then the file.
import { get, post } from "./api.js";
import { h, reworded, show } from "./dom.js";
import { languages } from "./signin.js";
import { capital, recorded, say, t, told } from "./words.js";

const ROADS = ["opcua", "mailbox", "carried", "linuxcnc", "files"];
const AGAIN_MS = 500;

export function setUp(enter) {
  const box = h("main", { class: "signin setup" });
  const answers = {};
  const said = h("p", { class: "fault", role: "alert" });
  let seen = { asked: [], told: [], question: null, file: "" };
  let busy = false;

  const ask = async (anew = false) => {
    busy = true;
    draw();
    said.textContent = "";
    try {
      seen = await post("/api/v1/site-file/question", { answers, anew });
    } catch (error) {
      said.textContent = told(error);
    }
    busy = false;
    draw();
    document.getElementById("answer")?.focus();
  };
  const give = (key, answer) => {
    answers[key] = answer;
    ask();
  };
  // Back to a question: it and what came behind it is asked again; what was said there stays as the default.
  const back = (at) => {
    const gone = seen.asked.slice(at);
    kept = Object.fromEntries(gone.map((one) => [one.key, one.answer]));
    for (const one of gone) delete answers[one.key];
    ask();
  };
  let kept = {};
  const make = async () => {
    busy = true;
    draw();
    try {
      const made = await post("/api/v1/site-file", { answers });
      if (made.made) return waits(made);
      show(said, ...made.faults.map((one) => h("span", { class: "line" }, told(one))));
    } catch (error) {
      said.textContent = told(error);
    }
    busy = false;
    draw();
  };
  const waits = async (made) => {
    const doubts = [...made.faults.map((one) => told(one)), ...made.remarks.map((one) => sentenceOf(one))];
    const card = (...below) =>
      show(
        box,
        h("div", { class: "row head" }, h("h1", {}, "trueflank")),
        h(
          "section",
          { class: "card", id: "written" },
          h("h2", {}, t("setup.written")),
          h("p", {}, made.file),
          doubts.length > 0 && [
            h("p", { class: "warn" }, `▲ ${t("setup.doubts")}`),
            h(
              "ul",
              { class: "lines", id: "doubts" },
              doubts.map((one) => h("li", {}, one)),
            ),
          ],
          below,
        ),
      );
    card(
      h("p", {}, t(doubts.length ? "setup.opening" : "setup.opens")),
      h("progress", { "aria-label": t("setup.opening") }),
    );
    while (!(await get("/api/v1/sites").catch(() => [])).length)
      await new Promise((over) => setTimeout(over, AGAIN_MS));
    if (!doubts.length) return enter();
    card(h("div", { class: "keys" }, h("button", { class: "primary", id: "go-on", onclick: enter }, t("setup.next"))));
    document.getElementById("go-on").focus();
  };
  const ways = () => [
    seen.asked.length > 0 &&
      h("button", { type: "button", id: "back", onclick: () => back(seen.asked.length - 1) }, t("dialog.back")),
    seen.told.some((one) => one.loud) &&
      h("button", { type: "button", id: "anew", onclick: () => ask(true) }, t("setup.anew")),
  ];
  const draw = () =>
    show(
      box,
      h(
        "div",
        { class: "row head" },
        h("h1", {}, "trueflank"),
        languages(() => reworded(box, draw)),
      ),
      h(
        "section",
        { class: "card", tabindex: 0, role: "region", "aria-label": t("setup.title", { file: "" }) },
        h("small", {}, t("setup.title", { file: seen.file })),
        ...found(seen),
        busy ? h("p", { id: "asking" }, t("setup.asks")) : question(seen, kept, { give, make, ways }),
        said,
      ),
      seen.asked.length > 0 && given(seen, back, busy),
    );
  ask();
  return box;
}

// What was found at the control behind the last answer; what went wrong there stays.
const found = (seen) =>
  seen.told
    .filter((one) => one.loud || one.after === seen.asked.length)
    .map((one) => h("p", { class: one.loud ? "warn found" : "found" }, say(one.code, one.fields).trim()));

// At a terminal one types the road, and its question names them; here each has a key.
const asks = (one) => (one.key === "road" ? t("setup.road") : say(one.code, one.fields));
const answered = (one) => (one.key === "road" ? t(`setup.${one.answer}`) : one.answer || "–");
const sentenceOf = (text) =>
  `${capital(recorded(text)).replace(/[.。]$/, "")}${document.documentElement.lang === "zh" ? "。" : "."}`;
// Usual answers, to be changed: nobody knows by heart how an instrument is written.
const USUAL = {
  laser: ["umd COM5", "attocube-ids tcp://192.168.1.1:9090", "bridge tcp://127.0.0.1:7001", "manual terminal://"],
  calibrator: ["bridge tcp://127.0.0.1:7001", "manual terminal://"],
  gear: ["none", "example"],
  optics: ["none"],
};
const choices = (key) =>
  USUAL[key] &&
  h(
    "div",
    { class: "keys start usual" },
    USUAL[key].map((one) =>
      h(
        "button",
        {
          type: "button",
          onclick: () => {
            const field = /** @type {HTMLInputElement} */ (document.getElementById("answer"));
            field.value = one;
            field.focus();
          },
        },
        h("b", {}, t(`setup.usual_${one.split(" ")[0].replace("-", "_")}`)),
        h("small", {}, one),
      ),
    ),
  );

function question(seen, kept, { give, make, ways }) {
  const now = seen.question;
  if (!now)
    return h(
      "div",
      { class: "stack" },
      h("h2", {}, t("setup.all")),
      h("p", {}, t("setup.all_what")),
      h(
        "div",
        { class: "keys" },
        ways(),
        h("button", { class: "primary", id: "make", onclick: make }, t("setup.make")),
      ),
    );
  const head = [
    h("h2", { id: "question" }, asks(now)),
    now.key !== "road" && h("p", {}, say(now.code, {}, 1)),
    now.wrong && h("p", { class: "fault", role: "alert" }, sentenceOf(say(now.wrong.code, now.wrong.fields))),
  ];
  if (now.key === "road")
    return h(
      "div",
      { class: "stack" },
      head,
      h(
        "dl",
        { class: "roads" },
        ROADS.map((one) =>
          h(
            "div",
            {},
            h(
              "dt",
              {},
              h(
                "button",
                { id: `road-${one}`, "aria-describedby": `road-${one}-what`, onclick: () => give("road", one) },
                t(`setup.${one}`),
              ),
            ),
            h("dd", { id: `road-${one}-what` }, t(`setup.${one}_what`)),
          ),
        ),
      ),
    );
  const send = (event) => {
    event.preventDefault();
    give(now.key, String(new FormData(event.target).get("answer")).trim());
  };
  const usual = now.answer || kept[now.key] || now.default;
  return h(
    "form",
    { onsubmit: send, class: "stack" },
    head,
    h("input", {
      id: "answer",
      name: "answer",
      "aria-labelledby": "question",
      type: now.secret ? "password" : "text",
      autocomplete: "off",
      spellcheck: "false",
      value: usual,
    }),
    choices(now.key),
    h("div", { class: "keys" }, ways(), h("button", { class: "primary", id: "next" }, t("setup.next"))),
  );
}

function given(seen, back, busy) {
  return h(
    "section",
    { class: "card", tabindex: 0, role: "region", "aria-label": t("setup.given") },
    h("h2", {}, t("setup.given")),
    h(
      "table",
      {},
      h(
        "tbody",
        {},
        seen.asked.map((one, at) =>
          h(
            "tr",
            {},
            h("td", {}, asks(one)),
            h("td", {}, h("b", {}, one.secret ? "••••" : answered(one))),
            h("td", { class: "num" }, h("button", { disabled: busy, onclick: () => back(at) }, t("setup.change"))),
          ),
        ),
      ),
    ),
  );
}
