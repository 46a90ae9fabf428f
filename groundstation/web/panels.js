/** The bar, the rows, the checks and the log, from the view's words; the page's text changes only where a word does. */
import { icons, legendIcons } from "./icons.js";

const $ = (id) => document.getElementById(id);

export function text(node, value) { const words = value ?? ""; if (node._text !== words) { node._text = words; node.textContent = words; } }

export function html(node, value) { if (node._html !== value) { node._html = value; node.innerHTML = value; } }

function look(node, value) { if (node._look !== value) { node._look = value; node.className = value; } }

const escape = (words) => String(words).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);
const lambda = (words) => escape(words).replace("λ2", "λ<sub>2</sub>");

export function drawBar(view, local) {
  const stop = view.stop, run = local && local.state !== "STOPPED" ? { state: local.state === "NOT CONFIRMED" ? "STOP ?" : local.state, icon: "stop", tone: "red", sub: local.sub || view.run.sub } : view.run;
  text($("run-word"), run.state); $("run").classList.toggle("long", run.state.length > 8); text($("run-sub"), run.sub);
  html($("run-icon"), `<span style="--hole:var(--red);display:contents">${icons[run.icon]}</span>`);
  look($("run-icon"), run.tone === "amber" ? "amber" : "");
  const cell = view.cell;
  text($("cell-label"), cell.label); text($("cell-big"), cell.big); text($("cell-of"), cell.of); text($("cell-sub"), cell.sub);
  look($("cell"), `cell ${stop ? "" : cell.tone}${cell.big.length > 7 ? " long" : ""}${!cell.tone && (cell.big + cell.of).length > 11 ? " wide" : ""}`); $("bar").classList.toggle("trouble", !stop && Boolean(cell.tone));
  html($("cell-icon"), stop || !cell.tone ? "" : `<span style="--hole:var(--red);display:contents">${cell.tone === "red" ? icons.fault : icons.caution}</span>`);
  const net = view.net, loud = Boolean(stop?.known && stop.silent.length) || local?.state === "NOT CONFIRMED";
  $("bar").classList.toggle("unconfirmed", loud);
  look($("net"), `cell ${loud ? "loud" : stop ? "" : net.tone}`);
  if (loud) {
    const names = (stop?.failed || []).map((f) => f.label), moving = (stop?.failed || []).find((f) => f.mps > 0.03);
    text($("net-label"), "");
    text($("net-word"), local?.state === "NOT CONFIRMED" ? "NOT CONFIRMED" : `${names.length > 3 ? `${names.length} robots` : names.join(", ")} NOT CONFIRMED`);
    html($("net-l2"), ""); html($("net-icon"), icons.unknown);
    text($("net-sub"), local?.state === "NOT CONFIRMED" ? "No answer from the page's server. Keep out." : `No answer for ${stop.since_s.toFixed(1)} s. ${moving ? `Mocap sees ${moving.label} moving ${moving.mps.toFixed(2)} m/s. ` : ""}Keep out.`);
  } else {
    text($("net-label"), "Network"); text($("net-word"), net.word);
    html($("net-l2"), net.l2 === null ? "" : `λ<sub>2</sub> ${net.l2.toFixed(2)}`);
    html($("net-icon"), net.tone === "amber" ? icons.caution : net.tone === "red" ? icons.split : icons.net); text($("net-sub"), net.sub);
  }
  const progress = view.progress;
  text($("progress-label"), progress.label); text($("progress-big"), progress.big); text($("progress-of"), progress.of); text($("progress-sub"), progress.sub);
  const bulk = progress.total > 40 ? `<u class="on bulk" style="flex:${progress.done}"></u><u class="bulk" style="flex:${progress.total - progress.done}"></u>` : "";
  html($("progress-track"), progress.sub ? "" : bulk || Array.from({ length: progress.total }, (_, k) => `<u${k < progress.done ? ' class="on"' : ""}></u>`).join(""));
  text($("time-label"), view.time.label); text($("time-big"), view.time.big); text($("time-sub"), view.time.sub);
}

