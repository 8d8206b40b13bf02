// The image plane coloured by predicted error among the needles, turned by the mouse or the arrow keys.
import { colour, ramp, sharp } from "./chart.js";
import { state } from "./state.js";

const canvas = /** @type {HTMLCanvasElement} */ (document.getElementById("scene"));
let turn = 0.6, tilt = 0.45;

/** @typedef {number[]} Vec */

export function drawScene() {
  const { c, w, h } = sharp(canvas), scene = state.answer?.scene;
  if (!scene) { c.fillStyle = colour("quiet"); c.fillText("no calibration yet", 12, h / 2); return; }
  const points = [...scene.corners_mm, [0, 0, 0]], low = [0, 1, 2].map((i) => Math.min(...points.map((/** @type {Vec} */ p) => p[i]))), high = [0, 1, 2].map((i) => Math.max(...points.map((/** @type {Vec} */ p) => p[i])));
  const centre = low.map((x, i) => (x + high[i]) / 2), size = Math.hypot(...low.map((x, i) => high[i] - x)) || 1, scale = (1.15 * Math.min(w, h)) / size;
  const see = (/** @type {Vec} */ p) => {
    const [x, y, z] = p.map((one, i) => one - centre[i]), a = x * Math.cos(turn) + z * Math.sin(turn), b = -x * Math.sin(turn) + z * Math.cos(turn);
    return [w / 2 + scale * a, h / 2 + scale * (y * Math.cos(tilt) - b * Math.sin(tilt))];
  };
  const line = (/** @type {Vec} */ a, /** @type {Vec} */ b, /** @type {string} */ stroke, width = 1) => { c.strokeStyle = stroke; c.lineWidth = width; c.beginPath(); c.moveTo(...at(see(a))); c.lineTo(...at(see(b))); c.stroke(); };
  plane(c, see, scene.corners_mm);
  c.globalAlpha = 0.35; for (const [a, b] of scene.needles_mm) line(a, b, colour("mark")); c.globalAlpha = 1;
  const here = state.live ? -1 : scene.frames.indexOf(state.frame);
  if (here >= 0) line(scene.needles_mm[here][0], scene.needles_mm[here][1], "#ff4136", 2.5);
  if (state.live?.hold?.ends_mm) { c.globalAlpha = 0.7; line(state.live.hold.ends_mm[0], state.live.hold.ends_mm[1], "#5ec8ff", 6); c.globalAlpha = 1; }
  const reach = 0.18 * size;
  [[reach, 0, 0], [0, reach, 0], [0, 0, reach]].forEach((axis, i) => { line([0, 0, 0], axis, ["#c0392b", "#2e8b57", "#3a7bd5"][i], 2); c.fillStyle = colour("ink"); c.fillText("xyz"[i], ...at(see(axis))); });
  c.fillText("marker", ...at(see([0, 0, 0])));
}

/** @param {number[]} p @returns {[number, number]} */
const at = (p) => [p[0], p[1]];

/** @param {CanvasRenderingContext2D} c @param {(p: Vec) => Vec} see @param {Vec[]} corners */
function plane(c, see, corners) {
  const map = state.answer.predicted, [o, u, , v] = corners;
  const place = (/** @type {number} */ a, /** @type {number} */ b) => see(o.map((x, i) => x + a * (u[i] - x) + b * (v[i] - x)));
  const low = map ? Math.min(...map.below_mm) : 0, high = map ? Math.max(...map.below_mm) : 1, n = map ? map.grid - 1 : 1;
  for (let j = 0; j < n; j++) for (let i = 0; i < n; i++) {
    c.fillStyle = map ? ramp((map.below_mm[j * map.grid + i] - low) / Math.max(high - low, 1e-9)) : colour("line");
    c.beginPath(); for (const [a, b] of [[i, j], [i + 1.04, j], [i + 1.04, j + 1.04], [i, j + 1.04]]) c.lineTo(...at(place(Math.min(1, a / n), Math.min(1, b / n)))); c.fill();
  }
  for (const [id, mm] of /** @type {[string, number][]} */ ([["scale-low", low], ["scale-high", high]])) /** @type {HTMLElement} */ (document.getElementById(id)).textContent = map ? `${mm.toFixed(2)} mm` : "";
  c.fillStyle = colour("ink"); c.fillText("u", ...at(place(0.5, -0.04))); c.fillText("v", ...at(place(-0.05, 0.5)));
}

export function listenToScene() {
  let held = false;
  canvas.addEventListener("pointerdown", (event) => { held = true; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => { if (held) { turn += event.movementX / 120; tilt += event.movementY / 120; drawScene(); } });
  canvas.addEventListener("pointerup", () => { held = false; });
  canvas.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, -0.15], ArrowDown: [0, 0.15] }[event.key];
    if (way) { turn += way[0]; tilt += way[1]; drawScene(); event.preventDefault(); event.stopPropagation(); }
  });
}
