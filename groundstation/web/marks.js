/** Targets on the map, by state; and what is being seeded. */
import { color, Layer, Sprites } from "./canvas.js";

const CROWD = 80, EVERY_MS = 150, TAU = 2 * Math.PI;
const PLUS = [[1, 0], [-1, 0], [0, 1], [0, -1]];

export class Marks {
  constructor() { this.layer = new Layer(false); this.sprites = new Sprites(); this.points = null; this.version = 0; }

  /** All targets: on a layer of their own, but while they are being placed. */
  draw(map, states, seed, now) {
    if (seed.points !== this.points) { this.points = seed.points; this.version += 1; }
    if (!seed.points.length) return;
    if (seed.open) { drawTargets(map.c, map, states, seed); return; }
    const c = this.layer.begin(map.width, map.height, map.ratio, `${map.place}|${this.version}`, states, now, EVERY_MS);
    if (c && seed.points.length > CROWD) this.crowd(c, map, states, seed.points);
    else if (c) drawTargets(c, map, states, seed);
    map.c.drawImage(this.layer.image, 0, 0, map.width, map.height);
  }

  /** Very many: a small picture each. */
  crowd(c, map, states, points) {
    this.sprites.keep(String(map.ratio));
    c.setTransform(1, 0, 0, 1, 0, 0);
    points.forEach(([x, y], k) => {
      const state = states[k] || "o";
      this.sprites.put(c, map.ratio, state, map.px(x, y), map.py(x, y), 14, (s) => drawTarget(s, 0, 0, state, true));
    });
  }
}

function drawTarget(c, x, y, state, small) {
  const r = small ? 4.5 : 9;
  c.beginPath();
  if (state === "d" || state === "h") {
    c.strokeStyle = color("--done"); c.lineWidth = small ? 1.2 : 1.8; c.arc(x, y, small ? 4 : 10, 0, TAU); c.stroke();
    if (small) return;
    c.lineWidth = 2; c.beginPath(); c.moveTo(x - 4.5, y); c.lineTo(x - 1, y + 4); c.lineTo(x + 5, y - 4); c.stroke();
    return;
  }
  c.fillStyle = color("--surface"); c.strokeStyle = color("--ink"); c.lineWidth = small ? 1.6 : 2.8;
  c.arc(x, y, r, 0, TAU); c.fill(); c.stroke();
  if (state !== "o") { c.fillStyle = color("--ink"); c.beginPath(); c.arc(x, y, small ? 1.6 : 3.2, 0, TAU); c.fill(); }
  if (state !== "t") return;
  c.beginPath();
  for (const [dx, dy] of PLUS) { c.moveTo(x + dx * (r - 3), y + dy * (r - 3)); c.lineTo(x + dx * (r + 7), y + dy * (r + 7)); }
  c.stroke();
}

function drawTargets(c, map, states, seed) {
  const small = seed.points.length > CROWD, strays = new Set(seed.open ? seed.strays.map((s) => s.index) : []);
  seed.points.forEach((point, k) => {
    const x = map.px(...point), y = map.py(...point);
    if (strays.has(k)) {
      c.fillStyle = color("--amber"); c.beginPath(); c.moveTo(x, y - 18); c.lineTo(x + 18, y); c.lineTo(x, y + 18); c.lineTo(x - 18, y); c.fill();
      c.strokeStyle = color("--on-amber"); c.lineWidth = 2.4; c.beginPath(); c.arc(x, y, 7, 0, 7); c.stroke();
    } else drawTarget(c, x, y, seed.open ? "s" : states[k] || "o", small);
    if (seed.chosen === k && seed.open) { c.strokeStyle = color("--blue"); c.lineWidth = 2.5; c.beginPath(); c.arc(x, y, (small ? 4.5 : 9) + 7, 0, 7); c.stroke(); }
  });
}

/** Which target is reached from which: the shortest ways that join them all. */
export function drawReach(map, seed) {
  const c = map.c;
  c.strokeStyle = color("--line"); c.lineWidth = 2; c.beginPath();
  for (const [a, b] of seed.ways) { c.moveTo(...map.toScreen(...seed.points[a])); c.lineTo(...map.toScreen(...seed.points[b])); }
  c.stroke();
}

/** The crosshair, and the ghosts of a cloud that is being dragged with their links. */
export function drawSeed(map, seed, say) {
  const c = map.c, ghost = seed.ghost;
  if (seed.cross) {
    const [x, y] = map.toScreen(...seed.cross); c.strokeStyle = color("--blue"); c.lineWidth = 1.5; c.beginPath();
    c.moveTo(x - 22, y); c.lineTo(x + 22, y); c.moveTo(x, y - 22); c.lineTo(x, y + 22); c.stroke();
  }
  if (!ghost) return;
  const [x, y] = map.toScreen(...ghost.center), r = ghost.radius * map.scale;
  c.fillStyle = color("--wash"); c.strokeStyle = color("--blue"); c.lineWidth = 2.2; c.beginPath(); c.arc(x, y, r, 0, 7); c.fill();
  c.setLineDash([9, 6]); c.stroke(); c.setLineDash([2, 5]); c.strokeStyle = color("--kept"); c.lineWidth = 1.5; c.beginPath();
  const all = [...seed.points, ...ghost.points];
  ghost.points.forEach((p, k) => all.forEach((q, m) => {
    if (m < seed.points.length + k && Math.hypot(p[0] - q[0], p[1] - q[1]) <= map.layout.r_c) { c.moveTo(...map.toScreen(...p)); c.lineTo(...map.toScreen(...q)); }
  }));
  c.stroke(); c.setLineDash([]); c.beginPath(); c.moveTo(x, y); c.lineTo(...map.toScreen(...ghost.to)); c.strokeStyle = color("--blue"); c.stroke();
  c.setLineDash([4, 3]); c.lineWidth = 2.4;
  ghost.points.forEach((p) => { c.beginPath(); c.arc(...map.toScreen(...p), 9, 0, 7); c.fillStyle = color("--surface"); c.fill(); c.stroke(); });
  c.setLineDash([]);
  say(map, x, y + r + 26, `+${ghost.points.length}, radius ${ghost.radius.toFixed(2)} m`, "", "--blue", true);
}
