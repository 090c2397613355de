// @ts-check
// The machine of a mounting, drawn from its chain: from the bed outward to work and tool, seen from the front
// (X to the right, Z up), or from the side where Y or A moves; what moves is filled, and the instrument looks along the
// direction of the moving axis.
import { s } from "./dom.js";
import { state } from "./state.js";
import { t } from "./words.js";

const BED = 372;
const PLACES = { work: 360, aside: 250, tool: 610 };
const label = (x, y, text, look = "") => s("text", { class: `caption ${look}`, x, y }, text);
const box = (look, x, y, width, height) => s("rect", { class: look, x, y, width, height });

export function machinery(axis, kind) {
  const { work, tool } = sides(axis);
  const ends = [path(work, t("drawing.work")), path(tool, t(state.file.work ? "drawing.wheel" : "drawing.tool"))];
  const side = tool.some((one) => one.letter === axis.letter) ? "tool" : "work";
  const own = (side === "work" ? work : tool).find((one) => one.letter === axis.letter);
  const [left, right] = [
    stack(work, own.direction[2] && side === "tool" ? "aside" : "work", axis.letter),
    stack(tool, "tool", axis.letter),
  ];
  const at = side === "work" ? left : right;
  return [
    box("bed", 16, BED, 728, 30),
    label(30, BED + 20, t("drawing.bed")),
    ...left.parts,
    ...right.parts,
    ...(own.kind === "revolute"
      ? turning(axis, kind, at, right.end, Boolean(own.direction[2]))
      : own.direction[2]
        ? upright(axis, kind, right.end)
        : level(axis, kind, at, side)),
    label(24, 60, `${t("drawing.chain")}: ${ends.filter(Boolean).join("; ")}`, "small"),
    label(24, 82, t("YA".includes(axis.letter) ? "drawing.view_side" : "drawing.view_front"), "small"),
  ];
}

// Where the chain is not known an axis stands alone on the bed; its letter tells where it leads.
function sides(axis) {
  const chain = state.plan.chain;
  if ([...chain.work, ...chain.tool].some((one) => one.letter === axis.letter)) return chain;
  const link = {
    letter: axis.letter,
    kind: axis.kind === "rotary" ? "revolute" : "prismatic",
    direction: ["XA", "YB", "ZC"].map((pair) => Number(pair.includes(axis.letter))),
  };
  return axis.letter === "Z" ? { work: [], tool: [link] } : { work: [link], tool: [] };
}

const path = (links, end) =>
  links.length ? [t("drawing.bed"), ...links.map((one) => one.letter), end].join(" › ") : "";

// The parts of one side, and where its end is: the place of the work or of the wheel.
function stack(links, side, moving) {
  const parts = [];
  const end = { x: PLACES[side], y: BED };
  const look = (letter) => (letter === moving ? "slide moving" : "slide");
  for (const one of links) {
    if (one.kind === "revolute" && !one.direction[2]) {
      end.y -= 56;
      parts.push(
        box(look(one.letter), end.x - 90, end.y, 180, 56),
        s("circle", { class: look(one.letter), cx: end.x + 60, cy: end.y + 28, r: 20 }),
        label(end.x - 78, end.y + 34, `${one.letter} · ${t("drawing.swivel")}`),
      );
    } else if (one.kind === "revolute") {
      end.y -= 34;
      parts.push(
        box(look(one.letter), end.x - 78, end.y, 156, 34),
        s("ellipse", { class: look(one.letter), cx: end.x, cy: end.y, rx: 78, ry: 9 }),
        label(end.x - 62, end.y + 26, `${one.letter} · ${t("drawing.table")}`),
      );
    } else if (one.direction[2]) {
      parts.push(
        box("stand", end.x + 14, 96, 70, end.y - 96),
        box(look(one.letter), end.x - 22, 176, 36, 110),
        label(end.x + 20, 90, `${one.letter} · ${t("drawing.slide")}`),
      );
      Object.assign(end, { x: end.x - 52, y: 230 });
    } else {
      end.y -= 32;
      parts.push(
        box(look(one.letter), end.x - 105, end.y, 210, 32),
        label(side === "tool" ? end.x - 22 : end.x - 92, end.y + 21, `${one.letter} · ${t("drawing.slide")}`),
      );
    }
  }
  if (side === "tool" && links.length)
    parts.push(s("line", { class: "arm", x1: end.x + 30, x2: end.x, y1: end.y, y2: end.y }));
  return { parts, end };
}

