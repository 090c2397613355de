// @ts-check
// The gear in three dimensions: it turns under the finger, its deviation exaggerated; a picked point tells its figures.
import * as library from "../vendor/three.module.min.js";

// The library's own types are another package.
const THREE = /** @type {any} */ (library);

const BELOW = new THREE.Color(0x2166ac);
const ABOVE = new THREE.Color(0xb2182b);
const WHITE = new THREE.Color(0xf4f4f4);
const FACES = 2;

function colourOf(value, scale) {
  const part = Math.min(1, Math.abs(value) / (scale || 1));
  return WHITE.clone().lerp(value < 0 ? BELOW : ABOVE, part);
}

/**
 * The flank's surface of every space: a ring of profiles over the face width, moved along its normal by the deviation.
 * @param {{points_mm: number[][], normals: number[][], z_mm: number[]}} form a space's profile (x, y) with its normals
 * @param {number[][][]} deviation um by space, profile point, height
 * @param {{scale: number, times: number}} how the largest deviation (um), and how many times larger than true
 */
function surface(form, deviation, { scale, times }) {
  const [spaces, points, heights] = [deviation.length, form.points_mm.length, form.z_mm.length];
  const [places, colours, faces, of] = [[], [], [], []];
  for (let k = 0; k < spaces; k += 1) {
    const [cos, sin] = [Math.cos((2 * Math.PI * k) / spaces), Math.sin((2 * Math.PI * k) / spaces)];
    for (let i = 0; i < points; i += 1) {
      const [[x, y], [nx, ny]] = [form.points_mm[i], form.normals[i]];
      for (let z = 0; z < heights; z += 1) {
        const um = deviation[k][i][z];
        const [px, py] = [x + (nx * um * times) / 1000, y + (ny * um * times) / 1000];
        places.push(px * cos - py * sin, px * sin + py * cos, form.z_mm[z]);
        const { r, g, b } = colourOf(um, scale);
        colours.push(r, g, b);
        of.push([k, i, z]);
        if (i + 1 === points || z + 1 === heights) continue;
        const at = (k * points + i) * heights + z;
        faces.push(at, at + heights, at + 1, at + 1, at + heights, at + heights + 1);
      }
    }
  }
  const made = new THREE.BufferGeometry();
  made.setAttribute("position", new THREE.Float32BufferAttribute(places, 3));
  made.setAttribute("color", new THREE.Float32BufferAttribute(colours, 3));
  made.setIndex(faces);
  made.computeVertexNormals();
  return { made, of };
}

/** Whether this browser can draw in three dimensions at all; by software is enough. */
export function able() {
  const probe = document.createElement("canvas");
  return Boolean(probe.getContext("webgl2"));
}

/**
 * A view of one gear; `set` shows another deviation, `pick` is told the point that was touched.
 * @param {HTMLCanvasElement} canvas
 */
export function view(canvas, { form, pick }) {
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
  renderer.setPixelRatio(Math.min(devicePixelRatio, FACES));
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(32, 1, 0.1, 5000);
  const reach = Math.max(...form.points_mm.map(([x, y]) => Math.hypot(x, y)));
  const turn = new THREE.Group();
  scene.add(turn, new THREE.HemisphereLight(0xffffff, 0xb0b0b0, 2.8), new THREE.DirectionalLight(0xffffff, 1.6));
  camera.position.set(0, -reach * 2.6, reach * 2.6);
  camera.lookAt(0, 0, 0);
  let [mesh, of, due, distance] = [null, [], false, 1];
  const draw = () => {
    due = false;
    renderer.render(scene, camera);
  };
  const later = () => {
    if (!due) requestAnimationFrame(draw);
    due = true;
  };
  const set = (deviation, how) => {
    const next = surface(form, deviation, how);
    mesh?.geometry.dispose();
    if (mesh) mesh.geometry = next.made;
    else {
      mesh = new THREE.Mesh(next.made, new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide }));
      turn.add(mesh);
    }
    of = next.of;
    later();
  };
  const sized = () => {
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !height) return;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    later();
  };
  new ResizeObserver(sized).observe(canvas);
  const rotate = (dx, dy) => {
    turn.rotation.z += dx;
    turn.rotation.x = Math.max(-1.2, Math.min(1.2, turn.rotation.x + dy));
    later();
  };
  const zoom = (by) => {
    distance = Math.max(0.25, Math.min(2.5, distance * by));
    camera.position.set(0, -reach * 2.6 * distance, reach * 2.6 * distance);
    later();
  };
  const at = (x, y) => {
    const frame = canvas.getBoundingClientRect();
    const ray = new THREE.Raycaster();
    ray.setFromCamera(
      new THREE.Vector2((2 * (x - frame.left)) / frame.width - 1, 1 - (2 * (y - frame.top)) / frame.height),
      camera,
    );
    const [hit] = mesh ? ray.intersectObject(mesh) : [];
    if (hit) pick(...of[hit.face.a]);
  };
  moved(canvas, { rotate, zoom, at });
  sized();
  return { set, rotate, zoom };
}

// A finger or the mouse turns it, two fingers and the wheel zoom, a touch picks; arrow keys, plus and minus as well.
function moved(canvas, { rotate, zoom, at }) {
  const held = new Map();
  let went = 0;
  const spread = () => {
    const [a, b] = [...held.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, [event.clientX, event.clientY]);
    went = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!held.has(event.pointerId)) return;
    const [before, wide] = [held.get(event.pointerId), held.size === 2 && spread()];
    held.set(event.pointerId, [event.clientX, event.clientY]);
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    went += Math.abs(dx) + Math.abs(dy);
    if (held.size === 1) rotate(dx / 150, dy / 150);
    else if (spread() > 4) zoom(wide / spread());
  });
  canvas.addEventListener("pointerup", (event) => {
    held.delete(event.pointerId);
    if (went < 6) at(event.clientX, event.clientY);
  });
  canvas.addEventListener("pointercancel", (event) => held.delete(event.pointerId));
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      zoom(event.deltaY < 0 ? 0.9 : 1.1);
    },
    { passive: false },
  );
  canvas.addEventListener("keydown", (event) => {
    const keys = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
    if (event.key in keys) rotate(...keys[event.key]);
    else if (event.key === "+" || event.key === "-") zoom(event.key === "+" ? 0.9 : 1.1);
    else return;
    event.preventDefault();
  });
}
