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
    this.floor = 0.05;
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
    this.floor = layout.floor || 0.05;
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

  /** lambda_2 over the whole recording on a log axis, hatched where no connected graph lies; dots for events. */
  drawStrip(now) {
    const { context: c, width, height } = fit($("replay-events"));
    c.clearRect(0, 0, width, height);
    const left = 36, right = width - 8, foot = height - 18, top = 4;
    const x = (at) => left + at / now.to * (right - left);
    const low = Math.log(this.floor * 0.62), high = Math.log(Math.max(2, ...this.strip.map((p) => p[1])) * 1.1);
    const y = (v) => foot - (Math.max(low, Math.log(v || 1e-9)) - low) / (high - low) * (foot - top);
    const level = y(this.floor);
    c.save(); c.beginPath(); c.rect(left, level, right - left, foot - level); c.clip();
    c.strokeStyle = color("--removed"); c.lineWidth = 1; c.beginPath();
    for (let k = left - 20; k < right + 20; k += 7) { c.moveTo(k, foot + 6); c.lineTo(k + 18, level - 6); }
    c.stroke(); c.restore();
    c.font = "600 13.5px Inter"; c.textAlign = "right"; c.textBaseline = "middle"; c.fillStyle = color("--ink2");
    c.lineWidth = 1;
    for (const value of [this.floor, 1]) {
      if (value === 1 && (this.floor > 0.6 || Math.exp(high) < 1.05)) continue;
      c.strokeStyle = color(value === 1 ? "--line" : "--ink3");
      c.beginPath(); c.moveTo(left, y(value)); c.lineTo(right, y(value)); c.stroke();
      c.fillText(value === 1 ? "1" : value.toFixed(2).replace(/^0/, ""), left - 5, y(value));
    }
    c.lineWidth = 3; c.lineJoin = "round"; c.strokeStyle = color("--blue");
    for (const past of [true, false]) {
      c.globalAlpha = past ? 1 : 0.4;
      c.beginPath();
      let last = null;
      for (const [at, value] of this.strip) {
        if ((at <= now.at) === past) { if (last === null) c.moveTo(x(at), y(value)); else { c.lineTo(x(at), last); c.lineTo(x(at), y(value)); } last = y(value); }
      }
      c.stroke();
    }
    c.globalAlpha = 1;
    c.fillStyle = color("--ink");
    for (const at of this.events) { c.beginPath(); c.arc(x(at), height - 8, 4, 0, 7); c.fill(); }
    c.strokeStyle = color("--violet"); c.lineWidth = 3; c.beginPath();
    c.moveTo(x(now.at), 0); c.lineTo(x(now.at), height); c.stroke();
  }
}
