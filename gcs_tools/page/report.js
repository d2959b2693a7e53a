"use strict";
// The report of one flight, or of two compared.

const flights = JSON.parse(document.getElementById("data").textContent);
const [flight, other] = flights;
const byId = (id) => document.getElementById(id);

function fillTable(table, head, rows) {
  const cells = (kind, values) => values.map((value) => {
    const cell = document.createElement(kind);
    if (value?.text !== undefined) { cell.textContent = value.text; cell.className = value.kind; } else cell.textContent = value;
    return cell;
  });
  if (head) {
    const row = table.createTHead().insertRow();
    row.append(...cells("th", head));
  }
  const body = table.createTBody();
  for (const { values, time_s } of rows) {
    const row = body.insertRow();
    row.append(...cells("td", values));
    if (time_s !== undefined) {
      row.dataset.time = time_s;
      row.tabIndex = 0;
      row.addEventListener("click", () => seek(time_s));
      row.addEventListener("keydown", (event) => { if (event.key === "Enter") seek(time_s); });
    }
  }
  if (!rows.length) body.insertRow().append(...cells("td", [{ text: "none", kind: "faint" }]));
}

const seconds = (time) => `${time.toFixed(2)} s`;
const held = (holds) => (holds ? { text: "held", kind: "good" } : { text: "failed", kind: "bad" });

// ---------------------------------------------------------------- in words

document.title = flights.map(({ name, outcome }) => `${name}: ${outcome}`).join("; ");
flights.forEach(({ name, outcome, succeeded, reason }, i) => {
  const one = byId("flights").appendChild(Object.assign(document.createElement("div"), { className: "one" }));
  const kind = succeeded ? "good" : outcome === "held" || outcome === "arrived" ? "warn" : "bad";
  const add = (tag, rest) => one.appendChild(Object.assign(document.createElement(tag), rest));
  const heading = add("h1", { textContent: name });
  if (other) heading.prepend(Object.assign(document.createElement("i"), { className: i ? "dashed" : "solid" }));
  add("span", { id: i ? "other-verdict" : "verdict", className: `verdict ${kind}`, textContent: outcome.toUpperCase() });
  add("span", { id: i ? "other-reason" : "reason", textContent: reason });
});
byId("flights").append(Object.assign(document.createElement("span"), { id: "began", className: "faint", textContent: flight.origin[0][1] }));
for (const { problems } of flights) for (const problem of problems) {
  byId("problems").append(Object.assign(document.createElement("p"), { className: "problem", textContent: problem }));
}
fillTable(byId("facts"), other && ["", flight.name, other.name],
  [...(other ? [["outcome", flight.outcome]] : []), ...flight.facts].map(([name, value]) => ({
    values: other ? [name, value, name === "outcome" ? other.outcome : new Map(other.facts).get(name) ?? ""] : [name, value] })));
// Columns without a value in any step are omitted.
const columns = [
  ["time", (step) => (step.end_s === null ? seconds(step.time_s) : `${seconds(step.time_s)} to ${seconds(step.end_s)}`)],
  ["obstacle", (step) => step.obstacle],
  ["plan", (step) => step.kind],
  ["side", (step) => step.side ?? ""],
  ["planned in", (step) => (step.plan_time_ms == null ? "" : `${step.plan_time_ms.toFixed(1)} ms`)],
  ["pre-condition", (step) => held(step.pre_condition)],
  ["post-condition", (step) => (step.end_s === null ? { text: "never reached", kind: "bad" } : held(step.post_condition))],
  ["least clearance", (step) => (step.clearance_m == null ? "" : `${step.clearance_m.toFixed(2)} m`)],
].filter(([, cell]) => !flight.steps.length || flight.steps.some((step) => cell(step) !== ""));
fillTable(byId("steps"), columns.map(([name]) => name),
  flight.steps.map((step) => ({ time_s: step.time_s, values: columns.map(([, cell]) => cell(step)) })));
