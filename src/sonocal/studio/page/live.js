// A scan that goes on: the number that is read from afar, how it fell, where to hold the needle, what the tracker sees.
import { colour, sharp } from "./chart.js";
import { changed, state } from "./state.js";
import { el } from "./words.js";

const by = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));
const curve = /** @type {HTMLCanvasElement} */ (by("fall"));
const LEFT = 44, RIGHT = 10, TOP = 10, BOTTOM = 20, MOST_SAID = 4;

export const isLive = () => state.work.phase === "live";

/** @param {number} mm @returns {string} three digits at the most: it is read from two metres away */
const short = (mm) => (mm < 10 ? mm.toFixed(2) : mm < 100 ? mm.toFixed(1) : "> 99");

/** Text that is read aloud is set where it changed, and not else. @param {string} id @param {string} text */
function say(id, text) { if (by(id).textContent !== text) by(id).textContent = text; }

export function drawLive() {
  document.body.classList.toggle("live", isLive());
  by("live").hidden = !isLive(); by("live-bar").hidden = !isLive();
  for (const id of ["film", "bar-play", "bar-marks"]) by(id).hidden = isLive();
  const live = state.live;
  if (!isLive()) return;
  const known = live && live.expected_mm !== null && !live.refusal;
  say("far", known ? short(live.expected_mm) : "\u2013"); say("far-unit", known ? "mm" : "");
  by("far").className = !known ? "" : live.until_mm && live.expected_mm <= live.until_mm ? "use" : state.answer?.verdict?.level || "";
  say("far-what", known ? `predicted error, 95 %, worst corner${live.until_mm ? `; ends below ${live.until_mm} mm` : ""}` : live?.refusal ? "no calibration yet" : "looks at the first images");
  say("hold", live?.hold ? live.hold.words : live?.advice || "");
  by("hold-what").hidden = !by("hold").textContent;
  drawSource(live); drawSaid(live); drawFall();
}

let told = "";
/** What stands elsewhere on the page, where a moment changed that. @param {(() => void)[]} steps */
export function drawChanged(steps) {
  const now = JSON.stringify([state.live?.connected, state.live?.refusal, state.live?.hold]);
  if (now !== told) for (const step of steps) step();
  told = now;
}

/** What the server and the tracker give. @param {any} live */
function drawSource(live) {
  if (!live) return;
  const quiet = live.connected && live.quiet_s > 1, source = el("li", live.connected ? (quiet ? `${live.server}: nothing comes` : `${live.server}: connected`) : `${live.server}: connection lost, tries again`);
  source.className = live.connected && !quiet ? "seen" : "lost"; source.id = "source";
  const tools = live.tools.map((/** @type {[string, boolean, number]} */ [name, seen, share]) => { const li = el("li", `${name}: ${seen ? "seen" : "not seen"} (${Math.round(100 * share)} % of images)`); li.className = seen ? "seen" : "lost"; return li; });
  if ([source, ...tools].map((one) => one.textContent).join() !== [...by("tracker").children].map((one) => one.textContent).join()) by("tracker").replaceChildren(source, ...tools);
  const lost = [[live.dropped, "came too fast"], [live.damaged, "damaged"], [live.late, "too late"]].filter(([count]) => count).map(([count, what]) => `${count} messages ${what}`);
  const lag = live.lag_ms ? [`the tracker stamps ${Math.abs(live.lag_ms[0]).toFixed(0)} ms ${live.lag_ms[0] < 0 ? "earlier" : "later"} than the scanner (\u00b1 ${live.lag_ms[1].toFixed(0)} ms)`] : [];
  say("counts", [`${live.at_s.toFixed(0)} s, ${live.recorded} images recorded, ${live.paired} with every pose, needle stands out in ${live.seen}, ${live.used} sightings used`, ...lag, ...lost].join("; "));
}

/** What went wrong, the last first; unless it stands there already, since it is read aloud. @param {any} live */
function drawSaid(live) {
  const said = (live?.said || []).slice(-MOST_SAID).reverse().map((/** @type {[number, string]} */ [at_s, what]) => `${at_s.toFixed(0)} s: ${what}`);
  if (by("said").dataset.said === said.join()) return;
  by("said").dataset.said = said.join(); by("said").replaceChildren(...said.map((/** @type {string} */ one) => el("li", one)));
}

/** Predicted error over time: each octave is as high. */
function drawFall() {
  const { c, w, h } = sharp(curve), fall = state.live?.fall || [];
  if (!fall.length) { c.fillStyle = colour("quiet"); c.fillText("the curve begins with the first calibration", LEFT, h / 2); return; }
  const wanted = state.live.until_mm, values = [...fall.map((/** @type {number[]} */ one) => one[1]), ...(wanted ? [wanted] : [])];
  const low = Math.log2(Math.min(...values) / 1.2), high = Math.max(Math.log2(Math.max(...values)), low + 1), end = Math.max(state.live.at_s, 1), start = fall[0][0];
  const x = (/** @type {number} */ s) => LEFT + ((w - LEFT - RIGHT) * (s - start)) / Math.max(end - start, 1), y = (/** @type {number} */ mm) => TOP + ((h - TOP - BOTTOM) * (high - Math.log2(mm))) / (high - low);
  const ticks = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].filter((mm) => Math.log2(mm) >= low && Math.log2(mm) <= high);
  c.strokeStyle = colour("line"); c.fillStyle = colour("quiet");
  for (const mm of ticks) { c.beginPath(); c.moveTo(LEFT, y(mm)); c.lineTo(w - RIGHT, y(mm)); c.stroke(); c.fillText(`${mm} mm`, 2, y(mm) + 4); }
  c.fillText(`${start.toFixed(0)} s`, LEFT, h - 5); c.textAlign = "right"; c.fillText(`${end.toFixed(0)} s`, w - RIGHT, h - 5); c.textAlign = "left";
  if (wanted) { c.strokeStyle = colour("use"); c.setLineDash([5, 4]); c.beginPath(); c.moveTo(LEFT, y(wanted)); c.lineTo(w - RIGHT, y(wanted)); c.stroke(); c.setLineDash([]); }
  c.strokeStyle = colour("mark"); c.lineWidth = 2.5; c.beginPath();
  fall.forEach((/** @type {number[]} */ [s, mm], /** @type {number} */ i) => { if (i) c.lineTo(x(s), y(fall[i - 1][1])); c.lineTo(x(s), y(mm)); });
  c.lineTo(x(end), y(fall[fall.length - 1][1])); c.stroke();
}

export async function endScan() {
  if (!isLive()) return;
  const answer = await fetch("/live/end", { method: "POST" }).catch(() => null);
  if (!answer || !answer.ok) { state.notice = "the scan could not be ended; press Ctrl+C in the terminal: what was recorded stays"; changed("notice"); }
}

export function listenToLive() { by("end").onclick = endScan; }