const OPTICS = { straight: "straight", tilt: "angle", position: "length", location: "length" };
const reflector = ({ x, y }) => s("path", { class: "optic", d: `M${x - 22},${y - 22} h26 l16,22 l-16,22 h-26 z` });
const arrow = (x1, y1, x2, y2) => s("line", { class: "positive", x1, y1, x2, y2 });
const tip = (x, y, shape) => s("path", { class: "tip", d: `M${x},${y} ${shape}` });

// Along a horizontal axis: the laser stands beside the machine and looks at what stands in the place of the work.
function level(axis, kind, { end }, side) {
  const optics = OPTICS[kind];
  const place = { x: end.x, y: end.y - 34 };
  return [
    box("laser", 30, place.y - 22, 96, 44),
    box("stand", 70, place.y + 22, 14, BED - place.y - 22),
    label(30, place.y - 32, t("drawing.laser")),
    s("line", { class: "light", x1: 126, x2: place.x - 22, y1: place.y, y2: place.y }),
    box("optic", 186, place.y - 22, 40, 44),
    box("stand", 199, place.y + 22, 14, BED - place.y - 22),
    label(186, place.y - 62, t(`drawing.fixed_${optics}`)),
    box("stand", place.x - 6, place.y + 22, 12, 12),
    reflector(place),
    label(place.x - 40, place.y - 32, t(`drawing.moving_${optics}`)),
    arrow(place.x - 70, 112, place.x + 60, 112),
    tip(place.x + 70, 112, "l-16,-8 v16 z"),
    label(side === "tool" ? place.x - 112 : place.x + 82, 120, `+${axis.letter}`, "title"),
  ];
}

// Along an upright axis: the beam goes up from the bed to what stands in the place of the wheel.
function upright(axis, kind, end) {
  const optics = OPTICS[kind];
  const x = end.x;
  return [
    box("laser", x - 24, BED - 44, 48, 44),
    label(x - 32, BED - 18, t("drawing.laser"), "end"),
    s("line", { class: "light", x1: x, x2: x, y1: BED - 44, y2: end.y + 20 }),
    box("optic", x - 22, BED - 96, 44, 36),
    label(x - 30, BED - 72, t(`drawing.fixed_${optics}`), "end"),
    s("g", { transform: `rotate(-90 ${x} ${end.y})` }, reflector(end)),
    label(x - 30, end.y + 6, t(`drawing.moving_${optics}`), "end"),
    arrow(x, 196, x, 130),
    tip(x, 120, "l-8,16 h16 z"),
    label(x - 50, 136, `+${axis.letter}`, "title"),
  ];
}

// About a turning axis: a calibrator on the table in the beam, or an artefact under an instrument at the wheel's place.
function turning(axis, kind, { end }, wheel, vertical) {
  // About an axis that points at who looks the turn lies in the drawing's plane.
  const turn = !vertical
    ? [
        s("path", { class: "positive turn", d: `M${end.x + 92},${end.y + 40} a96,96 0 0 0 -40,-84` }),
        tip(end.x + 46, end.y - 50, "l18,-2 l-10,16 z"),
        label(end.x + 104, end.y + 20, `+${axis.letter}`, "title"),
      ]
    : [
        s("path", { class: "positive turn", d: `M${end.x - 100},112 a100,26 0 0 0 192,6` }),
        tip(end.x + 98, 108, "l-16,10 l16,8 z"),
        label(end.x + 112, 120, `+${axis.letter}`, "title"),
      ];
  const place = { x: end.x, y: end.y - 44 };
  if (kind === "position")
    return [
      box("laser", 30, place.y - 22, 96, 44),
      box("stand", 70, place.y + 22, 14, BED - place.y - 22),
      label(30, place.y - 32, t("drawing.laser")),
      s("line", { class: "light", x1: 126, x2: place.x - 40, y1: place.y, y2: place.y }),
      box("optic", 186, place.y - 22, 40, 44),
      box("stand", 199, place.y + 22, 14, BED - place.y - 22),
      label(186, place.y - 62, t("drawing.fixed_angle")),
      box("optic", place.x - 42, place.y - 30, 84, 74),
      label(place.x - 62, place.y - 42, t("drawing.calibrator")),
      ...turn,
    ];
  return [
    s("circle", { class: "optic", cx: place.x, cy: place.y, r: 32 }),
    box("stand", place.x - 10, place.y + 32, 20, 12),
    label(place.x - 62, place.y - 44, t("drawing.artefact")),
    box("laser", wheel.x - 34, wheel.y - 16, 56, 32),
    s("line", { class: "light", x1: wheel.x - 34, x2: place.x + 30, y1: wheel.y, y2: place.y - 10 }),
    label(wheel.x + 22, wheel.y - 26, t("drawing.laser"), "end"),
    ...turn,
  ];
}