byId("movers-panel").hidden = !flight.movers.length;
fillTable(byId("movers"), ["mover", "class", "seen from", "to", "at most", "yielded for it"],
  flight.movers.map(({ id, kind, first_s, last_s, speed_max_mps, yielded_s }) => ({ time_s: first_s, values: [
    id, kind, seconds(first_s), seconds(last_s), `${speed_max_mps.toFixed(1)} m/s`, yielded_s ? seconds(yielded_s) : ""] })));
fillTable(byId("margins"), ["since", "clause", "required", "declared", "margin", ""],
  flight.margins.flatMap(({ time_s, clauses }) => clauses.map((clause) => ({ time_s, values: [
    seconds(time_s), clause.name.replaceAll("_", " "), clause.required.toFixed(2), `${clause.declared.toFixed(2)} ${clause.unit}`,
    { text: `${clause.margin.toFixed(2)} ${clause.unit}`, kind: clause.holds ? "good" : "bad" }, held(clause.holds)] }))));
fillTable(byId("events"), ["time", "", "what"], flight.events.map(({ time_s, severity, text }) => ({ time_s, values: [
  seconds(time_s), { text: severity, kind: { critical: "bad", error: "bad", warning: "warn" }[severity] ?? "faint" }, text] })));
fillTable(byId("origin"), null, flight.origin.map((values) => ({ values })));

// ---------------------------------------------------------------- pictures

const { path: own, truth } = flight;
const span = [Math.min(...flights.map(({ span_s }) => span_s[0])), Math.max(...flights.map(({ span_s }) => span_s[1]))];
const pairs = ({ north_m, east_m }) => north_m.map((north, i) => [north, east_m[i]]).filter(([north]) => north !== null);
const triples = ({ north_m, east_m, height_m }) => north_m.map((north, i) => [north, east_m[i], height_m[i]]).filter(([north]) => north !== null);
const reference = { north_m: own.reference_north_m, east_m: own.reference_east_m, height_m: own.reference_height_m };

const map = new FlightMap(byId("map"), flight.radius_m);
map.line("legs", "leg", flight.legs_ned_m);
map.line("ahead", "ahead", pairs(own));
map.line("reference", "reference", pairs(reference));
if (other) {
  map.line("others", "other", pairs(other.path));
  byId("other-legend").hidden = false;
  byId("other-name").textContent = other.name;
}
const moverLayer = new MoverLayer(map);
// Where each mover was seen, over time: middles of its boxes.  Where it could not have gone from one
// to the next, its name has been given to another, and another way begins.
const moverWays = [];
const wayOf = new Map();
for (const { movers } of flight.mover_moments) for (const { id, seen_s, speed_max_mps, box_m } of movers) {
  const place = [(box_m[0] + box_m[1]) / 2, (box_m[2] + box_m[3]) / 2];
  const before = wayOf.get(id)?.at(-1);
  if (before?.seen_s === seen_s) continue;
  const far = before && Math.hypot(place[0] - before.place[0], place[1] - before.place[1]) > speed_max_mps * (seen_s - before.seen_s) + 1;
  if (!before || far) { wayOf.set(id, []); moverWays.push(wayOf.get(id)); }
  wayOf.get(id).push({ seen_s, place });
}
for (const legend of document.querySelectorAll(".movers-legend")) legend.hidden = !flight.movers.length;
byId("true-movers-legend").hidden = !flight.true_movers.length;
map.outlines("field", "true-obstacle", flight.field_ned_m);
byId("field-legend").hidden = !flight.field_ned_m.length;
map.goal(flight.legs_ned_m.at(-1));
// Every obstacle that was ever known, as it was known last.
const latest = [...new Map(flight.obstacles.map((obstacle) => [obstacle.id, obstacle])).values()];
map.frame([...pairs(own), ...flight.legs_ned_m, ...moverWays.flat().map(({ place }) => place), ...latest.flatMap(({ region_ned_m }) => region_ned_m), ...(other ? pairs(other.path) : [])]);

