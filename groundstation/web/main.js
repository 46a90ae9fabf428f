/** The arena page: socket in, panels out, keys and buttons back. */
import { repaint } from "./canvas.js";
import { drawChart } from "./chart.js";
import { ArenaMap } from "./map.js";
import { drawBar, drawChecks, drawLegend, drawLog, drawParts, drawRelease, drawRows, html, text } from "./panels.js";
import { download, Seed } from "./seed.js";
import { Replay } from "./replay.js";
import { Stop } from "./stop.js";

const $ = (id) => document.getElementById(id);
const HELD = ["Enter", "B"]; // what moves robots takes a long press
const AGED_MS = 300, NO_DATA_MS = 1000, HOLD_MS = 600, ANSWER_MS = 2000;
const CALM_MS = 200; // words and tables follow so often; what is grave follows at once
const token = new URLSearchParams(location.hash.slice(1)).get("token") || undefined;

let socket = null, layout = null, view = null, viewAt = 0, asked = 0, holdFrom = 0, held = "", releaseNote = "", note = "";
let history = [], marks = [], drawnAt = -Infinity, drawnAlarm = "", grave = "", fresh = false;
const waiting = new Map();

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
  socket.onmessage = (event) => receive(JSON.parse(event.data));
  socket.onclose = () => setTimeout(connect, 300);
}

function send(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ token, ...message }));
}

/** Ask for something; resolves to "" or the reason why not. */
function ask(message) {
  asked += 1;
  const number = asked;
  return new Promise((resolve) => {
    waiting.set(number, resolve);
    setTimeout(() => { if (waiting.delete(number)) resolve("the page's server does not answer"); }, ANSWER_MS);
    send({ to: number, ...message });
  });
}

async function order(name, robots) { note = await ask({ do: "order", order: name, robots }); drawAll(); }

const map = new ArenaMap($("map"));
const seed = new Seed(map, $("map"), ask, () => drawAll());
const replay = new Replay(ask);
const stop = new Stop($("stop"), send, () => drawAll());

function receive(message) {
  if (message.kind === "layout") {
    layout = message; history = message.history; marks = message.marks;
    map.setLayout(layout); seed.setLayout(layout); replay.setLayout(layout); document.title = `${layout.name}, arena`;
    if (view?.robots.length !== layout.robots.length) view = null; // of another arena
  } else if (message.kind === "targets") seed.setServer(message.points);
  else if (message.kind === "answer") { waiting.get(message.to)?.(message.text); waiting.delete(message.to); }
  else if (message.kind === "view" && message.robots.length === layout?.robots.length) receiveView(message);
  else if (message.kind === "poses" && message.poses.length === view?.robots.length) {
    viewAt = performance.now(); view.age_s = message.age_s; window.arena.views += 1;
    map.setPoses(message.poses, viewAt);
    for (const k in message.hold) view.robots[k].hold = message.hold[k];
  }
}

function receiveView(message) {
  view = message; viewAt = performance.now(); window.arena.views += 1;
  if (!view.elapsed || (view.replay && history.length && view.elapsed < history[history.length - 1][0])) { history = []; marks = []; }
  for (const point of view.history) if (!history.length || point[0] > history[history.length - 1][0]) history.push(point);
  if (view.marked !== marks.length) marks = view.marked > 40 && marks.length ? marks.slice(0, view.marked - view.marks.length).concat(view.marks) : view.marks;
  map.setView(view, viewAt); stop.update(view.stop);
  if (view.replay) replay.draw(view.replay);
  grave = gravity(view); fresh = true;
}

/** What of a view is shown at once where it changes: run state, STOP and its answers, what may be pressed, what is missing, robots in trouble. */
function gravity({ scene, run, net, stop, can, missing, robots }) {
  const troubled = robots.map((r) => (r.trouble ? `${r.id}${r.trouble.level}${r.trouble.title}` : "")).join("");
  return [scene, run.state, net.word, stop?.answered, stop?.silent.length, stop?.releasing, Object.values(can), missing?.map((part) => part.title), troubled].join("|");
}

// --- what to show -----------------------------------------------------------------------------------

function choose(id) { map.selected = map.selected === id ? null : id; drawAll(); }

function age() { return view ? performance.now() - viewAt + Math.max(0, view.age_s) * 1000 : Infinity; }

function noData() {
  if (!view || age() < NO_DATA_MS) return null;
  const server = performance.now() - viewAt > NO_DATA_MS - 200;
  const gone = (view.missing || []).find((part) => ["router", "mocap_bridge"].includes(part.part));
  const who = server ? "page server" : gone ? gone.title.toLowerCase() : "motion capture";
  const late = view.age_s < 0 && !server ? "yet" : `${(age() / 1000).toFixed(1)} s`;
  const stop = gone?.part === "router" ? "STOP does not reach them." : server ? "STOP goes on trying, by both paths." : "STOP is live.";
  return { title: `NO DATA ${late}, ${who}`, text: `Robots stop by themselves without poses. ${stop}` };
}

