// The model in the posture of the chosen trial, along its time; what every muscle does there.
import { Figure } from "./figure.js";
import { button, element, shown } from "./format.js";
import { cycled, heat, MUSCLE } from "./palette.js";
import { Newest } from "./remote.js";
import { save, saveButtons } from "./saving.js";
import { sceneModule } from "./unpack.js";

/** What is drawn of a muscle, in the order in which the program gives it. */
const SHOWN = [
  { key: "activation", name: "activation", unit: "1" },
  { key: "force", name: "force", unit: "N" },
  { key: "moment", name: "moment", unit: "N·m" },
];
const TIME = { name: "time", unit: "s" };
/** Steps of the slider over a trial. */
const STEPS = 1000;

export class Motion {
  constructor({ engine, state, trials, tell, fieldsets }) {
    Object.assign(this, { engine, state, trials, tell, fieldsets, lit: null, time: null, playing: false });
    this.what = SHOWN[2];
    this.figure = new Figure({
      label: "Moment of every muscle in the chosen trial",
      x: TIME,
      y: this.what,
      width: 420,
      height: 250,
    });
    this.stage = element("div", { class: "live-stage live-motion-stage" });
    this.scale = element("p", { class: "live-scale" });
    this.root = element(
      "figure",
      { class: "panel live-motion" },
      element(
        "div",
        { class: "heading" },
        element("h3", {}, "The model in this trial"),
        saveButtons(this.figure, () => `${this.trial().name}_muscles`, () => this.table()),
      ),
      this.tools(),
      element(
        "div",
        { class: "live-pair" },
        element("div", { class: "live-motion-left" }, this.stage, this.scale),
        element("div", {}, this.legend(), element("div", { class: "sub" }, this.figure.root)),
      ),
    );
    this.poses = new Newest((asked) => this.pose(asked));
    this.muscles = new Newest((asked) => this.simulate(asked));
    for (const figure of [trials.large, trials.left, this.figure]) figure.onDrag = (time) => this.go(time);
    for (const figure of [trials.large, trials.left]) figure.onPoint = (time) => this.pointed(time);
    this.figure.onPoint = (time, muscle) => {
      this.pointed(time);
      this.light(muscle);
    };
    fieldsets.forEach((fieldset, i) => {
      fieldset.addEventListener("pointerenter", () => this.light(i));
      fieldset.addEventListener("pointerleave", () => this.light(null));
    });
    // Nothing of it is needed before it is seen.
    this.seen = new IntersectionObserver(([entry]) => entry.isIntersecting && this.open(), { rootMargin: "300px" });
    this.seen.observe(this.root);
  }

  trial() {
    return this.trials.trials[this.trials.chosen];
  }

  tools() {
    this.play = button("Play", () => this.toggle());
    this.slider = element("input", { type: "range", min: 0, max: STEPS, value: 0, class: "live-time" });
    this.slider.setAttribute("aria-label", "Time in the trial");
    this.slider.addEventListener("input", () => {
      const { time } = this.trial();
      this.pause();
      this.go(time[0] + (this.slider.value / STEPS) * (time.at(-1) - time[0]));
    });
    this.clock = element("span", { class: "live-clock" });
    const choice = (label, options, act) => {
      const made = element("select", {}, ...options.map(([value, text]) => element("option", { value }, text)));
      made.setAttribute("aria-label", label);
      made.addEventListener("change", () => act(made.value));
      return element("label", { class: "live-choice" }, `${label} `, made);
    };
    const colors = choice(
      "Colour",
      [
        ["activation", "activation"],
        ["force", "force"],
      ],
      (value) => {
        this.color = value;
        this.paint();
      },
    );
    this.color = "activation";
    const curves = choice(
      "Curves",
      ["moment", "force", "activation"].map((key) => [key, key]),
      (value) => {
        this.what = SHOWN.find(({ key }) => key === value);
        this.draw();
      },
    );
    return element(
      "div",
      { class: "live-tools live-scene-tools" },
      this.play,
      this.slider,
      this.clock,
      colors,
      curves,
      element("span", { class: "live-grow" }),
      button("Whole model", () => this.view?.home()),
      button("Picture", () => this.savePicture(), { "aria-label": "Save a picture of the model (PNG)" }),
    );
  }