const everything = [...flights.flatMap(({ path }) => triples(path)), ...latest.flatMap(({ region_ned_m }) => region_ned_m.map(([n, e]) => [n, e, 0]))];
const bounds = [Infinity, -Infinity].map((start, i) => [0, 1, 2].map((axis) => everything.reduce((found, point) => Math[i ? "max" : "min"](found, point[axis]), start)));
const space = new Space(byId("space"), everything.length ? bounds : [[0, 0, 0], [1, 1, 1]]);
for (const { measured_ned_m, region_ned_m, down_m } of latest) {
  const top = down_m?.[0] ?? null;
  space.prism(measured_ned_m, top === null ? flight.height_m + 1 : Math.min(flight.height_m + 1, -top), "obstacle");
  if (region_ned_m.length) space.lines.push({ points: [...region_ned_m, region_ned_m[0]].map(([n, e]) => [n, e, 0]), kind: "region", dash: [6, 4] });
}
for (const way of moverWays) space.lines.push({ points: way.map(({ place: [n, e] }) => [n, e, 0]), kind: "mover", width: 2, dash: [2, 3] });
for (const { path_ned_m } of flight.plans) space.lines.push({ points: path_ned_m.map(([n, e, d]) => [n, e, -d]), kind: "reference", width: 4 });
space.lines.push({ points: triples(own).map(([n, e]) => [n, e, 0]), kind: "rule", width: 3 });
space.lines.push({ points: triples(own), kind: "flown", width: 2 });
if (other) space.lines.push({ points: triples(other.path), kind: "fourth", dash: [5, 3] });

// The same quantity of both flights; the second is dashed and has its own colour.
const ofOther = { flown: "fourth", third: "reference", reference: "obstacle" };
function both(label, colour, values, time = (one) => one.path.time_s) {
  return flights.map((one, i) => ({
    label: other ? `${label} (${one.name})` : label, colour: i ? ofOther[colour] : colour, dashed: i > 0,
    time: time(one), values: values(one) ?? [] }));
}
const limit = (label, value) => (value === null ? [] : [{ label, value }]);
const { limits } = flight;
const common = { phases: flight.phases, span, seek };
const ofTruth = (one) => one.truth.time_s;
// Two flights are compared with each other, one flight with its reference.
const flownAndReference = (key) => [...(other ? [] : both("reference", "reference", (f) => f.path[`reference_${key}`])), ...both("flown", "flown", (f) => f.path[key])];
const clauseColours = ["flown", "reference", "third", "fourth", "lane", "obstacle", "faint", "ink"];
const charts = [
  { title: "Tracking error", unit: "m", zero: true, series: both("horizontal", "flown", (f) => f.path.tracking_error_m), limits: limit("E_tr of the contract", limits.tracking_error_m) },
  { title: "Clearance to the nearest obstacle", unit: "m", zero: true, series: [...both("as the daemon knew", "reference", (f) => f.known.clearance_m, (f) => f.known.time_s), ...both("ground truth", "flown", (f) => f.truth.clearance_m, ofTruth)] },
  { title: "Contract used: required as a share of declared", unit: "%", zero: true, series: flight.clauses.map(({ name, values }, i) => ({ label: name.replaceAll("_", " "), colour: clauseColours[i % clauseColours.length], time: flight.clause_times_s, values })), limits: [{ label: "all of it", value: 100 }] },
  { title: "Position north", unit: "m", series: flownAndReference("north_m") },
  { title: "Position east", unit: "m", series: flownAndReference("east_m") },
  { title: "Altitude", unit: "m", series: flownAndReference("height_m") },
  { title: "Velocity north", unit: "m/s", series: flownAndReference("north_mps"), limits: limit("cruise", limits.cruise_speed_mps) },
  { title: "Velocity east", unit: "m/s", series: flownAndReference("east_mps") },
  { title: "Velocity upwards", unit: "m/s", series: flownAndReference("up_mps") },
  { title: "Tilt", unit: "°", series: [...both("roll", "flown", (f) => f.path.roll_deg), ...both("pitch", "third", (f) => f.path.pitch_deg)],
    limits: [...limit("largest in a plan", limits.roll_max_deg), ...limit("", limits.roll_max_deg === null ? null : -limits.roll_max_deg)] },
  { title: "Heading", unit: "°", series: both("yaw", "flown", (f) => f.path.yaw_deg), least: 10 },
  { title: "Rotor speeds, ground truth", unit: "RPM", series: ["flown", "reference", "third", "fourth"].map((colour, i) => ({ label: `${i + 1}`, colour, time: truth.time_s, values: truth.rpm[i] ?? [] })) },
  { title: "Velocity error along the leg, in cruise", unit: "m/s", zero: true, series: both("largest", "flown", (f) => f.path.velocity_error_along_mps), limits: limit("allowed", limits.velocity_error_along_mps) },
  { title: "Velocity error across the leg, in cruise", unit: "m/s", zero: true, series: both("largest", "flown", (f) => f.path.velocity_error_across_mps), limits: limit("allowed", limits.velocity_error_across_mps) },
  { title: "Age of the newest detections", unit: "s", zero: true, series: both("oldest in 0.4 s", "flown", (f) => f.path.detection_age_s), limits: limit("allowed", limits.frame_age_max_s) },
  { title: "Time to plan", unit: "ms", zero: true, series: [{ label: "each plan", colour: "flown", dots: true, time: flight.plans.map((p) => p.time_s), values: flight.plans.map((p) => p.plan_time_ms) }] },
].map((options) => new Chart(byId("charts"), { ...common, ...options }));
const band = new Band(byId("band"), flight.phases, flight.steps, span, seek);

