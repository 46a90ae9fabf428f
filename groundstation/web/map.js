/** The arena to scale: floor, fence, links, targets, trails, robots, rings, callouts. Draws; decides nothing. */
import { color, fit } from "./canvas.js";

const KEPT = 0, CRITICAL = 1, REMOVED = 2, UNVERIFIED = 3;
const TRAIL_MS = 12000, FADES = 8, MANY = 20, TAU = 2 * Math.PI;

export class ArenaMap {
  constructor(canvas) {
    this.canvas = canvas;
    this.turn = 0;
    this.trails = new Map();
    this.rings = true;
    this.selected = null;
    this.before = null;
    this.view = null;
    this.at = 0;
    this.boxes = [];
  }

  setLayout(layout) {
    this.layout = layout; this.trails.clear();
    if (this.view?.robots.length !== layout.robots.length) this.before = this.view = null; // of another arena
  }

  /** A new view: poses are drawn on the way from the last one for one view's time, never beyond it. */
  setView(view, now) {
    this.before = this.view;
    this.view = view;
    this.gap = Math.min(100, now - this.at);
    this.at = now;
    view.robots.forEach((robot) => {
      if (robot.x === undefined || !robot.valid) return;
      const trail = this.trails.get(robot.id) || [];
      const last = trail[trail.length - 1];
      if (!last || Math.hypot(last.x - robot.x, last.y - robot.y) > 0.012) trail.push({ x: robot.x, y: robot.y, t: now });
      while (trail.length && now - trail[0].t > TRAIL_MS) trail.shift();
      this.trails.set(robot.id, trail);
    });
  }

  frame() {
    const { context, width, height } = fit(this.canvas);
    const [sx, sy] = this.layout.size;
    const base = sy >= sx ? 0 : 1;
    const turn = (base + this.turn) % 4;
    const [w, h] = turn % 2 === 0 ? [sy, sx] : [sx, sy];
    const left = 41, right = 26, top = 26, bottom = 8;
    const scale = Math.min((width - left - right) / w, (height - top - bottom) / h);
    const ox = left + (width - left - right - w * scale) / 2, oy = top + (height - top - bottom - h * scale) / 2;
    const toScreen = (x, y) => {
      const [u, v] = turn === 0 ? [y, x] : turn === 1 ? [x, sy - y] : turn === 2 ? [sy - y, sx - x] : [sx - x, y];
      return [ox + u * scale, oy + v * scale];
    };
    const toArena = (px, py) => {
      const u = (px - ox) / scale, v = (py - oy) / scale;
      return turn === 0 ? [v, u] : turn === 1 ? [u, sy - v] : turn === 2 ? [sx - v, sy - u] : [sx - u, v];
    };
    const angle = (heading) => {
      const [a, b] = [toScreen(0, 0), toScreen(Math.cos(heading), Math.sin(heading))];
      return Math.atan2(b[1] - a[1], b[0] - a[0]);
    };
    Object.assign(this, { scale, toScreen, toArena, angle, c: context, width, height, turnNow: turn });
    this.box = { x: ox, y: oy, w: w * scale, h: h * scale };
  }

  draw(now, seed, shown) {
    if (!this.layout) return;
    this.frame();
    const c = this.c;
    c.clearRect(0, 0, this.width, this.height);
    this.boxes = [];
    this.drawFloor();
    const view = this.view;
    if (!view) return;
    this.stopped = shown.stopped;
    const robots = this.poses(now);
    this.many = robots.length > MANY;
    this.radius = this.many ? Math.max(7, Math.min(13, 0.07 * this.scale)) : Math.max(13, Math.min(22, 0.114 * this.scale));
    this.drawTrails(now);
    const chosen = robots.find((r) => r.id === this.selected && r.x !== undefined);
    if (this.rings && chosen && !shown.stopped) this.drawRings(chosen);
    robots.forEach((r) => this.drawDoubt(r));
    this.drawLinks(robots, view.links, seed.open);
    if (seed.open) this.drawReach(seed);
    this.drawStarts(robots);
    this.drawClaims(robots, view, seed.points);
    this.drawTargets(view.targets, seed);
    robots.forEach((r, k) => this.drawRobot(r, this.layout.labels[k], shown.stopped));
    this.drawRingNames(chosen, shown.stopped);
    this.drawSeed(seed);
    if (!shown.noData) this.drawCallouts(robots, view, seed, shown.stopped);
    if (shown.noData) this.drawNoData(shown.noData);
    if (!seed.points.length && seed.open) this.say(this.box.x + this.box.w / 2, this.box.y + this.box.h / 2, "No targets", "Click to place, drag for a cloud.", "--blue", true);
    if (robots.every((r) => r.x === undefined) && !shown.noData) this.say(this.box.x + this.box.w / 2, this.box.y + 40, "No robot seen yet", "Waiting for poses of " + this.layout.labels.join(", "), "--critical", false);
  }