  /** Names of the muscles, each with the colour of its curve. */
  legend() {
    this.names = this.state.description.muscles.map(({ name }, i) => {
      const swatch = element("span", { class: "live-swatch" });
      swatch.style.setProperty("background", cycled(i));
      const made = button("", () => this.keep(i), { class: "live-name" });
      made.append(swatch, name);
      made.setAttribute("aria-pressed", false);
      for (const [event, muscle] of [
        ["pointerenter", i],
        ["pointerleave", null],
        ["focus", i],
        ["blur", null],
      ]) {
        made.addEventListener(event, () => this.light(muscle));
      }
      return made;
    });
    return element("div", { class: "live-tools live-names" }, ...this.names);
  }

  async open() {
    this.seen.disconnect();
    const { remote } = this.engine;
    try {
      const [scene, { description, geometry }] = await Promise.all([sceneModule(), remote.call("openStage")]);
      Object.assign(this, { scene, description });
      // Which muscle of the model each of those that are simulated is.
      this.places = this.state.description.muscles.map(({ name }) => description.muscles.findIndex((m) => m.name === name));
      const flat = await remote.call("postureAt", { trial: this.trials.chosen, sample: 0 });
      const posture = scene.decoded(flat, description);
      const label =
        "The model in the posture of the trial. Drag or arrow keys turn it, plus and minus bring it nearer, " +
        "Home shows all of it.";
      this.view = new scene.View3d({ holder: this.stage, description, geometry, posture, label });
    } catch (error) {
      this.stage.append(element("p", { class: "soft" }, `The model cannot be drawn here: ${error.message}`));
      return;
    }
    const wraps = this.description.wraps.flatMap(({ active, muscles }, w) =>
      active && muscles.some((m) => this.places.includes(m)) ? [w] : [],
    );
    this.view.choose({ bones: true, wraps: new Set(wraps) });
    const tip = element("div", { class: "tip", hidden: true });
    this.stage.append(tip);
    this.view.onHover = (muscle, event) => {
      const place = muscle === null ? -1 : this.places.indexOf(muscle);
      this.light(place < 0 ? null : place);
      tip.hidden = muscle === null;
      if (muscle === null) return;
      tip.replaceChildren(element("b", {}, this.description.muscles[muscle].name), ...this.readings(place));
      const box = this.stage.getBoundingClientRect();
      tip.style.setProperty("left", `${Math.min(event.clientX - box.left + 14, box.width - 150)}px`);
      tip.style.setProperty("top", `${event.clientY - box.top + 14}px`);
    };
    this.view.onSelect = (muscle) => {
      const place = this.places.indexOf(muscle);
      if (place >= 0) this.keep(place);
    };
    this.renew();
  }

  readings(place) {
    if (place < 0) return [element("div", {}, "not simulated")];
    const k = this.sample();
    const row = ({ key, name, unit }) =>
      element("div", {}, `${name} ${shown(this.found?.[place]?.[key][k] ?? NaN)}\u202f${unit === "1" ? "" : unit}`);
    return SHOWN.map(row);
  }

  /** Another trial, or other muscles and effects. */
  renew() {
    if (!this.view) return;
    const { time } = this.trial();
    const trial = this.trials.chosen;
    if (this.of !== trial) {
      this.pause();
      this.of = trial;
      this.time = null;
    }
    if (this.time === null) this.go(time[0] + 0.5 * (time.at(-1) - time[0]));
    this.muscles.ask({ trial, ...this.state.message() });
  }

  async simulate({ trial, muscles, effects }) {
    try {
      const flat = await this.engine.remote.call("musclesOfTrial", { trial, muscles, effects });
      const { samples } = this.trials.trials[trial];
      const column = (i) => flat.subarray(i * samples, (i + 1) * samples);
      this.found = muscles.map((_, m) =>
        Object.fromEntries(SHOWN.map(({ key }, k) => [key, column(SHOWN.length * m + k)])),
      );
      this.forces = muscles.map(([force]) => force);
      if (trial !== this.trials.chosen) return;
      this.draw();
      this.paint();
    } catch (error) {
      this.tell(error.message);
    }
  }

  draw() {
    if (!this.found) return;
    this.figure.y = this.what;
    this.figure.root.setAttribute("aria-label", `${this.what.name} of every muscle in the chosen trial`);
    const curve = ({ name }, i) => ({
      name,
      class: "series",
      color: cycled(i),
      key: i,
      x: this.trial().time,
      y: this.found[i][this.what.key],
    });
    this.figure.draw(this.state.description.muscles.map(curve));
    this.figure.mark(this.time);
  }

