// @ts-check
// The nine steps of a push as lamps: what its journal has written, in its order.
import { h } from "./dom.js";
import { t } from "./words.js";

export const STEPS = [
  "SNAPSHOT",
  "BACKUP",
  "DISABLE",
  "LOADED",
  "ENABLE",
  "ENABLED",
  "ACTIVATED",
  "EFFECT",
  "COMMITTED",
];
const WRONG = ["HELD", "STILL_ON", "STOPPED", "TORN", "ABORTED", "FAILED_TABLE", "ROLLING_BACK"];

export function lamps(axis, kinds, running) {
  // A sign proof is a small push before the great one: its steps are over when the live table is read again.
  const begun = kinds.lastIndexOf("SNAPSHOT");
  const own = begun >= 0 ? kinds.slice(begun) : kinds;
  // Once its sign is measured a test table goes back, as was told before: nothing went wrong.
  const proof = own.includes("MEASURED");
  // What went wrong is over once the old table acts again, and in a way back that was finished: it keeps what it found.
  const restored = own.includes("ROLLED_BACK");
  const over = own.lastIndexOf("COMMITTED");
  const wrong =
    !restored && own.find((one, at) => at > over && WRONG.includes(one) && !(proof && one === "ROLLING_BACK"));
  const done = STEPS.filter((one) => own.includes(one));
  const next = STEPS.find((_one, at) => !own.some((kind) => STEPS.indexOf(kind) >= at));
  // A step that a later one overtook was not needed: a reversal alone asks for no restart.
  const last = Math.max(-1, ...done.map((one) => STEPS.indexOf(one)));
  const look = (step) =>
    own.includes(step)
      ? "done"
      : STEPS.indexOf(step) < last
        ? "spared"
        : wrong && step === next
          ? "wrong"
          : running && !proof && done.length && step === next
            ? "next"
            : "open";
  const symbol = { done: "✔", spared: "–", wrong: "✖", next: "▶", open: "○" };
  return h(
    "div",
    { class: "lamps" },
    axis && h("b", { class: "axis" }, axis),
    h(
      "ol",
      {},
      STEPS.map((step, at) =>
        h(
          "li",
          { class: look(step) },
          h("span", { "aria-hidden": "true" }, symbol[look(step)]),
          h(
            "span",
            {},
            `${at + 1} ${t(`lamp.${step.toLowerCase()}`)}`,
            look(step) === "spared" && [h("br"), h("small", {}, t("lamp.spared"))],
          ),
        ),
      ),
    ),
    wrong
      ? h("strong", { class: "fault", role: "alert" }, t(`lamp.${wrong.toLowerCase()}`))
      : restored
        ? h("p", { class: "good" }, `✔ ${t("lamp.rolled_back")}`)
        : proof && h("p", {}, t("lamp.measured")),
  );
}
