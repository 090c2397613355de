// @ts-check
// Makes elements: h for HTML, s for SVG. Text is always set as text, never as markup.
const SVG = "http://www.w3.org/2000/svg";

function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "value" && "value" in node) node.value = value;
    else node.setAttribute(name, value === true ? "" : value);
  }
  for (const child of children.flat(4)) {
    if (child === null || child === undefined || child === false) continue;
    node.append(child instanceof Node ? child : String(child));
  }
  return node;
}

export function h(name, attributes, ...children) {
  return fill(document.createElement(name), attributes, children);
}

export function s(name, attributes, ...children) {
  return fill(document.createElementNS(SVG, name), attributes, children);
}

export function show(node, ...children) {
  const kept = document.activeElement?.id;
  node.replaceChildren(...children.flat(4).filter((one) => one !== null && one !== undefined && one !== false));
  if (kept) document.getElementById(kept)?.focus({ preventScroll: true });
  return node;
}

// Whether a box shows just this already: a key that is drawn anew between press and release hears no press, and a
// field loses what is being typed.
export function same(box, ...what) {
  const key = JSON.stringify([...what, document.documentElement.lang, document.documentElement.dataset.words]);
  if (box.dataset.key === key) return true;
  box.dataset.key = key;
  return false;
}

// Shows what was fetched for a box, unless the box was asked for something else meanwhile.
export function turn(box) {
  const key = box.dataset.key;
  return (...children) => box.dataset.key === key && show(box, ...children);
}

// What went wrong in place of a box; whatever comes next is drawn.
export function failed(box, text) {
  delete box.dataset.key;
  return show(box, h("p", { class: "fault", role: "alert" }, text));
}

// Other words around what was typed: that stays.
export function reworded(box, draw) {
  const typed = [...box.querySelectorAll("input")].map((one) => [one.name, one.value]);
  draw();
  for (const one of box.querySelectorAll("input"))
    one.value = typed.find(([name]) => name === one.name)?.[1] ?? one.value;
}

export function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}
