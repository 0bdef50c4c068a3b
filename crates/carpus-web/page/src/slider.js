// A slider with a number field beside it: bounds, interval and the value as given are drawn on its track.
import { element, shown } from "./format.js";

/** Steps of a slider from one end to the other. */
const STEPS = 1000;
let count = 0;

/**
 * - `range`: ends; `toShown`, `toValue`: between values and what people read
 * - `decimals`: of the number that is read; null: six significant digits
 * - `note`: why it cannot be moved, in place of its ends; null: it can
 */
export class Slider {
  constructor({ label, title, unit, range, mark, onChange, toShown = (v) => v, toValue = (v) => v, note = null, decimals = null }) {
    Object.assign(this, { range, toShown, toValue, onChange, decimals });
    const id = `live-slider-${count++}`;
    const [low, high] = range;
    this.input = element("input", { type: "range", id, min: 0, max: STEPS, step: 1 });
    this.field = element("input", { type: "number", class: "field", step: "any" });
    this.field.setAttribute("aria-label", unit ? `${title} [${unit}]` : title);
    this.band = element("span", { class: "live-interval", hidden: true });
    this.given = element("span", { class: "live-given", hidden: true });
    const ends = element("span", { class: "live-ends" }, note ?? `${shown(toShown(low), 4)} … ${shown(toShown(high), 4)}`);
    this.input.disabled = this.field.disabled = note !== null;
    const name = element("label", { htmlFor: id, title }, label);
    const track = element("span", { class: "live-track" }, this.band, this.given, this.input);
    this.root = element(
      "div",
      { class: "live-slider" },
      name,
      track,
      this.field,
      element("span", { class: "unit" }, unit),
      ends,
    );
    if (mark !== undefined) this.place(this.given, mark, mark);
    this.input.addEventListener("input", () => this.change(low + (this.input.value / STEPS) * (high - low)));
    this.field.addEventListener("change", () => {
      const asked = toValue(Number(this.field.value));
      if (this.field.value === "" || !Number.isFinite(asked)) return this.show(this.value);
      this.change(Math.min(Math.max(asked, Math.min(low, this.value)), Math.max(high, this.value)));
    });
  }

  change(value) {
    this.show(value);
    this.onChange(value);
  }

  show(value) {
    const [low, high] = this.range;
    this.value = value;
    this.input.value = Math.round(((value - low) / (high - low)) * STEPS);
    this.input.setAttribute("aria-valuetext", shown(this.toShown(value), 4));
    // Values that couplers compute may be no numbers.
    const now = this.toShown(value);
    const rounded = Number(this.decimals === null ? now.toPrecision(6) : now.toFixed(this.decimals));
    this.field.value = Number.isFinite(now) ? rounded + 0 : "";
  }

  /** Draws an interval on the track; none: nothing is drawn. */
  interval(ends) {
    if (ends) this.place(this.band, ends[0], ends[1]);
    else this.band.hidden = true;
  }

  place(mark, from, to) {
    const [low, high] = this.range;
    const at = (v) => Math.min(Math.max((v - low) / (high - low), 0), 1);
    mark.hidden = false;
    // The thumb's centre moves half its width inside the ends.
    mark.style.setProperty("left", `calc(8px + (100% - 16px) * ${at(from)})`);
    mark.style.setProperty("width", `max(2px, (100% - 16px) * ${at(to) - at(from)})`);
  }
}
