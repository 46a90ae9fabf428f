/** Seeding targets: click places, drag makes a cloud, drag moves; undo, keys, load and save. The server has the last word. */
const GRAB_PX = 20, DRAG_PX = 8, STEP_M = 0.05, MOST_HISTORY = 200;

/** Numbers that repeat for a seed. */
function random(seed) {
  let a = seed >>> 0;
  return () => { a = (a + 0x6d2b79f5) >>> 0; let t = Math.imul(a ^ (a >>> 15), 1 | a); t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t; return ((t ^ (t >>> 14)) >>> 0) / 4294967296; };
}

/** Targets of the smaller pieces, each with its distance to the nearest target of another piece. */
export function straysOf(points, reach) {
  const left = new Set(points.keys()), pieces = [];
  while (left.size) {
    const todo = [left.values().next().value], piece = []; left.delete(todo[0]);
    while (todo.length) {
      const k = todo.pop(); piece.push(k);
      for (const m of left) if ((points[k][0] - points[m][0]) ** 2 + (points[k][1] - points[m][1]) ** 2 <= reach * reach + 1e-9) { left.delete(m); todo.push(m); }
    }
    pieces.push(piece);
  }
  if (pieces.length < 2) return [];
  const largest = pieces.reduce((a, b) => (b.length > a.length ? b : a));
  return pieces.filter((p) => p !== largest).flatMap((piece) => { const own = new Set(piece); return piece.map((index) => {
    let gap = Infinity, nearest = null;
    points.forEach((q, k) => { const d = Math.hypot(points[index][0] - q[0], points[index][1] - q[1]); if (d < gap && !own.has(k)) { gap = d; nearest = q; } });
    return { index, gap, nearest };
  }); }).sort((a, b) => a.index - b.index);
}

/** Edges [i, j] of the shortest tree over the targets, without those longer than reach. */
export function waysOf(points, reach) {
  if (points.length < 2 || points.length > 200) return [];
  const near = points.map((p) => [Math.hypot(p[0] - points[0][0], p[1] - points[0][1]), 0]), left = new Set(points.keys()), ways = [];
  left.delete(0);
  while (left.size) {
    let next = -1;
    for (const k of left) if (next < 0 || near[k][0] < near[next][0]) next = k;
    left.delete(next);
    if (near[next][0] <= reach) ways.push([near[next][1], next]);
    for (const k of left) { const d = Math.hypot(points[k][0] - points[next][0], points[k][1] - points[next][1]); if (d < near[k][0]) near[k] = [d, next]; }
  }
  return ways;
}

export class Seed {
  constructor(map, canvas, ask, changed) {
    Object.assign(this, { map, canvas, ask, changed });
    this.points = []; this.server = []; this.past = []; this.future = [];
    this.mode = "point"; this.count = 5; this.draw = 1; this.open = false; this.pending = false;
    this.chosen = null; this.ghost = null; this.cross = null; this.anchor = null; this.refused = null; this.strays = []; this.ways = []; this.message = "";
    canvas.addEventListener("pointerdown", (e) => this.down(e));
    canvas.addEventListener("pointermove", (e) => this.move(e));
    canvas.addEventListener("pointerup", (e) => this.up(e));
    canvas.addEventListener("pointercancel", () => this.drop());
  }

  setLayout(layout) { this.layout = layout; }

  /** The station's targets. */
  setServer(points) { this.server = points; this.pending = false; this.set(points); }

  set(points) { this.points = points; this.strays = straysOf(points, this.layout.r_c); this.ways = waysOf(points, this.layout.r_c); if (this.chosen >= points.length) this.chosen = null; this.changed(); }

  async commit(points) {
    if (!this.open) return;
    this.past.push(this.points); if (this.past.length > MOST_HISTORY) this.past.shift();
    this.future = [];
    await this.apply(points);
  }

  async apply(points) {
    this.set(points);
    if (!points.length) { this.message = "At least one target is needed: the station keeps the last ones"; this.changed(); return; }
    const before = this.server, text = await this.ask({ do: "seed", points });
    this.message = text; if (text) this.set(before);
    this.changed();
  }

  undo() { if (this.open && this.past.length) { this.future.push(this.points); this.apply(this.past.pop()); } }
  redo() { if (this.open && this.future.length) { this.past.push(this.points); this.apply(this.future.pop()); } }

  inside([x, y]) { const { size, fence } = this.layout; return x >= fence && y >= fence && x <= size[0] - fence && y <= size[1] - fence; }

  fenceText() { const { size, fence } = this.layout; return `x ${fence} to ${(size[0] - fence).toFixed(2)}, y ${fence} to ${(size[1] - fence).toFixed(2)} m`; }

  at(event) { const box = this.canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; }