// ---------------------------------------------------------------- replay

const slider = byId("time");
slider.min = span[0];
slider.max = span[1];
let shownObstacles = null;
const NOTHING_SEEN = { corner_ned_m: [0, 0], heading_rad: 0, cell_m: 1, row: [], column_from: [], column_to: [], way_to_rest_ned_m: [], guide_ned_m: [] };
let shownSeen = NOTHING_SEEN;
let shownMarks = 0;
const NO_MOVERS = { yielding: null, movers: [], stamp_error_s: 0 };
const NOT_FREE = { corner_ned_m: [0, 0], cell_m: 1, row: [], column_from: [], column_to: [] };

// Draw what moves at a time; return what was known of it then.
function showMovers(time) {
  const known = flight.mover_moments.findLast(({ time_s }) => time_s <= time) ?? NO_MOVERS;
  moverLayer.show(known.movers, known.renewed ? known.time_s : time, known.stamp_error_s);
  moverLayer.free(flight.mover_moments.findLast(({ time_s, free }) => free && time_s <= time)?.free ?? NOT_FREE);
  moverLayer.trails("mover-way", moverWays.map((way) => way.filter(({ seen_s }) => seen_s <= time).map(({ place }) => place)));
  map.outlines("true-movers", "true-mover", flight.true_movers.map(({ half_m, time_s, places_ned_m }) => {
    const [north, east] = places_ned_m[indexAt(time_s, time)];
    return cornersOf([north - half_m, north + half_m, east - half_m, east + half_m]);
  }));
  return known;
}

function phaseWords(phase, { pause }, moving) {
  if (phase === "yield" && moving.yielding) return `yield ${yieldWords(moving)}`;
  return pause && !pause.startsWith("yielding") ? `${phase}: ${pause}` : phase;
}

