/** The scrubber under the map: where in the recording, play, steps, events. */
import { color, fit } from "./canvas.js";

const $ = (id) => document.getElementById(id);
const clock = (s) => `${String(Math.floor(s / 60)).padStart(2, "0")}:${(s % 60).toFixed(1).padStart(4, "0")}`;

export class Replay {
  constructor(ask) {
    this.ask = ask;
    this.now = null;
    this.events = [];
    this.dragging = false;
    $("replay-play").addEventListener("click", () => this.toggle());
    $("replay-next").addEventListener("click", () => this.ask({ do: "event" }));
    const range = $("replay-at");
    range.addEventListener("pointerdown", () => { this.dragging = true; });
    range.addEventListener("change", () => { this.dragging = false; });
    range.addEventListener("input", () => this.ask({ do: "seek", at: Number(range.value) }));
  }

  setLayout(layout) { this.events = layout.replay?.events || []; }

  toggle() { this.ask({ do: "play", on: !this.now?.playing }); }

  /** True where the key was for the replay. */
  key(event) {
    const key = event.key.length === 1 ? event.key.toUpperCase() : event.key;
    if (key === "K") this.toggle();
    else if (key === "N") this.ask({ do: "event" });
    else if (key === "ArrowLeft" || key === "ArrowRight") this.ask({ do: "seek", by: (key === "ArrowLeft" ? -1 : 1) * (event.shiftKey ? 5 : 0.1) });
    else if (/^[0-9]$/.test(key)) this.ask({ do: "seek", at: this.now.to * Number(key) / 10 });
    else if (key === "Escape") this.ask({ do: "live" });
    else return false;
    return true;
  }

  draw(now) {
    this.now = now;
    $("scrubber").hidden = !now;
    if (!now) return;
    const range = $("replay-at");
    range.max = String(now.to);
    if (!this.dragging) range.value = String(now.at);
    const words = `${clock(now.at)} / ${clock(now.to)}`;
    if ($("replay-time").textContent !== words) $("replay-time").textContent = words;
    const label = now.playing ? "Pause " : "Play ";
    if ($("replay-play").firstChild.textContent !== label) $("replay-play").firstChild.textContent = label;
    const { context: c, width, height } = fit($("replay-events"));
    c.clearRect(0, 0, width, height);
    c.fillStyle = color("--ink3");
    for (const at of this.events) c.fillRect(8 + at / now.to * (width - 16) - 1, 2, 2, height - 4);
  }
}
