/** The scrubber under the map: where in the recording, play, steps, events. */
import { color, fit } from "./canvas.js";

const $ = (id) => document.getElementById(id);
const clock = (s) => `${String(Math.floor(s / 60)).padStart(2, "0")}:${(s % 60).toFixed(1).padStart(4, "0")}`;

export class Replay {
  constructor(ask) {
    this.ask = ask;
    this.now = null;
    this.events = [];
    this.strip = [];
    this.dragging = false;
    $("replay-play").addEventListener("click", () => this.toggle());
    $("replay-speed").addEventListener("click", () => this.ask({ do: "speed", by: this.now?.speed >= 8 ? -9 : 1 }));
    $("replay-next").addEventListener("click", () => this.ask({ do: "event" }));
    const range = $("replay-at");
    range.addEventListener("pointerdown", () => { this.dragging = true; });
    range.addEventListener("change", () => { this.dragging = false; });
    range.addEventListener("input", () => this.ask({ do: "seek", at: Number(range.value) }));
  }

  setLayout(layout) {
    this.events = layout.replay?.events || [];
    this.strip = layout.replay?.strip || [];
  }

  toggle() { this.ask({ do: "play", on: !this.now?.playing }); }

  /** True where the key was for the replay. */
  key(event) {
    const key = event.key.length === 1 ? event.key.toUpperCase() : event.key;
    if (key === "K") this.toggle();
    else if (key === "N") this.ask({ do: "event" });
    else if (key === "ArrowLeft" || key === "ArrowRight") this.ask({ do: "seek", by: (key === "ArrowLeft" ? -1 : 1) * (event.shiftKey ? 5 : 0.1) });
    else if (/^[0-9]$/.test(key)) this.ask({ do: "seek", at: this.now.to * Number(key) / 10 });
    else if (key === "+" || key === "=" || key === "-") this.ask({ do: "speed", by: key === "-" ? -1 : 1 });
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
    const speed = `${now.speed}\u00d7 `;
    if ($("replay-speed").firstChild.textContent !== speed) $("replay-speed").firstChild.textContent = speed;
    this.drawStrip(now);
  }

  /** lambda_2 over the whole recording on a log axis, a full bar where the swarm is in pieces; below, ticks for events. */
  drawStrip(now) {
    const { context: c, width, height } = fit($("replay-events"));
    c.clearRect(0, 0, width, height);
    const x = (at) => 8 + at / now.to * (width - 16), foot = height - 8;
    const values = this.strip.map((p) => p[1]).filter((v) => v > 0);
    const low = Math.log(Math.min(0.2, ...values)), high = Math.log(Math.max(2, ...values));
    const y = (v) => foot - 2 - (Math.log(v) - low) / (high - low) * (foot - 4);
    c.strokeStyle = color("--blue"); c.lineWidth = 2; c.lineJoin = "round"; c.beginPath();
    let pen = false;
    for (const [at, value] of this.strip) {
      if (value > 0) { if (pen) c.lineTo(x(at), y(value)); else c.moveTo(x(at), y(value)); }
      pen = value > 0;
    }
    c.stroke();
    c.fillStyle = color("--red");
    for (const [at, value] of this.strip) if (!value) c.fillRect(x(at) - 1, 0, 2, foot);
    c.fillStyle = color("--ink3");
    for (const at of this.events) c.fillRect(x(at) - 1, foot, 2, 8);
    c.strokeStyle = color("--violet"); c.lineWidth = 2; c.beginPath();
    c.moveTo(x(now.at), 0); c.lineTo(x(now.at), height); c.stroke();
  }
}