/** Processes of the station that are missing: what it means, what to do. */
export function drawParts(missing) {
  html($("parts"), missing.map((part) => {
    const bad = part.level === "fault", line = (name, words) => (words ? `<dt>${name}</dt><dd>${escape(words)}</dd>` : "");
    return `<div class="row part open ${bad ? "bad" : "warn"}"><i style="--hole:var(--red-soft)">${bad ? icons.fault : icons.caution}</i><span class="title">${escape(part.title)}</span><span class="value">${escape(part.value)}</span><dl>${line("Why", part.why)}${line("Now", part.now)}${line("Do", part.do)}</dl></div>`;
  }).join(""));
}

const COLUMNS = [["pose ms", "pose_ms"], ["loop Hz", "hz"], ["jitter ms", "jitter_ms"], ["battery", "battery_v"]];
const STOP_COLUMNS = [["ack ms", "ack_ms"], ["m/s", "mps"], ["pose ms", "pose_ms"], ["battery", "battery_v"]];

function show(value, key) {
  if (value === undefined || value === null) return "–";
  return key === "battery_v" ? `${value.toFixed(1)} V` : key === "mps" ? value.toFixed(2) : key === "jitter_ms" ? value.toFixed(1) : String(value);
}

/** Kind and words of a row with something to say; null for a robot that is well. */
function rowHtml(robot, label, stop, folded) {
  const lost = stop?.known && stop.silent.includes(robot.id), trouble = robot.trouble;
  const id = `<span class="id">${escape(label)}</span>`;
  if (lost) {
    const seen = robot.x === undefined ? "Mocap does not see it" : `Mocap: ${(robot.mps ?? 0).toFixed(2)} m/s at x ${robot.x.toFixed(1)}, y ${robot.y.toFixed(1)}`;
    const why = robot.run === undefined ? "It has never reported" : robot.report_s > 1 ? `No report for ${robot.report_s.toFixed(1)} s` : `It reports ${escape(robot.run)}, not STOP`;
    return ["bad", `<i>${icons.unknown}</i>${id}<span class="title">NOT CONFIRMED</span><span class="value">${stop.since_s.toFixed(1)} s</span><dl><dt>Why</dt><dd>${why}</dd><dt>Seen</dt><dd>${seen}</dd><dt>Do</dt><dd>Keep out. Hit the cut-off switch</dd></dl>`];
  }
  const waved = stop && robot.run === "stopped" && trouble?.title === "Stopped";
  if (trouble && !waved) {
    const bad = trouble.level === "fault", part = (name, words) => (words ? `<dt>${name}</dt><dd>${escape(words)}</dd>` : "");
    return [(bad ? "bad" : "warn") + (folded ? " folded" : ""), `<i style="--hole:var(--red-soft)">${bad ? icons.fault : icons.caution}</i>${id}<span class="title">${escape(trouble.title)}</span><span class="value">${escape(trouble.value)} <em>${escape(trouble.limit)}</em></span><dl>${part("Why", trouble.why)}${part("Now", trouble.now)}${part("Do", trouble.do)}</dl>`];
  }
  return null;
}

/** The row of a robot that is well: built once, then only numbers change. */
function plainRow(node, robot, label, stop) {
  const stopped = robot.run === "stopped", columns = stop ? STOP_COLUMNS : COLUMNS;
  html(node, `<i>${stopped ? icons.stopped : icons.ok}</i><span class="id">${escape(label)}</span><span class="does"></span>${columns.map(([, key]) => `<span class="n${narrow(key, stop)}"></span>`).join("")}`);
  let cell = node.firstElementChild.nextElementSibling.nextElementSibling;
  text(cell, robot.task);
  for (const [, key] of columns) { cell = cell.nextElementSibling; text(cell, show(robot[key], key)); }
  return stopped ? "stop" : "";
}