  poses(now) {
    const part = this.before ? Math.min(1, (now - this.at) / Math.max(20, this.gap)) : 1;
    return this.view.robots.map((robot, k) => {
      const old = this.before?.robots[k];
      if (robot.x === undefined || old?.x === undefined || !robot.valid) return { ...robot };
      const turn = Math.atan2(Math.sin(robot.h - old.h), Math.cos(robot.h - old.h));
      return { ...robot, x: old.x + part * (robot.x - old.x), y: old.y + part * (robot.y - old.y), h: old.h + part * turn };
    });
  }

  drawFloor() {
    const c = this.c, { x, y, w, h } = this.box, [sx, sy] = this.layout.size, fence = this.layout.fence;
    c.fillStyle = color("--map"); c.fillRect(x, y, w, h);
    c.strokeStyle = color("--grid"); c.lineWidth = 1; c.beginPath();
    const step = Math.max(sx, sy) > 12 ? 1 : 0.5;
    for (let m = step; m < sx; m += step) { c.moveTo(...this.toScreen(m, 0)); c.lineTo(...this.toScreen(m, sy)); }
    for (let m = step; m < sy; m += step) { c.moveTo(...this.toScreen(0, m)); c.lineTo(...this.toScreen(sx, m)); }
    c.stroke();
    c.strokeStyle = color("--line"); c.lineWidth = 2; c.strokeRect(x, y, w, h);
    const [ax, ay] = this.toScreen(fence, fence), [bx, by] = this.toScreen(sx - fence, sy - fence);
    c.setLineDash([2.5, 6]); c.strokeStyle = color("--ink3"); c.lineWidth = 1.7;
    c.strokeRect(Math.min(ax, bx), Math.min(ay, by), Math.abs(bx - ax), Math.abs(by - ay)); c.setLineDash([]);
    c.fillStyle = color("--ink2"); c.font = "500 15px Inter"; c.textAlign = "center"; c.textBaseline = "middle";
    const along = this.turnNow % 2 === 0 ? [sy, sx] : [sx, sy], names = this.turnNow % 2 === 0 ? ["y", "x"] : ["x", "y"];
    const flip = [[false, false], [false, true], [true, true], [true, false]][this.turnNow];
    const every = Math.max(...along) > 12 ? 5 : 1;
    for (let m = 0; m <= along[0] + 1e-6; m += every) {
      const px = x + (flip[0] ? along[0] - m : m) * this.scale;
      c.fillText(m + every > along[0] ? `${m} m` : String(m), px, y - 13);
    }
    for (let m = every; m <= along[1] + 1e-6; m += every) c.fillText(String(m), x - 13, y + (flip[1] ? along[1] - m : m) * this.scale);
    c.font = "650 15px Inter";
    c.fillText(flip[0] ? `← ${names[0]}` : `${names[0]} →`, x + this.scale * 0.5, y - 13);
    c.fillText(flip[1] ? `${names[1]} ↑` : `${names[1]} ↓`, x - 20, y + this.scale * 0.5);
  }

