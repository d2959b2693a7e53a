"use strict";
// The flight from above: x is north, to the right; y is east, downwards; both in metres.

const SVG = "http://www.w3.org/2000/svg";

function svgElement(name, attributes = {}, text = "") {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text) element.textContent = text;
  return element;
}

function polyline(points) {
  return points.map(([north, east], i) => `${i ? "L" : "M"}${north} ${east}`).join("");
}

function polygon(points) {
  return points.length ? `${polyline(points)}Z` : "";
}

// What is lower or higher than the flight has no region: it is passed over or under.
function kindOf({ region_ned_m = [] }) {
  return region_ned_m.length ? "obstacle" : "passed-over";
}

// The id of an obstacle, with what it may reach to where that is known.
function nameOf({ id, down_m }) {
  const metres = (down, none) => (down === null ? none : `${(-down).toFixed(1)} m`);
  return down_m ? `${id}: from ${metres(down_m[1], "below")} to ${metres(down_m[0], "above")}` : id;
}

class FlightMap {
  constructor(svg, radius) {
    this.svg = svg;
    this.radius = radius;
    this.bounds = null;
    // The user has dragged or zoomed: keep the view until a double-click.
    this.held = false;
    this.layers = Object.fromEntries(
      ["seen", "field", "others-seen", "reach", "obstacles", "trails", "movers", "true-movers", "legs", "ahead", "reference", "plan", "flown", "others", "goal", "vehicles", "marks", "scale"].map((name) =>
        [name, svg.appendChild(svgElement("g", { class: `layer-${name}` }))]));
    this.lines = {};
    this.vehicles = {};
    // What keeps its size in pixels, with its place in metres.
    this.sized = new Map();
    this.#watchPointer();
    svg.addEventListener("dblclick", () => { this.held = false; this.fit(); });
    window.addEventListener("resize", () => this.fit());
  }

  // Draw a line once, or move it; `kind` is its CSS class.
  line(layer, kind, points, name = kind) {
    this.lines[name] ??= this.layers[layer].appendChild(svgElement("path", { class: kind }));
    this.lines[name].setAttribute("d", polyline(points));
  }

  // Outlines that are not used now: the true obstacles of a simulation, those seen at another time.
  outlines(layer, kind, found) {
    this.line(layer, kind, []);
    this.lines[kind].setAttribute("d", found.map(polygon).join(""));
  }

  obstacles(found) {
    this.layers.obstacles.replaceChildren(...found.flatMap((obstacle) => [
      svgElement("path", { class: "lane", d: polygon(obstacle.lane_ned_m ?? []) }),
      svgElement("path", { class: "region", d: polygon(obstacle.region_ned_m ?? []) }),
      svgElement("path", { class: "keep-out", d: polygon(obstacle.keep_out_ned_m ?? []) }),
      svgElement("path", { class: "boundary", d: polyline(obstacle.boundary_ned_m ?? []) }),
      this.#named(svgElement("path", { class: kindOf(obstacle), d: polygon(obstacle.measured_ned_m ?? []) }), nameOf(obstacle)),
    ]));
  }

  // The space that was seen free, as runs of cells; the way to rest and the guide in it.
  seen({ corner_ned_m, heading_rad, cell_m, row, column_from, column_to, way_to_rest_ned_m, guide_ned_m }) {
    const runs = row.map((i, k) => `M${i * cell_m} ${column_from[k] * cell_m}h${cell_m}v${(column_to[k] - column_from[k]) * cell_m}h${-cell_m}Z`);
    this.line("seen", "seen-free", []);
    this.lines["seen-free"].setAttribute("d", runs.join(""));
    this.lines["seen-free"].setAttribute("transform", `translate(${corner_ned_m.join(" ")}) rotate(${heading_rad * 180 / Math.PI})`);
    this.line("plan", "guide", guide_ned_m);
    this.line("plan", "way-to-rest", way_to_rest_ned_m);
  }

