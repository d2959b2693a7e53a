"use strict";
// Quantities over time, in SVG.  Time is in seconds since departure; missing values are null.

const PAD = { left: 46, right: 8, top: 8, bottom: 20 };

function niceTicks(low, high, count) {
  const rough = (high - low) / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const ticks = [];
  for (let tick = Math.ceil(low / step - 1e-9) * step; tick <= high + step * 1e-9; tick += step) ticks.push(tick);
  return { ticks, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

// Index of the last time at or before `time`; 0 before the first.
function indexAt(times, time) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= time) low = middle; else high = middle - 1;
  }
  return low;
}

class Chart {
  // series: {label, time, values, colour, dashed}; limits: {label, value}; phases: {start_s, end_s, phase};
  // zero: the scale begins at 0; least: the scale spans at least this much.
  constructor(parent, { title, unit, series, limits = [], phases = [], span, zero = false, least = 0, height = 150, seek }) {
    Object.assign(this, { unit, limits, phases, span, zero, least, height });
    this.series = series.filter(({ values }) => values?.some((value) => value !== null));
    if (!this.series.length) return;
    const panel = parent.appendChild(document.createElement("section"));
    panel.className = "panel";
    const heading = panel.appendChild(document.createElement("h2"));
    heading.textContent = title;
    heading.append(Object.assign(document.createElement("span"), { className: "faint", textContent: ` (${unit})` }));
    this.svg = panel.appendChild(svgElement("svg", { class: "chart", height, role: "img", "aria-label": title }));
    this.#legend(panel);
    this.#scale();
    new ResizeObserver(() => this.draw()).observe(this.svg);
    const follow = (event) => { if (event.buttons) seek(this.#timeAt(event)); };
    this.svg.addEventListener("pointerdown", follow);
    this.svg.addEventListener("pointermove", follow);
  }

  #legend(panel) {
    const legend = panel.appendChild(document.createElement("div"));
    legend.className = "legend";
    this.readouts = this.series.map(({ label, colour, dashed }) => {
      const entry = legend.appendChild(document.createElement("span"));
      const swatch = entry.appendChild(document.createElement("i"));
      swatch.style.borderColor = `var(--${colour})`;
      swatch.classList.toggle("dashed", Boolean(dashed));
      entry.append(`${label} `);
      return entry.appendChild(document.createElement("output"));
    });
  }

  #scale() {
    let low = this.zero ? 0 : Infinity, high = -Infinity;
    const take = (value) => { if (value !== null) { low = Math.min(low, value); high = Math.max(high, value); } };
    for (const { values } of this.series) values.forEach(take);
    for (const { value } of this.limits) take(value);
    // Do not magnify a quantity that hardly changes.
    const lacking = Math.max(this.least - (high - low), 0) / 2;
    low -= lacking;
    high += lacking;
    const margin = (high - low || Math.abs(high) || 1) * 0.08;
    this.low = this.zero && low >= 0 ? 0 : low - margin;
    this.high = high + margin;
    // Three significant digits on this scale.
    this.digits = Math.min(Math.max(2 - Math.floor(Math.log10(this.high - this.low)), 0), 3);
  }

  #x(time) { return PAD.left + (time - this.span[0]) / (this.span[1] - this.span[0] || 1) * this.width; }
  #y(value) { return this.height - PAD.bottom - (value - this.low) / (this.high - this.low) * (this.height - PAD.top - PAD.bottom); }