  table() {
    const { muscles } = this.state.description;
    const heads = muscles.flatMap(({ name }) => [`${name}_activation`, `${name}_force_n`, `${name}_moment_n_m`]);
    const row = (t, k) => [t, ...this.found.flatMap((m) => SHOWN.map(({ key }) => m[key][k]))];
    return [["time_s", ...heads], ...Array.from(this.trial().time, row)];
  }

  /** The sample at the present time. */
  sample() {
    const { time } = this.trial();
    let [low, high] = [0, time.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (time[middle] < this.time) low = middle;
      else high = middle;
    }
    return this.time - time[low] < time[high] - this.time ? low : high;
  }

  pointed(time) {
    if (time !== null && !this.playing) this.go(time);
  }

  go(time) {
    const { time: times } = this.trial();
    this.time = Math.min(Math.max(time, times[0]), times.at(-1));
    this.slider.value = Math.round(((this.time - times[0]) / (times.at(-1) - times[0] || 1)) * STEPS);
    this.slider.setAttribute("aria-valuetext", `${shown(this.time)} s`);
    this.clock.textContent = `${this.time.toFixed(2)}\u202fs`;
    for (const figure of [this.trials.large, this.trials.left, this.figure]) figure.mark(this.time);
    if (this.view) this.poses.ask({ trial: this.trials.chosen, sample: this.sample() });
  }

  async pose({ trial, sample }) {
    const flat = await this.engine.remote.call("postureAt", { trial, sample });
    this.posture = this.scene.decoded(flat, this.description);
    this.paint();
    this.view.show(this.posture);
    this.root.dataset.sample = sample;
  }

  toggle() {
    if (this.playing) return this.pause();
    const { time } = this.trial();
    this.playing = true;
    this.play.textContent = "Pause";
    if (this.time >= time.at(-1) - 1e-9) this.time = time[0];
    let before = null;
    const step = (now) => {
      if (!this.playing) return;
      const next = this.time + (before === null ? 0 : (now - before) / 1000);
      before = now;
      this.go(next);
      if (next >= time.at(-1)) this.pause();
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  pause() {
    this.playing = false;
    this.play.textContent = "Play";
  }

  paint() {
    if (!this.view) return;
    const k = this.sample();
    const colors = this.description.muscles.map(() => MUSCLE);
    const thin = new Set(this.description.muscles.map((_, m) => m));
    this.places.forEach((place, i) => {
      const found = this.found?.[i];
      if (place < 0) return;
      thin.delete(place);
      if (found) colors[place] = heat(this.color === "force" ? found.force[k] / this.forces[i] : found.activation[k]);
    });
    const lit = this.lit === null || this.places[this.lit] < 0 ? new Set() : new Set([this.places[this.lit]]);
    this.view.paint(colors, lit, new Set(), thin);
    this.drawScale();
  }

  drawScale() {
    if (this.scaleOf === this.color) return;
    this.scaleOf = this.color;
    const bar = element("span", { class: "live-heat" });
    const stops = [0, 0.25, 0.6, 1].map((part) => `${heat(part)} ${100 * part}%`);
    bar.style.setProperty("background", `linear-gradient(90deg, ${stops.join(", ")})`);
    const end = this.color === "force" ? "maximum isometric force" : "1";
    this.scale.replaceChildren(`${this.color} 0 `, bar, ` ${end}. Thickness: maximum isometric force.`);
  }

  /** A muscle that stands out until it is pressed again. */
  keep(muscle) {
    this.kept = this.kept === muscle ? null : muscle;
    this.names.forEach((made, i) => made.setAttribute("aria-pressed", i === this.kept));
    this.light(this.kept);
  }

  /** Lets a muscle stand out everywhere; null: none, or the one that is kept. */
  light(muscle) {
    const lit = muscle ?? this.kept ?? null;
    if (this.lit === lit) return;
    this.lit = lit;
    this.figure.light(lit);
    this.names.forEach((made, i) => made.classList.toggle("lit", i === lit));
    this.fieldsets.forEach((fieldset, i) => fieldset.classList.toggle("lit", i === lit));
    this.paint();
  }

  async savePicture() {
    if (!this.view) return;
    const ground = getComputedStyle(document.body).backgroundColor;
    save(`${this.trial().name}.png`, await this.view.picture(ground), "image/png");
  }
}
