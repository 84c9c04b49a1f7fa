"use strict";
// Shows what the server says and hands back what is chosen: nothing is computed here.
const $ = id => document.getElementById(id);
let state = null, revision = -1, shownWork = "", timer = 0, sending = 0, ended = false;

const number = value => value === null || value === undefined ? "" : String(Number(value.toPrecision(4)));

async function call(where, options) {
  let answer;
  try {
    answer = await fetch(where, {cache: "no-store", redirect: "error", ...options});
  } catch {
    throw Object.assign(new Error("cosim open does not answer: has it been ended?"), {gone: true});
  }
  const said = await answer.json();
  if (!answer.ok) throw Object.assign(new Error(said.error), {row: said.row});
  return said;
}

const press = (what, given = {}) => call(what, {method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(given)});

function say(id, text) {
  $(id).textContent = text;
  $(id).hidden = !text;
}

function list(id, texts) {
  $(id).replaceChildren(...texts.map(text => element("li", {}, text)));
  $(id).hidden = !texts.length;
}

function element(name, attributes = {}, ...inside) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === false || value === null) continue;
    if (key in made && key !== "list") made[key] = value; else made.setAttribute(key, value);
  }
  made.append(...inside);
  return made;
}

// files

async function send(files) {
  const kinds = file => /\.(ssp|fmu|toml)$/i.test(file.name) ? 0 : 1;  // the model first, so that the guesses are for it
  say("file-error", "");
  const errors = [];
  for (const file of [...files].sort((a, b) => kinds(a) - kinds(b))) {
    $("busy").textContent = `reading ${file.name}`;
    sending += 1;
    try {
      show(await call("file", {method: "POST", body: file, headers: {"Content-Type": "application/octet-stream", "X-Name": encodeURIComponent(file.name)}}));
    } catch (error) {
      errors.push(error.message);
    } finally {
      sending -= 1;
    }
  }
  $("busy").textContent = "";
  say("file-error", errors.join(" "));
  $("files").value = "";
}

$("files").addEventListener("change", () => send($("files").files));
for (const kind of ["dragenter", "dragover"]) addEventListener(kind, event => { event.preventDefault(); $("drop").classList.add("over"); });
for (const kind of ["dragleave", "drop"]) addEventListener(kind, event => { event.preventDefault(); $("drop").classList.remove("over"); });
addEventListener("drop", event => { if (event.dataTransfer.files.length) send(event.dataTransfer.files); });

$("model").addEventListener("change", async () => {
  say("file-error", "");
  try { show(await press("model", {model: $("model").value})); } catch (error) { say("file-error", error.message); show(state); }
});

$("example").addEventListener("click", async () => {
  say("file-error", "");
  try { show(await press("example")); } catch (error) { say("file-error", error.message); }
});

// columns

function picture(column) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 1 1");
  svg.setAttribute("preserveAspectRatio", "none");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", column.picture.map(([x, y], k) => `${k ? "L" : "M"}${x} ${0.96 - 0.92 * y}`).join(""));
  svg.append(path);
  return svg;
}

function logged(column) {
  if (!column) return [];
  const range = column.low === null ? column.why || "no numbers" : `${number(column.low)} to ${number(column.high)} ${column.unit === "1" ? "" : column.unit}`.trim();
  return [picture(column), element("span", {className: "shown"}, `${range}, ${column.shape}${column.missing ? `, ${column.missing} missing` : ""}`)];
}

function columnChoice(id, label, chosen, first) {
  const choice = element("select", {id, "aria-label": label});
  choice.append(...first.map(([value, text]) => element("option", {value}, text)),
    ...state.log.columns.map(c => element("option", {value: String(c.index), disabled: c.low === null}, c.name || `column ${c.index + 1}`)));
  choice.value = String(chosen ?? first[0][0]);
  return choice;
}

function field(kind, label, value, extra = {}) {
  return element("input", {type: "text", "data-kind": kind, "aria-label": label, value: String(value), autocomplete: "off", spellcheck: false, ...extra});
}

