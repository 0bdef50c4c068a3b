// What the residual depends on: means over bins of the angle, the velocity and the activation.
import { Figure } from "./figure.js";
import { element } from "./format.js";
import { saveButtons } from "./saving.js";

const BINS = 16;
const AXES = [
  { key: "angle", name: "angle", unit: "deg" },
  { key: "speed", name: "velocity", unit: "deg/s" },
  { key: "activation", name: "activation", unit: "1" },
];

/** Means over bins of equal width, maximal contractions left out. */
function binned(trials, key, moments) {
  const taken = trials
    .map((trial, i) => ({ x: trial[key], measured: trial.measured, moment: moments[i], use: trial.use }))
    .filter((t) => t.use !== "mvc");
  let [low, high] = [Infinity, -Infinity];
  for (const { x } of taken)
    for (const v of x) {
      low = Math.min(low, v);
      high = Math.max(high, v);
    }
  const bins = Array.from({ length: BINS }, () => ({ count: 0, x: 0, y: 0 }));
  for (const { x, measured, moment } of taken) {
    for (let k = 0; k < x.length; k += 1) {
      const bin = bins[Math.min(BINS - 1, Math.floor(((x[k] - low) / (high - low || 1)) * BINS))];
      bin.count += 1;
      bin.x += x[k];
      bin.y += measured[k] - moment[k];
    }
  }
  const filled = bins.filter((b) => b.count);
  return { x: filled.map((b) => b.x / b.count), y: filled.map((b) => b.y / b.count) };
}

export class Residuals {
  constructor(trials) {
    this.trials = trials;
    const y = { name: "residual", unit: "N·m" };
    this.figures = AXES.map((x) => new Figure({ label: `Residual against ${x.name}`, x, y, width: 420, height: 240 }));
    this.root = element(
      "div",
      { class: "live-axes" },
      ...this.figures.map((figure, i) =>
        element(
          "figure",
          { class: "panel" },
          element(
            "figcaption",
            {},
            element("span", { class: "name" }, `Against ${AXES[i].name}`),
            saveButtons(figure, () => `residual_${AXES[i].key}`),
          ),
          element("div", { class: "sub" }, figure.root),
        ),
      ),
    );
  }

  show(given, now) {
    this.given ??= AXES.map(({ key }) => binned(this.trials, key, given.moments));
    this.figures.forEach((figure, i) =>
      figure.draw(
        [
          { name: "as given", class: "before", ...this.given[i] },
          { name: "now", class: "after", ...binned(this.trials, AXES[i].key, now.moments) },
        ],
        { keep: true },
      ),
    );
  }
}
