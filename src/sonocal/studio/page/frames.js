// Images from the server, a few kept; those that come next are asked for ahead.

const MOST = 90, AHEAD = 6;
/** @type {Map<string, Promise<ImageBitmap | null>>} */
const kept = new Map();

export function forget() { kept.clear(); }

/** @param {number} index @param {number} step @returns {Promise<ImageBitmap | null>} */
export function frame(index, step = 1) {
  const key = `${index}/${step}`;
  let found = kept.get(key);
  if (!found) {
    found = fetched(index, step);
    kept.set(key, found);
    if (kept.size > MOST) kept.delete(/** @type {string} */ (kept.keys().next().value));
  }
  return found;
}

/** @param {number} index @param {number} count of frames */
export function ahead(index, count) { for (let i = 1; i <= AHEAD; i++) if (index + i < count) frame(index + i); }

/** @param {number} index @param {number} step */
async function fetched(index, step) {
  const answer = await fetch(`/frames/${index}?step=${step}`).catch(() => null);
  if (!answer || !answer.ok) { kept.delete(`${index}/${step}`); return null; }
  const width = Number(answer.headers.get("X-Width")), height = Number(answer.headers.get("X-Height"));
  const grey = new Uint8Array(await answer.arrayBuffer());
  const pixels = new Uint32Array(grey.length);
  for (let i = 0; i < grey.length; i++) pixels[i] = 0xff000000 | (grey[i] * 0x010101);
  return createImageBitmap(new ImageData(new Uint8ClampedArray(pixels.buffer), width, height));
}