function show(time) {
  const i = indexAt(own.time_s, time);
  if (own.time_s.length) {
    map.vehicle(own.north_m[i], own.east_m[i], own.yaw_rad[i]);
    map.line("flown", "flown", pairs({ north_m: own.north_m.slice(0, i + 1), east_m: own.east_m.slice(0, i + 1) }));
  }
  if (other?.path.time_s.length) {
    const j = indexAt(other.path.time_s, time);
    map.vehicle(other.path.north_m[j], other.path.east_m[j], other.path.yaw_rad[j], "other-vehicle");
  }
  const known = flight.obstacles.filter((o) => o.since_s <= time && (o.until_s === null || time < o.until_s));
  if (known.length !== shownObstacles?.length || known.some((o, k) => o !== shownObstacles[k])) {
    map.obstacles(known);
    shownObstacles = known;
    const ids = new Set(known.map(({ id }) => id));
    const elsewhere = latest.filter(({ id }) => !ids.has(id));
    map.outlines("others-seen", "seen-elsewhere", elsewhere.map(({ measured_ned_m }) => measured_ned_m));
    byId("seen-legend").hidden = !elsewhere.length;
  }
  const plan = flight.plans.findLast(({ time_s, end_s }) => time_s <= time && time <= end_s);
  map.line("plan", "plan", plan?.path_ned_m ?? []);
  const seen = flight.seen_spaces.findLast(({ time_s }) => time_s <= time) ?? NOTHING_SEEN;
  if (seen !== shownSeen) { map.seen(seen); shownSeen = seen; }
  const moving = showMovers(time);
  const past = flight.marks.filter(({ time_s }) => time_s <= time + 1e-6);
  if (past.length !== shownMarks) {
    map.marks(past);
    shownMarks = past.length;
    byId("why").hidden = !past.length;
    byId("why").className = `why ${past.at(-1)?.kind ?? ""}`;
    if (past.length) byId("why").textContent = `${past.at(-1).time_s.toFixed(1)} s: ${past.at(-1).text}`;
  }
  space.marks = own.north_m[i] == null ? [] : [{ point: [own.north_m[i], own.east_m[i], own.height_m[i]], kind: "flown" }];
  for (const { box_m: [n0, n1, e0, e1] } of moving.movers) space.marks.push({ point: [(n0 + n1) / 2, (e0 + e1) / 2, 0], kind: "mover" });
  space.draw();
  for (const chart of charts) chart.at(time);
  band.at(time);
  const phase = flight.phases.findLast(({ start_s, end_s }) => start_s <= time + 1e-6 && time <= end_s)?.phase ?? "";
  const metres = (value) => (value == null ? "–" : value.toFixed(1));
  const words = [`${time.toFixed(1)} s`, phaseWords(phase, seen, moving), `north ${metres(own.north_m[i])} m`, `east ${metres(own.east_m[i])} m`, `height ${metres(own.height_m[i])} m`];
  byId("readout").replaceChildren(...words.map((textContent) => Object.assign(document.createElement("span"), { textContent, className: textContent.length > 30 ? "long" : "" })));
}

// Whether the reader has chosen a time: the replay begins at the start otherwise.
let moved = false;

function seek(time) {
  moved = true;
  const within = Math.min(Math.max(time, span[0]), span[1]);
  slider.value = within;
  show(Number(slider.value));
}

let playing = null;
function stop() { playing = null; byId("play").textContent = "Play"; }
function step(now) {
  if (playing === null) return;
  const time = Number(slider.value) + (now - playing) / 1000 * Number(byId("rate").value);
  playing = now;
  seek(time);
  if (time >= span[1]) stop(); else requestAnimationFrame(step);
}
byId("play").addEventListener("click", () => {
  if (playing !== null) { stop(); return; }
  if (!moved || Number(slider.value) >= span[1]) seek(span[0]);
  playing = performance.now();
  byId("play").textContent = "Pause";
  requestAnimationFrame(step);
});
slider.addEventListener("input", () => { stop(); seek(Number(slider.value)); });
seek(flight.opens_at_s);
moved = false;
document.documentElement.dataset.ready = "true";
