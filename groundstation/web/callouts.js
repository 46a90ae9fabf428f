/** Words on the map: what is wrong with a robot or a target, beside it; and what stands over the whole map. */
import { color } from "./canvas.js";

/** The gravest two, beside their robots; while seeding, what cannot be placed. */
export function drawCallouts(map, robots, seed) {
  if (seed.open) { drawRefusals(map, seed); return; }
  let left = 2, boxes = null;
  const told = new Set(); // one callout for what many have in common
  robots.forEach((r, k) => {
    if (!map.seen[k] || left === 0) return;
    const x = map.sx[k], y = map.sy[k], name = map.layout.labels[k], lost = map.unconfirmed(r);
    if (!lost && !(r.trouble?.level === "fault" && !(map.stopped && r.run === "stopped") && !told.has(r.trouble.title))) return;
    boxes ??= occupied(map, robots, seed.points);
    left -= 1;
    if (lost) {
      const fast = (r.mps || 0) > 0.03;
      place(map, boxes, x, y, fast ? `${name} still moving` : `${name} no answer`, `${fast ? `${r.mps.toFixed(2)} m/s, no` : "No"} answer to STOP. Keep out.`, "--red", true);
    } else {
      told.add(r.trouble.title);
      place(map, boxes, x, y, `${name} ${r.trouble.title} ${r.trouble.value}`.trim(), r.valid === false ? "Last seen here. Keep clear." : r.trouble.now, "--red", true);
    }
  });
}

function drawRefusals(map, seed) {
  if (!seed.refused && !seed.strays.length) return;
  const boxes = occupied(map, map.view.robots, seed.points), c = map.c;
  if (seed.refused) { const [x, y] = map.toScreen(...seed.refused.at); place(map, boxes, x, y, "Beyond the fence", seed.refused.text, "--critical", false); }
  seed.strays.slice(0, 2).forEach((s) => {
    const [x, y] = map.toScreen(...seed.points[s.index]), [qx, qy] = map.toScreen(...s.nearest);
    c.strokeStyle = color("--critical"); c.lineWidth = 2.4; c.setLineDash([3, 5]); c.beginPath(); c.moveTo(x, y); c.lineTo(qx, qy); c.stroke(); c.setLineDash([]);
    place(map, boxes, x, y, `T${String(s.index + 1).padStart(2, "0")} out of reach: ${s.gap.toFixed(2)} m`, `nearest target must be within ${map.layout.r_c.toFixed(2)} m`, "--critical", false);
  });
}

/** [x, y, w, h] of what a callout should not cover. */
function occupied(map, robots, points) {
  const boxes = [], r = map.radius;
  if (points.length <= 80) for (const point of points) { const [x, y] = map.toScreen(...point); boxes.push([x - 12, y - 12, 24, 24]); }
  robots.forEach((_, k) => { if (map.seen[k]) boxes.push([map.sx[k] - r - 8, map.sy[k] - r - 8, 2 * r + 16, 2 * r + 16]); });
  return boxes;
}

/** A callout beside (x, y), where it covers least. */
function place(map, boxes, x, y, title, text, tone, filled) {
  const c = map.c;
  c.font = "700 21px Inter"; const a = c.measureText(title).width; c.font = "500 16px Inter"; const wide = Math.max(a, c.measureText(text).width) + 30, high = 62;
  let best = null;
  for (let k = 0; k < 16; k += 1) {
    for (const far of [70, 110, 150]) {
      const cx = x + Math.cos(k * Math.PI / 8) * (far + wide / 2 * Math.abs(Math.cos(k * Math.PI / 8))), cy = y + Math.sin(k * Math.PI / 8) * (far - 10);
      const box = [cx - wide / 2, cy - high / 2, wide, high];
      if (box[0] < 4 || box[1] < 4 || box[0] + wide > map.width - 4 || box[1] + high > map.height - 4) continue;
      let over = 0;
      for (const b of boxes) if (b[0] < box[0] + box[2] && b[0] + b[2] > box[0] && b[1] < box[1] + box[3] && b[1] + b[3] > box[1]) over += 1;
      const cost = over * 100 + far / 10;
      if (!best || cost < best.cost) best = { cost, cx, cy, box };
    }
  }
  const at = best || { cx: Math.min(Math.max(x, wide / 2 + 4), map.width - wide / 2 - 4), cy: Math.max(40, y - 80), box: [0, 0, 0, 0] };
  boxes.push(at.box);
  say(map, at.cx, at.cy, title, text, tone, filled);
}

export function say(map, x, y, title, text, tone, filled) {
  const c = map.c, shade = filled && tone === "--blue" ? color("--on-blue") : "#fff";
  c.font = "700 21px Inter"; const a = c.measureText(title).width; c.font = "500 16px Inter"; const b = text ? c.measureText(text).width : 0;
  const wide = Math.max(a, b) + 30, high = text ? 62 : 36, left = x - wide / 2, top = y - high / 2;
  c.beginPath(); c.roundRect(left, top, wide, high, 7); c.fillStyle = filled ? color(tone) : color("--surface"); c.fill();
  c.strokeStyle = filled ? color("--surface") : color(tone); c.lineWidth = 2; c.stroke();
  c.textAlign = "left"; c.textBaseline = "middle"; c.fillStyle = filled ? shade : color("--ink");
  c.font = text ? "700 21px Inter" : "650 18px Inter"; c.fillText(title, left + (text ? 15 : (wide - c.measureText(title).width) / 2), top + (text ? 21 : 19));
  c.font = "500 16px Inter"; c.fillText(text, left + 15, top + 45);
}

/** Poses are too old: hatched, and who does not speak. */
export function drawNoData(map, words) {
  const c = map.c, { x, y, w, h } = map.box;
  c.save(); c.beginPath(); c.rect(x, y, w, h); c.clip(); c.globalAlpha = 0.55; c.fillStyle = color("--map"); c.fillRect(x, y, w, h); c.globalAlpha = 0.5;
  c.strokeStyle = color("--removed"); c.lineWidth = 2; c.beginPath();
  for (let k = -h; k < w; k += 22) { c.moveTo(x + k, y + h); c.lineTo(x + k + h, y); }
  c.stroke(); c.restore();
  say(map, x + w / 2, y + h / 2, words.title, words.text, "--red", true);
}
