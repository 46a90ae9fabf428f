/** What lies below everything on the map: floor, grid, fence, axes, trails. */
import { color, Layer } from "./canvas.js";

const TRAIL_MS = 12000, FADES = 8, TRAILS_EVERY_MS = 120;
const STEP_M = 0.012, STEP_PX = 2.5;

/** Where each robot has been in the last seconds. */
export class Trails {
  constructor() { this.of = new Map(); this.version = 0; }

  clear() { this.of.clear(); }

  add(robot, x, y, now, scale) {
    let trail = this.of.get(robot);
    if (!trail) { trail = []; this.of.set(robot, trail); }
    const last = trail[trail.length - 1], step = Math.max(STEP_M, STEP_PX / (scale || 200));
    if (!last || Math.abs(last.x - x) + Math.abs(last.y - y) > step) { trail.push({ x, y, t: now }); this.version += 1; }
    while (trail.length && now - trail[0].t > TRAIL_MS) { trail.shift(); this.version += 1; }
  }
}

export class Ground {
  constructor() { this.floor = new Layer(true); this.whole = new Layer(true); }

  draw(map, trails, now) {
    const { width, height, ratio } = map, place = `${map.place}|${map.stopped}`;
    const floor = this.floor.begin(width, height, ratio, map.place, "", now, 0);
    if (floor) drawFloor(floor, map);
    const fading = trails.of.size ? Math.floor(now / (TRAIL_MS / FADES / 4)) : 0;
    const whole = this.whole.begin(width, height, ratio, place, `${trails.version}|${fading}`, now, TRAILS_EVERY_MS);
    if (whole) { copy(whole, this.floor, width, height); if (map.view) drawTrails(whole, map, trails, now); }
    copy(map.c, this.whole, width, height);
  }
}

function copy(c, layer, width, height) { c.drawImage(layer.image, 0, 0, width, height); }

function drawFloor(c, map) {
  const { x, y, w, h } = map.box, [sx, sy] = map.layout.size, fence = map.layout.fence;
  c.fillStyle = color("--surface"); c.fillRect(0, 0, map.width, map.height);
  c.fillStyle = color("--map"); c.fillRect(x, y, w, h);
  c.strokeStyle = color("--grid"); c.lineWidth = 1; c.beginPath();
  const step = Math.max(sx, sy) > 12 ? 1 : 0.5;
  for (let m = step; m < sx; m += step) { c.moveTo(...map.toScreen(m, 0)); c.lineTo(...map.toScreen(m, sy)); }
  for (let m = step; m < sy; m += step) { c.moveTo(...map.toScreen(0, m)); c.lineTo(...map.toScreen(sx, m)); }
  c.stroke();
  c.strokeStyle = color("--line"); c.lineWidth = 2; c.strokeRect(x, y, w, h);
  const [ax, ay] = map.toScreen(fence, fence), [bx, by] = map.toScreen(sx - fence, sy - fence);
  c.setLineDash([2.5, 6]); c.strokeStyle = color("--ink3"); c.lineWidth = 1.7;
  c.strokeRect(Math.min(ax, bx), Math.min(ay, by), Math.abs(bx - ax), Math.abs(by - ay)); c.setLineDash([]);
  drawAxes(c, map);
}

function drawAxes(c, map) {
  const { x, y } = map.box, [sx, sy] = map.layout.size, turn = map.turnNow;
  c.fillStyle = color("--ink2"); c.font = "500 15px Inter"; c.textAlign = "center"; c.textBaseline = "middle";
  const along = turn % 2 === 0 ? [sy, sx] : [sx, sy], names = turn % 2 === 0 ? ["y", "x"] : ["x", "y"];
  const flip = [[false, false], [false, true], [true, true], [true, false]][turn];
  const every = Math.max(...along) > 12 ? 5 : 1;
  for (let m = 0; m <= along[0] + 1e-6; m += every) {
    const px = x + (flip[0] ? along[0] - m : m) * map.scale;
    c.fillText(m + every > along[0] ? `${m} m` : String(m), px, y - 13);
  }
  for (let m = every; m <= along[1] + 1e-6; m += every) c.fillText(String(m), x - 13, y + (flip[1] ? along[1] - m : m) * map.scale);
  c.font = "650 15px Inter";
  c.fillText(flip[0] ? `← ${names[0]}` : `${names[0]} →`, x + map.scale * 0.5, y - 13);
  c.fillText(flip[1] ? `${names[1]} ↑` : `${names[1]} ↓`, x - 20, y + map.scale * 0.5);
}

/** Fading in a few steps: one stroke a step and robot, the newest up to where the robot is drawn now. */
function drawTrails(c, map, trails, now) {
  c.lineWidth = map.many ? 2 : 4;
  c.strokeStyle = map.stopped ? color("--removed") : color("--kept");
  map.view.robots.forEach((robot, k) => {
    const trail = trails.of.get(robot.id);
    if (!trail?.length) return;
    let step = -1, bx = 0, by = 0;
    for (const point of trail) {
      const age = Math.max(0, Math.floor((now - point.t) / TRAIL_MS * FADES)), x = map.px(point.x, point.y), y = map.py(point.x, point.y);
      if (age >= FADES) continue;
      if (age === step) c.lineTo(x, y);
      else {
        if (step >= 0) { c.lineTo(x, y); c.stroke(); }
        step = age;
        c.globalAlpha = 0.34 * (1 - (step + 0.5) / FADES);
        c.beginPath(); c.moveTo(x, y);
      }
      bx = x; by = y;
    }
    if (step < 0) return;
    if (map.seen[k] && Math.hypot(map.sx[k] - bx, map.sy[k] - by) < 3 * map.radius) c.lineTo(map.sx[k], map.sy[k]);
    c.stroke();
  });
  c.globalAlpha = 1;
}
