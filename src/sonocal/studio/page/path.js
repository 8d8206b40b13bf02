// The way from a needle to a calibration in other software: which step one is at, and what it asks for.
import { state } from "./state.js";
import { el } from "./words.js";

const by = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));
/** Of each step: its name, where it is on the page, what to do. */
const STEPS = [
  ["1 needle", "step-needle", "Say where the needle is in its marker\u2019s frame: a pivot and a spin below, or a needle.toml under Files."],
  ["2 sweep", "step-files", "Drop the recording of the needle that is moved through the image; or scan now, with sonocal studio --live."],
  ["3 check", "verdict", "Read the verdict; look at the worst sightings (N), mend or drop them; scan what is missing."],
  ["4 hand over", "export", "Press E: files for sonocal, PLUS, ITK and 3D Slicer."],
];
const SCANS = "Hold the needle as the page asks; Q ends the scan.", DONE = "Exported: the files are under Files.";

/** The step that is to be done. */
function now() {
  if (state.exported) return 4;
  if (state.work.phase === "live") return 1;
  if (state.answer?.verdict) return 2;
  return (state.work.targets || []).length || state.tool?.needle ? 1 : 0;
}

export function drawPath() {
  const at = now(), words = state.work.phase === "live" ? SCANS : at === 4 ? DONE : STEPS[at][2], list = by("steps");
  if (!list.children.length) list.replaceChildren(...STEPS.map(([name, target]) => { const step = /** @type {HTMLButtonElement} */ (el("button", name)); step.type = "button"; step.onclick = () => goToStep(target); return el("li", "", [step]); }));
  [...list.children].forEach((li, i) => { li.className = i < at ? "done" : i === at ? "now" : ""; if (i === at) li.setAttribute("aria-current", "step"); else li.removeAttribute("aria-current"); });
  if (by("path").textContent !== words) by("path").textContent = words;
}

/** @param {string} target of the page */
function goToStep(target) {
  const place = by(target).querySelector("button:enabled, input, summary") || by(target);
  by(target).scrollIntoView({ block: "center" }); /** @type {HTMLElement} */ (place).focus({ preventScroll: true });
}
