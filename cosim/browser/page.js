"use strict";
// Shows what the server says and hands back what is chosen: nothing is computed here.
const $ = id => document.getElementById(id);
let state = null, revision = -1, shownWork = "", shownAnswer = "", timer = 0, sending = 0, ended = false, words = {comma: ".", said: {}};

// words: English here, looked up in what the server has sent for the language in use

const said = (text, places = {}) => (words.said[text] ?? text).replace(/\{(\w+)\}/g, (_, name) => places[name]);
const comma = text => text.replace(".", words.comma);
const number = value => value === null || value === undefined ? "" : comma(String(Number(value.toPrecision(4))));
const written = [];  // what page.html holds, each as a function that says it anew

function findWritten() {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const text = node, whole = node.data, bare = whole.trim();
    if (/[a-z]{2}/i.test(bare)) written.push(() => { text.data = whole.replace(bare, () => said(bare)); });
  }
  for (const part of document.querySelectorAll("[title], [aria-label], [placeholder]")) {
    for (const name of ["title", "aria-label", "placeholder"].filter(n => part.hasAttribute(n))) {
      const own = part.getAttribute(name);
      written.push(() => part.setAttribute(name, said(own)));
    }
  }
  const title = document.title;
  written.push(() => { document.title = said(title); });
}

function speak(now) {
  words = now.words;
  document.documentElement.lang = now.language;
  for (const write of written) write();
  $("language").replaceChildren(...now.languages.map(code => element("option", {value: code}, new Intl.DisplayNames([code], {type: "language"}).of(code))));
  $("language").value = now.language;
}

// the first of the browser's languages that is there, until somebody chooses
const wanted = languages => navigator.languages.map(l => l.slice(0, 2).toLowerCase()).find(l => languages.includes(l)) ?? languages[0];

async function call(where, options) {
  let answer;
  try {
    answer = await fetch(where, {cache: "no-store", redirect: "error", ...options});
  } catch {
    throw Object.assign(new Error(said("cosim open does not answer: has it been ended?")), {gone: true});
  }
  const sent = await answer.json();
  if (!answer.ok) throw Object.assign(new Error(sent.error), {row: sent.row});
  return sent;
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

async function send(files, role = "log") {
  const kinds = file => /\.(ssp|fmu|toml)$/i.test(file.name) ? 0 : 1;  // the model first, so that the guesses are for it
  say("file-error", "");
  const errors = [];
  for (const file of [...files].sort((a, b) => kinds(a) - kinds(b))) {
    $("busy").textContent = said("reading {name}", {name: file.name});
    sending += 1;
    try {
      show(await call("file", {method: "POST", body: file, headers: {"Content-Type": "application/octet-stream", "X-Name": encodeURIComponent(file.name), "X-Role": role}}));
      if (kinds(file) && role === "log") role = "more";  // several at once are of one machine
    } catch (error) {
      errors.push(error.message);
    } finally {
      sending -= 1;
    }
  }
  $("busy").textContent = "";
  say("file-error", errors.join(" "));
}

const adding = event => event.target instanceof Element ? event.target.closest("[data-role]") : null;
$("files").addEventListener("change", async () => { await send($("files").files); $("files").value = ""; });
for (const kind of ["dragenter", "dragover"]) addEventListener(kind, event => { event.preventDefault(); (adding(event) ?? $("drop")).classList.add("over"); });
for (const kind of ["dragleave", "drop"]) addEventListener(kind, event => { event.preventDefault(); for (const part of document.querySelectorAll(".over")) part.classList.remove("over"); });
addEventListener("drop", event => { if (event.dataTransfer.files.length) send(event.dataTransfer.files, adding(event)?.dataset.role); });
for (const part of document.querySelectorAll("[data-role] input")) part.addEventListener("change", async () => { await send(part.files, part.parentElement.dataset.role); part.value = ""; });

$("language").addEventListener("change", async () => {
  try { show(await press("language", {language: $("language").value})); } catch (error) { say("file-error", error.message); }
});

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
  const unit = column.unit === "1" ? "" : column.unit;
  const range = column.low === null ? column.why || said("no numbers") : said("{low} to {high} {unit}", {low: number(column.low), high: number(column.high), unit}).trim();
  return [picture(column), element("span", {className: "shown"}, `${range}, ${said(column.shape)}${column.missing ? `, ${said("{count} missing", {count: column.missing})}` : ""}`)];
}