  /** Fading in a few steps: one stroke a step, however many robots there are. */
  drawTrails(now) {
    const c = this.c, steps = Array.from({ length: FADES }, () => new Path2D());
    for (const trail of this.trails.values()) {
      let before = null;
      for (const point of trail) {
        const [x, y] = this.toScreen(point.x, point.y), age = (now - point.t) / TRAIL_MS;
        if (before && age < 1) { const path = steps[Math.max(0, Math.floor(age * FADES))]; path.moveTo(...before); path.lineTo(x, y); }
        before = [x, y];
      }
    }
    c.lineWidth = this.many ? 2 : 4;
    c.strokeStyle = this.stopped ? color("--removed") : color("--kept");
    steps.forEach((path, k) => { c.globalAlpha = 0.34 * (1 - (k + 0.5) / FADES); c.stroke(path); });
    c.globalAlpha = 1;
  }

  drawRings(robot) {
    const c = this.c, [x, y] = this.toScreen(robot.x, robot.y), { r_c, r_n, r_a } = this.layout;
    c.fillStyle = color("--wash"); c.beginPath(); c.arc(x, y, r_c * this.scale, 0, 7); c.fill();
    c.strokeStyle = color("--kept"); c.lineWidth = 1.5;
    for (const [r, dash] of [[r_c, []], [r_n, [7, 5]], [r_a, []]]) { c.setLineDash(dash); c.beginPath(); c.arc(x, y, r * this.scale, 0, 7); c.stroke(); }
    c.setLineDash([]); c.strokeStyle = color("--blue"); c.lineWidth = 3; c.beginPath(); c.arc(x, y, this.radius + 11, 0, 7); c.stroke();
  }

  drawRingNames(robot, stopped) {
    if (!this.rings || !robot || stopped) return;
    const c = this.c, [x, y] = this.toScreen(robot.x, robot.y);
    c.font = "500 15px Inter"; c.textAlign = "center"; c.textBaseline = "middle";
    for (const [name, r, way] of [["c", this.layout.r_c, 3.5], ["n", this.layout.r_n, 2.9], ["a", this.layout.r_a, 4.2]]) {
      const px = x + Math.cos(way) * r * this.scale, py = y + Math.sin(way) * r * this.scale;
      const text = `r  ${r.toFixed(2)} m`, wide = c.measureText(text).width + 20;
      c.fillStyle = color("--surface"); c.strokeStyle = color("--kept"); c.lineWidth = 1;
      c.beginPath(); c.roundRect(px - wide / 2, py - 11, wide, 22, 11); c.fill(); c.stroke();
      c.fillStyle = color("--ink"); c.fillText(text, px, py + 0.5);
      c.font = "500 11px Inter"; c.fillText(name, px - wide / 2 + 18, py + 4); c.font = "500 15px Inter";
    }
  }

  drawDoubt(robot) {
    if (robot.x === undefined) return;
    const lost = this.unconfirmed(robot), calm = this.stopped && robot.run === "stopped";
    const bad = robot.trouble?.level === "fault" && !calm;
    if (!bad && !lost) return;
    const c = this.c, [x, y] = this.toScreen(robot.x, robot.y), r = this.radius * (lost ? 4.2 : 3.1);
    c.save(); c.beginPath(); c.arc(x, y, r, 0, 7); c.globalAlpha = 0.75; c.fillStyle = color("--red-soft"); c.fill(); c.globalAlpha = 1;
    c.strokeStyle = color("--red-text"); c.lineWidth = lost ? 3 : 2.4;
    if (!lost) c.setLineDash([3, 6]);
    c.stroke(); c.setLineDash([]);
    if (lost) {
      c.clip(); c.lineWidth = 1.6; c.globalAlpha = 0.6; c.beginPath();
      for (let k = -2 * r; k < 2 * r; k += 13) { c.moveTo(x + k, y + r); c.lineTo(x + k + 1.4 * r, y - r); }
      c.stroke();
    }
    c.restore();
  }

  unconfirmed(robot) { return Boolean(this.view.stop?.known && this.view.stop.silent.includes(robot.id)); }

