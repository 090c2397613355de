// @ts-check
// The tooth of a run: what was predicted of its flank with the set-up values apart, and what inspection found after.
import { get } from "./api.js";
import { record } from "./evaluate.js";
import { unrolled } from "./flankmap.js";
import { h, show, write } from "./dom.js";
import { array, number, signed } from "./figures.js";
import { base } from "./state.js";
import { prose, recorded, t } from "./words.js";

const flat = (map) => array(map.deviation_um).flat(2);
const rms = (map) => Math.sqrt(flat(map).reduce((sum, one) => sum + one * one, 0) / flat(map).length);
const largest = (map) => flat(map).reduce((most, one) => Math.max(most, Math.abs(one)), 0);

// Every map of a picture has one scale, so that what is paler is better.
function maps(named) {
  const most = Math.max(...named.map(([, , map]) => largest(map)));
  return named.map(([id, name, map]) => {
    const canvas = h("canvas", { class: "flank", role: "img", "aria-label": `${t("tooth.flank")}: ${name}` });
    new ResizeObserver(() =>
      unrolled(canvas, { deviation_um: array(map.deviation_um), z_mm: array(map.z_mm), largest_um: most }),
    ).observe(canvas);
    return h(
      "div",
      { class: "tooth" },
      h(
        "div",
        { class: "row head" },
        h("h2", {}, name),
        h(
          "span",
          {},
          "RMS ",
          h("b", { "data-flank": id }, number(rms(map))),
          ` µm · ${t("model.largest")} ${number(largest(map))} µm`,
        ),
      ),
      canvas,
    );
  });
}

// The gear in three dimensions beside its maps; where a browser cannot draw so, the maps alone tell it.
function solid(run, stage, named) {
  const box = h("div", { class: "solid" });
  const scale = Math.max(...named.map(([, , map]) => largest(map)));
  const deviations = Object.fromEntries(named.map(([id, , map]) => [id, array(map.deviation_um)]));
  const figure = h("output", { class: "picked", id: "picked", "aria-live": "off" }, t("tooth.pick"));
  const canvas = h("canvas", {
    class: "gear",
    tabindex: 0,
    role: "img",
    "aria-label": `${t("tooth.solid")}. ${t("tooth.solid_keys")}`,
  });
  const which = h(
    "select",
    { id: "solid-which", "aria-label": t("tooth.which") },
    named.map(([id, name]) => h("option", { value: id }, name)),
  );
  // So large that the largest deviation is 3 mm to begin with.
  const first = Math.min(5000, Math.max(10, Math.round(3000 / (scale || 1) / 10) * 10));
  const times = h("input", {
    id: "solid-times",
    type: "range",
    min: 1,
    max: Math.max(5000, first),
    value: first,
    "aria-label": t("tooth.times"),
  });
  const shown = h("span", { class: "num" }, `× ${first}`);
  show(
    box,
    h(
      "div",
      { class: "row head" },
      h("h2", {}, t("tooth.solid")),
      h("label", { class: "inline" }, which),
      h("label", { class: "inline" }, t("tooth.times"), times, shown),
    ),
    canvas,
    figure,
  );
  const load = async () => {
    const [{ able, view }, form] = await Promise.all([
      import("./tooth3d.js"),
      get(`${base()}/runs/${encodeURIComponent(run.run_id)}/form?stage=${stage}`),
    ]);
    if (!able()) throw new Error("no WebGL");
    const pick = (k, i, z) => {
      const told = { space: k + 1, angle: number(form.angle_deg[i], 2), height: number(form.z_mm[z], 2) };
      const values = named.map(([id, name]) => `${name} ${signed(deviations[id][k][i][z])} µm`);
      write(figure, `${t("tooth.picked", told)}: ${values.join(" · ")}`);
    };
    const gear = view(canvas, { form, pick });
    const set = () => gear.set(deviations[which.value], { scale, times: Number(times.value) });
    which.addEventListener("change", set);
    times.addEventListener("input", () => {
      write(shown, `× ${times.value}`);
      set();
    });
    set();
    box.dataset.ready = "3d";
  };
  load().catch(() => {
    box.dataset.ready = "2d";
    show(box, h("p", { class: "muted" }, t("tooth.flat")));
  });
  return box;
}

const rows = (every) =>
  h(
    "dl",
    { class: "facts" },
    every.map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", {}, text))),
  );
const lines = (said) =>
  said.length > 0 &&
  h(
    "ul",
    { class: "lines" },
    said.map((one) => h("li", {}, recorded(one))),
  );

export async function predictedTooth(run) {
  const { prediction, setup, eccentricity_um: off, tilt_arcsec: tilt, said } = await record(run.run_id, "tooth");
  const pair = (values, unit) => `${values.map((one) => signed(one)).join(" / ")} ${unit}`;
  const setups = [
    [t("tooth.x"), `${signed(setup.x_um)} µm`],
    [t("tooth.c"), `${signed(setup.c_arcsec)} ″`],
    [t("tooth.dressing"), `${signed(setup.dressing_um)} µm`],
    [t("tooth.centre"), pair(off, "µm")],
    [t("tooth.tilt"), pair(tilt, "″")],
  ];
  const named = [
    ["before", t("tooth.as_is"), prediction.before],
    ["own", t("tooth.own"), prediction.with_own],
    ["after", t("tooth.everything"), prediction.after],
  ];
  return [
    h("div", { class: "panel plots" }, solid(run, "tooth", named), maps(named)),
    h(
      "div",
      { class: "panel", tabindex: 0, role: "region", "aria-label": t("tooth.setup") },
      h("p", {}, t("tooth.expected", { rms: number(prediction.rms_um), u: number(prediction.u_um) })),
      h("h2", {}, t("tooth.setup")),
      rows(setups),
      h("p", { class: "muted" }, t("tooth.by_hand")),
      lines(said),
    ),
  ];
}

export async function verifiedTooth(run) {
  const parts = ["before", "after"].filter((one) => run.stages.includes(`inspected-${one}`));
  const found = await Promise.all(parts.map((one) => record(run.run_id, `inspected-${one}`)));
  const verdict = run.stages.includes("tooth-verdict") ? await record(run.run_id, "tooth-verdict") : null;
  const figures = [...new Set(found.flatMap((one) => Object.keys(one.figures)))];
  const named = found.map((one, at) => [parts[at], t(`phase.${parts[at]}`), one.fitted]);
  return [
    h("div", { class: "panel plots" }, solid(run, `inspected-${parts[0]}`, named), maps(named)),
    h(
      "div",
      { class: "panel", tabindex: 0, role: "region", "aria-label": t("tooth.flank") },
      h(
        "table",
        {},
        h(
          "thead",
          {},
          h(
            "tr",
            {},
            h("th", {}, "[µm]"),
            parts.map((one) => h("th", { class: "num" }, t(`phase.${one}`))),
          ),
        ),
        h(
          "tbody",
          {},
          figures.map((name) =>
            h(
              "tr",
              {},
              h("th", { scope: "row" }, name),
              found.map((one) => h("td", { class: "num" }, number(one.figures[name]))),
            ),
          ),
        ),
      ),
      verdict && h("p", { class: "verdict-words" }, prose(verdict.words)),
    ),
  ];
}
