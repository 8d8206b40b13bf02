// The image with ring and cross; a click or a drag moves the point.
import { ahead, frame } from "./frames.js";
import { send } from "./link.js";
import { changed, markAt, state } from "./state.js";

const canvas = /** @type {HTMLCanvasElement} */ (document.getElementById("frame"));
const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
/** A point that is being dragged. @type {number[] | null} */ let dragged = null;
export const drawn = { frames: 0 };

export async function drawFrame() {
  if (state.work.phase === "live") return; // its images come by themselves
  const size = state.work.size_px, index = state.frame;
  if (!size) { canvas.width = 640; canvas.height = 360; context.clearRect(0, 0, 640, 360); return; }
  const image = await frame(index);
  if (index !== state.frame || !image) return;
  if (canvas.width !== size[0] || canvas.height !== size[1]) { canvas.width = size[0]; canvas.height = size[1]; }
  context.drawImage(image, 0, 0);
  overlay(index, Math.max(1, size[0] / Math.max(200, canvas.clientWidth)));
  canvas.dataset.frame = String(index);
  drawn.frames++;
  ahead(index, state.work.frames);
}

/** @param {number} index @param {number} px of the image in one of the screen */
function overlay(index, px) {
  const targets = state.work.targets || [];
  context.lineWidth = 2 * px;
  for (const [u, v] of state.candidates[index] || []) ring(u, v, 4 * px, "rgb(255 170 0 / 55%)");
  const crosses = state.answer?.crosses?.[index];
  targets.forEach((/** @type {string} */ target, /** @type {number} */ i) => {
    const at = crosses?.[i];
    if (at && at[0] !== null) cross(at[0], at[1], 9 * px);
    const mark = markAt(index, target), own = target === state.target;
    const points = own && dragged ? [dragged] : mark ? mark[2] : [];
    for (const [u, v] of points) ring(u, v, (own ? 9 : 6) * px, mark?.[4] ? "#9aa2ad" : mark && mark[3] !== "found" ? "#ffe65a" : "#35e06f", mark?.[4]);
  });
}

/** @param {number} u @param {number} v @param {number} r @param {string} colour @param {boolean} [struck] */
export function ring(u, v, r, colour, struck) {
  context.strokeStyle = colour; context.beginPath();
  context.arc(u + 0.5, v + 0.5, r, 0, 7);
  if (struck) { context.moveTo(u - r, v + r); context.lineTo(u + r, v - r); }
  context.stroke();
}

/** @param {number} u @param {number} v @param {number} r */
export function cross(u, v, r) {
  context.strokeStyle = "#ff4136"; context.beginPath();
  context.moveTo(u + 0.5 - r, v + 0.5); context.lineTo(u + 0.5 + r, v + 0.5);
  context.moveTo(u + 0.5, v + 0.5 - r); context.lineTo(u + 0.5, v + 0.5 + r);
  context.stroke();
}

/** Image px of a pointer: the picture is fitted into the canvas's box. @param {PointerEvent} event */
function place(event) {
  const box = canvas.getBoundingClientRect(), scale = Math.min(box.width / canvas.width, box.height / canvas.height);
  const left = box.left + (box.width - scale * canvas.width) / 2, top = box.top + (box.height - scale * canvas.height) / 2;
  const u = (event.clientX - left) / scale - 0.5, v = (event.clientY - top) / scale - 0.5;
  return u < -0.5 || v < -0.5 || u > canvas.width - 0.5 || v > canvas.height - 0.5 ? null : [u, v];
}

/** @param {number[]} at_px */
export function moveTo(at_px) {
  const mark = markAt(state.frame, state.target);
  let nearest = 0;
  if (mark) mark[2].forEach((p, i) => { if (Math.hypot(p[0] - at_px[0], p[1] - at_px[1]) < Math.hypot(mark[2][nearest][0] - at_px[0], mark[2][nearest][1] - at_px[1])) nearest = i; });
  send({ action: "move", frame: state.frame, target: state.target, place: nearest, at_px: at_px.map((x) => Math.round(x * 1000) / 1000) });
}

export function listenToPointer() {
  canvas.addEventListener("pointerdown", (event) => {
    if (!state.target || !state.work.size_px || state.work.phase === "live") return;
    dragged = place(event);
    if (!dragged) return;
    canvas.setPointerCapture(event.pointerId);
    state.playing = false; changed("playing"); drawFrame();
  });
  canvas.addEventListener("pointermove", (event) => { if (dragged) { dragged = place(event) || dragged; drawFrame(); } });
  canvas.addEventListener("pointerup", () => { if (dragged) { const at = dragged; dragged = null; moveTo(at); } });
  canvas.addEventListener("pointercancel", () => { dragged = null; drawFrame(); });
}
