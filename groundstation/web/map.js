/** The arena to scale: ground, links, targets, robots, callouts. Draws; decides nothing. */
import { color, fit } from "./canvas.js";
import { drawCallouts, drawNoData, say } from "./callouts.js";
import { Ground, Trails } from "./ground.js";
import { drawReach, drawSeed, Marks } from "./marks.js";
import { drawDoubt, drawRingNames, drawRings, Tokens } from "./tokens.js";

const KEPT = 0, CRITICAL = 1, REMOVED = 2, UNVERIFIED = 3;
const MANY = 20, LEFT = 41, RIGHT = 26, TOP = 26, BOTTOM = 8;

export class ArenaMap {
  constructor(canvas) {
    this.canvas = canvas;
    this.turn = 0; this.layouts = 0;
    this.trails = new Trails(); this.ground = new Ground(); this.marks = new Marks(); this.tokens = new Tokens();
    this.rings = true;
    this.selected = null;
    this.view = null;
    this.at = 0; this.gap = 50;
    this.reserve(0);
  }

  /** Numbers of n robots, kept from frame to frame: where they were and are told to be, and where on the screen. */
  reserve(n) {
    this.from = new Float64Array(3 * n); this.to = new Float64Array(3 * n);
    this.seen = new Uint8Array(n);
    this.sx = new Float64Array(n); this.sy = new Float64Array(n); this.way = new Float64Array(n);
  }

  setLayout(layout) {
    this.layout = layout; this.layouts += 1; this.trails.clear();
    this.many = layout.robots.length > MANY;
    if (this.view?.robots.length !== layout.robots.length) this.view = null; // of another arena
    if (this.seen.length !== layout.robots.length) this.reserve(layout.robots.length);
  }

  /** A new view: poses are drawn on the way from the last one for one view's time, never beyond it. */
  setView(view, now) {
    this.view = view;
    this.began(now);
    view.robots.forEach((r, k) => { if (r.x === undefined) this.seen[k] = 0; else this.moved(k, r.x, r.y, r.h, r.valid, now); });
  }

  /** New poses, in the order of the robots: [x, y, heading, valid], null for a robot never seen. */
  setPoses(poses, now) {
    this.began(now);
    poses.forEach((pose, k) => { if (pose) this.moved(k, pose[0], pose[1], pose[2], pose[3], now); });
  }

  began(now) { this.gap = Math.max(20, Math.min(100, now - this.at)); this.at = now; }

  moved(k, x, y, heading, valid, now) {
    const { from, to } = this, i = 3 * k, smooth = this.seen[k] && valid;
    from[i] = smooth ? to[i] : x; from[i + 1] = smooth ? to[i + 1] : y;
    from[i + 2] = smooth ? heading - Math.atan2(Math.sin(heading - to[i + 2]), Math.cos(heading - to[i + 2])) : heading;
    to[i] = x; to[i + 1] = y; to[i + 2] = heading;
    this.seen[k] = 1;
    if (valid) this.trails.add(this.layout.robots[k], x, y, now, this.scale);
  }

  /** The canvas and, where it has changed, the way from metres to its pixels. */
  frame() {
    const { context, width, height, ratio } = fit(this.canvas, { alpha: false });
    this.c = context;
    const place = `${width}|${height}|${ratio}|${this.turn}|${this.layouts}`;
    if (place === this.place) return;
    const [mx, my] = this.layout.size, turn = ((my >= mx ? 0 : 1) + this.turn) % 4;
    const [w, h] = turn % 2 === 0 ? [my, mx] : [mx, my];
    const scale = Math.min((width - LEFT - RIGHT) / w, (height - TOP - BOTTOM) / h);
    const ox = LEFT + (width - LEFT - RIGHT - w * scale) / 2, oy = TOP + (height - TOP - BOTTOM - h * scale) / 2;
    Object.assign(this, { place, width, height, ratio, scale, turnNow: turn });
    this.box = { x: ox, y: oy, w: w * scale, h: h * scale };
    // [constant, by x, by y] of both pixel coordinates
    this.across = [[ox, 0, scale], [ox, scale, 0], [ox + my * scale, 0, -scale], [ox + mx * scale, -scale, 0]][turn];
    this.down = [[oy, scale, 0], [oy + my * scale, 0, -scale], [oy + mx * scale, -scale, 0], [oy, 0, scale]][turn];
    this.radius = this.many ? Math.max(7, Math.min(13, 0.07 * scale)) : Math.max(13, Math.min(22, 0.114 * scale));
  }

  px(x, y) { const a = this.across; return a[0] + a[1] * x + a[2] * y; }

  py(x, y) { const d = this.down; return d[0] + d[1] * x + d[2] * y; }

  toScreen(x, y) { return [this.px(x, y), this.py(x, y)]; }

  toArena(px, py) {
    const a = this.across, d = this.down, u = px - a[0], v = py - d[0], area = a[1] * d[2] - a[2] * d[1];
    return [(u * d[2] - v * a[2]) / area, (v * a[1] - u * d[1]) / area];
  }

  /** The robot under a place on the screen. */
  robotAt([x, y]) { return this.view?.robots.find((_, k) => this.seen[k] && Math.hypot(this.sx[k] - x, this.sy[k] - y) < this.radius + 6); }

