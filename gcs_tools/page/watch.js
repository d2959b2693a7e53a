"use strict";
// The live view: draws the daemon's messages as they arrive.

const byId = (id) => document.getElementById(id);
const map = new FlightMap(byId("map"), 0.3);
const SILENCE_MS = 1500;
const EVENTS_KEPT = 200;
const TRAIL_POINTS = 5000;
const trail = [];
let around = [];
let heard = null;

function row(table, values, kinds = []) {
  const added = table.insertRow();
  values.forEach((value, i) => { const cell = added.insertCell(); cell.textContent = value; if (kinds[i]) cell.className = kinds[i]; });
  return added;
}

const number = (value, digits = 2) => (value == null ? "–" : value.toFixed(digits));

const show = {
  trail({ points_ned_m }) {
    trail.splice(0, trail.length, ...points_ned_m);
    map.line("flown", "flown", trail);
  },

  status(status) {
    heard = performance.now();
    byId("phase").textContent = status.phase.toUpperCase();
    byId("phase").className = `verdict ${{ hold: "warn", standby: "faint" }[status.phase] ?? "good"}`;
    byId("mode").textContent = `${status.mode ?? "no mode"}, ${status.armed ? "armed" : "disarmed"}`;
    if (status.position_ned_m) {
      const [north, east, down] = status.position_ned_m;
      const [vn, ve] = status.velocity_ned_mps;
      trail.push(status.position_ned_m);
      if (trail.length > TRAIL_POINTS) trail.shift();
      map.line("flown", "flown", trail);
      map.vehicle(north, east, status.yaw_rad);
      map.frame([...trail, ...around, [north + 12, east], [north, east - 4], [north, east + 4]]);
      byId("readout").textContent = `north ${number(north)} m  east ${number(east)} m  height ${number(-down)} m  ${number(Math.hypot(vn, ve))} m/s`;
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
    byId("pause").textContent = seen.pause ? `pausing: ${seen.pause}` : "";
  },

  plan({ path_ned_m }) { map.line("plan", "plan", path_ned_m); },

  events({ time_s, severity, text }) {
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
