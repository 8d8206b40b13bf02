// Everything that a mouse does, by keyboard.
import { togglePlay } from "./film.js";
import { exportAll } from "./files.js";
import { moveTo } from "./frame_view.js";
import { send } from "./link.js";
import { endScan, isLive } from "./live.js";
import { nextWorst } from "./residuals.js";
import { changed, goTo, markAt, state } from "./state.js";

const HALF = 0.5;
/** @type {Record<string, number[]>} */
const WAYS = { ArrowLeft: [-HALF, 0], ArrowRight: [HALF, 0], ArrowUp: [0, -HALF], ArrowDown: [0, HALF] };

export function dropOrKeep() {
  const mark = markAt(state.frame, state.target);
  if (mark) send({ action: mark[4] ? "keep" : "drop", frame: state.frame, target: state.target });
}
export function undo() { if (state.undoable) send({ action: "undo" }); }

/** By half a pixel; where the image has no point yet, one is put where the calibration says, or in the middle. @param {number[]} by */
function nudge(by) {
  const mark = markAt(state.frame, state.target), size = state.work.size_px;
  if (!size || !state.target) return;
  const told = state.answer?.crosses?.[state.frame]?.[state.work.targets.indexOf(state.target)];
  const from = mark ? mark[2][0] : told && told[0] !== null ? told : [size[0] / 2, size[1] / 2];
  const at = [from[0] + by[0], from[1] + by[1]];
  if (mark) mark[2][0] = [...at, ...mark[2][0].slice(2)];
  changed("marks"); moveTo(at);
}

export function listenToKeys() {
  document.addEventListener("keydown", (event) => {
    const on = /** @type {HTMLElement} */ (event.target);
    if (event.ctrlKey || event.metaKey || event.altKey || /^(TEXTAREA|SELECT)$/.test(on.tagName) || /^(text|number)$/.test(/** @type {any} */ (on).type || "") || (on.tagName === "INPUT" && !event.shiftKey && on.id !== "seek")) return;
    if (isLive()) { if (event.key.toLowerCase() === "q") { endScan(); event.preventDefault(); } return; }
    const way = WAYS[event.key];
    if (way && event.shiftKey) nudge(way);
    else if (way && on.id !== "seek") goTo(state.frame + Math.sign(way[0] || way[1]) * (way[0] ? 1 : 10));
    else if (event.key === " " && on.tagName !== "BUTTON" && on.tagName !== "SUMMARY") togglePlay();
    else if (event.key.toLowerCase() === "x") dropOrKeep();
    else if (event.key.toLowerCase() === "n") nextWorst();
    else if (event.key.toLowerCase() === "z") undo();
    else if (event.key.toLowerCase() === "e") exportAll();
    else return;
    event.preventDefault();
  });
}
