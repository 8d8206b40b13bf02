// Distances by frame; a click goes to the nearest.
import { colour, sharp } from "./chart.js";
import { goTo, markAt, state } from "./state.js";

const canvas = /** @type {HTMLCanvasElement} */ (document.getElementById("residuals"));
const LEFT = 34, RIGHT = 8, TOP = 8, BOTTOM = 20;
/** @type {{x: number, y: number, frame: number, target: string}[]} */ let dots = [];

export function drawResiduals() {
  const { c, w, h } = sharp(canvas), rows = state.answer?.residuals || [];
  dots = [];
  if (!rows.length) { c.fillStyle = colour("quiet"); c.fillText("no calibration yet", LEFT, h / 2); return; }
  const first = state.work.frames ? 0 : rows[0][0], last = Math.max(first + 1, state.work.frames ? state.work.frames - 1 : rows[rows.length - 1][0]);
  const top = 1.15 * Math.max(0.05, ...rows.filter((/** @type {any} */ r) => r[3]).map((/** @type {any} */ r) => r[2]));
  const x = (/** @type {number} */ frame) => LEFT + ((w - LEFT - RIGHT) * (frame - first)) / (last - first);
  const y = (/** @type {number} */ mm) => h - BOTTOM - ((h - TOP - BOTTOM) * Math.min(mm, top)) / top;
  c.strokeStyle = colour("line"); c.fillStyle = colour("quiet");
  const tick = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10].find((one) => top / one <= 4) || 20;
  for (let mm = 0; mm <= top; mm += tick) { c.beginPath(); c.moveTo(LEFT, y(mm)); c.lineTo(w - RIGHT, y(mm)); c.stroke(); c.fillText(String(Number(mm.toFixed(2))), 4, y(mm) + 4); }
  c.fillText(String(first), LEFT, h - 5); c.textAlign = "right"; c.fillText(`frame ${last}`, w - RIGHT, h - 5); c.textAlign = "left";
  for (const [frame, target, mm, agrees] of rows) {
    const px = x(frame), py = y(mm);
    dots.push({ x: px, y: py, frame, target }); c.beginPath();
    if (!agrees) { c.strokeStyle = colour("stop"); c.moveTo(px - 3, py - 3); c.lineTo(px + 3, py + 3); c.moveTo(px + 3, py - 3); c.lineTo(px - 3, py + 3); c.stroke(); continue; }
    c.arc(px, py, 2.4, 0, 7); c.strokeStyle = c.fillStyle = colour("mark");
    if ((markAt(frame, target) || [])[3] === "found") c.fill(); else c.stroke();
  }
  c.strokeStyle = colour("care"); c.beginPath(); c.moveTo(x(state.frame), TOP); c.lineTo(x(state.frame), h - BOTTOM); c.stroke();
}

/** To the sighting of the largest residual but for those that were shown already. */
const shown = new Set();
export function nextWorst() {
  const rows = [...(state.answer?.residuals || [])].sort((a, b) => b[2] - a[2]);
  const next = rows.find((row) => !shown.has(`${row[0]} ${row[1]}`)) || rows[0];
  if (!next) return;
  if (rows.every((row) => shown.has(`${row[0]} ${row[1]}`))) shown.clear();
  shown.add(`${next[0]} ${next[1]}`); state.target = next[1]; goTo(next[0]);
}

export function listenToResiduals() {
  canvas.addEventListener("click", (event) => {
    const box = canvas.getBoundingClientRect(), px = event.clientX - box.left, py = event.clientY - box.top;
    const near = dots.reduce((/** @type {any} */ best, one) => !best || Math.hypot(one.x - px, (one.y - py) / 3) < Math.hypot(best.x - px, (best.y - py) / 3) ? one : best, null);
    if (near) { state.target = near.target; goTo(near.frame); }
  });
}
