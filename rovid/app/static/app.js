// The page of `rovid open`. It holds the user's choices, sends them to the server after each change and shows the answer:
// rovid.toml, open questions and the result of `rovid check`. All computations are done by the server.
import { drawSpot, Plots } from "./plots.js";
import { armOf, Sketch, standing } from "./sketch.js";
import { ask, byId, copy, element, hear, isOf, literally, soon, tidy, typed } from "./tools.js";
import { go, mark, step } from "./steps.js";

const ROLES = {
  "": "not used", heading: "heading", command: "command of a thruster", yaw_rate: "yaw rate (gyro)", roll: "roll", pitch: "pitch",
  supply_voltage: "supply voltage", torque: "torque (in place of thrusters)", extra: "carried along",
};
const SIZES = ["mass", "length", "width"];

let logs = []; // names of the chosen logs, as the server knows them
let look = null; // the server's description of these logs
let columns = new Map(); // "format|source" -> {kind, source, role, name, unit, sign}
// name -> {x, y, angle, arm, hand, placed}; hand: whether the user gave the arm, placed: with position and direction
let thrusters = new Map();
let vehicle = "", title = "", size = {}, stretches = [], timeUnit = "auto";
let draft = null, checked = null, saved = false, running = false;
// While rovid guesses from all logs, the user may change a column: `given` has those columns, null for an unused one.
let guessing = false, given = new Map();
// Whether the user has chosen a type of vehicle, and no draft has come since.
let newType = false;
// Rudder -> its coefficient, or the wheelbase of steered wheels, as the user gave it.
let rudders = {};
// Logs of this size in bytes are read as a whole before the first plot; of larger ones, the first log is read ahead.
const SMALL = 4e6;

const key = (kind, source) => `${kind}|${source}`;
// A column that rovid takes for the angle of a rudder, unless the user gives it another role.
const rudderOf = (kind, source) => (theirs() ? null : draft?.survey.rudders[kind]?.find((one) => one.source === source));
const current = () => look?.logs.find(({ path }) => path === byId("log").value);

function trouble(error) {
  const place = byId("trouble");
  place.hidden = !error;
  place.textContent = error ? error.message ?? String(error) : "";
}
// A folder with a rovid.toml that this page did not write: the check and the run use that file, and the fields show it.
const theirs = () => look?.existing && !look.chosen;

addEventListener("unhandledrejection", (event) => { trouble(event.reason); event.preventDefault(); });

// ---- 1. logs

async function folders(inside) {
  const list = await ask(`folders?${new URLSearchParams({ in: inside })}`);
  byId("folders").replaceChildren(...list.map(({ path }) => element("option", "", null, { value: path })));
  const items = list.slice(0, 200).map(({ path, logs: count }) => {
    const item = element("li"), words = count ? `${path} (${count} file${count > 1 ? "s" : ""})` : `${path} (no logs directly in it)`;
    element("button", words, item, { type: "button" }).addEventListener("click", () => {
      byId("folder").value = path;
      if (count) choose([path]);
      else folders(path);
    });
    return item;
  });
  byId("folder-list").replaceChildren(...items);
  if (!list.length && inside) choose([inside]); // says what is in it
}

let choosing = 0;

// Forget all about the last folder.
function clear() {
  [look, draft, checked, saved, logs, guessing, rudders] = [null, null, null, false, [], false, {}];
  byId("despite").checked = false;
  columns = new Map();
  given = new Map();
  thrusters = new Map();
  [vehicle, title, size, stretches, shownColumns, timeUnit] = ["", "", {}, [], [], "auto"];
  for (const id of ["rows", "check-said", "check-more", "run-steps", "run-warnings", "leave-list", "not-read", "senses", "commands", "toml", "log", "leave-log"]) byId(id).replaceChildren();
  for (const id of ["logs-found", "columns-said", "span", "curve", "save-words", "save-said", "run-said", "run-now", "run-error", "heard"]) byId(id).textContent = "";
  for (const id of ["run-error", "run-progress", "axes"]) byId(id).hidden = true;
  byId("run-said").dataset.state = "";
  document.querySelector("input[name=axes][value='']").checked = true;
  plots.place([]);
  showThrusters();
  showReport(null);
}

async function choose(names) {
  const own = ++choosing;
  trouble(null);
  clear();
  headlines("Reading the logs …");
  try {
    const found = await ask(`look?${new URLSearchParams(names.map((name) => ["log", name]))}`);
    if (own !== choosing) return; // the user chose another folder meanwhile
    look = found;
    logs = names;
    showLogs();
    recall(look.chosen ?? look.existing?.choice);
    const bytes = look.logs.reduce((sum, one) => sum + one.bytes, 0);
    guessing = !columns.size;
    if (bytes > SMALL && look.logs.length > 1 && guessing) {
      await refresh({ asGuessed: true, of: [look.logs[0].path] });
      if (own !== choosing) return;
      await openLog();
      go("signals");
      headlines("Reading all logs …");
    }
    await Promise.all([refresh({ asGuessed: guessing }), shownColumns.length ? null : openLog()]);
    if (own !== choosing) return;
    if (guessing && given.size) refreshSoon();
    guessing = false;
  } catch (error) {
    if (own !== choosing) return;
    look = null;
    guessing = false;
    go("logs");
    headlines();
    trouble(error);
    return;
  }
  byId("which").value = !theirs() && draft.survey.open.length ? "all" : "used";
  byId("type").value = vehicle;
  showStretches();
  openLog();
  showReport(look.reports[planar() ? "planar" : "yaw"], look.folder);
  go("signals");
  // The field that the user left is hidden by now.
  if (document.activeElement !== document.body) document.querySelector("#steps [aria-current]").focus();
}

function showLogs() {
  const several = look.logs.length > 1 ? `${look.logs.length} logs` : "One log";
  byId("logs-found").textContent = `${several} in ${look.folder || "this folder"}: ${look.logs.slice(0, 6).map(({ name }) => name).join(", ")}${look.logs.length > 6 ? " and others" : ""}.`;
  byId("log").replaceChildren(...look.logs.map(({ path, name }) => element("option", name, null, { value: path })));
  byId("leave-log").replaceChildren(...look.logs.map(({ name }) => element("option", name, null, { value: literally(name) })), element("option", "every log", null, { value: "*" }));
  byId("type").replaceChildren(element("option", "not one of these", null, { value: "" }), ...look.vehicles.map(({ id, name }) => element("option", name, null, { value: id })));
  if (look.logs.length > 1) byId("leave-log").value = literally(look.logs[0].name);
  saved = Boolean(look.existing && look.chosen);
}

