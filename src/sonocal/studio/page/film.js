// Filmstrip, slider, and playing.
import { frame } from "./frames.js";
import { changed, goTo, state } from "./state.js";

const strip = /** @type {HTMLElement} */ (document.getElementById("film"));
const seek = /** @type {HTMLInputElement} */ (document.getElementById("seek"));
const play = /** @type {HTMLButtonElement} */ (document.getElementById("play"));
const at = /** @type {HTMLElement} */ (document.getElementById("at"));
const TILES = 10, WIDE = 96;
let begun = 0, from = 0, of = "";

export function drawFilm() {
  const { frames, size_px: size, name } = state.work;
  seek.max = String(Math.max(0, (frames || 1) - 1)); seek.disabled = play.disabled = !frames;
  if (of === `${name} ${frames}`) return;
  of = `${name} ${frames}`; strip.replaceChildren();
  if (!frames || !size) return;
  const count = Math.min(TILES, frames), step = Math.max(1, Math.min(64, Math.floor(size[0] / WIDE)));
  for (let i = 0; i < count; i++) {
    const index = Math.round((i * (frames - 1)) / Math.max(1, count - 1)), button = document.createElement("button"), tile = document.createElement("canvas");
    button.type = "button"; button.dataset.frame = String(index); button.setAttribute("aria-label", `Frame ${index}`);
    button.append(tile); strip.append(button); button.onclick = () => goTo(index);
    frame(index, step).then((image) => { if (image) { tile.width = image.width; tile.height = image.height; tile.getContext("2d")?.drawImage(image, 0, 0); } });
  }
}

export function drawPlace() {
  seek.value = String(state.frame);
  at.textContent = state.work.frames ? `${state.frame} of ${state.work.frames - 1}` : "-";
  const tiles = /** @type {HTMLElement[]} */ ([...strip.children]);
  const near = tiles.reduce((/** @type {HTMLElement | null} */ best, one) => !best || Math.abs(Number(one.dataset.frame) - state.frame) < Math.abs(Number(best.dataset.frame) - state.frame) ? one : best, null);
  for (const one of tiles) one.setAttribute("aria-current", String(one === near));
  play.textContent = state.playing ? "Pause" : "Play"; play.setAttribute("aria-pressed", String(state.playing));
}

export function togglePlay() {
  if (!state.work.frames) return;
  state.playing = !state.playing; begun = performance.now();
  from = state.frame >= state.work.frames - 1 ? 0 : state.frame; changed("playing");
  if (state.playing) requestAnimationFrame(tick);
}

/** @param {number} now */
function tick(now) {
  if (!state.playing) return;
  const next = from + Math.floor(((now - begun) / 1000) * Math.max(state.work.rate_hz || 20, 1));
  goTo(next);
  if (next >= state.work.frames - 1) { state.playing = false; changed("playing"); return; }
  requestAnimationFrame(tick);
}

export function listenToFilm() { seek.oninput = () => goTo(Number(seek.value)); play.onclick = togglePlay; }
