// The fall of the error: as given, with the muscles as they are now, with every effect that is on, one after the other.
import { drawn, element, percent, shown, ticks } from "./format.js";
import { saveButtons } from "./saving.js";

const [WIDTH, LABEL, RIGHT, ROW] = [860, 230, 70, 50];
/** Letters of a name that fit before the bars. */
const LETTERS = 30;

/** Steps from the model as given to that of a message: { label, message }, without a message where nothing differs. */
export function steps(description, { muscles, effects }) {
  const given = description.muscles.map((m) => m.given);
  const same = JSON.stringify(muscles) === JSON.stringify(given);
  const nameOf = (id) => description.effects.find((e) => e.id === id).name;
  return [
    { label: "As given", message: null },
    { label: "Muscles as they are now", message: same ? null : { muscles, effects: [] } },
    ...effects.map(({ id }, i) => ({
      label: `+ ${nameOf(id)}`,
      message: { muscles, effects: effects.slice(0, i + 1) },
    })),
  ];
}

export class Waterfall {
  constructor(engine) {
    this.engine = engine;
    this.svg = drawn("svg", { class: "waterfall", role: "img", "aria-label": "Error after every step" });
    const saves = saveButtons({ root: this.svg, table: () => this.table() }, () => "errors");
    const key = (kind, text) => element("span", {}, element("span", { class: `box ${kind}` }), text);
    this.root = element(
      "figure",
      { class: "panel live-waterfall" },
      element("div", { class: "heading" }, element("h3", {}, "Error, step by step"), saves),
      element("p", { class: "legend" }, key("train", "Training"), key("held", "Held out")),
      element("div", { class: "scroll" }, this.svg),
    );
  }

  /**
   * Simulates the steps between and draws all. How many steps there are changes with the effects alone, so that nothing below
   * moves while a slider does.
   *
   * - `given`, `now`: what the engine answered at both ends; `isNewest`: whether nothing was changed meanwhile
   */
  async show(given, now, message, isNewest) {
    const found = steps(this.engine.opened.description, message);
    const last = found.length - 1;
    for (const [i, step] of found.entries()) {
      const between = step.message !== null && i < last;
      const answer = between ? await this.engine.remote.call("simulate", step.message) : i === last ? now : given;
      if (!isNewest()) return;
      step.train = answer.errors.train?.nrmse ?? null;
      step.held = answer.errors.held_out?.nrmse ?? null;
    }
    this.steps = found;
    this.draw();
  }

  draw() {
    const height = 30 + ROW * this.steps.length + 26;
    const bottom = height - 26;
    const most = 1.02 * Math.max(1e-6, ...this.steps.flatMap((s) => [s.train, s.held]));
    const x = (part) => LABEL + (part / most) * (WIDTH - RIGHT - LABEL);
    this.svg.setAttribute("viewBox", `0 0 ${WIDTH} ${height}`);
    const marks = ticks([0, 100 * most], 5).flatMap((v) => [
      drawn("line", { class: "grid", x1: x(v / 100), x2: x(v / 100), y1: 22, y2: bottom }),
      drawn("text", { class: "tick", "text-anchor": "middle", x: x(v / 100), y: bottom + 16 }, `${shown(v)}\u202f%`),
    ]);
    const rows = this.steps.map((step, i) => {
      const row = drawn("g", { class: "live-step", "data-train": step.train ?? "", "data-held": step.held ?? "" });
      const before = this.steps[i - 1];
      const top = 30 + ROW * i;
      row.append(
        name(step.label, top + 22, i === this.steps.length - 1),
        ...bar(x, step.train, before?.train, top + 1, "train"),
        ...bar(x, step.held, before?.held, top + 19, "held"),
      );
      return row;
    });
    this.svg.replaceChildren(...marks, ...rows);
  }

  /** The numbers that are drawn, as rows of a table. */
  table() {
    return [["step", "training_nrmse", "held_out_nrmse"], ...this.steps.map((s) => [s.label, s.train, s.held])];
  }
}

function name(label, y, current) {
  const fits = label.length <= LETTERS ? label : `${label.slice(0, LETTERS - 1)}\u2026`;
  const text = drawn("text", { class: current ? "step current" : "step", x: 0, y }, fits);
  text.append(drawn("title", {}, label));
  return text;
}

/** A bar, with what it fell by since the step before as its shade. */
function bar(x, value, before, y, kind) {
  if (value === null) return [];
  const fell = (before ?? 0) > value;
  const box = (from, to, shape) =>
    drawn("rect", { class: `${shape} ${kind}`, x: x(from), y, width: Math.max(x(to) - x(from), 0.5), height: 15 });
  return [
    ...(fell ? [box(value, before, "ghost")] : []),
    box(0, value, "fill"),
    drawn("text", { class: "value", x: x(fell ? before : value) + 6, y: y + 12 }, percent(value)),
  ];
}