// Restore the choices that are stored in rovid.toml, or that a file of the user's own makes.
function recall(chosen) {
  if (!chosen) return;
  if (chosen.axes === "planar") document.querySelector("input[name=axes][value=planar]").checked = true;
  [vehicle, title, size, stretches] = [chosen.vehicle ?? "", chosen.name ?? "", chosen.size ?? {}, chosen.leave_out ?? []];
  timeUnit = chosen.time_unit ?? "auto";
  rudders = chosen.rudders ?? {};
  for (const [name, place] of Object.entries(chosen.places ?? {})) thrusters.set(name, place);
  for (const [kind, those] of Object.entries(chosen.signals ?? {})) {
    for (const [name, { source, unit, sign }] of Object.entries(those)) put(kind, source, name, { unit, sign });
  }
  for (const [kind, those] of Object.entries(chosen.commands ?? {})) {
    for (const { source, name, arm } of those) {
      put(kind, source, "command", { name });
      if (theirs() && Number.isFinite(arm)) thrusters.set(name, { ...standing(name, arm, [...thrusters.values()]), arm, hand: true });
    }
  }
}

function put(kind, source, role, more = {}) {
  const known = role in ROLES ? role : "extra";
  columns.set(key(kind, source), { kind, source, role: known, name: known === "extra" ? role : "", unit: "", sign: 1, ...more });
}

// ---- the user's choices

const planar = () => document.querySelector("input[name=axes]:checked").value === "planar";

function choice({ asGuessed = false, of = logs } = {}) {
  const document = { logs: of, vehicle, name: title, size, time_unit: timeUnit, leave_out: stretches, places: Object.fromEntries(thrusters), rudders, axes: planar() ? "planar" : "" };
  if (asGuessed) return { ...document, signals: null, commands: null };
  const signals = {}, commands = {};
  for (const { kind, source, role, name, unit, sign } of columns.values()) {
    if (role === "command") {
      const { arm, hand, angle, placed } = thrusters.get(name) ?? {};
      (commands[kind] ??= []).push({ source, name, arm: hand ? arm : null, angle: placed ? angle : null });
    } else if (role) {
      (signals[kind] ??= {})[role === "extra" ? name : role] = { source, unit, sign };
    }
  }
  return { ...document, signals, commands };
}

// Get the draft of rovid.toml for the choices. With `asGuessed`, rovid's guesses become the choices.
// With `of`, only these logs are read, and nothing is checked yet.
async function refresh({ asGuessed = false, of = undefined, signal = undefined } = {}) {
  draft = await ask("draft", { body: choice({ asGuessed, of }), signal });
  const { signals, commands } = draft.survey;
  if (newType && vehicle) {
    // Motors that do not turn a vehicle of this type become unused, unless the user chose them.
    const idle = Object.entries(commands).flatMap(([kind, those]) => those.filter(({ told, turns, name }) => told && !turns && !thrusters.get(name)?.hand).map(({ source }) => [kind, source]));
    const left = idle.filter(([kind, source]) => !given.has(key(kind, source)) && columns.delete(key(kind, source)));
    newType = false;
    for (const [kind, source] of left) if (current()?.kind === kind) renewRow(kind, source);
    if (left.length) return refresh({ signal });
  }
  newType = false;
  if (asGuessed) {
    columns = new Map();
    for (const [kind, those] of Object.entries(signals)) {
      for (const [name, { source, unit, sign }] of Object.entries(those)) put(kind, source, name, { unit: unit ?? "", sign });
    }
    const turning = Object.values(commands).flat().some(({ turns }) => turns);
    for (const [kind, those] of Object.entries(commands)) {
      // If some commands are known to turn the vehicle, the user has to choose the others.
      for (const { source, name, turns, told } of those) if (turns || !told || !turning) put(kind, source, "command", { name });
    }
    for (const [id, one] of given) {
      if (one) only(one);
      columns.delete(id);
      if (one) columns.set(id, one);
    }
  }
  adoptArms();
  show();
  return of ? undefined : check();
}

// Thrusters that the user did not place get a position that fits the arm rovid assumes.
function adoptArms() {
  const named = Object.values(draft.survey.commands).flat();
  const inUse = new Set([...columns.values()].filter(({ role }) => role === "command").map(({ name }) => name));
  for (const name of [...thrusters.keys()]) if (!inUse.has(name)) thrusters.delete(name);
  const placed = [];
  for (const name of inUse) {
    const told = named.find((one) => one.name === name), arm = (told?.turns || 1) * (told?.arm ?? 1);
    if (!thrusters.get(name)?.hand) thrusters.set(name, { ...standing(name, arm, placed), arm, hand: false });
    placed.push(thrusters.get(name));
  }
}

const refreshSoon = soon((signal) => refresh({ signal }), 250);
let checking = false;
const checkSoon = soon(async (signal) => {
  const answer = await ask("check", { body: choice(), signal }).catch((error) => {
    checking = error.name === "AbortError"; // a newer check goes on
    throw error;
  });
  if (answer.stale) return check();
  [checked, checking] = [answer, false];
  return showCheck();
}, 350);

function check() {
  checking = true;
  byId("check-said").classList.add("stale");
  byId("check-said").classList.add("busy");
  if (!checked) byId("check-said").textContent = "Checking …";
  headlines();
  checkSoon();
}

function changed() {
  saved = false;
  trouble(null);
  if (!guessing) refreshSoon();
}

// ---- 2. columns

