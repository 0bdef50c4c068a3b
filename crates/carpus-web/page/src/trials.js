// All trials as small figures, and one of them large, with what is left of it.
import { Figure } from "./figure.js";
import { element, percent, shown, words } from "./format.js";
import { saveButtons } from "./saving.js";

const TIME = { name: "time", unit: "s" };
const MOMENT = { name: "moment", unit: "N·m" };
export const USES = { train: "training", test: "held out", mvc: "maximal contraction" };

/** Columns of what was recorded. */
export function columns(recorded, samples) {
  const part = (k) => recorded.subarray(k * samples, (k + 1) * samples);
  return { time: part(0), angle: part(1), speed: part(2), measured: part(3), activation: part(4) };
}

export class Trials {
  constructor(description, recorded) {
    this.trials = description.trials.map((trial, i) => ({ ...trial, ...columns(recorded[i], trial.samples) }));
    this.chosen = 0;
    this.large = new Figure({ label: "Moment of the chosen trial", x: TIME, y: MOMENT, width: 900, height: 250 });
    this.left = new Figure({
      label: "Measured minus simulated moment of the chosen trial",
      x: TIME,
      y: { name: "residual", unit: "N·m" },
      width: 900,
      height: 140,
    });
    this.title = element("h3", {});
    this.errors = element("p", { class: "result" });
    const name = () => `${this.trials[this.chosen].name}`;
    this.focus = element(
      "figure",
      { class: "panel live-focus" },
      element(
        "div",
        { class: "heading" },
        this.title,
        saveButtons(this.large, name, () => this.table()),
      ),
      this.errors,
      element("div", { class: "sub" }, this.large.root),
      element(
        "div",
        { class: "heading" },
        element("p", { class: "soft" }, "Measured minus simulated"),
        saveButtons(this.left, () => `${name()}_residual`),
      ),
      element("div", { class: "sub" }, this.left.root),
    );
    this.panels = this.trials.map((trial, i) => this.panel(trial, i));
    this.grid = element("div", { class: "live-grid" }, ...this.panels.map((p) => p.root));
  }

  panel(trial, i) {
    const figure = new Figure({
      label: `${trial.condition}: ${trial.name}`,
      x: TIME,
      y: MOMENT,
      width: 210,
      height: 110,
      small: true,
    });
    const error = element("span", { class: "live-error" });
    const name = element("span", { class: "name", title: trial.name }, trial.condition + posture(trial));
    const root = element(
      "button",
      { type: "button", class: `panel live-trial ${trial.use}` },
      element("span", { class: "live-caption" }, name, error),
      figure.root,
    );
    root.addEventListener("click", () => this.choose(i));
    return { root, figure, error };
  }

  choose(i) {
    this.chosen = i;
    this.panels.forEach((p, k) => p.root.setAttribute("aria-pressed", k === i));
    this.drawFocus(false);
    this.onChoose?.();
  }

  /** - `given`, `now`: what the engine answered */
  show(given, now) {
    Object.assign(this, { given, now });
    this.panels.forEach((panel, i) => {
      panel.figure.draw(this.curves(i), { keep: true });
      panel.error.textContent = percent(now.errors.nrmse[i]);
    });
    this.drawFocus(true);
  }

  curves(i) {
    const { time, measured } = this.trials[i];
    return [
      { name: "measured", class: "measured", x: time, y: measured },
      { name: "as given", class: "before", x: time, y: this.given.moments[i] },
      { name: "now", class: "after", x: time, y: this.now.moments[i] },
    ];
  }

  drawFocus(keep) {
    if (!this.now) return;
    const i = this.chosen;
    const { time, measured, use, condition, name } = this.trials[i];
    this.title.textContent = `${condition}${posture(this.trials[i])} `;
    this.title.append(element("small", {}, `${name}, ${USES[use] ?? use}`));
    const { nrmse, rmse_n_m: rmse } = this.now.errors;
    this.errors.replaceChildren(
      element("span", {}, "NRMSE as given ", element("b", {}, percent(this.given.errors.nrmse[i]))),
      element("span", {}, "now ", element("b", {}, percent(nrmse[i]))),
      element("span", {}, "RMS error now ", element("b", {}, `${shown(rmse[i])}\u202fN·m`)),
    );
    this.large.draw(this.curves(i), { keep });
    const residual = (moments) => measured.map((m, k) => m - moments[k]);
    this.left.draw(
      [
        { name: "as given", class: "before", x: time, y: residual(this.given.moments[i]) },
        { name: "now", class: "after", x: time, y: residual(this.now.moments[i]) },
      ],
      { keep },
    );
  }

  /** Every sample of the chosen trial. */
  table() {
    return [["time_s", "angle_deg", "measured_n_m", "as_given_n_m", "now_n_m"], ...this.rows(this.chosen)];
  }

  rows(i) {
    const { time, angle, measured } = this.trials[i];
    return Array.from(time, (t, k) => [t, angle[k], measured[k], this.given.moments[i][k], this.now.moments[i][k]]);
  }

  /** Every sample of all trials. */
  wholeTable() {
    const rows = this.trials.flatMap((trial, i) => this.rows(i).map((row) => [trial.name, trial.use, ...row]));
    return [["trial", "use", "time_s", "angle_deg", "measured_n_m", "as_given_n_m", "now_n_m"], ...rows];
  }
}

function posture(trial) {
  const own = trial.posture_deg === null ? "" : ` at ${shown(trial.posture_deg)}°`;
  const held = ({ coordinate, value, unit }) => `, ${words(coordinate)} ${shown(value)}${unit === "m" ? "\u202fm" : "°"}`;
  return own + trial.held.map(held).join("");
}