function alarm() { return `${grave}|${stop.state()?.state}|${age() > AGED_MS}`; }

/** Words and tables: with a new view, but not too often; at once where something grave has changed. */
function keepUp(now) { if (now - drawnAt >= (fresh ? CALM_MS / 2 : CALM_MS) || alarm() !== drawnAlarm) drawAll(); }

function drawAll() {
  drawnAt = performance.now(); drawnAlarm = alarm(); fresh = false;
  if (!view || !layout) { stop.draw(); return; }
  const local = stop.state(), stopped = Boolean(local);
  const body = document.body.classList;
  body.toggle("stopped", stopped); body.toggle("aged", age() > AGED_MS && !view.replay); body.toggle("replay", Boolean(view.replay));
  $("frame").hidden = !stopped && !view.replay;
  replay.draw(view.replay);
  document.body.dataset.run = stopped ? local.state : view.run.state;
  document.body.dataset.scene = view.scene ?? "";
  drawBar(view, local);
  drawParts(view.missing || []);
  drawRows(view, layout, map.selected, choose);
  seed.open = view.can.seed && !stopped;
  const placing = !stopped && (view.run.state === "DISARMED" || (view.run.state === "NO STATION" && !view.elapsed));
  body.toggle("placing", placing);
  $("seed").hidden = !placing; $("release").hidden = !view.stop;
  $("chart-panel").hidden = placing || Boolean(view.stop || view.replay); $("log").hidden = placing && view.checks.length > 4;
  if (placing) {
    drawChecks(view.checks); text($("seed-message"), seed.message || note);
    for (const mode of ["point", "cloud"]) $(`tool-${mode}`).classList.toggle("on", seed.mode === mode);
  }
  if (view.stop) drawRelease(view.stop, $("release-word").value.toUpperCase(), releaseNote);
  else { releaseNote = ""; if ($("release-word").value) $("release-word").value = ""; }
  drawLog(view, (view.stop || view.replay) && window.innerWidth > 1360 ? 4 : window.innerWidth > 1360 ? 2 : 1);
  drawActions(stopped);
  stop.draw();
  drawLegend(seed.open ? ["disarmed", "target", "attention", "kept", "fence"] : ["kept", "critical", "removed", ...(view.links.some((l) => l[2] === 3) ? ["unverified"] : []), "open", "seen", "tracked", "done", "fence"]);
  if (!$("chart-panel").hidden) {
    html($("chart-now"), `<span>now ${view.l2.toFixed(2)}</span><span>floor ${layout.floor.toFixed(layout.floor < 0.1 ? 3 : 2)}</span><span>last 60 s</span>`);
    drawChart($("chart"), { history, marks, elapsed: view.elapsed, floor: layout.floor });
  }
}

/** [key, label, enabled, primary, action] of the state. */
function actionList() {
  if (view.replay) return [["Esc", "Leave replay, live", true, true, () => ask({ do: "live" })]];
  const can = view.can, n = layout.robots.length, state = view.run.state;
  const rings = ["C", "Rings", true, false, () => { map.rings = !map.rings; }], lock = ["L", "Disarm", can.disarm, false, () => order("disarm")];
  const home = ["B", "Home", can.home, false, () => order("home")], repeat = ["N", "Repeat", can.repeat, state === "COMPLETED", () => order("repeat")];
  if (state === "HOMING") return [rings, lock];
  if (state === "COMPLETED" && (can.repeat || can.home)) return [home, repeat];
  if (state === "RUNNING") return [...dropping(can), ["H", "Hold", can.hold, false, () => order("hold")]];
  if (state === "HOLDING") return [lock, ...dropping(can), ["Enter", "Go on", can.start, true, () => order("run")]];
  if (state === "ARMED" || state === "ARMING") return [lock, ["Enter", "Start", can.start, true, () => order("run")]];
  if (state === "COMPLETED" || state === "FAILED") return [rings, ["L", "Reset", can.disarm, true, () => order("disarm")]];
  return [...(can.disarm ? [["L", "Clear", true, false, () => order("disarm")]] : can.home ? [home] : can.repeat ? [repeat] : []), ["Enter", "Start", false, false, () => {}], ["A", `Arm ${n} robot${n > 1 ? "s" : ""}`, can.arm, true, () => order("arm")]];
}

/** Drop a robot from the network, or take it back: the selected one, else the first in trouble, else the first dropped. */
function dropping(can) {
  const robots = view.robots, out = robots.filter((r) => r.out);
  const one = robots.find((r) => r.id === map.selected) || robots.find((r) => !r.out && r.trouble?.level === "fault") || out[0];
  if (!can.drop || !one) return [["C", "Rings", true, false, () => { map.rings = !map.rings; }]];
  const name = layout.labels[robots.indexOf(one)], send = (word) => () => order(word, [one.id]);
  return one.out ? [["J", `Rejoin ${name}`, true, false, send("readmit")]] : [["X", `Drop ${name}`, robots.length - out.length > 1, false, send("exclude")]];
}