function signalRow(row) {
  const columns = state.log.columns;
  const line = element("tr", {"data-signal": row.signal});
  const choice = columnChoice("", `Column that holds ${row.signal}`, row.column, [["", "not measured"]]);
  const picked = element("td");
  const notes = element("td", {}, choice);
  if (row.check) notes.append(element("small", {className: "check"}, `Check: ${row.check}`));
  else if (row.column !== null && row.why) notes.append(element("small", {}, `by ${row.why}`));
  const parts = {
    unit: field("unit", `Unit of ${row.signal}`, row.unit, {list: "units"}), gain: field("gain", `Gain of ${row.signal}`, row.gain),
    zero: field("zero", `Zero of ${row.signal}`, row.zero), reversed: element("input", {type: "checkbox", "data-kind": "reversed", checked: row.reversed, "aria-label": `${row.signal} counts the other way`}),
  };
  const refresh = () => {
    const column = choice.value === "" ? null : columns[Number(choice.value)];
    picked.replaceChildren(...logged(column));
    for (const part of Object.values(parts)) part.disabled = !column;
    line.classList.toggle("open", !column);
    unused();
  };
  choice.addEventListener("change", () => {
    const column = choice.value === "" ? null : columns[Number(choice.value)];
    if (column && column.unit) parts.unit.value = column.unit;
    notes.querySelector("small")?.remove();
    line.classList.remove("wrong");
    refresh();
  });
  line.append(element("th", {scope: "row"}, row.signal, element("small", {}, `${row.text}${row.needed ? " (needed)" : ""}`)), notes,
    element("td", {}, parts.unit), element("td", {className: "gain"}, parts.gain), element("td", {}, parts.zero), element("td", {}, parts.reversed), picked);
  line.refresh = refresh;
  return line;
}

function timeRow(time) {
  const line = element("tr", {"data-signal": "time"});
  const columns = state.log.columns;
  const first = [["", "no column: a fixed interval"]];
  if (time.own) first.unshift(["own", "stamps of each column"]);
  const choice = columnChoice("", "Column that holds the time", time.own ? "own" : time.column, first);
  const unit = field("unit", "Unit of time", time.unit), step = field("step", "Interval between samples", time.step ?? "");
  const interval = element("label", {className: "soft"}, "interval ", step), picked = element("td");
  const notes = element("td", {}, choice);
  if (time.check) notes.append(element("small", {className: "check"}, `Check: ${time.check}`));
  const refresh = () => {
    const column = columns[Number(choice.value || -1)];
    picked.replaceChildren(...logged(column));
    interval.hidden = choice.value !== "";
    unit.disabled = choice.value === "own";
    unused();
  };
  choice.addEventListener("change", () => { notes.querySelector("small")?.remove(); line.classList.remove("wrong"); refresh(); });
  line.append(element("th", {scope: "row"}, "time"), notes, element("td", {}, unit), element("td", {colSpan: 3}, interval), picked);
  line.refresh = refresh;
  return line;
}

const lines = () => [...document.querySelectorAll("tr[data-signal]")];

function unused() {
  const taken = new Set(lines().map(line => line.querySelector("select").value));
  const free = state.log.columns.filter(c => !taken.has(String(c.index)));
  $("unused").hidden = !free.length;
  $("unused").querySelector("summary").textContent = `Columns that are not used (${free.length})`;
  $("unused-rows").replaceChildren(...free.map(c => element("tr", {}, element("th", {scope: "row"}, c.name), element("td", {}, ...logged(c)))));
  const left = lines().filter(line => line.classList.contains("open") && line.querySelector("small")?.textContent.endsWith("(needed)")).map(line => line.dataset.signal);
  const checks = document.querySelectorAll("small.check").length, found = lines().filter(l => !l.classList.contains("open")).length - 1;
  $("summary").textContent = `${found} of ${lines().length - 1} signals have a column.`
    + (left.length ? ` Needed: ${left.join(", ")}.` : "") + (checks ? ` ${checks} to check.` : "");
}

function showForm() {
  const {log, form} = state;
  $("columns").hidden = $("start").hidden = !form || !log;
  $("drop").classList.toggle("filled", Boolean(log));
  $("example").hidden = Boolean(log);
  if (!form || !log) return;
  $("log-name").textContent = log.name;
  $("log-facts").textContent = [`${log.samples} samples`, log.duration !== null && `${number(log.duration)} s`, log.rate !== null && `${number(log.rate)} a second`,
    log.gaps && `${log.gaps} gaps`, log.backwards && `time goes back ${log.backwards} times`].filter(Boolean).join(", ") + ". Drop or choose another file to replace it.";
  list("log-warnings", log.warnings);
  const few = form.rows.length <= 12;  // of many connectors only those with a column are unfolded
  const shown = form.rows.filter(r => r.column !== null || r.needed || r.check || (few && (!form.least.length || form.least.includes(r.signal))));
  const rest = form.rows.filter(r => !shown.includes(r));
  $("main-rows").replaceChildren(timeRow(form.time), ...shown.map(signalRow));
  $("more-rows").replaceChildren(...rest.map(signalRow));
  $("more").hidden = !rest.length;
  $("more").querySelector("summary").textContent = `Signals without a column (${rest.length})`;
  for (const line of lines()) line.refresh();
}