const plots = new Plots(byId("rows"), {
  picked: (from, to) => {
    byId("leave-log").value = literally(current().name);
    byId("leave-from").value = String(Math.max(0, +from.toFixed(2)));
    byId("leave-to").value = String(+to.toFixed(2));
    byId("leave").open = true;
    byId("leave-reason").focus();
    byId("leave").scrollIntoView({ block: "center" });
    hear(`${from.toFixed(1)} to ${to.toFixed(1)} s. Type a reason, then press Leave out.`);
  },
  stretches: () => stretches.filter(({ log }) => current() && isOf(current().name, log)).map(({ from, to }) => [from, to ?? Infinity]),
  needed: () => [...columns.values()].filter(({ role }) => role === "heading" || role === "command").sort((a) => (a.role === "heading" ? -1 : 1)).map(({ source }) => source),
  timeUnit: () => timeUnit,
  heading: () => [...columns.values()].find(({ role, kind }) => role === "heading" && kind === current()?.kind),
});
let shownColumns = [];
// Order of the plots: what a fit needs first.
const FIRST = ["heading", "command", "yaw_rate"];

const openLog = async () => {
  if (!byId("log").value) return;
  byId("columns-said").textContent = "Reading …";
  shownColumns = (await plots.open(byId("log").value)).columns;
  listColumns();
};

function sayColumns() {
  const used = shownColumns.filter(({ source }) => columns.get(key(current().kind, source))?.role || rudderOf(current().kind, source)).length;
  const shown = document.querySelectorAll("#rows .row").length;
  byId("columns-said").textContent = `${shown} of ${shownColumns.length} columns of this log are shown; in use: ${used}.`;
}

function listColumns() {
  const { kind } = current(), all = byId("which").value === "all";
  const roleOf = ({ source }) => columns.get(key(kind, source))?.role || (rudderOf(kind, source) ? "command" : "");
  const rank = (column) => (FIRST.indexOf(roleOf(column)) + FIRST.length + 1) % (FIRST.length + 1);
  const used = shownColumns.filter((column) => roleOf(column)).sort((a, b) => rank(a) - rank(b));
  const list = all || !used.length ? [...used, ...shownColumns.filter((column) => !roleOf(column))] : used;
  byId("rows").replaceChildren(...list.map((column) => columnRow(kind, column)));
  sayColumns();
  plots.place(document.querySelectorAll("#rows .chart"));
}

function columnRow(kind, { source, samples, lowest, highest }) {
  const row = element("div"), side = element("div", "", row), id = key(kind, source);
  const own = columns.get(id) ?? { kind, source, role: "", name: "", unit: "", sign: 1 };
  const rudder = rudderOf(kind, source);
  row.className = own.role || rudder ? "row used" : "row";
  element("h3", source, side);
  const line = element("div", "", side, { class: "line" });
  const role = element("select", "", line, { "aria-label": `What ${source} is` });
  for (const [value, words] of Object.entries(ROLES)) element("option", rudder && !value ? "angle of a rudder" : words, role, { value });
  role.value = own.role;
  role.disabled = theirs();
  role.addEventListener("change", () => {
    for (const each of turn(kind, source, role.value)) renewRow(kind, each);
    sayColumns();
    [...document.querySelectorAll("#rows select")].find((each) => each.getAttribute("aria-label") === `What ${source} is`)?.focus();
  });
  const units = look.units[own.role] ?? [];
  if (units.length) {
    const unit = element("select", "", line, { "aria-label": `Unit of ${source}` });
    for (const each of units) element("option", each, unit, { value: each });
    unit.value = own.unit || units[0];
    unit.disabled = theirs();
    unit.addEventListener("change", () => alter(id, { unit: unit.value }));
  }
  if (own.role && !["command", "extra", "supply_voltage"].includes(own.role)) {
    const label = element("label", "", line), turned = element("input", "", label, { type: "checkbox", checked: own.sign < 0, disabled: Boolean(theirs()) });
    label.append(" sign reversed");
    turned.addEventListener("change", () => alter(id, { sign: turned.checked ? -1 : 1 }));
  }
  const declared = own.unit || "";
  const range = samples ? `${tidy(lowest)} to ${tidy(highest)}, ${samples} readings` : "no numbers in this log";
  element("p", why(kind, source) || range, side, { class: "why soft" });
  element("div", "", row, { class: "chart", "data-source": source, "data-used": own.role || (rudder ? "command" : ""), "data-unit": declared || rudder?.unit || "", role: "img", "aria-label": `${source} over time: ${range}` });
  return row;
}

function alter(id, values) {
  given.set(id, Object.assign(columns.get(id), values));
  changed();
}

// Replace a row in place, because the rows must not move while the user chooses.
function renewRow(kind, source) {
  const before = [...document.querySelectorAll("#rows .row")].find((row) => row.querySelector(".chart").dataset.source === source);
  if (!before) return;
  const row = columnRow(kind, shownColumns.find((column) => column.source === source));
  before.replaceWith(row);
  plots.swap(before.querySelector(".chart"), row.querySelector(".chart"));
}

// rovid's reason for the role of a column.
function why(kind, source) {
  const { signals, commands } = draft?.survey ?? { signals: {}, commands: {} };
  const one = [...Object.values(signals[kind] ?? {}), ...(commands[kind] ?? [])].find((each) => each.source === source);
  const { role } = columns.get(key(kind, source)) ?? {}, words = (role ? one : rudderOf(kind, source))?.why ?? "";
  return role === "heading" && words ? `${words}; shown without jumps of whole turns` : words;
}

// Give a column a role. Returns the columns with a changed role.
function turn(kind, source, role) {
  const before = columns.get(key(kind, source)), others = [source];
  columns.delete(key(kind, source));
  if (role) {
    others.push(...only({ kind, role }));
    const name = role === "command" || role === "extra" ? nameFor(source) : "";
    put(kind, source, role, { name, unit: look.units[role]?.[0] ?? "" });
  }
  given.set(key(kind, source), columns.get(key(kind, source)) ?? null);
  hear(`${source}: ${ROLES[role]}${before?.role ? `, previously ${ROLES[before.role]}` : ""}.`);
  changed();
  return others;
}

// There is one heading and one gyro: the previous column of this role becomes unused. Returns the previous column.
function only({ kind, role }) {
  if (["command", "extra"].includes(role)) return [];
  const previous = [...columns].filter(([, one]) => one.kind === kind && one.role === role);
  for (const [id] of previous) columns.delete(id);
  return previous.map(([, { source }]) => source);
}

