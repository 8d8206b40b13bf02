// Canvases in the page's own colours, sharp on any screen.

/** @param {HTMLCanvasElement} canvas @returns {{c: CanvasRenderingContext2D, w: number, h: number}} */
export function sharp(canvas) {
  const w = Math.max(1, canvas.clientWidth), h = Math.max(1, canvas.clientHeight), ratio = window.devicePixelRatio || 1;
  canvas.width = w * ratio; canvas.height = h * ratio;
  const c = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  c.setTransform(ratio, 0, 0, ratio, 0, 0); c.clearRect(0, 0, w, h); c.font = "12px system-ui, sans-serif";
  return { c, w, h };
}

/** @param {string} name of a colour in the style sheet */
export function colour(name) { return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim(); }

const RAMP = [[255, 255, 212], [254, 153, 41], [153, 52, 4]];
/** @param {number} share 0 to 1 @returns {string} light to dark */
export function ramp(share) {
  const x = Math.min(1, Math.max(0, share)) * 2, i = Math.min(1, Math.floor(x)), f = x - i;
  return `rgb(${RAMP[i].map((one, k) => Math.round(one + f * (RAMP[i + 1][k] - one))).join(" ")})`;
}
