// Files in and out: recordings and needles that are dropped or chosen, the needle's editor, what was exported.
import { changed, state } from "./state.js";
import { el } from "./words.js";

const box = /** @type {HTMLElement} */ (document.getElementById("files"));
let needle = '[[line]]\nname = "needle"\nframe = "Needle"\nfrom_mm = [0.0, 0.0, 0.0]\nto_mm = [0.0, 0.0, -200.0]\n';
let source = "", drawnFor = "";

/** The needle that was found stands in the editor. @param {string} toml */
export function writeNeedle(toml) {
  const text = /** @type {HTMLTextAreaElement | null} */ (document.getElementById("needle"));
  needle = toml;
  if (text) { text.value = toml; text.dispatchEvent(new Event("input")); }
}

/** @param {string} said */
export function tell(said) { state.notice = said; changed("notice"); }

/** @param {Blob} content @param {string} name @returns {Promise<string | null>} */
export async function upload(content, name) {
  const answer = await fetch("/inputs", { method: "PUT", headers: { "X-Name": encodeURIComponent(name) }, body: content }).catch(() => null);
  const told = answer ? await answer.json().catch(() => ({ refused: `${name} was refused` })) : { refused: `${name}: the connection was closed, it may be too large` };
  if (told.refused) { tell(told.refused); return null; }
  return told.name;
}

/** @param {string} name @param {string | null} targets */
async function open(name, targets) {
  const answer = await fetch("/open", { method: "POST", body: JSON.stringify(targets ? { source: name, targets } : { source: name }) });
  const told = await answer.json();
  tell(told.refused || "");
}

/** Calibrations by their names; a device set may hold wires, and is compared with where it is chosen for that. */
const CALIBRATION = /\.(json|tfm|npy|npz)$/i;

/** @param {Iterable<File>} files */
async function compare(files) {
  for (const file of files) {
    const other = await upload(file, file.name);
    if (!other) return;
    const answer = await fetch("/compare", { method: "POST", body: JSON.stringify({ other }) }), told = await answer.json();
    tell(told.refused || "");
  }
}

/** @param {Iterable<File>} files */
export async function take(files) {
  let targets = null, opened = false;
  for (const file of files) {
    if (CALIBRATION.test(file.name)) { await compare([file]); continue; }
    const name = await upload(file, file.name);
    if (!name) return;
    opened = true;
    if (/\.(toml|xml)$/i.test(name)) targets = name; else if (!/\.(raw|zraw)$/i.test(name)) source = name;
  }
  if (opened && (source || state.work.name)) await open(source || state.work.name, targets);
}

export async function exportAll() {
  if (!state.answer?.verdict) return;
  const answer = await fetch("/export", { method: "POST" }), told = await answer.json();
  if (told.refused) tell(told.refused);
}

export function drawFiles() {
  const key = `${state.work.name} ${state.work.phase} ${state.exported ? state.exported.files.length : ""}`;
  if (key === drawnFor) return;
  drawnFor = key;
  const choose = /** @type {HTMLInputElement} */ (el("input")); choose.type = "file"; choose.multiple = true; choose.id = "choose"; choose.onchange = () => take(choose.files || []);
  const label = el("label", "Recording or table, and needle.toml: "); label.append(choose);
  const other = /** @type {HTMLInputElement} */ (el("input")); other.type = "file"; other.id = "compare"; other.onchange = () => compare(other.files || []);
  const beside = el("label", "A calibration to compare with (.json, .xml, .tfm, .h5, a 4 x 4): "); beside.append(other);
  const text = /** @type {HTMLTextAreaElement} */ (el("textarea", "")); text.value = needle; text.id = "needle"; text.oninput = () => { needle = text.value; check(); };
  const editor = el("details", "", [el("summary", "What was scanned: needle or targets")]), note = el("p"), use = /** @type {HTMLButtonElement} */ (el("button", "Use this needle"));
  const caption = el("label", "In millimetres, in the frame of the needle's marker", [text]); note.className = "quiet"; use.type = "button"; use.id = "use-needle";
  const check = () => { const frame = /frame\s*=\s*"([^"]*)"/.exec(needle)?.[1] || "", tools = state.work.tools || []; note.textContent = !tools.length || tools.includes(frame) ? "" : `"${frame}" is no tool of this recording; it tracks ${tools.join(", ")}.`; };
  use.onclick = async () => { const name = await upload(new Blob([needle]), "needle.toml"); if (name && state.work.name) await open(state.work.name, name); };
  editor.append(caption, note, use); if (state.work.frames && !(state.work.targets || []).length) editor.setAttribute("open", ""); check();
  const out = state.exported ? [el("p", state.exported.folder), el("ul", "", state.exported.files.map((/** @type {string} */ name) => { const a = /** @type {HTMLAnchorElement} */ (el("a", name)); a.href = `/files/${encodeURIComponent(name)}`; a.download = name; return el("li", "", [a]); }))] : [];
  box.replaceChildren(label, editor, beside, ...out);
}

export function listenToDrops() {
  const stage = /** @type {HTMLElement} */ (document.body);
  stage.addEventListener("dragover", (event) => { event.preventDefault(); stage.classList.add("over"); });
  stage.addEventListener("dragleave", () => stage.classList.remove("over"));
  stage.addEventListener("drop", (event) => { event.preventDefault(); stage.classList.remove("over"); take(event.dataTransfer?.files || []); });
}
