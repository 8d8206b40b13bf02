// The first step: the needle from a pivot and a spin, as "sonocal tool" finds it.
import { tell, upload, writeNeedle } from "./files.js";
import { state } from "./state.js";
import { el, findingsOf, typeset } from "./words.js";

const by = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
/** What was sent, by what it shows. @type {Record<string, string>} */ const sent = { pivot: "", spin: "" };
let drawnFor = "";

/** @param {string} what it shows: pivot or spin @param {Iterable<File>} files a recording, of one part or two */
async function take(what, files) {
  for (const file of files) {
    const name = await upload(file, file.name);
    if (!name) return;
    if (!/\.(raw|zraw)$/i.test(name)) sent[what] = name;
  }
  drawSent();
}

/** A file that is dropped on this step: a spin if its name says so, or if the pivot is there already. @param {FileList} files */
function takeDropped(files) {
  const all = [...files], isPart = (/** @type {File} */ file) => /\.(raw|zraw)$/i.test(file.name), stem = (/** @type {File} */ file) => file.name.split(".")[0];
  let first = sent.pivot;
  for (const file of all.filter((one) => !isPart(one))) {
    const what = /spin/i.test(file.name) || (first && !/pivot/i.test(file.name)) ? "spin" : "pivot";
    if (what === "pivot") first = file.name;
    take(what, [...all.filter((one) => isPart(one) && stem(one) === stem(file)), file]);
  }
}

function drawSent() {
  for (const what of ["pivot", "spin"]) by(`${what}-name`).textContent = sent[what];
  by("find-needle").disabled = !sent.pivot && !sent.spin;
}

async function find() {
  const length = by("length").value.trim(), asked = { pivot: sent.pivot, spin: sent.spin, tool: by("tool-name").value, length_mm: length ? Number(length) : null };
  const answer = await fetch("/tool", { method: "POST", body: JSON.stringify(asked) }).catch(() => null), told = answer ? await answer.json().catch(() => ({ refused: "sonocal made a mistake; the terminal shows where" })) : { refused: "the connection is lost" };
  tell(told.refused || "");
}

/** @param {number[]} place */
const mm = (place) => `${place.map((x) => x.toFixed(1).replace("-0.0", "0.0")).join(", ")} mm`;
let asked = "";

/** What the first step asks for is open where the needle is not known; then as whoever looks leaves it. */
export function drawAsked() {
  const now = `${state.work.name} ${(state.work.targets || []).length > 0} ${state.work.phase === "empty"}`;
  if (now !== asked) by("needle-known").open = !(state.work.targets || []).length && ["empty", "ready", "looking"].includes(state.work.phase);
  asked = now;
}

export function drawTool() {
  const tool = state.tool, key = JSON.stringify(tool);
  if (key === drawnFor || !tool) return;
  drawnFor = key;
  const box = by("tool-result"), names = tool.names.join(" and ");
  box.className = `verdict ${tool.phase === "refused" ? "stop" : tool.level || ""}`; box.hidden = false;
  if (tool.phase === "looking") { box.replaceChildren(el("p", `Looking for tip and axis in ${names}`)); return; }
  if (tool.phase === "refused") { box.replaceChildren(el("p", tool.refused.sentence), ...findingsOf(tool.refused.findings)); return; }
  const rows = [];
  if (tool.tip) rows.push(["tip", `${mm(tool.tip.at_mm)}, \u00b1 ${tool.tip.within_mm.toFixed(2)} mm (95 %)`], ["rms about the tip", `${tool.tip.rms_mm.toFixed(2)} mm; tilted ${tool.tip.tilt_deg} deg; ${tool.tip.used} of ${tool.tip.of} poses used`]);
  if (tool.axis) rows.push(["axis", tool.axis.direction.map((/** @type {number} */ x) => x.toFixed(3).replace("-0.000", "0.000")).join(", ")], ["wobble about the axis", `${tool.axis.wobble_deg} deg, ${tool.axis.wobble_mm} mm; ${tool.axis.used} of ${tool.axis.of} poses used`]);
  if (tool.needle) rows.push(["needle", `from ${mm(tool.needle.from_mm)} to ${mm(tool.needle.to_mm)}: ${tool.needle.length_mm} mm, \u00b1 ${tool.needle.within_deg.toFixed(2)} deg (95 %)`]);
  const list = el("dl", "", rows.map(([name, value]) => el("div", "", [el("dt", name), el("dd", value)])));
  const next = tool.needle ? `It is the needle of the sweep now; kept as ${tool.kept}.` : "This tells the tip alone. Add a spin about the shaft, and the needle is known.";
  box.replaceChildren(el("p", typeset(tool.sentence)), list, el("p", next), ...findingsOf(tool.findings));
  if (tool.toml) writeNeedle(tool.toml);
}

export function listenToNeedle() {
  for (const what of ["pivot", "spin"]) by(what).onchange = () => take(what, by(what).files || []);
  by("find-needle").onclick = find;
  const step = by("step-needle");
  step.addEventListener("drop", (/** @type {DragEvent} */ event) => { event.preventDefault(); event.stopPropagation(); document.body.classList.remove("over"); takeDropped(event.dataTransfer?.files || /** @type {any} */ ([])); });
}