function columnChoice(id, label, chosen, first) {
  const choice = element("select", {id, "aria-label": label});
  choice.append(...first.map(([value, text]) => element("option", {value}, text)),
    ...state.log.columns.map(c => element("option", {value: String(c.index), disabled: c.low === null}, c.name || said("column {place}", {place: c.index + 1}))));
  choice.value = String(chosen ?? first[0][0]);
  return choice;
}

function field(kind, label, value, extra = {}) {
  return element("input", {type: "text", "data-kind": kind, "aria-label": label, value: typeof value === "number" ? comma(String(value)) : String(value), autocomplete: "off", spellcheck: false, ...extra});
}

function signalRow(row) {
  const columns = state.log.columns;
  const line = element("tr", {"data-signal": row.signal});
  const choice = columnChoice("", said("Column that holds {signal}", row), row.column, [["", said("not measured")]]);
  const picked = element("td");
  const notes = element("td", {}, choice);
  if (row.check) notes.append(element("small", {className: "check"}, said("Check: {check}", row)));
  else if (row.column !== null && row.why) notes.append(element("small", {}, said("Guess: {why}", row)));
  const parts = {
    unit: field("unit", said("Unit of {signal}", row), row.unit, {list: "units"}), gain: field("gain", said("Gain of {signal}", row), row.gain),
    zero: field("zero", said("Zero of {signal}", row), row.zero), reversed: element("input", {type: "checkbox", "data-kind": "reversed", checked: row.reversed, "aria-label": said("{signal} counts the other way", row)}),
  };
  if (row.held !== null) {
    parts.held = element("input", {type: "checkbox", "data-kind": "held", checked: row.held, "aria-label": said("{signal} stays until the next sample", row)});
    notes.append(element("label", {className: "soft"}, parts.held, ` ${said("stays until the next sample")}`));
  }
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
    if (column && parts.held) parts.held.checked = column.held;
    notes.querySelector("small")?.remove();
    line.classList.remove("wrong");
    refresh();
  });
  line.append(element("th", {scope: "row"}, row.signal, element("small", {}, `${row.text}${row.needed ? ` ${said("(needed)")}` : ""}`)), notes,
    element("td", {}, parts.unit), element("td", {className: "gain"}, parts.gain), element("td", {}, parts.zero), element("td", {}, parts.reversed), picked);
  line.refresh = refresh;
  line.needed = row.needed;
  return line;
}

function timeRow(time) {
  const line = element("tr", {"data-signal": "time"});
  const columns = state.log.columns;
  const first = [["", said("no column: a fixed interval")]];
  if (time.own) first.unshift(["own", said("stamps of each column")]);
  const choice = columnChoice("", said("Column that holds the time"), time.own ? "own" : time.column, first);
  const unit = field("unit", said("Unit of time"), time.unit), step = field("step", said("Interval between samples"), time.step ?? "");
  const interval = element("label", {className: "soft"}, `${said("interval")} `, step), picked = element("td");
  const notes = element("td", {}, choice);
  if (time.check) notes.append(element("small", {className: "check"}, said("Check: {check}", time)));
  const refresh = () => {
    const column = columns[Number(choice.value || -1)];
    picked.replaceChildren(...logged(column));
    interval.hidden = choice.value !== "";
    unit.disabled = choice.value === "own";
    unused();
  };
  choice.addEventListener("change", () => { notes.querySelector("small")?.remove(); line.classList.remove("wrong"); refresh(); });
  line.append(element("th", {scope: "row"}, said("time")), notes, element("td", {}, unit), element("td", {colSpan: 3}, interval), picked);
  line.refresh = refresh;
  return line;
}

function numberRow(row) {
  const trusted = field("trusted", said("How well {name} is known", row), row.trusted, {placeholder: said("exactly")});
  const free = element("input", {type: "checkbox", "data-kind": "free", checked: row.free, "aria-label": said("{name} is not known", row)});
  const refresh = () => { trusted.disabled = free.checked; };
  free.addEventListener("change", refresh);
  refresh();
  return element("tr", {"data-number": row.name}, element("th", {scope: "row"}, row.name, element("small", {}, row.text)),
    element("td", {}, `${number(row.value)} ${row.unit === "1" ? "" : row.unit}`.trim()), element("td", {}, trusted), element("td", {}, free));
}

const numbers = () => [...document.querySelectorAll("tr[data-number]")];
const lines = () => [...document.querySelectorAll("tr[data-signal]")];

