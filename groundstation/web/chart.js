/** lambda_2 over the last minute on a log axis; hatched below the floor, where no connected graph lies. */
import { color, fit } from "./canvas.js";

const WINDOW_S = 60;

export function drawChart(canvas, data) {
  const { context: c, width, height } = fit(canvas);
  if (!width) return;
  c.clearRect(0, 0, width, height);
  const left = 28, right = width - 1, top = 8, bottom = height - 44;
  const floor = data.floor || 0.05, high = data.history.reduce((most, p) => Math.max(most, p[1]), 2);
  const low = floor * 0.78;
  const y = (v) => bottom - (Math.log(Math.max(v, low)) - Math.log(low)) / (Math.log(high * 1.15) - Math.log(low)) * (bottom - top);
  const end = Math.max(WINDOW_S, data.elapsed), begin = end - WINDOW_S;
  const x = (t) => left + (t - begin) / WINDOW_S * (right - left);
  c.font = "500 14px Inter";
  c.textBaseline = "middle";
  c.textAlign = "right";
  const yf = y(floor);
  c.save();
  c.beginPath(); c.rect(left, yf, right - left, bottom - yf + 4); c.clip();
  c.strokeStyle = color("--removed"); c.lineWidth = 1; c.globalAlpha = 0.7; c.beginPath();
  for (let k = left - 20; k < right + 20; k += 7) { c.moveTo(k, bottom + 6); c.lineTo(k + 14, bottom - 8); }
  c.stroke(); c.restore();
  c.strokeStyle = color("--line"); c.lineWidth = 1;
  if (high > 1 && floor < 1) { c.beginPath(); c.moveTo(left, y(1)); c.lineTo(right, y(1)); c.stroke(); c.fillStyle = color("--ink2"); c.fillText("1", left - 8, y(1)); }
  c.strokeStyle = color("--ink3"); c.lineWidth = 1.5; c.beginPath(); c.moveTo(left, yf); c.lineTo(right, yf); c.stroke();
  c.fillStyle = color("--ink2"); c.font = "650 14px Inter"; c.fillText(floor.toFixed(floor < 0.1 ? 3 : 2).replace(/^0/, ""), left - 3, yf);
  const points = data.history.filter((p) => p[0] >= begin - 1);
  c.save(); c.beginPath(); c.rect(left, 0, right - left, height); c.clip();
  c.strokeStyle = color("--blue"); c.lineWidth = 3; c.lineJoin = "round"; c.beginPath();
  points.forEach(([t, v], k) => { if (k === 0) c.moveTo(x(t), y(v)); else { c.lineTo(x(t), y(points[k - 1][1])); c.lineTo(x(t), y(v)); } });
  if (points.length) c.lineTo(x(data.elapsed), y(points[points.length - 1][1]));
  c.stroke(); c.restore();
  const row = bottom + 18;
  c.strokeStyle = color("--line"); c.lineWidth = 1; c.beginPath(); c.moveTo(left, row); c.lineTo(right, row); c.stroke();
  c.font = "500 14px Inter"; c.fillStyle = color("--ink2"); c.textAlign = "left"; c.fillText("done", -2, row);
  for (const [t, kind] of data.marks) {
    if (t < begin || x(t) < left + 10) continue;
    c.beginPath();
    if (kind === "done") { c.fillStyle = color("--ink"); c.arc(x(t), row, 5, 0, 7); }
    else { c.fillStyle = color("--amber"); c.moveTo(x(t), row - 7); c.lineTo(x(t) + 6, row); c.lineTo(x(t), row + 7); c.lineTo(x(t) - 6, row); }
    c.fill();
  }
  c.fillStyle = color("--ink2"); c.textAlign = "center"; c.font = "500 13.5px Inter";
  for (let t = Math.ceil(begin / 20) * 20; t <= end - 6; t += 20) {
    c.fillText(`${String(Math.floor(t / 60)).padStart(2, "0")}:${String(t % 60).padStart(2, "0")}`, Math.max(20, x(t)), row + 17);
  }
}