/** Columns that a tablet has no room for. */
function narrow(key, stop) { return key === "jitter_ms" || (stop && key === "pose_ms") ? " jit" : ""; }

/** One row a robot; with more than eight, those in trouble stand above the scrolling list. */
export function drawRows(view, layout, selected, choose) {
  const cautions = view.robots.filter((robot) => robot.trouble?.level === "caution").length;
  const columns = view.stop ? STOP_COLUMNS : COLUMNS;
  html($("rows-head"), `<span></span><span></span><span>Robot</span>${columns.map(([head, key]) => `<span class="n${narrow(key, view.stop)}">${head}</span>`).join("")}`);
  const list = $("rows-list"), pinned = $("rows-pinned"), many = view.robots.length > 8;
  $("rows").classList.toggle("few", !many);
  if (list._rows?.length !== view.robots.length) {
    list.innerHTML = ""; pinned.innerHTML = "";
    list._rows = view.robots.map((robot) => {
      const node = document.createElement("div"); node.dataset.robot = robot.id; node.addEventListener("click", () => choose(robot.id)); list.append(node); return node;
    });
  }
  const told = new Set(), explained = (view.missing || []).some((part) => part.level === "fault");
  view.robots.forEach((robot, k) => {
    const trouble = robot.trouble, same = trouble && `${trouble.title}|${trouble.why}`;
    const folded = Boolean(trouble && (explained || told.has(same)) && selected !== robot.id);
    if (trouble) told.add(same);
    const node = list._rows[k], found = rowHtml(robot, layout.labels[k], view.stop, folded);
    if (found) html(node, found[1]);
    const first = found ? found[0] : plainRow(node, robot, layout.labels[k], view.stop);
    const kind = first === "warn" && (cautions === 1 || selected === robot.id) ? "warn open" : first;
    look(node, `row ${kind}${!found && selected === robot.id ? " sel" : ""}`);
    const home = many && (kind.startsWith("bad") || kind.startsWith("warn")) ? pinned : list;
    if (node.parentNode !== home) { const after = list._rows.slice(k + 1).find((n) => n.parentNode === home); home.insertBefore(node, after || null); }
  });
}

export function drawChecks(checks) {
  html($("checks"), checks.map(([level, words]) => `<li class="${level}"><i style="--hole:var(--red-soft)">${level === "ok" ? icons.ok : level === "fault" ? icons.fault : icons.caution}</i><span>${lambda(words)}</span></li>`).join(""));
}

export function drawLog(view, rows) {
  html($("health"), view.health.map(([words, level]) => `<span class="${level}">${escape(words)}</span>`).join(""));
  html($("events"), view.events.slice(-rows).reverse().map(([, time, words, level]) => `<li class="${level}"><time>${time}</time><span>${escape(words)}</span></li>`).join(""));
}

export function drawRelease(stop, typed, message) {
  const rest = stop.silent.length, names = stop.failed.slice(0, 8).map((f) => f.label).join(", ") + (rest > 8 ? ` and ${rest - 8} more` : "");
  text($("release-why"), !stop.known ? "Waiting for the robots' answers." : rest ? `${names} ${rest > 1 ? "are" : "is"} not confirmed: latched on, and you ${rest > 8 ? "count them" : rest > 1 ? "name them" : "name it"}.` : "All robots confirmed. Type the word to unlock.");
  text($("release-ghost"), stop.word.startsWith(typed) ? typed + stop.word.slice(typed.length) : "");
  $("release-button").disabled = typed !== stop.word || stop.releasing || !stop.known;
  text($("release-message"), message);
}

export function drawLegend(kinds) {
  const many = kinds.includes("critical");
  html($("legend"), kinds.map((kind) => `<span>${legendIcons[kind]}${{ disarmed: "robot, disarmed", attention: "needs attention", target: "target", kept: many ? "kept" : "link" }[kind] || kind}</span>`).join(""));
}
