// What a person has changed: the muscles' parameters and the effects that are on.

/** Maximum isometric force, optimal fibre length, tendon slack length: the order of every triple. */
export const PROPERTIES = [
  {
    name: "max_isometric_force",
    short: "Maximum isometric force",
    symbol: "F\u2092",
    unit: "N",
    about: "Force of the muscle's fibres at their optimal length, fully active and at rest.",
  },
  {
    name: "optimal_fiber_length",
    short: "Optimal fibre length",
    symbol: "\u2113\u2092",
    unit: "m",
    about: "Length of the fibres at which they pull hardest.",
  },
  {
    name: "tendon_slack_length",
    short: "Tendon slack length",
    symbol: "\u2113\u209b",
    unit: "m",
    about: "Length of the tendon up to which it does not pull.",
  },
];

const copyOf = (effects) => effects.map((e) => ({ id: e.id, values: [...e.values] }));

export class State {
  constructor(description) {
    this.description = description;
    const muscles = description.muscles.map((m) => m.given);
    this.models = [{ label: "As given", muscles, intervals: [], effects: [] }, ...description.states];
    this.listeners = [];
    this.go(this.models[0]);
  }

  /** Takes on the values of a model: as given, or one that was fitted. */
  go(model) {
    this.model = model;
    this.muscles = model.muscles.map((m) => [...m]);
    this.effects = copyOf(model.effects);
    this.changed("all");
  }

  setMuscle(muscle, property, value) {
    this.muscles[muscle][property] = value;
    this.changed("muscle");
  }

  effect(id) {
    return this.effects.find((e) => e.id === id) ?? null;
  }

  /** Switches an effect on, as it was fitted last, else with a usual size; or off. */
  switchEffect(id, on) {
    this.effects = this.effects.filter((e) => e.id !== id);
    if (on) this.effects.push({ id, values: this.usual(id) });
    this.changed("effects");
  }

  setEffect(id, parameter, value) {
    this.effect(id).values[parameter] = value;
    this.changed("effect");
  }

  usual(id) {
    const fitted = this.models
      .toReversed()
      .flatMap((m) => m.effects)
      .find((e) => e.id === id);
    if (fitted) return [...fitted.values];
    const { parameters } = this.description.effects.find((e) => e.id === id);
    return parameters.map((p) => {
      if (!p.amplitude) return p.start;
      const [low, high] = p.range;
      const sign = high > 0 ? 1 : -1;
      return Math.min(Math.max(sign * p.scale, low), high);
    });
  }

  /** Intervals that the newest fit has found. */
  intervals() {
    return this.model.intervals.length ? this.model.intervals : [];
  }

  isChanged() {
    return (
      JSON.stringify([this.muscles, this.effects]) !== JSON.stringify([this.model.muscles, copyOf(this.model.effects)])
    );
  }

  /** What the engine is asked with. */
  message() {
    return { muscles: this.muscles.map((m) => [...m]), effects: copyOf(this.effects) };
  }

  changed(what) {
    for (const listener of this.listeners) listener(what);
  }
}
