"use strict";
// The flight in three dimensions: an orthographic view; drag to turn it.

class Space {
  constructor(canvas, bounds) {
    this.canvas = canvas;
    this.turn = -0.6;
    this.tilt = 0.55;
    this.zoom = 1;
    this.center = [0, 1, 2].map((axis) => (bounds[0][axis] + bounds[1][axis]) / 2);
    this.half = [0, 1, 2].map((axis) => (bounds[1][axis] - bounds[0][axis]) / 2);
    this.lines = [];
    this.marks = [];
    let last = null;
    canvas.addEventListener("pointerdown", (event) => { last = event; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointerup", () => { last = null; });
    canvas.addEventListener("pointermove", (event) => {
      if (!last) return;
      this.turn += (event.clientX - last.clientX) * 0.01;
      this.tilt = Math.min(Math.max(this.tilt + (event.clientY - last.clientY) * 0.01, 0), Math.PI / 2);
      last = event;
      this.draw();
    });
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.zoom *= Math.exp(-event.deltaY * 0.0015); this.draw(); }, { passive: false });
    new ResizeObserver(() => this.draw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  // Pixels per metre, so that everything fits at any turn.
  #scale() {
    const { canvas, turn, tilt, half: [n, e, h] } = this;
    const [cosine, sine] = [Math.abs(Math.cos(turn)), Math.abs(Math.sin(turn))];
    const across = n * cosine + e * sine;
    const up = h * Math.cos(tilt) + (n * sine + e * cosine) * Math.sin(tilt);
    return this.zoom * 0.46 * Math.min(canvas.clientWidth / (across || 1), canvas.clientHeight / (up || 1));
  }

  // north, east, height -> pixels; east is to the right of north, as seen from above.
  #project([north, east, height]) {
    const n = north - this.center[0], e = east - this.center[1], h = height - this.center[2];
    const across = n * Math.cos(this.turn) + e * Math.sin(this.turn);
    const towards = -n * Math.sin(this.turn) + e * Math.cos(this.turn);
    const up = h * Math.cos(this.tilt) - towards * Math.sin(this.tilt);
    return [this.canvas.clientWidth / 2 + across * this.scale, this.canvas.clientHeight / 2 - up * this.scale];
  }

  draw() {
    const { canvas } = this;
    const ratio = window.devicePixelRatio || 1;
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    this.scale = this.#scale();
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    for (const { points, kind, width = 1.5, dash = [] } of this.lines) {
      context.beginPath();
      points.forEach((point, i) => { const [x, y] = this.#project(point); if (i) context.lineTo(x, y); else context.moveTo(x, y); });
      context.strokeStyle = colour(kind);
      context.lineWidth = width;
      context.setLineDash(dash);
      context.stroke();
    }
    context.setLineDash([]);
    this.#north(context, colour("faint"));
    for (const { point, kind } of this.marks) {
      const [x, y] = this.#project(point);
      const [groundX, groundY] = this.#project([point[0], point[1], 0]);
      context.strokeStyle = context.fillStyle = colour(kind);
      context.lineWidth = 1;
      context.beginPath(); context.moveTo(x, y); context.lineTo(groundX, groundY); context.stroke();
      context.beginPath(); context.arc(x, y, 6, 0, 2 * Math.PI); context.fill();
    }
  }

  #north(context, colour) {
    const [x, y] = this.#project([0, 0, 0]), [toX, toY] = this.#project([1, 0, 0]);
    const length = Math.hypot(toX - x, toY - y) || 1;
    const [dx, dy] = [(toX - x) / length, (toY - y) / length];
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = 2;
    context.font = "12px sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.beginPath();
    context.moveTo(28 - 14 * dx, 28 - 14 * dy);
    context.lineTo(28 + 8 * dx, 28 + 8 * dy);
    context.stroke();
    context.fillText("N", 28 + 18 * dx, 28 + 18 * dy);
  }

  // A prism over these corners (north, east), from the ground up.
  prism(corners, height, kind) {
    const closed = [...corners, corners[0]];
    this.lines.push({ points: closed.map(([n, e]) => [n, e, 0]), kind }, { points: closed.map(([n, e]) => [n, e, height]), kind });
    for (const [n, e] of corners) this.lines.push({ points: [[n, e, 0], [n, e, height]], kind });
  }
}