function nameFor(source) {
  const plain = source.split(/[^\p{L}\p{N}]+/u).filter(Boolean).join("_").toLowerCase() || "thruster";
  const taken = new Set([...columns.values()].map(({ name }) => name));
  let name = plain;
  for (let k = 2; taken.has(name); k++) name = `${plain}_${k}`;
  return name;
}

byId("log").addEventListener("change", openLog);
byId("which").addEventListener("change", listColumns);
byId("time-unit").addEventListener("change", () => {
  timeUnit = byId("time-unit").value;
  changed();
  return openLog();
});
for (const each of document.querySelectorAll("input[name=drag]")) {
  each.addEventListener("change", () => byId("signals").classList.toggle("leaves", each.value === "leave"));
}
const MOVES = { "zoom-in": () => plots.zoom(0.5), "zoom-out": () => plots.zoom(2), earlier: () => plots.pan(-0.4), later: () => plots.pan(0.4), whole: () => plots.all() };
for (const [id, act] of Object.entries(MOVES)) byId(id).addEventListener("click", act);

// ---- 3. vehicle

const sketch = new Sketch(byId("sketch"), (name, place) => moveThruster(name, place));

function moveThruster(name, { x, y, angle }) {
  if (theirs()) return;
  const one = { x, y, angle, hand: true, placed: true };
  one.arm = Math.round(armOf(one) * 1e4) / 1e4;
  thrusters.set(name, one);
  hear(`${name}: arm ${tidy(one.arm, 3)} m`);
  showThrusters();
  changed();
}

const sizeOf = (what) => size[what] ?? look?.vehicles.find(({ id }) => id === (vehicle || draft?.survey.vehicle?.type))?.[what] ?? null;

function drawSketch() {
  sketch.draw([...thrusters].map(([name, one]) => ({ name, ...one })), sizeOf("length"), sizeOf("width"));
}

function showThrusters() {
  drawSketch();
  const body = document.querySelector("#thruster-table tbody"), names = [...thrusters.keys()];
  // The fields stay while the thrusters are the same, because the user may be typing in one.
  if (names.join("\n") !== [...body.rows].map(({ dataset }) => dataset.name).join("\n")) {
    body.replaceChildren(...names.map(thrusterRow));
  }
  for (const row of body.rows) fillRow(row, thrusters.get(row.dataset.name));
  const unplaced = names.filter((name) => !thrusters.get(name).placed);
  byId("unplaced").textContent = unplaced.length ? `Drawn hollow at an assumed place, because the position is not known: ${unplaced.join(", ")}. ` : "";
  const notes = [];
  const every = Object.values(draft?.survey.commands ?? {}).flat();
  for (const [name, one] of thrusters) {
    const told = every.find((each) => each.name === name);
    const arm = theirs() ? "arm of rovid.toml" : one.hand ? "arm entered by you" : told?.arm ? "arm from the vehicle type" : "arm unknown: 1 m is used as a placeholder";
    notes.push(element("li", `${name}: ${arm}${told ? `; ${told.why}` : ""}`));
  }
  for (const one of allRudders()) {
    const item = element("li", `${one.name}: its angle is ${one.source}; ${one.why}. ${planar() ? "" : RUDDER_SIZES[one.size].words}: `);
    if (!planar()) rudderField(one, item).id = `t-rudder-${one.name}`;
    notes.push(item);
  }
  if (!notes.length) notes.push(element("li", "No thrusters yet: choose in the step Signals which columns command thrusters."));
  byId("senses").replaceChildren(...notes);
  byId("thruster-table").hidden = !thrusters.size;
}

const RUDDER_SIZES = {
  coefficient: { words: "Its coefficient, N m s²/(m² rad)", why: "is not in the logs. Without it inertia and drag have an unknown common scale; times and ratios are valid. Enter it in N m s²/(m² rad):" },
  wheelbase: { words: "Its wheelbase, m", why: "is estimated from these logs. Enter the measured wheelbase in m:" },
};
const allRudders = () => (theirs() ? [] : Object.values(draft?.survey.rudders ?? {}).flat());

// An input for the size of a rudder or of steered wheels: empty for what the logs show.
function rudderField({ name, size: what, value }, parent = null) {
  const attributes = { "aria-label": `${name}: ${what}`, inputmode: "decimal", size: 8, "data-asks": name, value: rudders[name] ?? "", placeholder: value ? String(value) : "" };
  const input = element("input", "", parent, attributes);
  input.addEventListener("change", () => {
    const size_ = typed(input.value), fine = size_ === null || size_ > 0;
    input.setAttribute("aria-invalid", String(!fine));
    if (!fine) return;
    if (size_ === null) delete rudders[name];
    else rudders[name] = size_;
    changed();
  });
  return input;
}

const FIELDS = { x: "ahead, m", y: "to starboard, m", angle: "direction, degrees from the bow", arm: "yaw arm, m" };
const shownAs = { x: (value) => value.toFixed(3), y: (value) => value.toFixed(3), angle: (value) => String(Math.round(value * 10) / 10), arm: (value) => String(+value.toPrecision(4)) };

function thrusterRow(name) {
  const row = element("tr", "", null, { "data-name": name });
  const field = (what, label, parent) => {
    const input = element("input", "", parent, { id: `t-${what}-${name}`, "aria-label": label, spellcheck: "false", autocomplete: "off", class: what, disabled: Boolean(theirs()) });
    input.addEventListener("change", () => typedInto(name, what, input));
    return input;
  };
  field("name", `Name of ${name}`, element("th", "", row, { scope: "row" })).value = name;
  for (const [what, words] of Object.entries(FIELDS)) field(what, `${name}: ${words}`, element("td", "", row, { "data-label": words })).inputMode = "decimal";
  element("button", "Reverse", element("td", "", row), { type: "button", disabled: Boolean(theirs()), "aria-label": `Reverse ${name}` }).addEventListener("click", () => {
    const one = thrusters.get(name);
    moveThruster(name, { ...one, angle: one.angle > 0 ? one.angle - 180 : one.angle + 180 });
  });
  return row;
}

function fillRow(row, one) {
  for (const what of Object.keys(FIELDS)) {
    const input = row.querySelector(`input.${what}`);
    if (input !== document.activeElement) input.value = shownAs[what](one[what]);
  }
}