  /** One path a kind: kept thin, critical double rails, removed dotted with a cross, unverified dashed. */
  drawLinks(robots, links, seeding) {
    const c = this.c, lines = [KEPT, CRITICAL, REMOVED, UNVERIFIED].map(() => new Path2D()), crosses = new Path2D(), map = this.many;
    for (const [i, j, kind] of links) {
      const a = robots[i], b = robots[j];
      if (a.x === undefined || b.x === undefined) continue;
      const [ax, ay] = this.toScreen(a.x, a.y), [bx, by] = this.toScreen(b.x, b.y);
      lines[kind].moveTo(ax, ay); lines[kind].lineTo(bx, by);
      if (kind !== REMOVED || map) continue;
      const mx = (ax + bx) / 2, my = (ay + by) / 2;
      crosses.moveTo(mx - 6, my - 6); crosses.lineTo(mx + 6, my + 6); crosses.moveTo(mx + 6, my - 6); crosses.lineTo(mx - 6, my + 6);
    }
    const stroke = (path, shade, width, dash = []) => { c.strokeStyle = color(shade); c.lineWidth = width; c.setLineDash(dash); c.stroke(path); };
    if (!seeding) { stroke(lines[REMOVED], "--removed", 2, [2.5, 7]); stroke(crosses, "--removed", 2.8); }
    stroke(lines[KEPT], this.stopped ? "--removed" : "--kept", map ? 1.8 : 3.4);
    stroke(lines[CRITICAL], this.stopped ? "--removed" : "--critical", map ? 4.5 : 9);
    stroke(lines[CRITICAL], "--map", map ? 1.8 : 3.4);
    stroke(lines[UNVERIFIED], "--red-text", 3, [9, 6]);
    c.setLineDash([]);
  }

  /** Where each misplaced robot belongs. */
  drawStarts(robots) {
    const c = this.c;
    c.strokeStyle = color("--ink3"); c.fillStyle = color("--ink3"); c.lineWidth = 1.8; c.font = "600 15px Inter"; c.textAlign = "center"; c.textBaseline = "middle";
    robots.forEach((r, k) => {
      if (r.away_m === undefined) return;
      const [x, y] = this.toScreen(...this.layout.starts[k]);
      c.setLineDash([5, 4]); c.beginPath(); c.arc(x, y, this.radius, 0, 7); c.stroke();
      c.setLineDash([2, 6]); c.beginPath(); c.moveTo(x, y); c.lineTo(...this.toScreen(r.x, r.y)); c.stroke(); c.setLineDash([]);
      if (!this.many) c.fillText(this.layout.labels[k], x, y);
    });
  }

  /** Which target is reached from which: the shortest ways that join them all. */
  drawReach(seed) {
    const c = this.c;
    c.strokeStyle = color("--line"); c.lineWidth = 2; c.beginPath();
    for (const [a, b] of seed.ways) { c.moveTo(...this.toScreen(...seed.points[a])); c.lineTo(...this.toScreen(...seed.points[b])); }
    c.stroke();
  }

  drawClaims(robots, view, points) {
    const c = this.c;
    c.strokeStyle = color("--ink"); c.lineWidth = 1.8; c.setLineDash([2, 4]);
    robots.forEach((r) => {
      const target = points[r.claim];
      if (r.x === undefined || !target || view.targets[r.claim] !== "t") return;
      c.beginPath(); c.moveTo(...this.toScreen(r.x, r.y)); c.lineTo(...this.toScreen(...target)); c.stroke();
    });
    c.setLineDash([]);
  }

