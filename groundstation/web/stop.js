/**
 * STOP ALL. Pointer-down in the capture phase or Space, in any field, on any screen; no dialog; WebSocket and POST
 * together. Pressing again sends it again. It is a software stop: the hardware cut-off stays required.
 */
import { icons } from "./icons.js";

const CONFIRM_MS = 500;

export class Stop {
  constructor(button, send, changed) {
    this.button = button;
    this.send = send;
    this.changed = changed;
    this.pressed = null; // {id, at, posted}
    this.shown = "";
    document.addEventListener("pointerdown", (event) => {
      if (!event.target.closest?.("#stop")) return;
      event.preventDefault();
      this.press("the STOP button");
    }, { capture: true });
    document.addEventListener("keydown", (event) => {
      if (event.code !== "Space") return;
      event.preventDefault();
      event.stopImmediatePropagation();
      if (!event.repeat) this.press("Space");
    }, { capture: true });
    document.addEventListener("keyup", (event) => {
      if (event.code === "Space") { event.preventDefault(); event.stopImmediatePropagation(); }
    }, { capture: true });
  }

  press(source) {
    const latched = this.view?.id || (this.pressed && performance.now() - this.pressed.at < 3000 ? this.pressed.id : 0);
    const id = latched || Date.now() * 1000 + Math.floor(Math.random() * 1000);
    const body = { id, source };
    this.send({ do: "stop", ...body });
    const press = { id, at: performance.now(), posted: false };
    if (!this.pressed || this.pressed.id !== id) this.pressed = press;
    fetch("/stop", { method: "POST", body: JSON.stringify(body), keepalive: true })
      .then((response) => { if (response.ok) press.posted = true; })
      .catch(() => { press.failed = true; });
    this.changed();
  }

  /** The server's word on it; null when nothing is latched. */
  update(view) {
    if (this.pressed && view?.id === this.pressed.id) this.pressed.heard = true;
    if (this.pressed?.heard && !view) this.pressed = null;
    this.view = view;
  }

  /** What to show, also when no server answers: null, or {state, title, sub}. */
  state() {
    const mine = this.pressed && !this.pressed.heard ? this.pressed : null;
    if (mine) {
      const age = performance.now() - mine.at;
      if (age < CONFIRM_MS) return { state: "STOPPING", sub: "sent on both paths" };
      return { state: "NOT CONFIRMED", sub: `No answer from the page's server for ${(age / 1000).toFixed(1)} s. Use the cut-off switch, or: ahdc-groundstation stop` };
    }
    if (!this.view) return null;
    return { state: this.view.known ? "STOPPED" : "STOPPING", sub: "" };
  }

  draw() {
    const now = this.state();
    let html = `<i style="--hole:var(--red)">${icons.stop}</i><b>STOP ALL</b><kbd>Space</kbd>`;
    if (now) {
      const count = this.view ? ` ${this.view.answered}/${this.view.of}` : "";
      const title = now.state === "STOPPED" ? "STOPPED, latched" : now.state === "STOPPING" ? `STOPPING${count}` : now.state;
      html = `<i style="--hole:var(--surface)">${icons.stop}</i><div><b>${title}</b><small>Space or press: send STOP again</small></div>`;
    }
    if (html === this.shown) return;
    this.shown = html;
    this.button.innerHTML = html;
    this.button.classList.toggle("latched", Boolean(now));
  }
}