function typedInto(name, what, input) {
  if (what === "name") return rename(name, input.value.trim());
  const value = typed(input.value), fine = value !== null && Number.isFinite(value);
  input.setAttribute("aria-invalid", String(!fine));
  if (!fine) return undefined;
  if (what !== "arm") return moveThruster(name, { ...thrusters.get(name), [what]: value });
  const before = [...thrusters].filter(([other, { hand }]) => hand && other !== name).map(([, one]) => one);
  thrusters.set(name, { ...standing(name, value, before), arm: value, hand: true });
  showThrusters();
  return changed();
}

function rename(name, next) {
  if (!next || next === name || thrusters.has(next)) {
    byId(`t-name-${name}`).value = name;
    return undefined;
  }
  for (const one of columns.values()) if (one.role === "command" && one.name === name) one.name = next;
  thrusters = new Map([...thrusters].map(([each, one]) => [each === name ? next : each, one]));
  showThrusters();
  return changed();
}

byId("type").addEventListener("change", () => {
  vehicle = byId("type").value;
  newType = true;
  size = {};
  for (const [name, one] of thrusters) if (!one.hand) thrusters.delete(name);
  changed();
});
byId("name").addEventListener("change", () => { title = byId("name").value.trim(); changed(); });
for (const what of SIZES) {
  byId(what).addEventListener("change", () => {
    const value = typed(byId(what).value), fine = value === null || value > 0;
    byId(what).setAttribute("aria-invalid", String(!fine));
    if (!fine) return;
    if (value === null) delete size[what];
    else size[what] = value;
    changed();
  });
}

// ---- 4. what to leave out

byId("leave-form").addEventListener("submit", (event) => {
  event.preventDefault();
  const from = typed(byId("leave-from").value) ?? 0, to = typed(byId("leave-to").value);
  const fine = Number.isFinite(from) && (to === null || to > from);
  for (const id of ["leave-from", "leave-to"]) byId(id).setAttribute("aria-invalid", String(!fine));
  if (!fine) return trouble("The end has to be later than the beginning, both in s from the beginning of the log.");
  stretches.push({ log: byId("leave-log").value, from, to, reason: byId("leave-reason").value.trim() });
  for (const id of ["leave-from", "leave-to", "leave-reason"]) byId(id).value = "";
  hear("The interval is left out.");
  showStretches();
  return changed();
});

function showStretches() {
  byId("leave-list").replaceChildren(...stretches.map((one, k) => {
    const end = one.to === null ? "end of log" : `${one.to} s`;
    const item = element("li", `${one.log}: ${one.from} s to ${end}${one.reason ? `, ${one.reason}` : ""} `);
    element("button", "Undo", item, { type: "button", "aria-label": `Undo ${one.log} ${one.from} s to ${end}` }).addEventListener("click", () => {
      stretches.splice(k, 1);
      showStretches();
      changed();
    });
    return item;
  }));
  plots.shade();
}

// ---- 5. check, 6. rovid.toml

function showCheck() {
  const { tasks, notes, caution, document } = checked;
  const said = byId("check-said"), more = byId("check-more");
  said.className = "";
  byId("despite-line").hidden = !noGo();
  said.replaceChildren(...(tasks.length ? [] : [element("p", "Nothing is to be done before a fit.")]));
  const list = element("ol", "", said);
  for (const task of tasks) list.append(advice(task));
  more.replaceChildren();
  if (document?.logs?.length) logTable(document.logs, more);
  if (caution) element("p", caution, more, { class: "guessed" });
  const fold = (title) => {
    const folded = element("details", "", more);
    element("summary", title, folded);
    return folded;
  };
  if (checked.spots?.length) {
    const folded = fold("Plots of the faults");
    folded.addEventListener("toggle", () => { for (const spot of checked.spots) drawSpot(spot, folded); }, { once: true });
  }
  if (notes.length) {
    const items = element("ul", "", fold(`${notes.length} more remark${notes.length > 1 ? "s" : ""}`));
    for (const note of notes) element("li", note, items);
  }
  headlines();
}