  // Where the flight is to end.
  goal(place) {
    this.layers.goal.style.display = place ? "" : "none";
    if (!place) return;
    if (!this.goalMark) {
      this.goalMark = svgElement("g", { class: "goal" });
      this.goalMark.append(svgElement("circle", { r: 7 }), svgElement("circle", { r: 2, class: "dot" }));
      this.#named(this.goalMark, "goal");
    }
    this.layers.goal.append(this.goalMark);
    this.#size(this.goalMark, place);
  }

  // What went wrong, or touched the vehicle, where it did: {place_ned_m, text, kind} each.
  marks(found) {
    for (const mark of this.layers.marks.children) this.sized.delete(mark);
    const placed = found.filter(({ place_ned_m }) => place_ned_m);
    this.layers.marks.replaceChildren(...placed.map(({ place_ned_m, text, kind }) => {
      const mark = this.#named(svgElement("g", { class: `mark ${kind}` }), text);
      mark.append(svgElement("circle", { r: 8 }), svgElement("path", { d: kind === "touch" ? "M-4 0H4" : "M-3.5 -3.5L3.5 3.5M3.5 -3.5L-3.5 3.5" }));
      this.#size(mark, place_ned_m);
      return mark;
    }));
  }

  // What the contract declares: the vehicle's radius, and the range and width of its view, which
  // is drawn in front of it.
  declare(radius, range, width) {
    this.radius = radius;
    // Drawn anew with its next position.
    this.vehicles.vehicle?.remove();
    delete this.vehicles.vehicle;
    const half = Math.min(width, 2 * Math.PI - 1e-6) / 2;
    const [north, east] = [range * Math.cos(half), range * Math.sin(half)];
    this.coneShape = `M0 0L${north} ${-east}A${range} ${range} 0 ${half > Math.PI / 2 ? 1 : 0} 1 ${north} ${east}Z`;
  }

  vehicle(north, east, yaw, name = "vehicle") {
    if (!this.vehicles[name]) {
      const r = this.radius;
      const group = svgElement("g", { id: name });
      const kind = name === "vehicle" ? "vehicle" : "vehicle other";
      if (name === "vehicle") group.append(svgElement("path", { class: "cone", d: this.coneShape ?? "" }));
      group.append(
        svgElement("circle", { class: kind, r, "fill-opacity": 0.35 }),
        svgElement("path", { class: `${kind} arrow`, d: `M${r} 0L${-0.7 * r} ${0.6 * r}L${-0.35 * r} 0L${-0.7 * r} ${-0.6 * r}Z` }));
      this.vehicles[name] = this.layers.vehicles.appendChild(group);
      this.#sizeArrows();
    }
    const known = Number.isFinite(north) && Number.isFinite(east);
    this.vehicles[name].style.display = known ? "" : "none";
    if (known) {
      const turn = (yaw ?? 0) * 180 / Math.PI;
      this.vehicles[name].setAttribute("transform", `translate(${north} ${east}) rotate(${turn})`);
    }
  }

  // Show all of these points, unless the user has moved the view.
  frame(points) {
    const known = points.filter(([north, east]) => Number.isFinite(north) && Number.isFinite(east));
    if (!known.length) return;
    const bounds = [Infinity, Infinity, -Infinity, -Infinity];
    for (const [north, east] of known) {
      bounds[0] = Math.min(bounds[0], north); bounds[1] = Math.min(bounds[1], east);
      bounds[2] = Math.max(bounds[2], north); bounds[3] = Math.max(bounds[3], east);
    }
    this.bounds = bounds;
    if (!this.held) this.fit();
  }

  fit() {
    if (!this.bounds) return;
    const margin = 2;
    const [north, east, farNorth, farEast] = this.bounds;
    // As high as the content, within limits.
    const wanted = this.svg.clientWidth * (farEast - east + 2 * margin) / (farNorth - north + 2 * margin);
    this.svg.style.height = `${Math.min(Math.max(wanted, 160), 0.6 * window.innerHeight)}px`;
    const aspect = this.svg.clientWidth / Math.max(this.svg.clientHeight, 1) || 1;
    const width = Math.max(farNorth - north + 2 * margin, (farEast - east + 2 * margin) * aspect);
    this.view = [(north + farNorth - width) / 2, (east + farEast - width / aspect) / 2, width, width / aspect];
    this.#look();
  }

