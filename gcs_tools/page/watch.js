"use strict";
// The live view: draws the daemon's messages as they arrive.

const byId = (id) => document.getElementById(id);
const map = new FlightMap(byId("map"), 0.3);
const SILENCE_MS = 1500;
const EVENTS_KEPT = 200;
const TRAIL_POINTS = 5000;
const moverLayer = new MoverLayer(map);
// What is known of movers; and where and when the vehicle was last.
let moving = null;
let latest = null;
// Farther than this movers would make everything else too small.
const MOVER_SHOWN_M = 20;
const MOVERS_LISTED = 20;
const trail = [];
let around = [];
let heard = null;
// Farther than this the goal would make everything else too small: its distance is told.
const GOAL_SHOWN_M = 60;
// What the badge's reason is made of.
const why = { phase: "", hold: "", pause: "", yielding: "", avoided: "", missing: [] };

function row(table, values, kinds = []) {
  const added = table.insertRow();
  values.forEach((value, i) => { const cell = added.insertCell(); cell.textContent = value; if (kinds[i]) cell.className = kinds[i]; });
  return added;
}

const number = (value, digits = 2) => (value == null ? "–" : value.toFixed(digits));

function showReason() {
  const { phase, hold, pause, yielding, avoided, missing } = why;
  const lack = missing.length > 1 ? `${missing[0].text} (and ${missing.length - 1} more)` : missing[0]?.text;
  const reasons = { hold, pause, yield: yielding, avoid: avoided, standby: lack ?? "nothing is missing" };
  byId("reason").textContent = reasons[phase] ?? "";
}

function showBattery(charge) {
  const battery = byId("battery");
  battery.textContent = charge == null ? "battery unknown" : `battery ${(100 * charge).toFixed(0)} %`;
  battery.className = charge == null ? "faint" : charge < 0.2 ? "bad" : charge < 0.35 ? "warn" : "";
}

// What moves, as it may be at a time: on the map, and as a table.
function showMovers() {
  if (moving === null || latest === null) return;
  const { time, place } = latest;
  const { movers, stamp_error_s, missing, left_out } = moving;
  const drawn = moverLayer.show(movers, time, stamp_error_s);
  const table = byId("movers");
  table.replaceChildren();
  row(table, ["mover", "class", "away", "seen", "at most", ""]);
  for (const { id, kind, seen_s, speed_max_mps, now, yields_for } of drawn.slice(0, MOVERS_LISTED)) {
    row(table, [id, kind, `${awayFrom(place, now).toFixed(1)} m`, `${Math.max(time - seen_s, 0).toFixed(1)} s ago`, `${speed_max_mps.toFixed(1)} m/s`, yields_for ? "yields for it" : ""], ["", "", "", "", "", "warn"]);
  }
  if (!drawn.length) row(table, ["none is seen"], ["faint"]);
  const more = Math.max(drawn.length - MOVERS_LISTED, 0) + left_out;
  if (more) row(table, [`and ${more} more, farther away`], ["faint"]);
  byId("movers-missing").hidden = !missing;
  byId("movers-missing").textContent = missing ? `no place is known to hold no mover: ${missing}` : "";
}

