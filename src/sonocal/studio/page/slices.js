// Three cuts through what was scanned so far, while the scan goes on.
import { isLive } from "./live.js";
import { el } from "./words.js";

const box = /** @type {HTMLElement} */ (document.getElementById("slices")), note = /** @type {HTMLElement} */ (document.getElementById("slices-note"));
const EACH_MS = 250;
/** Water is dark, and a needle in it small: square roots of grey. */
const BRIGHTER = Uint32Array.from({ length: 256 }, (_, grey) => 0xff000000 | (Math.round(Math.sqrt(255 * grey)) * 0x010101));
let runs = false, last = -1;

/** Asks a few times a second while the scan goes on. */
export async function followSlices() {
  if (runs || !isLive()) return;
  runs = true; last = -1; box.replaceChildren(); note.textContent = "begins with the first calibration";
  while (isLive()) {
    const answer = await fetch(`/live/slices?after=${last}`).catch(() => null);
    if (answer && answer.status === 200) await draw(answer);
    else if (answer?.headers.get("X-Refused")) note.textContent = decodeURIComponent(answer.headers.get("X-Refused") || "");
    await new Promise((done) => setTimeout(done, EACH_MS));
  }
  runs = false;
}

/** @param {Response} answer */
async function draw(answer) {
  const told = JSON.parse(answer.headers.get("X-Told") || "{}"), grey = new Uint8Array(await answer.arrayBuffer());
  last = told.number;
  const said = `${told.images} images, voxels of ${told.spacing_mm} mm`;
  if (note.textContent !== said) note.textContent = said;
  let from = 0;
  told.pictures.forEach((/** @type {any} */ one, /** @type {number} */ i) => {
    const figure = box.children[i] || box.appendChild(el("figure", "", [el("canvas"), el("figcaption")]));
    const canvas = /** @type {HTMLCanvasElement} */ (figure.firstChild), caption = /** @type {HTMLElement} */ (figure.lastChild), pixels = new Uint32Array(one.width * one.height);
    for (let k = 0; k < pixels.length; k++) pixels[k] = BRIGHTER[grey[from + k]];
    from += pixels.length;
    canvas.width = one.width; canvas.height = one.height; canvas.setAttribute("role", "img"); canvas.setAttribute("aria-label", `Cut at ${one.along} = ${one.at_mm} mm`);
    canvas.getContext("2d")?.putImageData(new ImageData(new Uint8ClampedArray(pixels.buffer), one.width, one.height), 0, 0);
    const [left, right, bottom, top] = one.edges_mm;
    caption.textContent = `${one.along} = ${one.at_mm} mm; ${one.across} from ${left} to ${right}, ${one.upright} from ${bottom} to ${top}`;
  });
}
