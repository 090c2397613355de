// @ts-check
// The machine of a mounting, drawn from its chain: from the bed outward to work and tool, seen from the front
// (X to the right, Z up), or from the side where Y or A moves; what moves is filled, and the instrument looks along the
// direction of the moving axis. Each link carries what comes behind it, so that all of it stands where the axes stand.
import { s, write } from "./dom.js";
import { number } from "./figures.js";
import { state } from "./state.js";
import { t } from "./words.js";

/**
 * @typedef {object} Link of the chain, from the bed outward
 * @property {string} letter
 * @property {string} kind "prismatic" or "revolute"
 * @property {number[]} direction
 * @typedef {{x: number, y: number}} Place in the drawing, px
 * @typedef {object} Side
 * @property {SVGElement} root
 * @property {SVGElement} outermost what moves with the end of the side
 * @property {Place} end where that is while every axis stands in the middle of its travel
 * @property {Mover[]} movers
 * @typedef {object} Mover
 * @property {string} letter
 * @property {number[]} along px for half of the travel; [0, 0] of a turning axis
 * @property {(turned: number) => void} turn shows an angle in deg
 * @property {SVGElement} group
 */

const BED = 372;
const PLACES = { work: 360, aside: 250, tool: 610 };
const HALF_PX = [46, 40];
const label = (x, y, text, look = "") => s("text", { class: `caption ${look}`, x, y }, text);
const box = (look, x, y, width, height) => s("rect", { class: look, x, y, width, height });

/**
 * The drawing of an axis' mounting. `place` moves everything to where axes stand, mm or deg by machine axis.
 * @param {{name: string, letter: string, kind: string}} axis of the site file
 * @param {string} kind what is measured: position, straight, tilt, location
 * @returns {{parts: SVGElement[], place: (positions: Record<string, number>) => void}}
 */
export function machinery(axis, kind) {
  const { work, tool } = sides(axis);
  const ends = [path(work, t("drawing.work")), path(tool, t(state.file.work ? "drawing.wheel" : "drawing.tool"))];
  const side = tool.some((one) => one.letter === axis.letter) ? "tool" : "work";
  const own = (side === "work" ? work : tool).find((one) => one.letter === axis.letter);
  const left = stack(work, own.direction[2] && side === "tool" ? "aside" : "work", axis.letter);
  const right = stack(tool, "tool", axis.letter);
  const at = side === "work" ? left : right;
  const stands = label(736, BED + 20, "", "end stands");
  const optics =
    own.kind === "revolute"
      ? turning(axis, kind, at, right, Boolean(own.direction[2]))
      : own.direction[2]
        ? upright(axis, kind, right)
        : level(axis, kind, at, side);
  const parts = [
    box("bed", 16, BED, 728, 30),
    label(30, BED + 20, t("drawing.bed")),
    stands,
    left.root,
    right.root,
    ...optics.fixed,
    label(24, 60, `${t("drawing.chain")}: ${ends.filter(Boolean).join("; ")}`, "small"),
    label(24, 82, t("YA".includes(axis.letter) ? "drawing.view_side" : "drawing.view_front"), "small"),
  ];
  const place = (positions) => {
    const [ofWork, ofTool] = [left, right].map((one) => shifted(one, positions));
    optics.follow(side === "work" ? ofWork : ofTool, ofTool);
    write(stands, textOf(positions));
  };
  return { parts, place };
}

// The machine's own name of an axis of the chain, and its travel; one that is not measured has none.
const axisOf = (letter) => state.file.axes.find((one) => one.letter === letter);

function textOf(positions) {
  const known = state.file.axes.filter((one) => one.name in positions);
  const one = ({ name, kind }) => `${name} ${number(positions[name], 3)} ${kind === "rotary" ? "°" : "mm"}`;
  return known.map(one).join("   ");
}

