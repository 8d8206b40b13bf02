// The newest image of a scan, with ring and cross, and the ghost of the needle that is to be held next.
import { cross, ring } from "./frame_view.js";
import { isLive } from "./live.js";
import { state } from "./state.js";

const canvas = /** @type {HTMLCanvasElement} */ (document.getElementById("frame"));
const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
const PAUSE_MS = 400;
let runs = false, last = -1;

/** Asks for one image after the other while the scan goes on: as many as are drawn, never more. */
export async function followFrames() {
  if (runs || !isLive()) return;
  runs = true; last = -1;
  while (isLive()) {
    const answer = await fetch(`/live/frame?after=${last}`).catch(() => null);
    if (answer && answer.status === 200) await draw(answer);
    else if (!answer || answer.status !== 204) await new Promise((done) => setTimeout(done, PAUSE_MS));
  }
  runs = false;
}

/** @param {Response} answer */
async function draw(answer) {
  const told = JSON.parse(answer.headers.get("X-Told") || "{}"), width = Number(answer.headers.get("X-Width")), height = Number(answer.headers.get("X-Height"));
  const grey = new Uint8Array(await answer.arrayBuffer()), pixels = new Uint32Array(grey.length);
  for (let i = 0; i < grey.length; i++) pixels[i] = 0xff000000 | (grey[i] * 0x010101);
  await new Promise((done) => requestAnimationFrame(done));
  if (!isLive()) return;
  last = told.number;
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  context.putImageData(new ImageData(new Uint8ClampedArray(pixels.buffer), width, height), 0, 0);
  const px = Math.max(1, width / Math.max(200, canvas.clientWidth));
  ghost(px);
  context.lineWidth = 2 * px;
  for (const [u, v] of told.candidates) ring(u, v, 4 * px, "rgb(255 170 0 / 55%)");
  for (const at of told.crosses) if (at) cross(at[0], at[1], 9 * px);
  for (const at of told.rings) if (at) ring(at[0], at[1], 9 * px, "#35e06f");
  canvas.dataset.item = String(told.item);
}

/** Where the needle is to cross, and to where its hub leans. @param {number} px of the image in one of the screen */
function ghost(px) {
  const hold = state.live?.hold;
  if (!hold) return;
  const [u, v] = hold.place_px, [a, b] = hold.hub_px, lean = Math.hypot(a - u, b - v);
  context.save();
  context.strokeStyle = context.fillStyle = "#5ec8ff"; context.lineCap = "round"; context.globalAlpha = 0.75;
  context.setLineDash([6 * px, 6 * px]); context.lineWidth = 3 * px; context.beginPath(); context.arc(u, v, 16 * px, 0, 7); context.stroke();
  context.setLineDash([]);
  if (lean > 12 * px) { context.lineWidth = 7 * px; context.globalAlpha = 0.45; context.beginPath(); context.moveTo(u, v); context.lineTo(a, b); context.stroke(); }
  context.globalAlpha = 0.9; context.beginPath(); context.arc(a, b, 5 * px, 0, 7); context.fill();
  context.restore();
}
