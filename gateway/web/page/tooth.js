// The tooth of a run: what was predicted of its flank with the set-up values apart, and what inspection found after.
import { record } from "./evaluate.js";
import { unrolled } from "./flankmap.js";
import { h } from "./dom.js";
import { array, number, signed } from "./figures.js";
import { prose, recorded, t } from "./words.js";

const flat = (map) => array(map.deviation_um).flat(2);
const rms = (map) => Math.sqrt(flat(map).reduce((sum, one) => sum + one * one, 0) / flat(map).length);
const largest = (map) => flat(map).reduce((most, one) => Math.max(most, Math.abs(one)), 0);

// Every map of a picture has one scale, so that what is paler is better.
function maps(named) {
  const most = Math.max(...named.map(([, , map]) => largest(map)));
  return named.map(([id, name, map]) => {
    const canvas = h("canvas", { class: "flank", role: "img", "aria-label": `${t("tooth.flank")}: ${name}` });
    new ResizeObserver(() => unrolled(canvas, { deviation_um: array(map.deviation_um), z_mm: array(map.z_mm), largest_um: most })).observe(canvas);
    return h("div", { class: "tooth" }, h("div", { class: "row head" }, h("h2", {}, name), h("span", {}, "RMS ", h("b", { "data-flank": id }, number(rms(map))), ` µm · ${t("model.largest")} ${number(largest(map))} µm`)), canvas);
  });
}

const rows = (every) => h("dl", { class: "facts" }, every.map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", {}, text))));
const lines = (said) => said.length > 0 && h("ul", { class: "lines" }, said.map((one) => h("li", {}, recorded(one))));

export async function predictedTooth(run) {
  const { prediction, setup, eccentricity_um: off, tilt_arcsec: tilt, said } = await record(run.run_id, "tooth");
  const pair = (values, unit) => `${values.map((one) => signed(one)).join(" / ")} ${unit}`;
  const setups = [[t("tooth.x"), `${signed(setup.x_um)} µm`], [t("tooth.c"), `${signed(setup.c_arcsec)} ″`], [t("tooth.dressing"), `${signed(setup.dressing_um)} µm`],
    [t("tooth.centre"), pair(off, "µm")], [t("tooth.tilt"), pair(tilt, "″")]];
  return [h("div", { class: "panel plots" }, maps([["before", t("tooth.as_is"), prediction.before], ["own", t("tooth.own"), prediction.with_own], ["after", t("tooth.everything"), prediction.after]])),
    h("div", { class: "panel", tabindex: 0, role: "region", "aria-label": t("tooth.setup") }, h("p", {}, t("tooth.expected", { rms: number(prediction.rms_um), u: number(prediction.u_um) })), h("h2", {}, t("tooth.setup")), rows(setups), h("p", { class: "muted" }, t("tooth.by_hand")), lines(said))];
}

export async function verifiedTooth(run) {
  const parts = ["before", "after"].filter((one) => run.stages.includes(`inspected-${one}`));
  const found = await Promise.all(parts.map((one) => record(run.run_id, `inspected-${one}`)));
  const verdict = run.stages.includes("tooth-verdict") ? await record(run.run_id, "tooth-verdict") : null;
  const figures = [...new Set(found.flatMap((one) => Object.keys(one.figures)))];
  return [h("div", { class: "panel plots" }, maps(found.map((one, at) => [parts[at], t(`phase.${parts[at]}`), one.fitted]))),
    h("div", { class: "panel", tabindex: 0, role: "region", "aria-label": t("tooth.flank") }, h("table", {}, h("thead", {}, h("tr", {}, h("th", {}, "[µm]"), parts.map((one) => h("th", { class: "num" }, t(`phase.${one}`))))),
      h("tbody", {}, figures.map((name) => h("tr", {}, h("th", { scope: "row" }, name), found.map((one) => h("td", { class: "num" }, number(one.figures[name]))))))), verdict && h("p", { class: "verdict-words" }, prose(verdict.words)))];
}