function logTable(rows, parent) {
  const table = element("table", "", element("div", "", parent, { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of logs" }));
  element("caption", "Logs", table);
  const head = element("tr", "", element("thead", "", table));
  for (const words of ["log", "s", "held commands", "sines", "Hz", "samples", "remarks"]) element("th", words, head, { scope: "col", class: words === "log" || words === "remarks" ? "" : "n" });
  const body = element("tbody", "", table);
  for (const one of rows) {
    const row = element("tr", "", body);
    element("th", one.name, row, { scope: "row" });
    for (const value of [one.duration.toFixed(0), one.held_commands, one.sine_runs, tidy(one.sample_rate, 3), one.samples]) element("td", String(value), row, { class: "n" });
    element("td", one.remarks.map(({ count, kind }) => `${count} ${kind}`).join(", ") || "none", row);
  }
}

function showToml() {
  const lines = (theirs() ? look.existing.text : draft.text).split("\n");
  byId("toml").replaceChildren(...lines.map((line) => {
    const kind = /OPEN:/.test(line) ? "open" : /_guessed/.test(line) ? "guess" : /^\s*#/.test(line) ? "remark" : "";
    return element("span", `${line}\n`, null, { class: kind });
  }));
  const button = byId("save-button");
  button.disabled = Boolean(theirs()) || saved;
  button.textContent = saved ? "Saved" : "Save rovid.toml";
  byId("save-words").textContent = theirs()
    ? `${look.existing.file} is your own file: this page did not write it, or the file was changed later. The page uses the file and does not replace it. To set up a new file here, move this one away.`
    : `Save writes ${[draft.file, ...draft.beside].join(" and ")}. Open questions and guesses are highlighted.`;
}

async function save() {
  byId("save-said").textContent = "";
  trouble(null);
  const { written } = await ask("save", { body: choice() });
  saved = true;
  look.existing = { file: written[0], text: draft.text };
  look.chosen = choice();
  byId("save-said").textContent = `Written: ${written.join(" and ")}.`;
  show();
}
byId("save-button").addEventListener("click", save);

// ---- run and result

// Follow the run. If the user opens another folder meanwhile, only the bar speaks of the run.
async function watch() {
  const own = choosing;
  running = true;
  headlines();
  try {
    for (;;) {
      const work = await ask("progress");
      if (own === choosing) showWork(work);
      else byId("run-short").textContent = `A run for the previous folder goes on: ${work.steps?.at(-1)?.text ?? ""}`;
      if (work.state !== "running") return;
      await new Promise((then) => { setTimeout(then, 500); });
    }
  } finally {
    running = false;
    headlines();
  }
}

const RUNS = { running: "Running for", done: "Done in", failed: "The run failed after", cancelled: "Cancelled after", none: "" };

function showWork({ key: begun, state, seconds, steps, done, total, error, warnings, report, page }) {
  const said = byId("run-said"), bar = byId("run-progress");
  if (said.dataset.state !== state || state === "running") said.textContent = RUNS[state] && `${RUNS[state]} ${Math.round(seconds)} s`;
  said.dataset.state = state;
  said.className = state === "running" ? "busy" : "";
  said.setAttribute("aria-live", state === "running" ? "off" : "polite");
  const list = byId("run-steps");
  for (const { after, text } of (steps ?? []).slice(list.children.length)) {
    element("li", `${Math.round(after)} s: ${text.replace(/: \S+ \d+ of .*/, " …")}`, list);
    hear(text);
  }
  byId("run-now").textContent = state === "running" ? steps.at(-1)?.text ?? "Starting …" : "";
  bar.hidden = state !== "running";
  if (total) Object.assign(bar, { max: total, value: done });
  else bar.removeAttribute("value");
  byId("run-error").hidden = !error;
  byId("run-error").textContent = error ?? "";
  byId("run-warnings").replaceChildren(...(warnings ?? []).map((text) => element("li", text)));
  if (state === "done") showReport(report, page);
  byId("cancel-button").hidden = state !== "running" || !begun;
  if (begun || state !== "running") headlines();
}

function showReport(report, file) {
  byId("report").hidden = !report;
  byId("no-report").hidden = Boolean(report);
  if (!report) return byId("report-frame").removeAttribute("src");
  // The address of a report has no token: a report is foreign content.
  byId("report-link").href = `/report/${report}`;
  byId("report-frame").src = `/report/${report}`;
  byId("report-file").textContent = file ?? "";
  return undefined;
}

const noGo = () => checked?.verdict === "no_go";

// What keeps the run from starting: {text, step, at}; null if nothing does.
function obstacle() {
  if (!draft) return { text: "Choose the folder that holds your logs.", step: "logs", at: "folder" };
  if (guessing) return { text: "All logs are being read.", step: "signals" };
  const asked = questions().find(({ needed }) => needed);
  if (asked) return { ...asked, text: asked.text.replace(/\. .*/, ".") };
  if (checking) return { text: "The check goes on.", step: "check" };
  if (noGo() && !byId("despite").checked) return { text: "The check says no go.", step: "check", at: "despite" };
  return null;
}

byId("run-button").addEventListener("click", async () => {
  const first = obstacle();
  if (first) {
    hear(first.text);
    return go(first.step, first.at);
  }
  if (running) return go("run");
  try {
    if (!theirs() && !saved) await save();
    byId("run-steps").replaceChildren();
    showReport(null);
    go("run");
    showWork({ state: "running", seconds: 0, steps: [] });
    await ask("run", { body: { logs, diagnosis: !byId("run-quick").checked, axes: planar() ? "planar" : "" } });
  } catch (error) {
    go("run");
    return showWork({ state: "failed", seconds: 0, steps: [], error: error.message });
  }
  const own = choosing;
  await watch();
  if (own === choosing && !byId("report").hidden && byId("run-said").dataset.state === "done") go("result", "report-link");
  return undefined;
});
byId("despite").addEventListener("change", () => headlines());
byId("cancel-button").addEventListener("click", () => ask("cancel", { body: {} }));

for (const each of document.querySelectorAll("input[name=axes]")) {
  each.addEventListener("change", () => {
    showReport(look?.reports[planar() ? "planar" : "yaw"]);
    changed();
  });
}

// ---- display

// The logs' open questions and advice: {text, step, at, needed, field}. `at` gives the element to go to, `field` makes an
// input that answers the question where it is asked.
function questions() {
  if (!draft || theirs()) return [];
  const senses = draft.survey.open.filter((what) => what.startsWith("sense of ")).map((what) => nameOf(what.replace("sense of ", "")));
  const asked = [];
  if (draft.survey.open.includes("heading")) asked.push({ text: "Which column is the heading?", step: "signals", at: firstRole, needed: true, field: headingField });
  if (draft.survey.open.includes("command")) asked.push({ text: "Which columns command thrusters?", step: "signals", at: firstRole, needed: true });
  if (senses.length > 2) {
    asked.push({ text: `The logs do not show which way ${senses.join(", ")} turn the vehicle. Choose the type of the vehicle; or enter their yaw arms; or mark the columns that do not turn it as not used.`, step: "thrusters", at: "type", needed: true });
  } else for (const name of senses) {
    asked.push({
      text: `The logs do not show which way ${name} turns the vehicle. Enter its yaw arm in m, positive if it turns the bow to starboard; or mark its column as not used.`,
      step: "thrusters", at: `t-arm-${name}`, needed: true, field: () => armField(name),
    });
  }
  const every = Object.values(draft.survey.commands).flat();
  const unknown = [...thrusters].filter(([name, { hand }]) => !hand && !every.find((one) => one.name === name)?.arm).map(([name]) => name);
  for (const name of unknown.filter((each) => !senses.includes(each)).slice(0, 4)) {
    asked.push({ text: `The yaw arm of ${name} is not known; 1 m is a placeholder. Enter it in m:`, step: "thrusters", at: `t-arm-${name}`, field: () => armField(name) });
  }
  for (const one of planar() ? [] : allRudders().filter(({ given: known }) => !known)) {
    asked.push({ text: `The ${one.size} of ${one.name} ${RUDDER_SIZES[one.size].why}`, step: "thrusters", at: `t-rudder-${one.name}`, field: () => rudderField(one) });
  }
  if (draft.survey.curve.guessed && thrusters.size) asked.push({ text: curveWords(), step: "thrusters", at: "curve" });
  return asked;
}

const nameOf = (source) => [...columns.values()].find((one) => one.source === source)?.name || source;
const firstRole = () => { showAll(); return [...document.querySelectorAll("#rows select")].find((each) => !each.value) ?? byId("which"); };

function showAll() {
  byId("which").value = "all";
  listColumns();
}

function armField(name) {
  const input = element("input", "", null, { "aria-label": `${name}: yaw arm, m`, inputmode: "decimal", size: 6, "data-asks": name });
  input.addEventListener("change", () => typedInto(name, "arm", input));
  return input;
}

function headingField() {
  const line = element("span", "", null, { class: "line" });
  const choice_ = element("select", "", line, { "aria-label": "Column of the heading" });
  for (const value of ["", ...shownColumns.map(({ source }) => source)]) element("option", value || "choose a column", choice_, { value });
  const unit = element("select", "", line, { "aria-label": "Unit of the heading" });
  for (const value of look.units.heading) element("option", value, unit, { value });
  choice_.addEventListener("change", () => {
    const { kind } = current();
    turn(kind, choice_.value, "heading");
    columns.get(key(kind, choice_.value)).unit = unit.value;
    listColumns();
  });
  return line;
}

// Where a sentence of the check leads to: the field of the thruster, column, size or log that it names.
function targetOf(text) {
  const named = (word) => new RegExp(`(^|[^\\p{L}\\p{N}_])${word.replace(/[.*+?^${}()|[\]\\]/g, "\\$&")}($|[^\\p{L}\\p{N}_])`, "u").test(text);
  const column = [...columns.values()].find(({ source }) => source.length > 1 && named(source));
  if (column) return { words: column.source, step: "signals", at: () => roleField(column.source) };
  if (text.includes("[signals] time")) return { words: "the unit of the time", step: "signals", at: "time-unit" };
  const log = look.logs.find(({ name }) => named(name));
  if (log) {
    return { words: log.name, step: "signals", at: () => {
      byId("log").value = log.path;
      openLog();
      return byId("log");
    } };
  }
  if (/\b(arms?|thruster|reverse|turns)\b/.test(text) || !/\bRun\b/.test(text)) {
    const thruster = [...thrusters.keys()].find(named);
    if (thruster) return { words: `thruster ${thruster}`, step: "thrusters", at: `t-arm-${thruster}` };
  }
  const what = SIZES.find((each) => named(each));
  if (what) return { words: what, step: "thrusters", at: what };
  if (/\bheading\b/.test(text)) {
    const one = [...columns.values()].find(({ role }) => role === "heading");
    if (one) return { words: one.source, step: "signals", at: () => roleField(one.source) };
  }
  return null;
}

const roleField = (source) => [...document.querySelectorAll("#rows select")].find((each) => each.getAttribute("aria-label") === `What ${source} is`) ?? byId("which");

// A line of advice with a link to its field.
function advice(text, target = targetOf(text), field = null) {
  const item = element("li");
  text.split("`").forEach((part, k) => (k % 2 ? element("code", part, item) : item.append(part)));
  item.append(" ");
  if (field) item.append(field(), " ");
  if (target) {
    const link = element("button", target.words ? `Go to ${target.words}` : "Go there", item, { type: "button", class: "link" });
    link.addEventListener("click", () => {
      go(target.step, target.at);
      headlines();
    });
  }
  return item;
}

// The first lines of the page: the next step for the user. `reading`: what is going on.
function headlines(reading = "") {
  const list = byId("now-list"), title_ = byId("now-title");
  const asked = questions(), needed = asked.filter((one) => one.needed), state = byId("run-said").dataset.state;
  const lines = asked.map((one) => [one.text, one, one.field]);
  let words, busy = false, verdict = "";
  if (reading) [words, busy] = [reading, true];
  else if (running) [words, busy] = ["Fitting and diagnosing …", true];
  else if (!draft) words = "Choose the folder that holds your logs.";
  else if (needed.length) {
    const rest = asked.length - needed.length, values = rest > 1 ? `${rest} values are` : "one value is";
    words = needed.length > 1 ? `${needed.length} questions are open` : "One question is open";
    words += rest ? `, and ${values} not measured.` : ".";
  }
  else if (state === "done" && (saved || theirs())) words = "Done: here is the report.";
  else if (state === "failed" && (saved || theirs())) {
    [words, verdict] = ["The run failed.", "no_go"];
    if (step !== "run") lines.unshift([byId("run-error").textContent, { step: "run", words: "the run" }]);
  } else if (checking) [words, busy] = ["Checking the logs …", true];
  else if (checked) {
    ({ words, verdict } = checked);
    // The step "check" has the whole list. The arms are asked for above.
    const armsAsked = asked.some(({ step: place }) => place === "thrusters");
    const tasks = checked.tasks.filter((text) => !(armsAsked && /^Measure yaw_arm/.test(text)));
    if (step !== "check") {
      // The plots stay near the top.
      // The reason of a "no go" precedes the questions.
      lines[noGo() ? "unshift" : "push"](...tasks.slice(0, 1).map((text) => [text]));
      const more = tasks.length - 1;
      if (more > 0) lines.push([`${more} more ${more > 1 ? "points" : "point"} of the check.`, { step: "check", words: "the check" }]);
    }
  } else [words, busy] = ["Reading the logs …", true];
  if (title_.textContent !== words) title_.textContent = words;
  title_.className = busy ? "busy" : verdict;
  // An input that the user is typing into stays.
  if (!list.contains(document.activeElement) || document.activeElement.tagName !== "INPUT") {
    list.replaceChildren(...(reading || running || state === "done" ? [] : lines).map((each) => advice(...each)));
  }
  mark("logs", draft ? "done" : "");
  mark("signals", needed.some((one) => one.step === "signals") ? "open" : draft ? "done" : "");
  mark("thrusters", asked.some((one) => one.step === "thrusters") ? "open" : draft ? "done" : "");
  mark("check", checked && !checking ? (noGo() ? "open" : "done") : "");
  mark("run", running ? "" : { done: "done", failed: "open" }[state] ?? "");
  mark("result", byId("report").hidden ? "" : "done");
  byId("run-button").hidden = running;
  byId("run-button").classList.toggle("waits", Boolean(obstacle()));
  if (!running || byId("run-now").textContent) byId("run-short").textContent = running ? byId("run-now").textContent : obstacle()?.text ?? "";
}
document.getElementById("steps").addEventListener("click", () => headlines(draft || !look ? "" : "Reading the logs …"));

function curveWords() {
  const { file, guessed } = draft.survey.curve;
  const what = draft.survey.vehicle?.guessed && file !== "thrust_guess.csv" ? "the curve of the vehicle type, which is a guess" : "a guess: thrust proportional to the command";
  const mend = "To replace it, put a CSV with the columns command,thrust_N next to the logs.";
  return file ? `Thrust curve: ${file}${guessed ? `, ${what}. ${mend}` : "."}` : "";
}

function show() {
  byId("name").value = title;
  byId("name").placeholder = draft.text.match(/^name = "(.*)"$/m)?.[1] ?? "";
  for (const what of SIZES) {
    byId(what).value = size[what] ?? "";
    byId(what).placeholder = sizeOf(what) ?? "not known";
  }
  for (const id of ["type", "name", "time-unit", ...SIZES]) byId(id).disabled = Boolean(theirs());
  showTimeUnit();
  showThrusters();
  if (shownColumns.length) for (const row of document.querySelectorAll("#rows .row")) {
    const { source } = row.querySelector(".chart").dataset, text = why(current().kind, source);
    if (text) row.querySelector(".why").textContent = text;
  }
  byId("curve").textContent = curveWords();
  const type = !vehicle && look.vehicles.find(({ id }) => id === draft.survey.vehicle?.type);
  byId("type").options[0].textContent = type ? `from the logs: ${type.name}` : "not one of these";
  byId("not-read").replaceChildren(...draft.survey.warnings.map((text) => element("li", text)));
  byId("run-words").textContent = `The run ${theirs() ? `uses ${look.existing.file}` : "saves rovid.toml"}, fits inertia and drag, looks for the causes of what the model gets wrong, and writes the report.`;
  byId("axes").hidden = !draft.planar.length && !planar();
  byId("axes-why").textContent = draft.planar.length ? `The logs hold ${draft.planar.join(", ").replaceAll("_", " ")}.` : "";
  for (const place of document.querySelectorAll(".theirs")) {
    place.hidden = !theirs();
    place.textContent = `The page shows ${look.existing?.file} and does not change it, because this page did not write it. To change a value, edit the file and open the folder again.`;
  }
  showToml();
  byId("commands").replaceChildren(...draft.commands.flatMap(({ what, line }) => {
    const value = element("dd");
    element("code", line, value);
    const button = element("button", "Copy", value, { type: "button", "aria-label": `Copy ${line}` });
    button.addEventListener("click", () => copy(line, button));
    return [element("dt", what), value];
  }));
  headlines();
}

// The unit of a time column: as its name or its values show, or as chosen.
function showTimeUnit() {
  const { time } = draft.survey, guessed = time?.why ? `${time.unit} (a guess)` : "the unit of the log";
  byId("time-label").hidden = !time;
  byId("time-unit").replaceChildren(...["auto", "s", "ms", "us", "ns"].map((unit) => element("option", unit === "auto" ? guessed : unit, null, { value: unit })));
  byId("time-unit").value = timeUnit;
}

// ---- start

for (const button of document.querySelectorAll("[data-copy]")) {
  button.addEventListener("click", () => copy(document.querySelector(button.dataset.copy).textContent, button));
}
byId("folder-form").addEventListener("submit", (event) => {
  event.preventDefault();
  choose([byId("folder").value.trim().replace(/\/+$/, "")]);
});

async function entries(item, ahead = "") {
  if (item.isFile) return [{ name: ahead + item.name, file: await new Promise((then, not) => { item.file(then, not); }) }];
  const reader = item.createReader(), found = [];
  for (;;) {
    const some = await new Promise((then, not) => { reader.readEntries(then, not); });
    if (!some.length) break;
    for (const each of some) found.push(...await entries(each, `${ahead}${item.name}/`));
  }
  return found;
}

async function upload(dropped) {
  let folder = "", count = 0;
  const isLog = ({ name }) => begun.formats.some((suffix) => name.toLowerCase().endsWith(suffix));
  const files = dropped.filter(isLog), refused = dropped.filter((each) => !isLog(each)).map(({ name }) => name);
  const said = [refused.length ? `Not copied, because these are not logs: ${refused.slice(0, 5).join(", ")}${refused.length > 5 ? ", …" : ""}.` : ""];
  for (const { name, file } of files) {
    byId("drop-said").textContent = `Copying ${name} (${count + 1} of ${files.length}) …`;
    try {
      const done = await ask(`upload?${new URLSearchParams({ name, folder })}`, { raw: file });
      folder = done.folder;
      count += 1;
    } catch (error) {
      said.push(error.message);
    }
  }
  byId("drop-said").textContent = `${count} of ${files.length} copied${folder ? ` into ${folder}` : ""}. ${said.slice(0, 4).join(" ")}`;
  if (count) {
    byId("folder").value = folder;
    await choose([folder]);
  }
}
for (const id of ["files", "directory"]) {
  byId(id).addEventListener("change", () => upload([...byId(id).files].map((file) => ({ name: file.webkitRelativePath || file.name, file }))));
}
const drop = byId("drop");
for (const type of ["dragenter", "dragover"]) {
  drop.addEventListener(type, (event) => { event.preventDefault(); drop.classList.add("over"); });
}
drop.addEventListener("dragleave", () => drop.classList.remove("over"));
drop.addEventListener("drop", async (event) => {
  event.preventDefault();
  drop.classList.remove("over");
  const items = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  upload((await Promise.all(items.map((item) => entries(item)))).flat());
});

const begun = await ask("start");
byId("where").textContent = begun.folder;
byId("top").textContent = begun.folder;
drop.hidden = !begun.uploads;
go("logs");
headlines();
folders("");
if (begun.logs.length) {
  byId("folder").value = begun.logs[0];
  await choose(begun.logs);
}
const before = await ask("progress");
if (before.state === "running") {
  go("run");
  watch();
}
