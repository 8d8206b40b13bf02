// Wires: what changed is drawn anew, once a picture of the screen.
import { drawCoverage } from "./coverage.js";
import { drawFiles, exportAll, listenToDrops } from "./files.js";
import { drawFilm, drawPlace, listenToFilm } from "./film.js";
import { drawFrame, drawn, listenToPointer } from "./frame_view.js";
import { forget } from "./frames.js";
import { dropOrKeep, listenToKeys, undo } from "./keys.js";
import { drawPath } from "./path.js";
import { drawAsked, drawTool, listenToNeedle } from "./needle.js";
import { connect } from "./link.js";
import { drawChanged, drawLive, listenToLive } from "./live.js";
import { followFrames } from "./live_frames.js";
import { drawResiduals, listenToResiduals, nextWorst } from "./residuals.js";
import { drawScene, listenToScene } from "./scene.js";
import { followSlices } from "./slices.js";
import { markAt, onChange, state } from "./state.js";
import { listenToTour } from "./tour.js";
import { drawBeside, drawFindings, drawHead, drawNumbers, drawVerdict, el } from "./words.js";

history.replaceState(null, "", "/"); // the key was good once

const by = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
/** @type {Set<string>} */ const waiting = new Set();
let name = "", charted = 0;

/** What is drawn anew for what changed. @type {Record<string, (() => void)[]>} */
const ANEW = {
  frame: [drawFrame, drawPlace, drawButtons, drawCharts],
  marks: [drawFrame, drawButtons, drawResiduals],
  candidates: [drawFrame],
  playing: [drawPlace, drawCharts],
  progress: [drawVerdict],
  beside: [drawBeside],
  tool: [drawTool, drawPath],
  live: [drawLive, () => drawChanged([drawHead, drawVerdict, drawScene])],
  answer: [drawFrame, drawHead, drawPath, drawVerdict, drawNumbers, drawFindings, drawResiduals, drawScene, drawCoverage, drawButtons],
};
const ALL = [drawLive, followFrames, followSlices, drawHead, drawPath, drawTool, drawAsked, drawFilm, drawPlace, drawFrame, drawVerdict, drawNumbers, drawBeside, drawFindings, drawFiles, drawResiduals, drawScene, drawCoverage, drawButtons, drawTargets];

/** The charts' own marks of the frame; while frames play, a few times a second: the frames come first. */
function drawCharts() {
  const now = performance.now();
  if (state.playing && now - charted < 400) return;
  charted = now; drawResiduals(); drawScene();
}

function drawButtons() {
  const mark = markAt(state.frame, state.target);
  by("drop").disabled = !mark; by("drop").firstChild.textContent = mark?.[4] ? "Keep sighting " : "Drop sighting ";
  by("undo").disabled = !state.undoable; by("export").disabled = !state.answer?.verdict; by("worst").disabled = !state.answer?.residuals?.length;
}

function drawTargets() {
  const targets = state.work.targets || [];
  by("target").replaceChildren(...targets.map((/** @type {string} */ one) => { const o = /** @type {HTMLOptionElement} */ (el("option", one)); o.value = one; o.selected = one === state.target; return o; }));
  by("target").disabled = targets.length < 2;
}

onChange((what) => {
  if (what === "work" && state.work.name !== name) { name = state.work.name; forget(); }
  if (!waiting.size) requestAnimationFrame(draw);
  waiting.add(what);
});

function draw() {
  const steps = new Set([...waiting].flatMap((what) => ANEW[what] || ALL));
  waiting.clear();
  for (const step of steps) step();
}

by("target").onchange = () => { state.target = by("target").value; draw(); for (const step of ANEW.marks) step(); };
by("drop").onclick = dropOrKeep; by("undo").onclick = undo; by("worst").onclick = nextWorst; by("export").onclick = exportAll;
new ResizeObserver(() => { for (const step of [drawLive, drawFrame, drawResiduals, drawScene, drawCoverage]) step(); }).observe(document.body);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { for (const step of ALL) step(); });
for (const listen of [listenToPointer, listenToFilm, listenToResiduals, listenToScene, listenToDrops, listenToKeys, listenToTour, listenToLive, listenToNeedle]) listen();
by("frame").drawn = drawn;
for (const step of ALL) step();
connect();
