// Verdict, numbers, findings, advice: all text is set as text, so that a name is never markup.
import { state } from "./state.js";

/** @param {string} id */
const by = (id) => /** @type {HTMLElement} */ (document.getElementById(id));
/** @param {string} tag @param {string} [text] @param {Node[]} [inside] */
export function el(tag, text = "", inside = []) { const one = document.createElement(tag); one.textContent = text; one.append(...inside); return one; }

/** A sentence of the terminal's letters in those of a page. @param {string} sentence */
export const typeset = (sentence) => sentence.replaceAll("+-", "\u00b1");

export function drawVerdict() {
  const box = by("verdict"), answer = state.answer, notYet = state.live?.refusal;
  if (notYet) { box.className = "verdict"; box.replaceChildren(el("strong", "Not yet"), el("p", notYet)); return; }
  const refused = answer?.refused || state.work.refused;
  box.className = `verdict ${refused ? "stop" : answer?.verdict?.level || ""}`;
  if (refused) box.replaceChildren(el("strong", TITLES[refused.code || refused.kind] || "No calibration"), el("p", refused.sentence), el("p", ADVICE[refused.kind] || ""));
  else if (answer?.verdict) box.replaceChildren(el("strong", answer.verdict.headline), el("p", typeset(answer.verdict.expectation)), el("ul", "", answer.verdict.reasons.map((/** @type {string[]} */ r) => el("li", typeset(r[1])))));
  else box.replaceChildren(el("strong", WAITING[state.work.phase] || ""), el("p", state.progress && state.work.phase === "looking" ? `${state.progress.done} of ${state.progress.of} images looked at; the images can be looked at meanwhile.` : ""));
}
/** @type {Record<string, string>} */
const TITLES = { NoConsensusError: "No needle found", DegenerateGeometryError: "A motion is left free", InputError: "Not yet", FormatError: "This file cannot be read", bug: "sonocal made a mistake" };
/** @type {Record<string, string>} */
const ADVICE = { NoConsensusError: "Click the needle in a dozen images of different places and tilts: the calibration follows your points.", DegenerateGeometryError: "Scan what is missing, and join it to this recording.", InputError: "" };
/** @type {Record<string, string>} */
const WAITING = { connecting: "Connecting", empty: "Drop a recording here", opening: "Opening", looking: "Looking for the needle", ready: "Calibrating", live: "Scan" };

export function drawNumbers() {
  const { fit, predicted } = state.answer || {}, mm = (/** @type {number | undefined} */ x) => (x === undefined ? "-" : x < 100 ? `${x.toFixed(2)} mm` : `${Number(x.toPrecision(2))} mm`);
  const rows = [["predicted error, 95 %, worst corner", mm(predicted?.worst_mm)], ["at the centre", mm(predicted?.centre_mm)], ["rms of residuals", mm(fit?.rms_mm)], ["sightings used", fit ? `${fit.used} of ${fit.of}` : "-"]];
  by("numbers").replaceChildren(...rows.map(([name, value], i) => { const dd = el("dd", value); dd.id = `number-${i}`; if (!i) dd.className = "big"; return el("div", "", [el("dt", name), dd]); }));
  by("numbers").dataset.revision = String(state.answer?.revision ?? "");
}

/** Another calibration beside this one. */
export function drawBeside() {
  const box = by("beside"), told = state.beside;
  box.hidden = !told;
  if (!told) return;
  const said = told.refused ? [told.refused] : told.sentences.length ? told.sentences : ["is compared once there is a calibration."];
  box.replaceChildren(el("h2", `Compared with ${told.name}`), ...said.map((/** @type {string} */ one) => el("p", typeset(one))));
}

/** @param {any[]} found @returns {Node[]} each to be opened for what to do */
export function findingsOf(found) { return found.map((one) => { const d = el("details", "", [el("summary", typeset(one.message)), el("p", one.advice), el("p", one.code)]); d.className = one.severity; return d; }); }

export function drawFindings() {
  const refused = state.answer?.refused || state.work.refused, found = state.answer?.findings || refused?.findings || [];
  by("findings").replaceChildren(...(found.length ? findingsOf(found) : [el("p", "none")]));
  const next = [...(state.answer?.coverage?.next || [])];
  if (state.answer?.loosest) next.push(typeset(`Loosest is ${state.answer.loosest}.`));
  by("next").replaceChildren(...(next.length ? next : ["nothing to say yet"]).map((one) => el("li", one)));
}

export function drawHead() {
  const { name, frames, size_px: size, tools, phase } = state.work;
  by("what").textContent = name ? `${name}${frames ? `: ${frames} frames of ${size.join(" x ")} px; tracked: ${(tools || []).join(", ")}` : ""}` : "no recording";
  by("stage-note").textContent = phase === "empty" ? "Drop a recording and its needle.toml here, or choose them under Files; a needle that is not known yet is found below." : "";
  const banner = by("banner"), lost = state.connection === "lost";
  const gone = phase === "live" && state.live && !state.live.connected;
  const kept = state.live ? `what was recorded is in ${state.work.folder}/recording.mhd: name it to sonocal studio, with the same --lines.` : "start the same command again in the terminal. Every click that was kept is in the journal; others are sent when it is back.";
  const said = gone && !lost ? `The connection to ${state.live.server} is lost: waits for it. What was recorded is kept.` : lost ? `The connection to sonocal is lost: ${kept}` : state.notice;
  banner.hidden = !said; banner.textContent = said; banner.className = lost || gone ? "stop" : state.exported && said === state.exported.said ? "good" : "";
}