  #look() {
    this.svg.setAttribute("viewBox", this.view.join(" "));
    const metres = this.#metres();
    for (const [element, place] of this.sized) element.setAttribute("transform", `translate(${place[0]} ${place[1]}) scale(${metres})`);
    this.#sizeArrows();
    this.#scaleBar(metres);
  }

  // The arrow is as large as the vehicle, and never too small to be seen.
  #sizeArrows() {
    const grown = Math.max(1, 8 * this.#metres() / this.radius);
    for (const vehicle of Object.values(this.vehicles)) vehicle.querySelector(".arrow").setAttribute("transform", `scale(${grown})`);
  }

  // Metres of a pixel.
  #metres() { return this.view ? this.view[2] / Math.max(this.svg.clientWidth, 1) : 1; }

  // Keep the size of an element in pixels at a place in metres, until it is let go.
  size(element, place) { this.#size(element, place); }
  unsize(element) { this.sized.delete(element); }

  #size(element, place) {
    this.sized.set(element, place);
    element.setAttribute("transform", `translate(${place[0]} ${place[1]}) scale(${this.#metres()})`);
  }

  // A bar of a round length at the lower left, at most a third of the map and 130 pixels wide.
  #scaleBar(metres) {
    const most = Math.min(130, this.svg.clientWidth / 3) * metres;
    const power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].find((factor) => factor * power <= most) * power;
    const bar = svgElement("g", { class: "scale", transform: `translate(${this.view[0]} ${this.view[1] + this.view[3]}) scale(${metres})` });
    const end = 10 + length / metres;
    bar.append(svgElement("path", { d: `M10 -14V-9H${end}V-14` }), svgElement("text", { x: end + 5, y: -8 }, `${Number(length.toPrecision(1))} m`));
    this.layers.scale.replaceChildren(bar);
  }

  #named(element, name) {
    element.append(svgElement("title", {}, name));
    return element;
  }

  #watchPointer() {
    const { svg } = this;
    // Every finger that is down, by where it was last.
    const down = new Map();
    svg.addEventListener("pointerdown", (event) => { down.set(event.pointerId, event); svg.setPointerCapture(event.pointerId); });
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, (event) => down.delete(event.pointerId));
    svg.addEventListener("pointermove", (event) => {
      const last = down.get(event.pointerId);
      if (!last || !this.view) return;
      this.held = true;
      const other = [...down.values()].find(({ pointerId }) => pointerId !== event.pointerId);
      if (other) {
        const apart = ({ clientX, clientY }) => Math.hypot(clientX - other.clientX, clientY - other.clientY) || 1;
        this.#zoom(other, apart(last) / apart(event));
      } else {
        const scale = this.view[2] / svg.clientWidth;
        this.view[0] -= (event.clientX - last.clientX) * scale;
        this.view[1] -= (event.clientY - last.clientY) * scale;
        this.#look();
      }
      down.set(event.pointerId, event);
    });
    svg.addEventListener("wheel", (event) => {
      if (!this.view) return;
      event.preventDefault();
      this.held = true;
      this.#zoom(event, Math.exp(event.deltaY * 0.0015));
    }, { passive: false });
  }

  // Show `factor` times as much, and leave what is under the pointer where it is.
  #zoom({ clientX, clientY }, factor) {
    const box = this.svg.getBoundingClientRect();
    const at = [(clientX - box.left) / box.width, (clientY - box.top) / box.height];
    this.view[0] += this.view[2] * at[0] * (1 - factor);
    this.view[1] += this.view[3] * at[1] * (1 - factor);
    this.view[2] *= factor; this.view[3] *= factor;
    this.#look();
  }
}
