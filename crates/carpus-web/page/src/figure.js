// Curves over an axis, drawn as SVG.
import { drawn, element, shown, ticks } from "./format.js";

/** Most points of a curve that are drawn. */
const DRAWN = 400;

const extent = (arrays) => {
  let [low, high] = [Infinity, -Infinity];
  for (const array of arrays)
    for (const v of array)
      if (Number.isFinite(v)) {
        low = Math.min(low, v);
        high = Math.max(high, v);
      }
  return low <= high ? [low, high] : [0, 1];
};

export class Figure {
  /**
   * - `x`, `y`: { name, unit }; `small`: without axis titles and readings; `zero`: whether the axis holds zero
   */
  constructor({ label, x, y, width, height, small = false, zero = true }) {
    Object.assign(this, { x, y, width, height, small, zero, curves: [], lit: null });
    this.frame = small ? { left: 26, right: 4, top: 4, bottom: 14 } : { left: 52, right: 10, top: 8, bottom: 36 };
    this.root = drawn("svg", {
      class: "figure live-figure",
      viewBox: `0 0 ${width} ${height}`,
      role: "img",
      "aria-label": label,
    });
    this.axes = this.root.appendChild(drawn("g"));
    this.lines = this.root.appendChild(drawn("g"));
    // Drawn at the size that it has on the page, so that text keeps its own.
    new ResizeObserver(() => this.resize()).observe(this.root);
    if (!small) this.root.addEventListener("pointermove", (event) => this.point(event));
    if (!small) this.root.addEventListener("pointerleave", () => this.leave());
    if (!small) this.root.addEventListener("pointerdown", (event) => this.press(event));
  }

  /**
   * Draws curves: { name, class, x, y }, and an area between two ends where there is `low` and `high`; `color` where no class
   * has it, `key` where a curve is lit ([`light`]).
   * Axes hold all of them, and stay as they are while they do.
   */
  draw(curves, { keep = false } = {}) {
    this.curves = curves;
    const found = {
      x: extent(curves.map((c) => c.x)),
      y: extent(curves.flatMap((c) => (c.low ? [c.y, c.low, c.high] : [c.y]))),
    };
    const y = this.zero ? [Math.min(found.y[0], 0), Math.max(found.y[1], 0)] : found.y;
    const within = (now, ends) => now[0] >= ends[0] && now[1] <= ends[1];
    const fits = keep && this.range && within(y, this.range.y) && within(found.x, this.range.x);
    if (!fits) {
      const margin = 0.04 * (y[1] - y[0]) || 1;
      this.range = { x: found.x, y: [y[0] - margin, y[1] + margin] };
      this.drawAxes();
    }
    this.drawLines();
  }

  drawLines() {
    this.lines.replaceChildren(
      ...this.curves.flatMap((curve) => [
        ...(curve.low ? [drawn("path", { class: `band ${curve.class}`, d: this.area(curve) })] : []),
        this.line(curve),
      ]),
    );
    this.drawMark();
  }

  line(curve) {
    const isDim = this.lit !== null && curve.key !== undefined && curve.key !== this.lit;
    const state = isDim ? "dim" : curve.key !== undefined && curve.key === this.lit ? "lit" : "";
    const made = drawn("path", { class: `curve ${curve.class} ${state}`, d: this.path(curve) });
    if (curve.color) made.style.setProperty("stroke", curve.color);
    return made;
  }

  /** Lets the curve of this key stand out; null: none. */
  light(key) {
    if (this.lit === key) return;
    this.lit = key;
    if (this.range) this.drawLines();
  }

  /** Draws a line at a value of the axis; null: none. */
  mark(value) {
    this.marked = value;
    this.drawMark();
  }

  drawMark() {
    this.markLine?.remove();
    this.markLine = null;
    if (this.marked === null || this.marked === undefined || !this.range) return;
    const [low, high] = this.range.x;
    if (!(this.marked >= low && this.marked <= high)) return;
    const at = this.px(this.marked);
    const ends = { x1: at, x2: at, y1: this.frame.top, y2: this.height - this.frame.bottom };
    this.markLine = this.lines.appendChild(drawn("line", { class: "live-mark", ...ends }));
  }

  resize() {
    const width = Math.round(this.root.clientWidth);
    if (!width || width === this.width) return;
    this.width = width;
    this.root.setAttribute("viewBox", `0 0 ${width} ${this.height}`);
    if (!this.range) return;
    this.drawAxes();
    this.drawLines();
  }

  px(v) {
    const [low, high] = this.range.x;
    return this.frame.left + ((v - low) / (high - low || 1)) * (this.width - this.frame.left - this.frame.right);
  }

  py(v) {
    const [low, high] = this.range.y;
    return (
      this.height - this.frame.bottom - ((v - low) / (high - low)) * (this.height - this.frame.top - this.frame.bottom)
    );
  }

  path({ x, y }) {
    const step = Math.max(1, (x.length - 1) / (DRAWN - 1));
    const points = [];
    for (let k = 0; k < x.length - 0.5; k += step) {
      const i = Math.round(k);
      points.push(`${this.px(x[i]).toFixed(1)} ${this.py(y[i]).toFixed(1)}`);
    }
    return points.length ? `M${points.join("L")}` : "";
  }