function filled() {
  const rows = {};
  let time = {};
  for (const line of lines()) {
    const get = kind => line.querySelector(`[data-kind=${kind}]`);
    const choice = line.querySelector("select").value;
    const column = choice === "" || choice === "own" ? null : Number(choice);
    if (line.dataset.signal === "time") time = {column, own: choice === "own", unit: get("unit").value, step: get("step").value};
    else rows[line.dataset.signal] = {column, unit: get("unit").value, gain: get("gain").value, zero: get("zero").value, reversed: get("reversed").checked};
  }
  return {time, rows, calibrate: $("calibrate").checked, budget: $("budget").value};
}

// diagnosis

$("diagnose").addEventListener("click", async () => {
  say("form-error", "");
  for (const line of lines()) line.classList.remove("wrong");
  $("diagnose").disabled = true;
  try {
    show(await press("diagnose", filled()));
  } catch (error) {
    say("form-error", error.message);
    $("diagnose").disabled = false;
    const line = lines().find(l => l.dataset.signal === error.row);
    if (line) { line.closest("details")?.setAttribute("open", ""); line.classList.add("wrong"); line.querySelector("select").focus(); }
    if (error.row === "budget") $("budget").focus();
  }
});

$("stop").addEventListener("click", async () => {
  $("stop").disabled = true;
  try { show(await press("stop")); } catch (error) { say("form-error", error.message); }
});

$("close").addEventListener("click", async () => {
  try { await press("close"); } catch { /* it has ended already */ }
  finish("Ended. Results stay in their folder; this page can be closed.");
});

function finish(text) {
  ended = true;
  clearTimeout(timer);
  say("gone", text);
  $("progress").hidden = true;
  for (const part of document.querySelectorAll("button, input, select")) part.disabled = true;
  $("gone").scrollIntoView({block: "nearest"});
}

function showWork() {
  const work = state.work, runs = work.state === "running" || work.state === "stopping";
  $("progress").hidden = !runs;
  $("stop").hidden = !runs;
  $("stop").disabled = work.state === "stopping";
  $("diagnose").disabled = runs;
  for (const part of document.querySelectorAll("#columns select, #columns input, #model, #files, #calibrate, #budget")) if (runs || part.dataset.held) {
    if (runs && !part.disabled) { part.dataset.held = "1"; part.disabled = true; }
    if (!runs) { delete part.dataset.held; part.disabled = false; }
  }
  if (runs) {
    if (work.share > 0) $("bar").value = work.share; else $("bar").removeAttribute("value");
    if ($("doing").textContent !== work.text) $("doing").textContent = work.text;
    $("seconds").textContent = `${Math.round(work.seconds)} s`;
  }
  const key = JSON.stringify([work.state, work.folder, revision]);
  if (key === shownWork) return;
  shownWork = key;
  say("form-error", work.state === "failed" || (work.state === "stopped" && work.error) ? work.error : "");
  const over = work.lines.length > 0 && !runs;
  $("answer").hidden = !over;
  $("frame").hidden = $("report").hidden = !(over && work.report);
  if (!over) { $("frame").removeAttribute("src"); return; }
  $("lines").replaceChildren(...work.lines.flatMap((line, k) => {
    const at = line.indexOf(": ");
    return [element("dt", {}, line.slice(0, at)), element("dd", {className: k === 0 ? "first" : ""}, line.slice(at + 2))];
  }));
  $("answer-title").textContent = work.state === "stopped" ? "Answer, as far as it was found" : "Answer";
  list("warnings", [...new Set(work.warnings)]);
  $("folder").textContent = work.folder;
  if (work.report) $("frame").src = "report";
  $("answer-title").focus({preventScroll: true});
  $("answer").scrollIntoView({block: "start"});
}

function show(now) {
  if (!("form" in now)) Object.assign(now, {log: state.log, form: state.form});
  state = now;
  if (now.revision !== revision) {
    revision = now.revision;
    $("model").replaceChildren(...now.models.map(m => element("option", {value: m.value}, m.label)));
    showForm();
  }
  $("model").value = now.model;
  showWork();
  clearTimeout(timer);
  if (now.closed) finish("Ended. Results stay in their folder; this page can be closed.");
  else if (!ended) timer = setTimeout(look, now.work.state === "running" || now.work.state === "stopping" ? 400 : 2000);
}

async function look() {
  if (ended) return;
  try { const now = await call(`state?revision=${revision}`); if (!sending) show(now); else timer = setTimeout(look, 1000); }
  catch (error) { if (error.gone) finish(`${error.message} ${state?.work.folder ? `What was found is in ${state.work.folder}. ` : ""}Start it again with 'cosim open'.`); else say("gone", error.message); }
}

document.body.append(element("datalist", {id: "units"}, ...["1", "%", "V", "mA", "deg", "rad", "deg/s", "rad/s", "mm", "m", "bar", "Pa", "kPa", "psi", "N.m", "N"].map(u => element("option", {value: u}))));
look();
