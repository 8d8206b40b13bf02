// The WebSocket: edits go out until the server says that they are on the disk; what stands comes in.
import { changed, state } from "./state.js";

/** @type {WebSocket | null} */ let socket = null;
/** Edits of which the server has not said that they are kept; they are sent again after a break. @type {Map<string, any>} */
const pending = new Map();
let tries = 0, run = "", count = 0;

/** @param {any} edit action and what it is of */
export function send(edit) {
  const id = `${Date.now().toString(36)}-${Math.random().toString(36).slice(2)}-${count++}`;
  pending.set(id, { id, ...edit });
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(pending.get(id)));
}

export function connect() {
  socket = new WebSocket(`ws://${location.host}/events`);
  socket.onopen = () => {
    tries = 0; state.connection = "open"; changed("connection");
    for (const edit of pending.values()) socket?.send(JSON.stringify(edit));
  };
  socket.onmessage = (event) => heard(JSON.parse(event.data));
  socket.onclose = () => {
    state.connection = "lost"; changed("connection");
    setTimeout(connect, Math.min(4000, 250 * 2 ** tries++));
  };
}

/** @param {any} message */
function heard(message) {
  if (message.run && run && message.run !== run) { state.answer = null; state.candidates = {}; }
  run = message.run || run;
  switch (message.kind) {
    case "work":
      if (message.name !== state.work.name) { state.answer = null; state.marks = []; state.exported = null; state.frame = 0; state.live = null; }
      state.work = message; state.target = (message.targets || []).includes(state.target) ? state.target : (message.targets || [""])[0] || "";
      break;
    case "progress": state.progress = message; break;
    case "candidates": state.candidates = message.places; break;
    case "marks": state.marks = message.marks; state.undoable = message.undoable; state.revision = message.revision; break;
    case "answer": state.answer = message; break;
    case "beside": state.beside = message; break;
    case "tool": state.tool = message; break;
    case "live": state.live = message; break;
    case "exported": state.notice = message.said = `Exported ${message.files.length} files into ${message.folder}`; state.exported = message; break;
    case "kept": pending.delete(message.id); return;
    case "refused": pending.delete(message.id); state.notice = message.sentence; break;
  }
  changed(message.kind);
}
