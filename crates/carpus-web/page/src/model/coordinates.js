// Coordinates as sliders, in degrees and metres.
import { element, words } from "../format.js";
import { Slider } from "../slider.js";

/** Ranges beyond these stand for none, as OpenSim writes them: half a turn, a metre. */
const UNLIMITED = { deg: Math.PI, m: 1, "rad or m": 1 };

/** What a slider goes over [rad or m]. */
export function range({ range: [low, high], unit, start }) {
  const most = UNLIMITED[unit];
  const ends = high - low > 4 * most || !(high > low) ? [-most, most] : [low, high];
  return [Math.min(ends[0], start), Math.max(ends[1], start)];
}

/** Why a coordinate cannot be set; null: it can. */
export function held({ locked, follows, prescribed }) {
  if (follows) return `follows ${words(follows)}`;
  if (locked) return "locked";
  return prescribed ? "prescribed" : null;
}

export class Coordinates {
  /** - `onChange`: (index, value [rad or m]) */
  constructor(description, onChange) {
    this.sliders = description.coordinates.map(
      (c, i) =>
        new Slider({
          label: words(c.name),
          title: `${words(c.name)}, joint ${words(c.joint)}`,
          unit: c.unit === "deg" ? "°" : c.unit,
          range: range(c),
          mark: c.start,
          note: held(c),
          decimals: c.unit === "deg" ? 3 : 5,
          onChange: (value) => onChange(i, value),
          toShown: (v) => v * c.scale,
          toValue: (v) => v / c.scale,
        }),
    );
    const of = (wanted) =>
      this.sliders.filter((_, i) => (held(description.coordinates[i]) === null) === wanted).map((s) => s.root);
    const [free, others] = [of(true), of(false)];
    const summary = element("summary", {}, `Locked and coupled coordinates (${others.length})`);
    this.root = element(
      "div",
      {},
      ...free,
      free.length ? null : element("p", { class: "soft" }, "No coordinate of this model can be set."),
      others.length ? element("details", {}, summary, ...others) : null,
    );
    this.sliders.forEach(({ root }, i) => {
      root.dataset.coordinate = description.coordinates[i].name;
    });
  }

  show(q) {
    this.sliders.forEach((slider, i) => slider.show(q[i]));
  }
}
