"use strict";
// What moves, on the map: where it may be by now, what it may reach until the vehicle rests, the truth.

const LABELS_APART_M = 1.5;

// Least and greatest north, least and greatest east -> corners.
function cornersOf([northMin, northMax, eastMin, eastMax]) {
  return [[northMin, eastMin], [northMax, eastMin], [northMax, eastMax], [northMin, eastMax]];
}

function grown([northMin, northMax, eastMin, eastMax], by) {
  return [northMin - by, northMax + by, eastMin - by, eastMax + by];
}

function extentOf(points) {
  const [norths, easts] = [0, 1].map((axis) => points.map((point) => point[axis]));
  return [Math.min(...norths), Math.max(...norths), Math.min(...easts), Math.max(...easts)];
}

// From a place to the nearest point of a box.
function awayFrom([north, east], [northMin, northMax, eastMin, eastMax]) {
  return Math.hypot(Math.max(northMin - north, 0, north - northMax), Math.max(eastMin - east, 0, east - eastMax));
}

// Why the vehicle yields, and for which movers, as far as they are seen.
function yieldWords({ yielding, movers }) {
  const whom = movers.filter(({ yields_for }) => yields_for).map(({ id }) => id);
  return yielding ? `${whom.length ? `for ${whom.join(", ")}: ` : ""}${yielding}` : "";
}

// Those that get a label: not two of a class beside each other, such as one mover of two sensors.
function labelled(drawn) {
  const found = [];
  for (const mover of drawn) {
    const beside = ({ kind, now }) => kind === mover.kind && Math.hypot(now[0] - mover.now[0], now[2] - mover.now[2]) < LABELS_APART_M;
    if (!found.some(beside)) found.push(mover);
  }
  return found;
}

class MoverLayer {
  constructor(map) {
    this.map = map;
    this.shown = [];
  }

  // Draw each mover {id, kind, seen_s, speed_max_mps, box_m, reach_m, yields_for} as it may be at a time.
  show(movers, time, stampError) {
    const { layers } = this.map;
    for (const name of this.shown) this.map.unsize(name);
    const drawn = movers.map((mover) => {
      const age = Math.max(time - mover.seen_s, 0);
      const now = grown(mover.box_m, mover.speed_max_mps * (age + stampError));
      const name = `${mover.id} (${mover.kind}): seen ${age.toFixed(1)} s ago, at most ${mover.speed_max_mps.toFixed(1)} m/s`;
      // At rest, reach ends with the record: what it may have reached since belongs to it, too.
      return { ...mover, now, name, reach: extentOf([...cornersOf(mover.reach_m), ...cornersOf(now)]) };
    });
    const path = (kind, { yields_for }, box) => svgElement("path", { class: yields_for ? `${kind} yielded` : kind, d: polygon(cornersOf(box)) });
    layers.reach.replaceChildren(...drawn.map((mover) => path("reach", mover, mover.reach)));
    this.shown = labelled(drawn).map((mover) => {
      const label = svgElement("g", { class: "mover-name" });
      label.append(svgElement("text", { x: 3, y: -3 }, mover.kind));
      this.map.size(label, [mover.now[0], mover.now[2]]);
      return label;
    });
    layers.movers.replaceChildren(...drawn.map((mover) => {
      const box = path("mover", mover, mover.now);
      box.append(svgElement("title", {}, mover.name));
      return box;
    }), ...this.shown);
    return drawn;
  }

  // Cells that hold no mover until the vehicle rests, as runs to the east.
  free({ corner_ned_m, cell_m, row, column_from, column_to }) {
    const runs = row.map((i, k) => `M${i * cell_m} ${column_from[k] * cell_m}h${cell_m}v${(column_to[k] - column_from[k]) * cell_m}h${-cell_m}Z`);
    this.map.line("seen", "mover-free", []);
    this.map.lines["mover-free"].setAttribute("d", runs.join(""));
    this.map.lines["mover-free"].setAttribute("transform", `translate(${corner_ned_m.join(" ")})`);
  }

  // Several lines that are drawn alike.
  trails(kind, lines) {
    this.map.line("trails", kind, []);
    this.map.lines[kind].setAttribute("d", lines.map(polyline).join(""));
  }
}