let actions = [], actionWords = "";
function drawActions(stopped) {
  actions = stopped ? [] : actionList();
  const words = actions.map(([key, label, enabled, primary]) => `${key}|${label}|${enabled}|${primary}`).join(";");
  if (words === actionWords) return;
  actionWords = words;
  $("actions").replaceChildren(...actions.map(([key, label, enabled, primary], k) => {
    const button = document.createElement("button"), hint = document.createElement("kbd");
    button.type = "button"; button.disabled = !enabled; button.className = primary && enabled ? "primary" : ""; button.dataset.action = label;
    hint.textContent = key; button.append(`${label} `, hint);
    button.addEventListener("click", () => { actions[k]?.[4](); button.blur(); });
    return button;
  }));
}

window.arena = { frames: 0, views: 0 }; // how often it was drawn and told, for benches and tests
function loop(now) {
  requestAnimationFrame(loop);
  keepUp(now);
  if (layout) { map.draw(now, seed, { stopped: document.body.classList.contains("stopped"), noData: noData() }); window.arena.frames += 1; }
  if (holdFrom && now - holdFrom >= HOLD_MS) { holdFrom = 0; actions.find(([key, , enabled]) => key === held && enabled)?.[4](); }
}

// --- keys and buttons ---------------------------------------------------------------------------------

function screenshot() { drawAll(); download($("map").toDataURL("image/png"), `${layout.name}-${Math.round(view.elapsed)}s.png`); }

function theme(name) {
  document.documentElement.dataset.theme = name;
  try { localStorage.setItem("theme", name); } catch { /* private window: the choice lasts as long as the page */ }
  repaint(); drawAll();
}

function placeBy(mode) { seed.mode = mode; seed.drop(); drawAll(); }

function select(step) {
  const ids = layout.robots, at = ids.indexOf(map.selected);
  map.selected = ids[(at + step + ids.length + (at < 0 && step < 0 ? 1 : 0)) % ids.length];
  drawAll();
}

document.addEventListener("keydown", (event) => {
  if (event.target.tagName === "INPUT" || event.ctrlKey || event.metaKey || event.altKey || !view) return;
  const key = event.key.length === 1 ? event.key.toUpperCase() : event.key;
  if (view.stop && key === "R" && !$("release").hidden) { $("release-word").focus(); return; } // the word begins with it
  if (view.replay && replay.key(event)) { event.preventDefault(); return; }
  if (seed.key(event, document.activeElement === $("map"))) { event.preventDefault(); return; }
  if (HELD.includes(key)) { event.preventDefault(); if (!event.repeat) { holdFrom = performance.now(); held = key; } return; }
  const action = actions.find(([name, , enabled]) => name === key && enabled);
  if (event.repeat) return;
  if (action) action[4]();
  else if (key === "C") map.rings = !map.rings;
  else if (key === "R") map.turn = (map.turn + 1) % 4;
  else if (key === "D") theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  else if (key === "M") screenshot();
  else if (key === "P") placeBy("point");
  else if (key === "G") placeBy("cloud");
  else if (key === "O") $("file").click();
  else if (key === "S") seed.save();
  else if (key === "ArrowUp" || key === "ArrowDown") { select(key === "ArrowUp" ? -1 : 1); event.preventDefault(); }
  else if (key === "?") $("help").hidden = !$("help").hidden;
  else if (key === "Escape") { $("help").hidden = true; map.selected = null; drawAll(); }
});
document.addEventListener("keyup", () => { holdFrom = 0; });
window.addEventListener("blur", () => { holdFrom = 0; });
$("tool-point").addEventListener("click", () => placeBy("point"));
$("tool-cloud").addEventListener("click", () => placeBy("cloud"));
$("tool-undo").addEventListener("click", () => seed.undo());
$("tool-load").addEventListener("click", () => $("file").click());
$("file").addEventListener("change", () => { const [file] = $("file").files; if (file) seed.load(file); $("file").value = ""; });
$("release-word").addEventListener("input", () => drawAll());
$("release-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  releaseNote = await ask({ do: "release", typed: $("release-word").value });
  $("release-word").blur();
  drawAll();
});

let saved = null;
try { saved = localStorage.getItem("theme"); } catch { saved = null; }
document.documentElement.dataset.theme = saved || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
document.fonts.addEventListener("loadingdone", repaint); // what was drawn before has other letters
setInterval(() => keepUp(performance.now()), 100); // a page in the background gets no frames
requestAnimationFrame(loop);
connect();
stop.draw();
