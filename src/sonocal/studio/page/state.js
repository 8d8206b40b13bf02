// What the page knows, in one place; whoever draws subscribes.

/** @typedef {[number, string, number[][], string, boolean]} MarkRow frame, target, points px, origin, dropped */

export const state = {
  /** @type {any} */ work: { phase: "connecting" },
  /** @type {any} */ answer: null,
  /** @type {MarkRow[]} */ marks: [],
  undoable: 0,
  revision: 0,
  /** @type {Record<string, number[][]>} */ candidates: {},
  /** @type {any} */ progress: null,
  frame: 0,
  target: "",
  playing: false,
  connection: "opening",
  notice: "",
  /** @type {any} */ exported: null,
  /** How far another calibration is from this one; null without one. @type {any} */ beside: null,
  /** What was found of the needle's tip and axis. @type {any} */ tool: null,
  /** How a scan that goes on stands; null without one. @type {any} */ live: null,
};

/** @type {Set<(what: string) => void>} */
const listeners = new Set();

/** @param {(what: string) => void} listener */
export function onChange(listener) { listeners.add(listener); }

/** @param {string} what changed */
export function changed(what) { for (const one of listeners) one(what); }

/** @param {number} frame @param {string} target @returns {MarkRow | undefined} */
export function markAt(frame, target) { return state.marks.find((row) => row[0] === frame && row[1] === target); }

/** @param {number} frame */
export function goTo(frame) {
  const last = Math.max(0, (state.work.frames || 1) - 1);
  const next = Math.min(last, Math.max(0, Math.round(frame)));
  if (next !== state.frame) { state.frame = next; changed("frame"); }
}