function unused() {
  const taken = new Set(lines().map(line => line.querySelector("select").value));
  const free = state.log.columns.filter(c => !taken.has(String(c.index)));
  $("unused").hidden = !free.length;
  $("unused").querySelector("summary").textContent = said("Columns that are not used ({count})", {count: free.length});
  $("unused-rows").replaceChildren(...free.map(c => element("tr", {}, element("th", {scope: "row"}, c.name), element("td", {}, ...logged(c)))));
  const left = lines().filter(line => line.classList.contains("open") && line.needed).map(line => line.dataset.signal);
  const checks = document.querySelectorAll("small.check").length, found = lines().filter(l => !l.classList.contains("open")).length - 1;
  $("summary").textContent = said("{found} of {all} signals have a column.", {found, all: lines().length - 1})
    + (left.length ? ` ${said("Needed: {names}.", {names: left.join(", ")})}` : "") + (checks ? ` ${said("{count} to check.", {count: checks})}` : "");
}

const length = record => [said("{count} samples", {count: record.samples}), record.duration !== null && `${number(record.duration)} s`];
const ROLES = {more: "diagnosed together with it", held_out: "the gain is judged on it", external: "record of the tracker"};

function showBeside() {
  $("beside").hidden = !state.log && !state.beside.length;
  $("beside-files").replaceChildren(...state.beside.map((file, place) => {
    const button = element("button", {type: "button", className: "quiet small"}, said("Remove"));
    button.setAttribute("aria-label", said("Remove {name}", file));
    button.addEventListener("click", async () => { try { show(await press("remove", {place})); } catch (error) { say("file-error", error.message); } });
    return element("li", {}, element("b", {}, file.name), element("span", {className: "soft"}, [said(ROLES[file.role]), ...length(file)].filter(Boolean).join(", ")), button);
  }));
}

function showForm() {
  const {log, form} = state;
  showBeside();
  $("columns").hidden = $("start").hidden = !form || !log;
  $("drop").classList.toggle("filled", Boolean(log));
  $("example").hidden = Boolean(log);
  if (!form || !log) return;
  $("log-name").textContent = log.name;
  $("log-facts").textContent = [...length(log), log.rate !== null && said("{rate} a second", {rate: number(log.rate)}), log.gaps && said("{count} gaps", {count: log.gaps}),
    log.backwards && said("time goes back {count} times", {count: log.backwards})].filter(Boolean).join(", ") + `. ${said("Drop or choose another file to replace it.")}`;
  list("log-warnings", log.warnings);
  const few = form.rows.length <= 12;  // of many connectors only those with a column are unfolded
  const shown = form.rows.filter(r => r.column !== null || r.needed || r.check || (few && (!form.least.length || form.least.includes(r.signal))));
  const rest = form.rows.filter(r => !shown.includes(r));
  $("main-rows").replaceChildren(timeRow(form.time), ...shown.map(signalRow));
  $("more-rows").replaceChildren(...rest.map(signalRow));
  $("more").hidden = !rest.length;
  $("more").querySelector("summary").textContent = said("Signals without a column ({count})", {count: rest.length});
  $("number-rows").replaceChildren(...form.numbers.map(numberRow));
  $("numbers").hidden = !form.numbers.length;
  $("numbers").querySelector("summary").textContent = said("Parameters of the model ({count}): which may be wrong?", {count: form.numbers.length});
  for (const line of lines()) line.refresh();
}

// what was chosen by hand outlives another language or one more file
const parts = () => [...lines(), ...numbers()].flatMap(line => [...line.querySelectorAll("select, input")].map(part => [`${line.dataset.signal ?? line.dataset.number} ${part.dataset.kind ?? ""}`, part]));

function chosen() {
  if (!state?.form || !state.log) return null;
  const values = new Map(parts().map(([key, part]) => [key, part.type === "checkbox" ? part.checked : part.value]));
  return {of: JSON.stringify([state.log.name, state.log.columns.map(c => c.name), state.form.rows.map(r => r.signal).sort()]), values};
}

function choose(before) {
  if (before === null || chosen()?.of !== before.of) return;
  for (const [key, part] of parts()) if (before.values.has(key)) { if (part.type === "checkbox") part.checked = before.values.get(key); else part.value = before.values.get(key); }
  for (const line of lines()) line.refresh();
  for (const line of numbers()) line.querySelector("[data-kind=trusted]").disabled = line.querySelector("[data-kind=free]").checked;
}

