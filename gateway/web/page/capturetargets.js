// @ts-check
// The targets of the axis at work: what was taken of each; the last one stays in the middle; a touch takes it again.
import { post } from "./api.js";
import { confirmed, shown } from "./dialogs.js";
import { h, same, show, write } from "./dom.js";
import { number, signed, unit } from "./figures.js";
import { axisOf, devOf, part, shownAxis, unitOf } from "./readings.js";
import { base, may, state } from "./state.js";
import { t, told } from "./words.js";

export function targetList(box) {
  const axis = axisOf(shownAxis()) ?? state.plan.axes[0];
  const found = part(axis.axis);
  const targets = [...new Set([...axis.targets, ...found.map((one) => one.target)])].sort((a, b) => a - b);
  const last = found[found.length - 1];
  // The keys stay while readings come.
  if (!same(box, axis.axis, targets))
    show(
      box,
      h(
        "table",
        {},
        h(
          "thead",
          {},
          h(
            "tr",
            {},
            h("th", { class: "num" }, t("capture.number")),
            h("th", { class: "num" }, `${t("chart.target")} [${unit(axis.unit)}]`),
            h("th", {}, "▷"),
            h("th", {}, "◁"),
            h("th", { class: "num" }, `${t("capture.mean")} [${unit(unitOf(axis.axis))}]`),
            h("th", {}, h("span", { class: "hidden" }, t("capture.again"))),
          ),
        ),
        h(
          "tbody",
          {},
          targets.map((target, at) => row(axis, target, at)),
        ),
      ),
    );
  const rows = box.querySelectorAll("tbody tr");
  const before = box.querySelector(".current");
  targets.forEach((target, at) =>
    tell(
      rows[at],
      found.filter((one) => one.target === target),
      last?.target === target,
    ),
  );
  const current = box.querySelector(".current");
  if (current && current !== before) box.scrollTop = current.offsetTop - box.clientHeight / 2;
}

function row(axis, target, at) {
  return h(
    "tr",
    {},
    h("td", { class: "num" }, at + 1),
    h("td", { class: "num" }, number(target, 3)),
    h("td", { class: "dots" }),
    h("td", { class: "dots" }),
    h("td", { class: "num" }),
    h(
      "td",
      {},
      h(
        "button",
        {
          class: "again",
          "aria-label": t("capture.again_at", { target: number(target, 3) }),
          onclick: () => again(axis, target),
        },
        "↻",
      ),
    ),
  );
}

function tell(line, found, current) {
  const mean = found.length ? found.reduce((sum, one) => sum + devOf(one), 0) / found.length : null;
  const count = (way) => found.filter((one) => one.approach === way).length;
  const dots = (way) => (count(way) > 3 ? `● ${count(way)}` : "●".repeat(count(way)) || "○");
  const [up, down, middle, key] = [...line.children].slice(2);
  line.className = current ? "current" : "";
  write(up, dots(1));
  write(down, dots(-1));
  write(middle, mean === null ? "–" : signed(mean, 2));
  key.firstChild.disabled = !found.length || !state.status.run || !may("operator");
}

async function again(axis, target) {
  const where = t("capture.again_at", { target: number(target, 3) });
  if (!(await confirmed(where, t("capture.again_what")))) return;
  for (const approach of [1, -1]) {
    await post(`${base()}/retake`, { axis: axis.axis, target, approach, repetition: 0 }).catch((error) =>
      shown(where, [h("p", { class: "fault" }, told(error))]),
    );
  }
}
