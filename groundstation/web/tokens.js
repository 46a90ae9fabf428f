/** Robots on the map: teardrops by state, hold rings, rings of the selected one, circles of doubt. */
import { color, Sprites } from "./canvas.js";

const HEADINGS = 64, HOLDS = 40, TAU = 2 * Math.PI;

export class Tokens {
  constructor() { this.sprites = new Sprites(); }

  /** Forget what was drawn for another size. */
  keep(map) { this.sprites.keep(`${map.radius}|${map.ratio}|${map.many}`); }

  /** All robots; many of them as sprites, few of them as paths with their ids. */
  draw(map, robots) {
    for (let k = 0; k < robots.length; k += 1) if (map.seen[k]) this.one(map, robots[k], k);
  }

  one(map, robot, k) {
    const x = map.sx[k], y = map.sy[k], way = map.way[k], r = map.radius, c = map.c, kind = kindOf(map, robot);
    if (robot.hold !== undefined && !map.stopped) {
      const part = Math.round(robot.hold * HOLDS);
      if (map.many) this.sprites.put(c, map.ratio, `hold${part}`, x, y, r + 12, (s) => drawHold(s, 0, 0, r, part / HOLDS));
      else drawHold(c, x, y, r, robot.hold);
    }
    if (map.many) {
      const turn = kind === "octagon" ? 0 : Math.round((way / TAU + 1) * HEADINGS) % HEADINGS;
      this.sprites.put(c, map.ratio, `${kind}${turn}`, x, y, 1.6 * r + 4, (s) => drawToken(s, 0, 0, r, turn / HEADINGS * TAU, kind, true));
      if (kind !== "bad" && kind !== "lost" && robot.id !== map.selected) return;
    } else drawToken(c, x, y, r, way, kind, false);
    const label = map.layout.labels[k], size = Math.round(r * (label.length > 2 ? 0.75 : 1.04));
    c.fillStyle = kind === "lost" ? "#fff" : color(INKS[kind]); c.font = `750 ${size}px Inter`; c.textAlign = "center"; c.textBaseline = "middle";
    c.fillText(label, x, y + 1);
  }
}

const INKS = { octagon: "--on-stopped", lost: "--on-red", bad: "--red-text", out: "--on-stopped", hollow: "--blue", moving: "--on-blue" };

function kindOf(map, robot) {
  const lost = map.unconfirmed(robot);
  if (robot.run === "stopped" && !lost && map.stopped) return "octagon";
  if (lost) return "lost";
  if (robot.trouble?.level === "fault") return "bad";
  if (robot.out) return "out";
  return robot.run === "disarmed" || robot.run === undefined ? "hollow" : "moving";
}

function drawHold(c, x, y, r, part) {
  c.lineWidth = 6; c.strokeStyle = color("--line"); c.beginPath(); c.arc(x, y, r + 8, 0, 7); c.stroke();
  c.strokeStyle = color("--ink"); c.beginPath(); c.arc(x, y, r + 8, -Math.PI / 2, -Math.PI / 2 + part * TAU); c.stroke();
}

function drop(c, x, y, r, way) {
  c.beginPath(); c.arc(x, y, r, way + 0.88, way - 0.88 + TAU); c.lineTo(x + Math.cos(way) * r * 1.58, y + Math.sin(way) * r * 1.58); c.closePath();
}

function drawToken(c, x, y, r, way, kind, many) {
  if (kind === "octagon") {
    c.fillStyle = color("--stopped"); c.beginPath();
    for (let k = 0; k < 8; k += 1) c.lineTo(x + Math.cos(Math.PI / 8 + k * Math.PI / 4) * r * 1.05, y + Math.sin(Math.PI / 8 + k * Math.PI / 4) * r * 1.05);
    c.closePath(); c.fill();
    return;
  }
  drop(c, x, y, r, way);
  if (kind === "bad") {
    c.fillStyle = color("--surface"); c.strokeStyle = color("--red-text"); c.lineWidth = 3; c.fill(); c.setLineDash([5, 4]); c.stroke(); c.setLineDash([]);
  } else if (kind === "hollow") {
    c.fillStyle = color("--surface"); c.strokeStyle = color("--blue"); c.lineWidth = many ? 2 : 3.5; c.fill(); c.stroke();
  } else {
    c.strokeStyle = color("--surface"); c.lineWidth = 3; c.stroke();
    c.fillStyle = color(kind === "lost" ? "--red" : kind === "out" ? "--stopped" : "--blue"); c.fill();
  }
}