// Everything of a side moved to where its axes stand; by how much its end stands off the middle.
function shifted({ movers }, positions) {
  const total = [0, 0];
  for (const { letter, along, turn, group } of movers) {
    const axis = axisOf(letter);
    const at = positions[axis?.name];
    if (!Number.isFinite(at)) continue;
    const [low, high] = axis.travel;
    const part = Math.max(-1, Math.min(1, (2 * (at - low)) / (high - low) - 1));
    const [dx, dy] = along.map((px) => part * px);
    group.setAttribute("transform", `translate(${dx.toFixed(1)} ${dy.toFixed(1)})`);
    turn(at);
    total[0] += dx;
    total[1] += dy;
  }
  return { dx: total[0], dy: total[1] };
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

const still = () => {};

/**
 * The parts of one side, each within the one that carries it.
 * @param {Link[]} links
 * @returns {Side}
 */
function stack(links, side, moving) {
  const root = s("g", {});
  const end = { x: PLACES[side], y: BED };
  const movers = [];
  let outermost = root;
  const look = (letter) => (letter === moving ? "slide moving" : "slide");
  for (const one of links) {
    const group = s("g", { "data-moves": one.letter });
    const mover = { letter: one.letter, along: [0, 0], turn: still, group };
    if (one.kind === "revolute" && !one.direction[2]) {
      end.y -= 56;
      const [cx, cy] = [end.x + 60, end.y + 28];
      const spoke = s("line", { class: "spoke", x1: cx, y1: cy, x2: cx, y2: cy - 20 });
      mover.turn = (deg) => spoke.setAttribute("transform", `rotate(${deg.toFixed(1)} ${cx} ${cy})`);
      group.append(
        box(look(one.letter), end.x - 90, end.y, 180, 56),
        s("circle", { class: look(one.letter), cx, cy, r: 20 }),
        spoke,
        label(end.x - 78, end.y + 34, `${one.letter} · ${t("drawing.swivel")}`),
      );
    } else if (one.kind === "revolute") {
      end.y -= 34;
      const [cx, cy] = [end.x, end.y];
      const spoke = s("line", { class: "spoke", x1: cx, y1: cy, x2: cx + 78, y2: cy });
      // A circle seen from the side: the far half of a turn lies above its middle.
      mover.turn = (deg) => {
        const turned = (deg * Math.PI) / 180;
        spoke.setAttribute("x2", (cx + 78 * Math.cos(turned)).toFixed(1));
        spoke.setAttribute("y2", (cy - 9 * Math.sin(turned)).toFixed(1));
      };
      group.append(
        box(look(one.letter), cx - 78, cy, 156, 34),
        s("ellipse", { class: look(one.letter), cx, cy, rx: 78, ry: 9 }),
        spoke,
        label(cx - 62, cy + 26, `${one.letter} · ${t("drawing.table")}`),
      );
    } else if (one.direction[2]) {
      mover.along = [0, -HALF_PX[1] * Math.sign(one.direction[2])];
      outermost.append(
        box("stand", end.x + 14, 96, 70, end.y - 96),
        label(end.x + 20, 90, `${one.letter} · ${t("drawing.slide")}`),
      );
      group.append(box(look(one.letter), end.x - 22, 176, 36, 110));
      Object.assign(end, { x: end.x - 52, y: 230 });
    } else {
      // What moves along the line of sight stands still in the drawing, and its position is written below.
      mover.along = [HALF_PX[0] * (one.direction[0] || Number(moving === one.letter)), 0];
      end.y -= 32;
      group.append(
        box(look(one.letter), end.x - 105, end.y, 210, 32),
        label(side === "tool" ? end.x - 22 : end.x - 92, end.y + 21, `${one.letter} · ${t("drawing.slide")}`),
      );
    }
    outermost.append(group);
    outermost = group;
    movers.push(mover);
  }
  if (side === "tool" && links.length)
    outermost.append(s("line", { class: "arm", x1: end.x + 30, x2: end.x, y1: end.y, y2: end.y }));
  return { root, outermost, end, movers };
}

const OPTICS = { straight: "straight", tilt: "angle", position: "length", location: "length" };
const reflector = ({ x, y }) => s("path", { class: "optic", d: `M${x - 22},${y - 22} h26 l16,22 l-16,22 h-26 z` });
const arrow = (x1, y1, x2, y2) => s("line", { class: "positive", x1, y1, x2, y2 });
const tip = (x, y, shape) => s("path", { class: "tip", d: `M${x},${y} ${shape}` });

// Laser and fixed optics beside the machine, in line with a place; the beam ends at what moves.
function beside(place, until, optics) {
  const light = s("line", { class: "light", x1: 126, x2: place.x - until, y1: place.y, y2: place.y });
  const fixed = [
    box("laser", 30, place.y - 22, 96, 44),
    box("stand", 70, place.y + 22, 14, BED - place.y - 22),
    label(30, place.y - 32, t("drawing.laser")),
    light,
    box("optic", 186, place.y - 22, 40, 44),
    box("stand", 199, place.y + 22, 14, BED - place.y - 22),
    label(186, place.y - 62, t(optics)),
  ];
  return { fixed, follow: ({ dx }) => light.setAttribute("x2", (place.x - until + dx).toFixed(1)) };
}

// Along a horizontal axis: the laser stands beside the machine and looks at what stands in the place of the work.
function level(axis, kind, { end, outermost }, side) {
  const optics = OPTICS[kind];
  const place = { x: end.x, y: end.y - 34 };
  outermost.append(
    box("stand", place.x - 6, place.y + 22, 12, 12),
    reflector(place),
    label(place.x - 40, place.y - 32, t(`drawing.moving_${optics}`)),
  );
  const { fixed, follow } = beside(place, 22, `drawing.fixed_${optics}`);
  const sense = [
    arrow(place.x - 70, 112, place.x + 60, 112),
    tip(place.x + 70, 112, "l-16,-8 v16 z"),
    label(side === "tool" ? place.x - 112 : place.x + 82, 120, `+${axis.letter}`, "title"),
  ];
  return { fixed: [...fixed, ...sense], follow };
}

// Along an upright axis: the beam goes up from the bed to what stands in the place of the wheel.
function upright(axis, kind, { end, outermost }) {
  const optics = OPTICS[kind];
  const x = end.x;
  const light = s("line", { class: "light", x1: x, x2: x, y1: BED - 44, y2: end.y + 20 });
  outermost.append(
    s("g", { transform: `rotate(-90 ${x} ${end.y})` }, reflector(end)),
    label(x - 30, end.y + 6, t(`drawing.moving_${optics}`), "end"),
  );
  const fixed = [
    box("laser", x - 24, BED - 44, 48, 44),
    label(x - 32, BED - 18, t("drawing.laser"), "end"),
    light,
    box("optic", x - 22, BED - 96, 44, 36),
    label(x - 30, BED - 72, t(`drawing.fixed_${optics}`), "end"),
    arrow(x, 170, x, 120),
    tip(x, 110, "l-8,16 h16 z"),
    label(x - 50, 126, `+${axis.letter}`, "title"),
  ];
  return { fixed, follow: ({ dy }) => light.setAttribute("y2", (end.y + 20 + dy).toFixed(1)) };
}

// About a turning axis: a calibrator on the table in the beam, or an artefact under an instrument at the wheel's place.
function turning(axis, kind, { end, outermost }, { end: wheel, outermost: head }, vertical) {
  // About an axis that points at who looks the turn lies in the drawing's plane.
  const sense = !vertical
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
  if (kind === "position") {
    outermost.append(
      box("optic", place.x - 42, place.y - 30, 84, 74),
      label(place.x - 62, place.y - 42, t("drawing.calibrator")),
    );
    const { fixed, follow } = beside(place, 40, "drawing.fixed_angle");
    return { fixed: [...fixed, ...sense], follow };
  }
  outermost.append(
    s("circle", { class: "optic", cx: place.x, cy: place.y, r: 32 }),
    box("stand", place.x - 10, place.y + 32, 20, 12),
    label(place.x - 62, place.y - 44, t("drawing.artefact")),
  );
  head.append(
    box("laser", wheel.x - 34, wheel.y - 16, 56, 32),
    label(wheel.x + 22, wheel.y - 26, t("drawing.laser"), "end"),
  );
  const light = s("line", { class: "light", x1: wheel.x - 34, x2: place.x + 30, y1: wheel.y, y2: place.y - 10 });
  const follow = ({ dx, dy }, { dx: hx, dy: hy }) => {
    const ends = { x1: wheel.x - 34 + hx, y1: wheel.y + hy, x2: place.x + 30 + dx, y2: place.y - 10 + dy };
    for (const [name, value] of Object.entries(ends)) light.setAttribute(name, value.toFixed(1));
  };
  return { fixed: [light, ...sense], follow };
}