  area({ x, low, high }) {
    const at = (values) => (v, i) => `${this.px(v).toFixed(1)} ${this.py(values[i]).toFixed(1)}`;
    const there = [...x].map(at(high)),
      back = [...x].map(at(low)).reverse();
    return `M${[...there, ...back].join("L")}Z`;
  }

  drawAxes() {
    const { left, right, top, bottom } = this.frame;
    const [floor, end] = [this.height - bottom, this.width - right];
    const marks = [];
    for (const v of ticks(this.range.y, Math.max(2, Math.round(this.height / 45)))) {
      const at = this.py(v);
      marks.push(drawn("line", { class: Math.abs(v) < 1e-12 ? "zero" : "grid", x1: left, x2: end, y1: at, y2: at }));
      marks.push(drawn("text", { class: "tick y", x: left - 4, y: at + 3.5 }, shown(v)));
    }
    for (const v of ticks(this.range.x, Math.max(2, Math.round(this.width / 90)))) {
      const at = this.px(v);
      if (!this.small) marks.push(drawn("line", { class: "grid", x1: at, x2: at, y1: top, y2: floor }));
      marks.push(drawn("text", { class: "tick x", x: at, y: floor + (this.small ? 11 : 14) }, shown(v)));
    }
    if (!this.small) {
      const unit = ({ name, unit: of }) => `${name} [${of}]`;
      marks.push(drawn("text", { class: "tick x", x: (left + end) / 2, y: this.height - 4 }, unit(this.x)));
      const middle = (top + floor) / 2;
      marks.push(
        drawn("text", { class: "tick x", x: 12, y: middle, transform: `rotate(-90 12 ${middle})` }, unit(this.y)),
      );
    }
    this.axes.replaceChildren(...marks);
  }

  /** Value of the axis at the pointer, and where it is drawn. */
  value(event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.root.getScreenCTM().inverse());
    const [low, high] = this.range.x;
    const part = (at.x - this.frame.left) / (this.width - this.frame.left - this.frame.right);
    return { value: low + part * (high - low), at };
  }

  press(event) {
    if (!this.onDrag || !this.curves.length) return;
    const { value } = this.value(event);
    const [low, high] = this.range.x;
    if (value < low || value > high) return;
    this.onDrag(value);
    this.root.setPointerCapture(event.pointerId);
  }

  /** Values of all curves at the pointer. */
  point(event) {
    if (!this.curves.length) return;
    const { value, at } = this.value(event);
    const [low, high] = this.range.x;
    if (this.onDrag && event.buttons & 1) this.onDrag(Math.min(Math.max(value, low), high));
    if (value < low || value > high) return this.leave();
    this.onPoint?.(value, this.nearestCurve(value, at.y));
    this.cross ??= this.root.insertBefore(drawn("line", { class: "cross" }), this.root.firstChild);
    for (const [name, v] of [
      ["x1", this.px(value)],
      ["x2", this.px(value)],
      ["y1", this.frame.top],
      ["y2", this.height - this.frame.bottom],
    ]) {
      this.cross.setAttribute(name, v);
    }
    this.tip ??= this.root.parentElement.appendChild(element("div", { class: "tip" }));
    const row = (name, v, unit) => element("div", {}, `${name} `, element("b", {}, shown(v)), `\u202f${unit}`);
    const nearest = (x) => {
      let best = 0;
      for (let i = 1; i < x.length; i += 1) if (Math.abs(x[i] - value) < Math.abs(x[best] - value)) best = i;
      return best;
    };
    this.tip.replaceChildren(
      row(this.x.name, value, this.x.unit),
      ...this.curves.map((c) => row(c.name, c.y[nearest(c.x)], this.y.unit)),
    );
    const box = this.root.getBoundingClientRect(),
      around = this.root.parentElement.getBoundingClientRect();
    const px = box.left - around.left + (this.px(value) / this.width) * box.width;
    const left = px > box.width / 2 ? px - this.tip.offsetWidth - 10 : px + 10;
    this.tip.style.setProperty("left", `${left}px`);
    this.tip.style.setProperty("top", `${box.top - around.top + 10}px`);
  }

  /** Key of the curve that is nearest to a place; null where none is near. */
  nearestCurve(value, y) {
    const NEAR = 14;
    let [best, found] = [NEAR, null];
    for (const { x, y: values, key } of this.curves) {
      if (key === undefined) continue;
      let i = 0;
      while (i + 1 < x.length && x[i + 1] <= value) i += 1;
      const away = Math.abs(this.py(values[i]) - y);
      if (away < best) [best, found] = [away, key];
    }
    return found;
  }

  leave() {
    this.onPoint?.(null, null);
    this.cross?.remove();
    this.tip?.remove();
    this.cross = this.tip = null;
  }

  /** The numbers that are drawn, as rows of a table. */
  table() {
    const rows = [["curve", `${this.x.name} [${this.x.unit}]`, `${this.y.name} [${this.y.unit}]`]];
    for (const c of this.curves) for (let i = 0; i < c.x.length; i += 1) rows.push([c.name, c.x[i], c.y[i]]);
    return rows;
  }
}
