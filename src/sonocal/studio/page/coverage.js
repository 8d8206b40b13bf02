// Sightings in ninths of the image, and the needle's tilts from its normal.
import { colour, sharp } from "./chart.js";
import { state } from "./state.js";

const canvas = /** @type {HTMLCanvasElement} */ (document.getElementById("coverage"));

export function drawCoverage() {
  const { c, w, h } = sharp(canvas), found = state.answer?.coverage;
  if (!found) { c.fillStyle = colour("quiet"); c.fillText("no calibration yet", 8, h / 2); return; }
  const side = Math.min(h - 24, w / 2 - 12), most = Math.max(1, ...found.cells.flat());
  found.cells.forEach((/** @type {number[]} */ row, /** @type {number} */ j) => row.forEach((count, i) => {
    c.globalAlpha = 0.12 + (0.6 * count) / most; c.fillStyle = colour("mark"); c.fillRect((i * side) / 3, (j * side) / 3, side / 3 - 2, side / 3 - 2); c.globalAlpha = 1;
    c.fillStyle = colour("ink"); c.fillText(String(count), (i * side) / 3 + 6, (j * side) / 3 + 16);
  }));
  const r = side / 2, x = w - r - 6, y = r + 2;
  c.strokeStyle = colour("line"); for (const share of [1 / 3, 2 / 3, 1]) { c.beginPath(); c.arc(x, y, r * share, 0, 7); c.stroke(); }
  c.fillStyle = colour("mark");
  found.tilt_deg.forEach((/** @type {number} */ tilt, /** @type {number} */ i) => { const a = (found.around_deg[i] * Math.PI) / 180, d = (r * tilt) / 90; c.fillRect(x + d * Math.cos(a) - 1, y + d * Math.sin(a) - 1, 2.5, 2.5); });
  c.fillStyle = colour("quiet"); c.fillText("sightings in the image", 0, h - 6); c.textAlign = "right"; c.fillText("tilts, rings 30\u00b0", w, h - 6); c.textAlign = "left";
}