  drawTargets(states, seed) {
    const c = this.c, small = seed.points.length > 80, r = small ? 4.5 : 9;
    const strays = new Set(seed.strays.map((s) => s.index));
    if (small && !seed.open) { this.drawCrowd(states, seed.points, r); return; }
    seed.points.forEach((point, k) => {
      const [x, y] = this.toScreen(...point), state = seed.open ? "s" : states[k] || "o";
      if (strays.has(k) && seed.open) {
        c.fillStyle = color("--amber"); c.beginPath(); c.moveTo(x, y - 18); c.lineTo(x + 18, y); c.lineTo(x, y + 18); c.lineTo(x - 18, y); c.fill();
        c.strokeStyle = color("--on-amber"); c.lineWidth = 2.4; c.beginPath(); c.arc(x, y, 7, 0, 7); c.stroke();
      } else if (state === "d" || state === "h") {
        c.strokeStyle = color("--done"); c.lineWidth = small ? 1.2 : 1.8; c.beginPath(); c.arc(x, y, small ? 4 : 10, 0, 7); c.stroke();
        if (!small) { c.lineWidth = 2; c.beginPath(); c.moveTo(x - 4.5, y); c.lineTo(x - 1, y + 4); c.lineTo(x + 5, y - 4); c.stroke(); }
      } else {
        c.fillStyle = color("--surface"); c.strokeStyle = color("--ink"); c.lineWidth = small ? 1.6 : 2.8;
        c.beginPath(); c.arc(x, y, r, 0, 7); c.fill(); c.stroke();
        if (state !== "o") { c.fillStyle = color("--ink"); c.beginPath(); c.arc(x, y, small ? 1.6 : 3.2, 0, 7); c.fill(); }
        if (state === "t") { c.beginPath(); for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) { c.moveTo(x + dx * (r - 3), y + dy * (r - 3)); c.lineTo(x + dx * (r + 7), y + dy * (r + 7)); } c.stroke(); }
      }
      if (seed.chosen === k && seed.open) { c.strokeStyle = color("--blue"); c.lineWidth = 2.5; c.beginPath(); c.arc(x, y, r + 7, 0, 7); c.stroke(); }
      if (!small) this.boxes.push([x - 12, y - 12, 24, 24]);
    });
  }

  /** Very many targets: one path a look. */
  drawCrowd(states, points, r) {
    const c = this.c, rings = new Path2D(), dots = new Path2D(), done = new Path2D(), ticks = new Path2D();
    points.forEach((point, k) => {
      const [x, y] = this.toScreen(...point), state = states[k] || "o";
      if (state === "d" || state === "h") { done.moveTo(x + 4, y); done.arc(x, y, 4, 0, TAU); return; }
      rings.moveTo(x + r, y); rings.arc(x, y, r, 0, TAU);
      if (state !== "o") { dots.moveTo(x + 1.6, y); dots.arc(x, y, 1.6, 0, TAU); }
      if (state === "t") for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) { ticks.moveTo(x + dx * (r - 3), y + dy * (r - 3)); ticks.lineTo(x + dx * (r + 7), y + dy * (r + 7)); }
    });
    c.strokeStyle = color("--done"); c.lineWidth = 1.2; c.stroke(done);
    c.fillStyle = color("--surface"); c.fill(rings); c.strokeStyle = color("--ink"); c.lineWidth = 1.6; c.stroke(rings); c.stroke(ticks);
    c.fillStyle = color("--ink"); c.fill(dots);
  }

  drawRobot(robot, label, stopped) {
    if (robot.x === undefined) return;
    const c = this.c, [x, y] = this.toScreen(robot.x, robot.y), way = this.angle(robot.h), r = this.radius;
    const bad = robot.trouble?.level === "fault", lost = this.unconfirmed(robot), hollow = robot.run === "disarmed" || robot.run === undefined;
    this.boxes.push([x - r - 8, y - r - 8, 2 * r + 16, 2 * r + 16]);
    if (robot.hold !== undefined && !stopped) {
      c.lineWidth = 6; c.strokeStyle = color("--line"); c.beginPath(); c.arc(x, y, r + 8, 0, 7); c.stroke();
      c.strokeStyle = color("--ink"); c.beginPath(); c.arc(x, y, r + 8, -Math.PI / 2, -Math.PI / 2 + robot.hold * 2 * Math.PI); c.stroke();
    }
    const drop = () => {
      c.beginPath(); c.arc(x, y, r, way + 0.88, way - 0.88 + 2 * Math.PI); c.lineTo(x + Math.cos(way) * r * 1.58, y + Math.sin(way) * r * 1.58); c.closePath();
    };
    let ink = color("--on-blue");
    if (robot.run === "stopped" && !lost && stopped) {
      c.fillStyle = color("--stopped"); c.beginPath();
      for (let k = 0; k < 8; k += 1) c.lineTo(x + Math.cos(Math.PI / 8 + k * Math.PI / 4) * r * 1.05, y + Math.sin(Math.PI / 8 + k * Math.PI / 4) * r * 1.05);
      c.closePath(); c.fill(); ink = color("--on-stopped");
    } else if (lost) {
      c.fillStyle = color("--red"); c.strokeStyle = color("--surface"); c.lineWidth = 3; drop(); c.stroke(); c.fill(); ink = "#fff";
    } else if (bad) {
      c.fillStyle = color("--surface"); c.strokeStyle = color("--red-text"); c.lineWidth = 3; drop(); c.fill(); c.setLineDash([5, 4]); c.stroke(); c.setLineDash([]); ink = color("--red-text");
    } else if (robot.out) {
      c.strokeStyle = color("--surface"); c.lineWidth = 3; drop(); c.stroke(); c.fillStyle = color("--stopped"); c.fill(); ink = color("--on-stopped");
    } else if (hollow) {
      c.fillStyle = color("--surface"); c.strokeStyle = color("--blue"); c.lineWidth = this.many ? 2 : 3.5; drop(); c.fill(); c.stroke(); ink = color("--blue");
    } else {
      c.strokeStyle = color("--surface"); c.lineWidth = 3; drop(); c.stroke(); c.fillStyle = color("--blue"); c.fill();
    }
    if (this.many && !bad && !lost && robot.id !== this.selected) return;
    const size = Math.round(r * (label.length > 2 ? 0.75 : 1.04));
    c.fillStyle = ink; c.font = `750 ${size}px Inter`; c.textAlign = "center"; c.textBaseline = "middle"; c.fillText(label, x, y + 1);
  }

  drawSeed(seed) {
    const c = this.c;
    if (!seed.open) return;
    if (seed.cross) {
      const [x, y] = this.toScreen(...seed.cross); c.strokeStyle = color("--blue"); c.lineWidth = 1.5; c.beginPath();
      c.moveTo(x - 22, y); c.lineTo(x + 22, y); c.moveTo(x, y - 22); c.lineTo(x, y + 22); c.stroke();
    }
    const ghost = seed.ghost;
    if (!ghost) return;
    const [x, y] = this.toScreen(...ghost.center), r = ghost.radius * this.scale;
    c.fillStyle = color("--wash"); c.strokeStyle = color("--blue"); c.lineWidth = 2.2; c.beginPath(); c.arc(x, y, r, 0, 7); c.fill();
    c.setLineDash([9, 6]); c.stroke(); c.setLineDash([2, 5]); c.strokeStyle = color("--kept"); c.lineWidth = 1.5; c.beginPath();
    const all = [...seed.points, ...ghost.points];
    ghost.points.forEach((p, k) => all.forEach((q, m) => {
      if (m < seed.points.length + k && Math.hypot(p[0] - q[0], p[1] - q[1]) <= this.layout.r_c) { c.moveTo(...this.toScreen(...p)); c.lineTo(...this.toScreen(...q)); }
    }));
    c.stroke(); c.setLineDash([]); c.beginPath(); c.moveTo(x, y); c.lineTo(...this.toScreen(...ghost.to)); c.strokeStyle = color("--blue"); c.stroke();
    c.setLineDash([4, 3]); c.lineWidth = 2.4;
    ghost.points.forEach((p) => { c.beginPath(); c.arc(...this.toScreen(...p), 9, 0, 7); c.fillStyle = color("--surface"); c.fill(); c.stroke(); });
    c.setLineDash([]);
    this.say(x, y + r + 26, `+${ghost.points.length}, radius ${ghost.radius.toFixed(2)} m`, "", "--blue", true);
  }

  drawCallouts(robots, view, seed, stopped) {
    if (seed.open && seed.refused) { const [x, y] = this.toScreen(...seed.refused.at); this.place(x, y, "Beyond the fence", seed.refused.text, "--critical", false); }
    if (seed.open) {
      seed.strays.slice(0, 2).forEach((s) => {
        const [x, y] = this.toScreen(...seed.points[s.index]), [qx, qy] = this.toScreen(...s.nearest), c = this.c;
        c.strokeStyle = color("--critical"); c.lineWidth = 2.4; c.setLineDash([3, 5]); c.beginPath(); c.moveTo(x, y); c.lineTo(qx, qy); c.stroke(); c.setLineDash([]);
        this.place(x, y, `T${String(s.index + 1).padStart(2, "0")} out of reach: ${s.gap.toFixed(2)} m`, `nearest target must be within ${this.layout.r_c.toFixed(2)} m`, "--critical", false);
      });
      return;
    }
    let left = 2;
    const told = new Set(); // one callout for what many have in common
    robots.forEach((r, k) => {
      if (r.x === undefined || left === 0) return;
      const [x, y] = this.toScreen(r.x, r.y), name = this.layout.labels[k];
      if (this.unconfirmed(r)) {
        left -= 1;
        const fast = (r.mps || 0) > 0.03;
        this.place(x, y, fast ? `${name} still moving` : `${name} no answer`, `${fast ? `${r.mps.toFixed(2)} m/s, no` : "No"} answer to STOP. Keep out.`, "--red", true);
      } else if (r.trouble?.level === "fault" && !(stopped && r.run === "stopped") && !told.has(r.trouble.title)) {
        left -= 1;
        told.add(r.trouble.title);
        this.place(x, y, `${name} ${r.trouble.title} ${r.trouble.value}`.trim(), r.valid === false ? "Last seen here. Keep clear." : r.trouble.now, "--red", true);
      }
    });
  }

  /** A callout beside (x, y), where it covers least. */
  place(x, y, title, text, tone, filled) {
    const c = this.c;
    c.font = "700 21px Inter"; const a = c.measureText(title).width; c.font = "500 16px Inter"; const wide = Math.max(a, c.measureText(text).width) + 30, high = 62;
    let best = null;
    for (let k = 0; k < 16; k += 1) {
      for (const far of [70, 110, 150]) {
        const cx = x + Math.cos(k * Math.PI / 8) * (far + wide / 2 * Math.abs(Math.cos(k * Math.PI / 8))), cy = y + Math.sin(k * Math.PI / 8) * (far - 10);
        const box = [cx - wide / 2, cy - high / 2, wide, high];
        if (box[0] < 4 || box[1] < 4 || box[0] + wide > this.width - 4 || box[1] + high > this.height - 4) continue;
        const over = this.boxes.filter((b) => b[0] < box[0] + box[2] && b[0] + b[2] > box[0] && b[1] < box[1] + box[3] && b[1] + b[3] > box[1]).length;
        const cost = over * 100 + far / 10;
        if (!best || cost < best.cost) best = { cost, cx, cy, box };
      }
    }
    const at = best || { cx: Math.min(Math.max(x, wide / 2 + 4), this.width - wide / 2 - 4), cy: Math.max(40, y - 80), box: [0, 0, 0, 0] };
    this.boxes.push(at.box);
    this.say(at.cx, at.cy, title, text, tone, filled);
  }

  say(x, y, title, text, tone, filled) {
    const c = this.c, shade = filled && tone === "--blue" ? color("--on-blue") : "#fff";
    c.font = "700 21px Inter"; const a = c.measureText(title).width; c.font = "500 16px Inter"; const b = text ? c.measureText(text).width : 0;
    const wide = Math.max(a, b) + 30, high = text ? 62 : 36, left = x - wide / 2, top = y - high / 2;
    c.beginPath(); c.roundRect(left, top, wide, high, 7); c.fillStyle = filled ? color(tone) : color("--surface"); c.fill();
    c.strokeStyle = filled ? color("--surface") : color(tone); c.lineWidth = 2; c.stroke();
    c.textAlign = "left"; c.textBaseline = "middle"; c.fillStyle = filled ? shade : color("--ink");
    c.font = text ? "700 21px Inter" : "650 18px Inter"; c.fillText(title, left + (text ? 15 : (wide - c.measureText(title).width) / 2), top + (text ? 21 : 19));
    c.font = "500 16px Inter"; c.fillText(text, left + 15, top + 45);
  }

  drawNoData(text) {
    const c = this.c, { x, y, w, h } = this.box;
    c.save(); c.beginPath(); c.rect(x, y, w, h); c.clip(); c.globalAlpha = 0.55; c.fillStyle = color("--map"); c.fillRect(x, y, w, h); c.globalAlpha = 0.5;
    c.strokeStyle = color("--removed"); c.lineWidth = 2; c.beginPath();
    for (let k = -h; k < w; k += 22) { c.moveTo(x + k, y + h); c.lineTo(x + k + h, y); }
    c.stroke(); c.restore();
    this.say(x + w / 2, y + h / 2, text.title, text.text, "--red", true);
  }
}
