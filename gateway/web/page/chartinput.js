// @ts-check
// Zoom and pan of a chart: wheel, two fingers, one finger or Shift to pan, arrow keys, plus, minus and Home.
const STEP = 0.1;
const ZOOM = 0.8;

export function handled(now) {
  const {
    box,
    parts: { place },
  } = now;
  now.reset = () => {
    now.resetting = true;
    now.zoomed = false;
    now.auto = true;
    now.plot?.setData(now.data, true);
    now.resetting = false;
  };
  const scaled = (name, change) => {
    const { min, max } = now.plot.scales[name];
    Object.assign(now, { zoomed: true, auto: false });
    now.plot.setScale(name, change(min, max));
  };
  const pan = (name, part) =>
    scaled(name, (min, max) => ({ min: min + part * (max - min), max: max + part * (max - min) }));
  const zoom = (name, by, at = 0.5) =>
    scaled(name, (min, max) => {
      const middle = min + at * (max - min);
      return { min: middle - by * (middle - min), max: middle + by * (max - middle) };
    });
  const move = (by) => {
    const { data, plot } = now;
    const at = Math.max(0, Math.min(data[0].length - 1, (plot.cursor.idx ?? -1) + by));
    plot.setCursor({ left: plot.valToPos(data[0][at], "x"), top: plot.bbox.height / devicePixelRatio / 2 });
  };
  box.addEventListener("keydown", (event) => {
    if (!now.plot || event.target !== box || event.ctrlKey || event.metaKey || event.altKey) return;
    const keys = {
      ArrowLeft: () => (event.shiftKey ? pan("x", -STEP) : move(-1)),
      ArrowRight: () => (event.shiftKey ? pan("x", STEP) : move(1)),
      ArrowUp: () => pan("y", STEP),
      ArrowDown: () => pan("y", -STEP),
      "+": () => zoom("x", ZOOM),
      "-": () => zoom("x", 1 / ZOOM),
      Home: now.reset,
    };
    if (!(event.key in keys)) return;
    event.preventDefault();
    keys[event.key]();
  });
  const partOf = (event) => {
    const frame = now.plot.over.getBoundingClientRect();
    return [(event.clientX - frame.left) / frame.width, 1 - (event.clientY - frame.top) / frame.height];
  };
  place.addEventListener(
    "wheel",
    (event) => {
      // A wheel alone scrolls the screen.
      if (!now.plot || !(event.ctrlKey || event.shiftKey)) return;
      event.preventDefault();
      const [x, y] = partOf(event);
      const by = (event.deltaY || event.deltaX) < 0 ? ZOOM : 1 / ZOOM;
      zoom("x", by, x);
      zoom("y", by, y);
    },
    { passive: false },
  );
  fingers(place, { pan, zoom, partOf, able: () => Boolean(now.plot) });
}

// One finger pans, two zoom about their middle; a mouse drags a rectangle, with Shift it pans.
function fingers(place, { pan, zoom, partOf, able }) {
  const held = new Map();
  const spread = () => {
    const [a, b] = [...held.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  place.addEventListener(
    "pointerdown",
    (event) => {
      if (!able() || (event.pointerType === "mouse" && !event.shiftKey)) return;
      event.stopPropagation();
      event.preventDefault();
      place.setPointerCapture(event.pointerId);
      held.set(event.pointerId, partOf(event));
    },
    true,
  );
  // The library drags by mouse events.
  place.addEventListener("mousedown", (event) => event.shiftKey && event.stopPropagation(), true);
  place.addEventListener("pointermove", (event) => {
    if (!held.has(event.pointerId)) return;
    const [before, wide] = [held.get(event.pointerId), held.size === 2 && spread()];
    held.set(event.pointerId, partOf(event));
    const [x, y] = held.get(event.pointerId);
    if (held.size === 1) {
      pan("x", before[0] - x);
      pan("y", before[1] - y);
    } else if (held.size === 2 && spread() > 0.01) {
      zoom("x", wide / spread(), x);
      zoom("y", wide / spread(), y);
    }
  });
  for (const end of ["pointerup", "pointercancel"])
    place.addEventListener(end, (event) => held.delete(event.pointerId));
}
