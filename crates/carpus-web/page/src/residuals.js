// What the residual depends on: means over bins of the angle, the velocity and the activation.
import { Figure } from "./figure.js";
import { element } from "./format.js";
import { saveButtons } from "./saving.js";

const BINS = 16;
const AXES = [
  { key: "angle", name: "angle", unit: "deg" },
  { key: "speed", name: "velocity", unit: "deg/s" },
  { key: "activation", name: "mean activation", unit: "1" },
];

/** Means over bins of equally many samples. */
function binned(trials, key, moments) {
  const samples = trials.flatMap((trial, i) => (trial.use === "mvc" ? [] : Array.from(trial[key], (x, k) => [x, trial.measured[k] - moments[i][k]])));
  samples.sort((a, b) => a[0] - b[0]);
  const [x, y] = [[], []];
  for (let bin = 0; bin < BINS; bin += 1) {
    const part = samples.slice(Math.floor((bin * samples.length) / BINS), Math.floor(((bin + 1) * samples.length) / BINS));
    if (!part.length) continue;
    x.push(part.reduce((sum, s) => sum + s[0], 0) / part.length);
    y.push(part.reduce((sum, s) => sum + s[1], 0) / part.length);
  }
  return { x, y };
}

export class Residuals {
  constructor(trials) {
    this.trials = trials;
    const y = { name: "residual", unit: "N·m" };
    this.figures = AXES.map((x) => new Figure({ label: `Residual against ${x.name}`, x, y, width: 420, height: 240 }));
    this.root = element("div", { class: "live-axes" }, ...this.figures.map((figure, i) => element("figure", { class: "panel" },
      element("figcaption", {}, element("span", { class: "name" }, `Against ${AXES[i].name}`), saveButtons(figure, () => `residual_${AXES[i].key}`)),
      element("div", { class: "sub" }, figure.root))));
  }

  show(given, now) {
    this.given ??= AXES.map(({ key }) => binned(this.trials, key, given.moments));
    this.figures.forEach((figure, i) => figure.draw([
      { name: "as given", class: "before", ...this.given[i] },
      { name: "now", class: "after", ...binned(this.trials, AXES[i].key, now.moments) },
    ], { keep: true }));
  }
}