/** Around a robot in trouble: where it may be; hatched where it has not confirmed a STOP. */
export function drawDoubt(map, robot, k) {
  const lost = map.unconfirmed(robot), calm = map.stopped && robot.run === "stopped";
  if (!lost && !(robot.trouble?.level === "fault" && !calm)) return;
  const x = map.sx[k], y = map.sy[k], r = map.radius * (lost ? 4.2 : 3.1);
  if (map.many) map.tokens.sprites.put(map.c, map.ratio, `doubt${lost}`, x, y, r + 3, (s) => drawCircle(s, 0, 0, r, lost));
  else drawCircle(map.c, x, y, r, lost);
}

function drawCircle(c, x, y, r, lost) {
  c.save(); c.beginPath(); c.arc(x, y, r, 0, 7); c.globalAlpha = 0.75; c.fillStyle = color("--red-soft"); c.fill(); c.globalAlpha = 1;
  c.strokeStyle = color("--red-text"); c.lineWidth = lost ? 3 : 2.4;
  if (!lost) c.setLineDash([3, 6]);
  c.stroke(); c.setLineDash([]);
  if (lost) {
    c.clip(); c.lineWidth = 1.6; c.globalAlpha = 0.6; c.beginPath();
    for (let h = -2 * r; h < 2 * r; h += 13) { c.moveTo(x + h, y + r); c.lineTo(x + h + 1.4 * r, y - r); }
    c.stroke();
  }
  c.restore();
}

/** r_c, r_n and r_a about the selected robot. */
export function drawRings(map, k) {
  const c = map.c, x = map.sx[k], y = map.sy[k], { r_c, r_n, r_a } = map.layout;
  c.fillStyle = color("--wash"); c.beginPath(); c.arc(x, y, r_c * map.scale, 0, 7); c.fill();
  c.strokeStyle = color("--kept"); c.lineWidth = 1.5;
  for (const [r, dash] of [[r_c, []], [r_n, [7, 5]], [r_a, []]]) { c.setLineDash(dash); c.beginPath(); c.arc(x, y, r * map.scale, 0, 7); c.stroke(); }
  c.setLineDash([]); c.strokeStyle = color("--blue"); c.lineWidth = 3; c.beginPath(); c.arc(x, y, map.radius + 11, 0, 7); c.stroke();
}

export function drawRingNames(map, k) {
  const c = map.c, x = map.sx[k], y = map.sy[k], { r_c, r_n, r_a } = map.layout;
  c.font = "500 15px Inter"; c.textAlign = "center"; c.textBaseline = "middle";
  for (const [name, r, way] of [["c", r_c, 3.5], ["n", r_n, 2.9], ["a", r_a, 4.2]]) {
    const px = x + Math.cos(way) * r * map.scale, py = y + Math.sin(way) * r * map.scale;
    const text = `r  ${r.toFixed(2)} m`, wide = c.measureText(text).width + 20;
    c.fillStyle = color("--surface"); c.strokeStyle = color("--kept"); c.lineWidth = 1;
    c.beginPath(); c.roundRect(px - wide / 2, py - 11, wide, 22, 11); c.fill(); c.stroke();
    c.fillStyle = color("--ink"); c.fillText(text, px, py + 0.5);
    c.font = "500 11px Inter"; c.fillText(name, px - wide / 2 + 18, py + 4); c.font = "500 15px Inter";
  }
}