  down(event) {
    const px = this.at(event), robot = this.map.robotAt(px);
    if (robot) { this.map.selected = this.map.selected === robot.id ? null : robot.id; this.changed(); return; }
    if (!this.open || event.button !== 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.chosen = this.near(px);
    this.grip = { px, target: this.chosen, moved: false };
    this.refused = null;
  }

  /** The target at a place on the screen, or null. */
  near(px) {
    const found = this.points.map((p, k) => [Math.hypot(...this.map.toScreen(...p).map((v, i) => v - px[i])), k]).filter((e) => e[0] < GRAB_PX).sort((a, b) => a[0] - b[0])[0];
    return found ? found[1] : null;
  }

  move(event) {
    if (!this.grip) return;
    const px = this.at(event), grip = this.grip;
    if (!grip.moved && Math.hypot(px[0] - grip.px[0], px[1] - grip.px[1]) < DRAG_PX) return;
    grip.moved = true;
    const here = this.map.toArena(...px);
    if (grip.target !== null) {
      grip.points ??= this.points;
      this.refused = this.inside(here) ? null : { at: here, text: this.fenceText() };
      if (!this.refused) this.set(grip.points.map((p, k) => (k === grip.target ? round(here) : p)));
      return;
    }
    this.spread(this.map.toArena(...grip.px), here);
  }

  /** A cloud as it would be, from its middle to its rim. */
  spread(center, to) {
    this.ghost = { center, to, radius: Math.hypot(to[0] - center[0], to[1] - center[1]) };
    this.ghost.points = this.cloud(this.ghost);
  }

  /** The cloud that is shown becomes targets. */
  settle() {
    const points = this.ghost.points; this.drop(); this.draw += 1;
    if (points.length) this.commit([...this.points, ...points]);
  }

  up(event) {
    const grip = this.grip; this.grip = null;
    if (!grip) return;
    if (grip.moved && grip.target !== null) {
      const points = this.points;
      if (grip.points) { this.points = grip.points; this.refused = null; this.commit(points); }
    } else if (this.ghost) this.settle();
    else if (grip.target === null && this.mode === "point") this.add(this.map.toArena(...this.at(event)));
    this.changed();
  }

  drop() { this.grip = null; this.ghost = null; this.refused = null; this.anchor = null; }

  add(point) {
    if (!this.inside(point)) { this.refused = { at: point, text: this.fenceText() }; return; }
    this.refused = null;
    this.commit([...this.points, round(point)]);
  }

  /** Points within the circle, apart from each other, inside the fence; the same for the same draw. */
  cloud({ center, radius }) {
    const next = random(this.draw), points = [];
    for (let tries = 0; tries < 400 && points.length < this.count; tries += 1) {
      const r = radius * Math.sqrt(next()), way = next() * 2 * Math.PI, p = [center[0] + r * Math.cos(way), center[1] + r * Math.sin(way)];
      if (this.inside(p) && points.every((q) => Math.hypot(p[0] - q[0], p[1] - q[1]) > Math.min(0.15, radius / this.count))) points.push(round(p));
    }
    return points;
  }

  /** The chosen target, else the one under the crosshair. */
  remove() {
    const gone = this.chosen ?? (this.cross ? this.near(this.map.toScreen(...this.cross)) : null);
    this.chosen = null;
    if (this.open && gone !== null) this.commit(this.points.filter((_, k) => k !== gone));
  }

  /** T at the crosshair: a target; in cloud mode first its middle, then its rim. */
  put() {
    if (!this.cross) return;
    if (this.mode === "point") this.add(this.cross);
    else if (this.anchor) { if (this.ghost) this.settle(); }
    else if (this.inside(this.cross)) this.anchor = this.cross;
    else this.refused = { at: this.cross, text: this.fenceText() };
  }

  /** True where the key was used. */
  key(event, focused) {
    if (!this.open) return false;
    const key = event.key, ways = { ArrowUp: [0, -1], ArrowDown: [0, 1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };
    if (key in ways && focused) {
      const { size } = this.layout, here = this.cross || [size[0] / 2, size[1] / 2], [x, y] = this.map.toScreen(...here), way = ways[key];
      const moved = this.map.toArena(x + way[0] * STEP_M * this.map.scale, y + way[1] * STEP_M * this.map.scale);
      this.cross = moved.map((v, k) => Math.min(size[k], Math.max(0, Math.round(v / STEP_M) * STEP_M)));
      if (this.anchor) this.spread(this.anchor, this.cross);
    } else if (key === "t" || key === "T") this.put();
    else if (key === "Escape" && this.anchor) this.drop();
    else if (key === "Delete" || key === "Backspace") this.remove();
    else if (key === "z") this.undo();
    else if (key === "Z") this.redo();
    else if (key === "+" || key === "-") this.count = Math.min(50, Math.max(1, this.count + (key === "+" ? 1 : -1)));
    else return false;
    return true;
  }

  save() {
    const blob = new Blob([JSON.stringify({ points: this.points }) + "\n"], { type: "application/json" });
    download(URL.createObjectURL(blob), `${this.layout.name}-targets.json`);
  }

  async load(file) {
    try {
      const value = JSON.parse(await file.text());
      await this.commit(Array.isArray(value) ? value : value.points);
    } catch { this.message = `${file.name}: a list of [x, y] in metres is needed`; this.changed(); }
  }
}

const round = (p) => p.map((v) => Math.round(v * 1000) / 1000);

export function download(url, name) {
  const link = document.createElement("a"); link.href = url; link.download = name; link.click();
}