const show = {
  declared({ radius_m, detection_range_m, field_of_view_rad }) { map.declare(radius_m, detection_range_m, field_of_view_rad); },

  departure({ waiting, missing }) {
    why.missing = missing;
    byId("departure").hidden = !waiting;
    byId("missing").replaceChildren(...missing.map(({ text, cure }) => {
      const line = document.createElement("li");
      line.append(Object.assign(document.createElement("span"), { className: "warn", textContent: text }));
      if (cure) line.append(Object.assign(document.createElement("span"), { className: "faint", textContent: ` → ${cure}` }));
      return line;
    }));
    if (!missing.length) byId("missing").append(Object.assign(document.createElement("li"), { className: "good", textContent: "nothing is missing" }));
    showReason();
  },

  trail({ points_ned_m }) {
    trail.splice(0, trail.length, ...points_ned_m);
    map.line("flown", "flown", trail);
  },

  status(status) {
    heard = performance.now();
    byId("phase").textContent = status.phase.toUpperCase();
    byId("phase").className = `verdict ${{ hold: "warn", yield: "warn", standby: "faint" }[status.phase] ?? "good"}`;
    why.phase = status.phase;
    showReason();
    showBattery(status.battery_charge);
    byId("virtual").textContent = status.virtual_obstacles ? "VIRTUAL OBSTACLES: real ones are not seen" : "";
    byId("mode").textContent = `${status.mode ?? "no mode"}, ${status.armed ? "armed" : "disarmed"}`;
    if (status.position_ned_m) {
      const [north, east, down] = status.position_ned_m;
      const [vn, ve] = status.velocity_ned_mps;
      trail.push(status.position_ned_m);
      if (trail.length > TRAIL_POINTS) trail.shift();
      map.line("flown", "flown", trail);
      map.vehicle(north, east, status.yaw_rad);
      latest = { time: status.time_s, place: [north, east] };
      showMovers();
      const goal = status.goal_ned_m;
      const away = goal ? Math.hypot(goal[0] - north, goal[1] - east) : null;
      map.goal(goal);
      const near = (moving?.movers ?? []).filter(({ box_m }) => awayFrom([north, east], box_m) < MOVER_SHOWN_M);
      map.frame([...trail, ...around, ...near.flatMap(({ box_m }) => cornersOf(box_m)), ...(away !== null && away < GOAL_SHOWN_M ? [goal] : []), [north + 12, east], [north, east - 4], [north, east + 4]]);
      const words = [`goal ${number(away, 1)} m away`, `north ${number(north)} m`, `east ${number(east)} m`, `height ${number(-down)} m`, `${number(Math.hypot(vn, ve))} m/s`];
      byId("readout").replaceChildren(...words.map((textContent) => Object.assign(document.createElement("span"), { textContent })));
    }
    const link = byId("link");
    link.replaceChildren();
    for (const [name, count] of Object.entries(status.dropped ?? {})) row(link, [name.replaceAll("_", " "), count]);
    row(link, ["obstacles known", status.obstacles_known]);
  },

  monitors({ time_s: _, ...monitors }) {
    byId("monitors").replaceChildren(...Object.entries(monitors).map(([name, { measured, limit, unit }]) => {
      const gauge = Object.assign(document.createElement("div"), { className: "gauge" });
      const words = Object.assign(document.createElement("span"), { textContent: name.replaceAll("_", " ") });
      // Clearance has a lower limit, everything else an upper one.
      const least = name === "clearance";
      const meter = document.createElement("meter");
      meter.max = least ? 5 : (limit ?? 1) * 1.25;
      meter.value = Math.min(measured ?? 0, meter.max);
      if (least) { meter.low = 0.2; meter.optimum = meter.max; } else { meter.high = limit ?? meter.max; meter.optimum = 0; }
      const broken = measured !== null && limit !== null && (least ? measured <= limit : measured > limit);
      const allowed = least || limit === null ? "" : ` of ${number(limit)}`;
      const reading = Object.assign(document.createElement("output"), { textContent: `${number(measured)}${allowed} ${unit}`, className: broken ? "bad" : "" });
      if (limit === null) reading.title = "no limit stated";
      gauge.append(words, meter, reading);
      return gauge;
    }));
  },

  margins({ clauses }) {
    const table = byId("margins");
    table.replaceChildren();
    for (const { name, margin, unit, holds } of clauses) row(table, [name.replaceAll("_", " "), `${number(margin)} ${unit}`], ["", holds ? "good" : "bad"]);
  },

  map({ obstacles, passed_over = [] }) {
    around = obstacles.flatMap(({ region_ned_m }) => region_ned_m);
    map.obstacles([...passed_over, ...obstacles]);
  },

  seen_space(seen) {
    map.seen(seen);
    why.pause = seen.pause ?? "";
    showReason();
    byId("pause").textContent = seen.pause && !["pause", "yield"].includes(why.phase) ? `pausing: ${seen.pause}` : "";
  },

  movers(record) {
    moving = { ...record, movers: record.movers.filter(({ box_ned_m }) => box_ned_m.length).map((mover) => ({ ...mover, box_m: extentOf(mover.box_ned_m), reach_m: extentOf(mover.reach_ned_m) })) };
    why.yielding = yieldWords(record);
    byId("movers-panel").hidden = false;
    for (const legend of document.querySelectorAll(".movers-legend")) legend.hidden = false;
    moverLayer.free(record);
    showMovers();
    showReason();
  },

  plan({ path_ned_m, obstacle, side }) {
    map.line("plan", "plan", path_ned_m);
    why.avoided = [obstacle, side].filter(Boolean).join(", ");
    showReason();
  },

  events({ time_s, name, severity, text, data }) {
    if (name === "phase") why.hold = data.to === "hold" ? text.replace(/^holding: /, "") : "";
    showReason();
    const table = byId("events");
    const kind = { critical: "bad", error: "bad", warning: "warn" }[severity] ?? "faint";
    const added = row(table, [new Date(time_s * 1000).toLocaleTimeString(), severity, text], ["", kind]);
    table.tBodies[0].prepend(added);
    while (table.rows.length > EVENTS_KEPT) table.deleteRow(-1);
  },
};

function showContact() {
  const silent_ms = heard === null ? null : performance.now() - heard;
  const contact = byId("contact");
  if (silent_ms === null) contact.textContent = "waiting for the daemon";
  else contact.textContent = silent_ms > SILENCE_MS ? `no contact for ${(silent_ms / 1000).toFixed(0)} s` : "";
  contact.className = silent_ms !== null && silent_ms > SILENCE_MS ? "bad" : "warn";
}

const stream = new EventSource("stream");
// A stream that reopens starts with everything known: replace what is shown.
stream.addEventListener("open", () => byId("events").replaceChildren());
stream.addEventListener("message", ({ data }) => {
  const { key, payload } = JSON.parse(data);
  show[key]?.(payload);
});
setInterval(showContact, 250);
document.documentElement.dataset.ready = "true";