  draw(now, seed, shown) {
    if (!this.layout) return;
    this.frame();
    if (!this.width) return;
    this.stopped = shown.stopped;
    const view = this.view;
    if (view) this.step(now);
    this.ground.draw(this, this.trails, now);
    if (!view) return;
    const robots = view.robots, chosen = this.rings && !this.stopped ? robots.findIndex((r, k) => r.id === this.selected && this.seen[k]) : -1;
    this.tokens.keep(this);
    if (chosen >= 0) drawRings(this, chosen);
    for (let k = 0; k < robots.length; k += 1) if (this.seen[k]) drawDoubt(this, robots[k], k);
    this.drawLinks(view.links, seed.open);
    if (seed.open) drawReach(this, seed);
    this.drawStarts(robots);
    this.drawClaims(robots, view.targets, seed.points);
    this.marks.draw(this, view.targets, seed, now);
    this.tokens.draw(this, robots);
    if (chosen >= 0) drawRingNames(this, chosen);
    if (seed.open) drawSeed(this, seed, say);
    if (!shown.noData) drawCallouts(this, robots, seed);
    this.drawWords(robots, seed, shown);
  }

  /** Where every robot is drawn at this moment. */
  step(now) {
    const part = Math.min(1, (now - this.at) / this.gap), { from, to } = this;
    const at = (i) => from[i] + part * (to[i] - from[i]);
    for (let k = 0; k < this.seen.length; k += 1) {
      if (!this.seen[k]) continue;
      const x = at(3 * k), y = at(3 * k + 1), heading = at(3 * k + 2), co = Math.cos(heading), si = Math.sin(heading);
      this.sx[k] = this.px(x, y); this.sy[k] = this.py(x, y);
      this.way[k] = Math.atan2(this.down[1] * co + this.down[2] * si, this.across[1] * co + this.across[2] * si);
    }
  }

  unconfirmed(robot) { return Boolean(this.view.stop?.known && this.view.stop.silent.includes(robot.id)); }

  line(i, j) { const c = this.c; c.beginPath(); c.moveTo(this.sx[i], this.sy[i]); c.lineTo(this.sx[j], this.sy[j]); c.stroke(); }

  /** Kept thin, critical double rails, removed dotted with a cross, unverified dashed. A stroke each: one path of all costs twice as much. */
  drawLinks(links, seeding) {
    const c = this.c, many = this.many;
    const strokes = (kind, shade, width, dash) => {
      c.strokeStyle = color(shade); c.lineWidth = width; c.setLineDash(dash);
      for (const link of links) if (link[2] === kind && this.seen[link[0]] && this.seen[link[1]]) this.line(link[0], link[1]);
    };
    if (!seeding) {
      strokes(REMOVED, "--removed", 2, [2.5, 7]);
      if (!many) this.drawCrosses(links);
    }
    strokes(KEPT, this.stopped ? "--removed" : "--kept", many ? 1.8 : 3.4, []);
    strokes(CRITICAL, this.stopped ? "--removed" : "--critical", many ? 4.5 : 9, []);
    strokes(CRITICAL, "--map", many ? 1.8 : 3.4, []);
    strokes(UNVERIFIED, "--red-text", 3, [9, 6]);
    c.setLineDash([]);
  }

  drawCrosses(links) {
    const c = this.c;
    c.setLineDash([]); c.lineWidth = 2.8; c.beginPath();
    for (const [i, j, kind] of links) {
      if (kind !== REMOVED || !this.seen[i] || !this.seen[j]) continue;
      const x = (this.sx[i] + this.sx[j]) / 2, y = (this.sy[i] + this.sy[j]) / 2;
      c.moveTo(x - 6, y - 6); c.lineTo(x + 6, y + 6); c.moveTo(x + 6, y - 6); c.lineTo(x - 6, y + 6);
    }
    c.stroke();
  }

  /** Where each misplaced robot belongs. */
  drawStarts(robots) {
    const c = this.c;
    robots.forEach((r, k) => {
      if (r.away_m === undefined || !this.seen[k]) return;
      c.strokeStyle = color("--ink3"); c.fillStyle = color("--ink3"); c.lineWidth = 1.8; c.font = "600 15px Inter"; c.textAlign = "center"; c.textBaseline = "middle";
      const [x, y] = this.toScreen(...this.layout.starts[k]);
      c.setLineDash([5, 4]); c.beginPath(); c.arc(x, y, this.radius, 0, 7); c.stroke();
      c.setLineDash([2, 6]); c.beginPath(); c.moveTo(x, y); c.lineTo(this.sx[k], this.sy[k]); c.stroke(); c.setLineDash([]);
      if (!this.many) c.fillText(this.layout.labels[k], x, y);
    });
  }

  /** From each robot to the target that it tracks. */
  drawClaims(robots, states, points) {
    const c = this.c;
    c.strokeStyle = color("--ink"); c.lineWidth = 1.8; c.setLineDash(this.many ? [2, 6] : [2, 4]);
    robots.forEach((r, k) => {
      const target = points[r.claim];
      if (!this.seen[k] || !target || states[r.claim] !== "t") return;
      c.beginPath(); c.moveTo(this.sx[k], this.sy[k]); c.lineTo(this.px(...target), this.py(...target)); c.stroke();
    });
    c.setLineDash([]);
  }

  drawWords(robots, seed, shown) {
    const { x, y, w, h } = this.box;
    if (shown.noData) drawNoData(this, shown.noData);
    if (!seed.points.length && seed.open) say(this, x + w / 2, y + h / 2, "No targets", "Click to place, drag for a cloud.", "--blue", true);
    if (!shown.noData && robots.every((_, k) => !this.seen[k])) say(this, x + w / 2, y + 40, "No robot seen yet", "Waiting for poses of " + this.layout.labels.join(", "), "--critical", false);
  }
}