function filled() {
  const rows = {};
  let time = {};
  for (const line of lines()) {
    const get = kind => line.querySelector(`[data-kind=${kind}]`);
    const choice = line.querySelector("select").value;
    const column = choice === "" || choice === "own" ? null : Number(choice);
    if (line.dataset.signal === "time") time = {column, own: choice === "own", unit: get("unit").value, step: get("step").value};
    else rows[line.dataset.signal] = {column, unit: get("unit").value, gain: get("gain").value, zero: get("zero").value, reversed: get("reversed").checked, held: get("held")?.checked};
  }
  const known = Object.fromEntries(numbers().map(line => [line.dataset.number, {trusted: line.querySelector("[data-kind=trusted]").value, free: line.querySelector("[data-kind=free]").checked}]));
  return {time, rows, numbers: known, calibrate: $("calibrate").checked, budget: $("budget").value};
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
    const known = numbers().find(l => l.dataset.number === error.row);
    if (known) { known.closest("details").setAttribute("open", ""); known.querySelector("input").focus(); }
    if (error.row === "budget") $("budget").focus();
  }
});

$("stop").addEventListener("click", async () => {
  $("stop").disabled = true;
  try { show(await press("stop")); } catch (error) { say("form-error", error.message); }
});

$("close").addEventListener("click", async () => {
  try { await press("close"); } catch { /* it has ended already */ }
  finish(said("Ended. Results stay in their folder; this page can be closed."));
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
  for (const part of document.querySelectorAll("#columns select, #columns input, #beside input, #beside button, #model, #files, #calibrate, #budget")) if (runs || part.dataset.held) {
    if (runs && !part.disabled) { part.dataset.held = "1"; part.disabled = true; }
    if (!runs) { delete part.dataset.held; part.disabled = false; }
  }
  if (runs) {
    if (work.share > 0) $("bar").value = work.share; else $("bar").removeAttribute("value");
    if ($("doing").textContent !== work.text) $("doing").textContent = work.text;
    $("seconds").textContent = `${Math.round(work.seconds)} s`;
  }
  const key = JSON.stringify([work.state, work.folder, revision, state.language]);
  if (key === shownWork) return;
  shownWork = key;
  say("form-error", work.state === "failed" || (work.state === "stopped" && work.error) ? work.error : "");
  const over = work.lines.length > 0 && !runs;
  $("answer").hidden = !over;
  $("frame").hidden = $("report").hidden = !(over && work.report);
  if (!over) { $("frame").removeAttribute("src"); return; }
  $("lines").replaceChildren(...work.lines.flatMap(([question, answer], k) => [element("dt", {}, question), element("dd", {className: k === 0 ? "first" : ""}, answer)]));
  $("answer-title").textContent = work.state === "stopped" ? said("Answer, as far as it was found") : said("Answer");
  list("warnings", [...new Set(work.warnings)]);
  $("folder").textContent = work.folder;
  if (work.report) $("frame").src = "report";
  if (shownAnswer === work.folder) return;  // the same again, in another language
  shownAnswer = work.folder;
  $("answer-title").focus({preventScroll: true});
  $("answer").scrollIntoView({block: "start"});
}

function show(now) {
  if (!("form" in now)) Object.assign(now, {log: state.log, form: state.form, beside: state.beside, words: state.words});
  if (now.language === null) { press("language", {language: wanted(now.languages)}).then(show, error => say("gone", error.message)); return; }
  const before = state ? chosen() : null;
  state = now;
  if (now.revision !== revision) {
    revision = now.revision;
    speak(now);
    $("model").replaceChildren(...now.models.map(m => element("option", {value: m.value}, m.label)));
    showForm();
    choose(before);
  }
  $("model").value = now.model;
  showWork();
  clearTimeout(timer);
  if (now.closed) finish(said("Ended. Results stay in their folder; this page can be closed."));
  else if (!ended) timer = setTimeout(look, now.work.state === "running" || now.work.state === "stopping" ? 400 : 2000);
}

async function look() {
  if (ended) return;
  try { const now = await call(`state?revision=${revision}`); if (!sending) show(now); else timer = setTimeout(look, 1000); }
  catch (error) { if (error.gone) finish([error.message, state?.work.folder && said("What was found is in {folder}.", state.work), said("Start it again with 'cosim open'.")].filter(Boolean).join(" ")); else say("gone", error.message); }
}

document.body.append(element("datalist", {id: "units"}, ...["1", "%", "V", "mA", "deg", "rad", "deg/s", "rad/s", "mm", "m", "bar", "Pa", "kPa", "psi", "N.m", "N"].map(u => element("option", {value: u}))));
findWritten();
look();