  #timeAt(event) {
    const x = event.clientX - this.svg.getBoundingClientRect().left;
    return this.span[0] + (x - PAD.left) / this.width * (this.span[1] - this.span[0]);
  }

  draw() {
    if (!this.svg) return;
    this.width = Math.max(this.svg.clientWidth - PAD.left - PAD.right, 1);
    const bottom = this.height - PAD.bottom, right = PAD.left + this.width;
    const parts = this.phases.map(({ start_s, end_s, phase }) => svgElement("rect", {
      x: this.#x(start_s), width: Math.max(this.#x(end_s) - this.#x(start_s), 0), y: PAD.top,
      height: bottom - PAD.top, style: `fill: var(--phase-${phase}, transparent)` }));
    const vertical = niceTicks(this.low, this.high, 4);
    for (const tick of vertical.ticks) {
      parts.push(svgElement("path", { class: "axis", d: `M${PAD.left} ${this.#y(tick)}H${right}` }));
      parts.push(svgElement("text", { x: PAD.left - 5, y: this.#y(tick) + 4, "text-anchor": "end" }, tick.toFixed(vertical.digits)));
    }
    const horizontal = niceTicks(this.span[0], this.span[1], this.width / 70);
    for (const tick of horizontal.ticks) {
      parts.push(svgElement("text", { x: this.#x(tick), y: this.height - 5, "text-anchor": "middle" }, `${tick.toFixed(horizontal.digits)} s`));
    }
    for (const { label, value } of this.limits) {
      parts.push(svgElement("path", { class: "limit", d: `M${PAD.left} ${this.#y(value)}H${right}` }));
      // Above its line, unless the line is at the top.
      const y = this.#y(value) - PAD.top > 14 ? this.#y(value) - 3 : this.#y(value) + 11;
      parts.push(svgElement("text", { class: "limit", x: right - 3, y, "text-anchor": "end" }, label));
    }
    for (const { time, values, colour, dashed, dots } of this.series) {
      const style = `stroke: var(--${colour})`;
      if (dots) {
        values.forEach((value, i) => { if (value !== null) parts.push(svgElement("circle", { cx: this.#x(time[i]), cy: this.#y(value), r: 4, style: `fill: var(--${colour})` })); });
      } else {
        parts.push(svgElement("path", { d: this.#path(time, values), class: dashed ? "dashed" : "", style }));
      }
    }
    this.cursor = svgElement("path", { class: "cursor" });
    this.svg.replaceChildren(...parts, this.cursor);
    this.at(this.time ?? this.span[0]);
  }

  #path(time, values) {
    let path = "", pen = "M";
    for (let i = 0; i < values.length; i++) {
      if (values[i] === null) { pen = "M"; continue; }
      path += `${pen}${this.#x(time[i]).toFixed(1)} ${this.#y(values[i]).toFixed(1)}`;
      pen = "L";
    }
    return path;
  }

  at(time) {
    this.time = time;
    if (!this.cursor) return;
    this.cursor.setAttribute("d", `M${this.#x(time)} ${PAD.top}V${this.height - PAD.bottom}`);
    this.series.forEach(({ time: times, values, dots }, i) => {
      const value = dots ? null : values[indexAt(times, time)];
      this.readouts[i].textContent = value === null ? "" : value.toFixed(this.digits).replace(/^-(0\.?0*)$/, "$1");
    });
  }
}

const BAND = { row: 28, axis: 18 };

// One band of phases over a time axis, and in it the steps of the induction: which obstacle, and
// whether pre- and post-condition held.  A label that does not fit beside its neighbours is turned.
class Band {
  constructor(svg, phases, steps, span, seek) {
    Object.assign(this, { svg, phases, steps, span });
    new ResizeObserver(() => this.draw()).observe(svg);
    svg.addEventListener("pointerdown", (event) => {
      const share = (event.clientX - svg.getBoundingClientRect().left) / svg.clientWidth;
      seek(span[0] + share * (span[1] - span[0]));
    });
  }

  #x(time) { return (time - this.span[0]) / (this.span[1] - this.span[0] || 1) * this.svg.clientWidth; }

  draw() {
    const spans = this.phases.map((phase) => this.#labelled(phase));
    this.row = Math.max(BAND.row, ...spans.map(({ turned, step, label }) => (turned ? 7 * label.length + (step ? 38 : 12) : 0)));
    const height = this.row + BAND.axis;
    // Setting the same height again would have the observer call once more.
    if (this.svg.getAttribute("height") !== String(height)) this.svg.setAttribute("height", height);
    const ticks = niceTicks(this.span[0], this.span[1], this.svg.clientWidth / 70);
    const axis = ticks.ticks.map((tick) => svgElement("text", {
      class: "tick", x: Math.min(Math.max(this.#x(tick), 12), this.svg.clientWidth - 12), y: height - 4, "text-anchor": "middle" }, `${tick.toFixed(ticks.digits)} s`));
    this.cursor = svgElement("path", { stroke: "var(--ink)" });
    this.svg.replaceChildren(...spans.flatMap((each) => this.#drawn(each)), ...axis, this.cursor);
    this.at(this.time ?? this.span[0]);
  }

  // The longest label that fits, else the shortest turned, where there is room for a line of text.
  #labelled({ start_s, end_s, phase }) {
    const width = Math.max(this.#x(end_s) - this.#x(start_s), 1);
    const step = phase === "avoid" ? this.steps.find(({ time_s }) => Math.abs(time_s - start_s) < 0.05) : null;
    const words = step ? [`avoid ${step.obstacle}`, step.obstacle, phase] : [phase];
    const fitting = words.find((word) => width > 6.5 * word.length + (step ? 34 : 8));
    const turned = fitting === undefined && width >= 14;
    return { start_s, end_s, phase, width, step, words, turned, label: fitting ?? (turned ? words.at(step ? 1 : 0) : "") };
  }

  #drawn({ start_s, end_s, phase, width, step, words, turned, label }) {
    const left = this.#x(start_s), middle = left + width / 2;
    const rect = svgElement("rect", { x: left, width, y: 0, height: this.row, stroke: "var(--rule)", style: `fill: var(--phase-${phase}, transparent)` });
    rect.append(svgElement("title", {}, `${words[0]}, ${start_s.toFixed(1)} to ${end_s.toFixed(1)} s`));
    const text = svgElement("text", { x: middle, y: this.row / 2 + 4, "text-anchor": "middle" }, label);
    if (turned) text.setAttribute("transform", `rotate(-90 ${middle} ${this.row / 2})`);
    if (!step || !label) return [rect, text];
    // Beside the label, or above and below a turned one; the turned one is read upwards.
    const marks = turned
      ? [this.#mark(middle, this.row - 3, "pre-condition", step.pre_condition), this.#mark(middle, 12, "post-condition", step.post_condition)]
      : [this.#mark(left + 9, this.row / 2 + 4, "pre-condition", step.pre_condition), this.#mark(this.#x(end_s) - 9, this.row / 2 + 4, "post-condition", step.post_condition)];
    return [rect, text, ...marks];
  }

  #mark(x, y, what, holds) {
    const mark = svgElement("text", { x, y, "text-anchor": "middle", style: `fill: var(--${holds ? "good" : "bad"})` }, holds ? "✓" : "✗");
    mark.append(svgElement("title", {}, `${what} ${holds ? "held" : "failed"}`));
    return mark;
  }

  at(time) {
    this.time = time;
    this.cursor?.setAttribute("d", `M${this.#x(time)} 0V${this.row}`);
  }
}
