// The page of a model: in any posture, in three dimensions, with lengths and moment arms.
import { Figure } from "../figure.js";
import { button, element, shown, words } from "../format.js";
import { cycled, MUSCLE } from "../palette.js";
import { Newest, Remote } from "../remote.js";
import { csv, save, saveButtons } from "../saving.js";
import { block, sceneModule } from "../unpack.js";
import { Coordinates, held, range } from "./coordinates.js";
import { Muscles } from "./muscles.js";
import { OpenSimTable } from "./opensim.js";

/** Values of a coordinate over which curves are drawn. */
const VALUES = 121;
/** Muscles that are chosen at the start, and at most drawn as curves. */
const [FIRST, MOST] = [4, 24];
/** Up to so many wrapping surfaces are all drawn at the start. */
const FEW_SURFACES = 8;

const at = (id) => document.getElementById(id);

class Page {
  constructor(remote, description, scene) {
    Object.assign(this, { remote, description, scene, lit: null });
    const given = (at("live").dataset.start ?? "").split(" ").filter(Boolean).map(Number);
    this.start = description.start.map((v, i) => given[i] ?? v);
    this.q = [...this.start];
    this.coordinates = new Coordinates(description, (i, value) => this.set(i, value));
    this.muscles = new Muscles(description, { onChoose: () => this.chosen(), onHover: (m) => this.light(m) });
    this.theirs = null;
    this.opensim = new OpenSimTable(description, { onTable: (table) => this.beside(table), about: () => this.about });
    const x = { name: "", unit: "" };
    this.length = new Figure({
      label: "Lengths of the chosen muscles",
      x,
      y: { name: "length", unit: "mm" },
      width: 420,
      height: 220,
      zero: false,
    });
    this.arm = new Figure({
      label: "Moment arms of the chosen muscles",
      x,
      y: { name: "moment arm", unit: "mm" },
      width: 420,
      height: 220,
    });
    for (const figure of [this.length, this.arm]) {
      figure.onDrag = (value) => this.set(this.about, value / this.axis().scale);
      figure.onPoint = (_, muscle) => this.light(muscle);
    }
    this.newest = new Newest((asked) => this.compute(asked));
  }

  axis() {
    return this.description.coordinates[this.about];
  }

  set(i, value) {
    this.q[i] = value;
    this.ask();
  }

  ask() {
    const section = at("live");
    section.dataset.changed = performance.now();
    section.dataset.settled = false;
    return this.newest.ask({ q: [...this.q], about: this.about, chosen: [...this.muscles.chosen].slice(0, MOST) });
  }

  /** Shows a table of OpenSim beside the curves: over its coordinate, with its muscles; null: none. */
  beside(table) {
    this.theirs = table;
    if (table) {
      for (const [i, value] of table.held) this.q[i] = value;
      this.about = table.about;
      this.axisSelect.value = table.about;
      this.ready = false;
      this.muscles.choose(new Set(table.curves.map((curve) => curve.muscle)));
      this.ready = true;
    }
    if (this.swept) this.swept.key = null;
    this.chosen();
  }

  /** Our values where the table of OpenSim has its own, one array for each of its curves. */
  async atTheirs(q) {
    const { about, x, curves } = this.theirs;
    const muscles = [...new Set(curves.map((curve) => curve.muscle))];
    const swept = await this.remote.call("sweep", { q, about, values: [...x], muscles });
    const part = (k) => swept.subarray(k * x.length, (k + 1) * x.length);
    return curves.map(({ muscle, kind }) => part(2 * muscles.indexOf(muscle) + (kind === "arm" ? 1 : 0)));
  }

  /** Posture and moment arms; curves, where anything that they depend on has changed. */
  async compute({ q, about, chosen }) {
    const axis = this.description.coordinates[about];
    const [flat, arms] = await Promise.all([
      this.remote.call("posture", { q }),
      this.remote.call("momentArms", { q, about }),
    ]);
    this.posture = this.scene.decoded(flat, this.description);
    this.arms = arms;
    this.view?.show(this.posture);
    this.coordinates.show(this.posture.q);
    this.muscles.show(this.posture, arms, axis.unit);
    const others = q.map((v, i) => (i === about ? 0 : v));
    const key = JSON.stringify([others, about, chosen]);
    if (key !== this.swept?.key) {
      const [low, high] = range(axis);
      const values = Array.from({ length: VALUES }, (_, k) => low + ((high - low) * k) / (VALUES - 1));
      const swept = await this.remote.call("sweep", { q, about, values, muscles: chosen });
      const part = (k) => swept.subarray(k * VALUES, (k + 1) * VALUES);
      const curves = chosen.map((m, i) => ({ muscle: m, length: part(2 * i), arm: part(2 * i + 1) }));
      this.swept = { key, about, values, curves };
      const { theirs } = this;
      if (theirs?.about === about) this.opensim.compare(theirs, await this.atTheirs(q));
      else if (theirs) this.opensim.away();
      this.drawCurves();
    }
    const now = this.posture.q[about] * axis.scale;
    this.length.mark(now);
    this.arm.mark(now);
    await this.drawLevers();
    const section = at("live");
    section.dataset.renewed = performance.now();
    section.dataset.settled = true;
  }

  drawCurves() {
    const { about, values, curves } = this.swept;
    const axis = this.description.coordinates[about];
    const x = Float64Array.from(values, (v) => v * axis.scale);
    const title = { name: words(axis.name), unit: axis.unit || "1" };
    const isLength = axis.unit === "deg";
    this.arm.y = isLength ? { name: "moment arm", unit: "mm" } : { name: "moment arm", unit: "1" };
    const of = (what, factor) =>
      curves.map((curve) => ({
        name: this.description.muscles[curve.muscle].name,
        class: "series",
        color: this.colors[curve.muscle],
        key: curve.muscle,
        x,
        y: curve[what].map((v) => v * factor),
      }));
    const theirs = (what, factor) => {
      const drawn = this.theirs?.about === about ? this.theirs.curves.filter((c) => c.kind === what) : [];
      return drawn
        .filter(({ muscle }) => this.muscles.chosen.has(muscle))
        .map(({ muscle, y }) => ({
          name: `${this.description.muscles[muscle].name}, OpenSim's table`,
          class: "series theirs",
          key: muscle,
          x: Float64Array.from(this.theirs.x, (v) => v * axis.scale),
          y: y.map((v) => v * factor),
        }));
    };
    const factor = isLength ? 1e3 : 1;
    for (const [figure, drawn] of [
      [this.length, [...of("length", 1e3), ...theirs("length", 1e3)]],
      [this.arm, [...of("arm", factor), ...theirs("arm", factor)]],
    ]) {
      figure.x = title;
      figure.draw(drawn);
    }
  }

  async drawLevers() {
    if (!this.view) return;
    const wanted = this.showLevers ? [...this.muscles.chosen] : [];
    const found = await Promise.all(
      wanted.map((muscle) => this.remote.call("lever", { q: this.q, about: this.about, muscle })),
    );
    const levers = found.map((lever, i) => ({ lever, muscle: wanted[i], color: this.colors[wanted[i]] }));
    this.levers = levers.filter(({ lever }) => lever.length);
    this.view.levers(this.levers);
    this.label();
  }

  /** Numbers beside the moment arms that are drawn. */
  label() {
    const texts = (this.levers ?? []).map(({ lever, muscle, color }) => {
      const middle = [0, 1, 2].map((k) => (lever[3 + k] + lever[6 + k]) / 2);
      const [x, y] = this.view.on(middle);
      const isLength = this.axis().unit === "deg";
      const text = isLength ? `${shown(1e3 * this.arms[muscle])}\u202fmm` : shown(this.arms[muscle]);
      const made = element("span", { class: "live-label" }, text);
      for (const [name, value] of [
        ["left", `${x + 6}px`],
        ["top", `${y - 9}px`],
        ["border-color", color],
      ]) {
        made.style.setProperty(name, value);
      }
      return made;
    });
    this.labels.replaceChildren(...texts);
  }

  /** Colours of muscles: chosen ones as their curves. */
  paint() {
    const { muscles } = this.description;
    const chosen = [...this.muscles.chosen];
    this.colors = muscles.map((_, m) => {
      const place = chosen.indexOf(m);
      if (this.everyColor) return cycled(m);
      return place < 0 ? MUSCLE : cycled(place);
    });
    this.muscles.paint(this.colors);
    this.view?.paint(this.colors, this.lit === null ? new Set() : new Set([this.lit]));
  }

  /** Which wrapping surfaces are drawn. */
  chooseSurfaces() {
    const { wraps } = this.description;
    const mode = this.surfaces.value;
    const belongs = ({ active, muscles }) =>
      active && (mode === "all" ? muscles.length > 0 : mode === "chosen" && muscles.some((m) => this.muscles.chosen.has(m)));
    this.view?.choose({
      bones: this.showBones.checked,
      wraps: new Set(wraps.flatMap((wrap, w) => (belongs(wrap) ? [w] : []))),
    });
  }

  chosen() {
    if (!this.ready) return;
    this.paint();
    this.chooseSurfaces();
    this.ask();
  }

  /** Lets a muscle stand out everywhere; null: none. */
  light(muscle) {
    if (this.lit === muscle) return;
    this.lit = muscle;
    this.muscles.light(muscle);
    this.length.light(muscle);
    this.arm.light(muscle);
    this.view?.paint(this.colors, muscle === null ? new Set() : new Set([muscle]));
  }

  /** The free coordinate that most muscles turn, and those that turn it most. */
  async begin() {
    const { coordinates } = this.description;
    const free = coordinates.flatMap((c, i) => (held(c) === null ? [i] : []));
    const all = await Promise.all(free.map((about) => this.remote.call("momentArms", { q: this.q, about })));
    const turned = all.map((arms) => arms.filter((arm) => Math.abs(arm) > 1e-3).length);
    const isTurn = free.map((i) => (coordinates[i].unit === "deg" ? 1 : 0));
    const best = free.map((_, k) => k).sort((a, b) => isTurn[b] - isTurn[a] || turned[b] - turned[a] || a - b)[0];
    this.about = free[best] ?? 0;
    this.muscles.arms = all[best] ?? [];
    this.muscles.choose(new Set(this.muscles.turning().slice(0, FIRST)));
    this.ready = true;
  }

  /** The coordinate that curves go over. */
  axisChoice() {
    const options = this.description.coordinates.flatMap((c, i) =>
      held(c) === null ? [element("option", { value: i }, words(c.name))] : [],
    );
    const choice = element("select", {}, ...options);
    choice.setAttribute("aria-label", "Coordinate of the curves and moment arms");
    choice.value = this.about;
    this.axisSelect = choice;
    choice.addEventListener("change", () => {
      this.about = Number(choice.value);
      this.ask();
    });
    return element("label", { class: "live-choice" }, "Curves over ", choice);
  }

  tools() {
    const switched = (text, act, checked = false) => {
      const box = element("input", { type: "checkbox", checked });
      box.addEventListener("change", () => act(box.checked));
      return [box, element("label", { class: "live-choice" }, box, text)];
    };
    const surfaces = [
      ["all", "all"],
      ["chosen", "of chosen"],
      ["none", "none"],
    ].map(([value, text]) => element("option", { value }, text));
    this.surfaces = element("select", { title: "Surfaces that muscles wrap over" }, ...surfaces);
    this.surfaces.setAttribute("aria-label", "Wrapping surfaces that are drawn");
    this.surfaces.value = this.description.wraps.length > FEW_SURFACES ? "chosen" : "all";
    this.surfaces.addEventListener("change", () => this.chooseSurfaces());
    const [bones, bonesLabel] = switched("Bones", () => this.chooseSurfaces(), true);
    this.showBones = bones;
    const [, levers] = switched("Moment arms", (on) => {
      this.showLevers = on;
      this.drawLevers();
    });
    const [, colors] = switched("Colour all", (on) => {
      this.everyColor = on;
      this.paint();
      this.drawCurves();
      this.drawLevers();
    });
    return element(
      "div",
      { class: "live-tools live-scene-tools" },
      bonesLabel,
      levers,
      colors,
      this.description.wraps.length
        ? element("label", { class: "live-choice" }, "Surfaces ", this.surfaces)
        : null,
      element("span", { class: "live-grow" }),
      button("Whole model", () => this.view?.home()),
      button("Picture", () => this.savePicture(), { "aria-label": "Save a picture of the model (PNG)" }),
    );
  }

  async savePicture() {
    const ground = getComputedStyle(document.body).backgroundColor;
    save(`${this.description.name}.png`, await this.view.picture(ground), "image/png");
  }

  /** Coordinates, lengths and moment arms in this posture, as files. */
  saves() {
    const posture = () => {
      const { coordinates, muscles } = this.description;
      const rows = coordinates.map((c, i) => ["coordinate", c.name, c.unit || "1", this.posture.q[i] * c.scale]);
      const about = this.axis().name;
      const armUnit = this.axis().unit === "deg" ? "m" : "1";
      muscles.forEach((muscle, m) => {
        rows.push(["length", muscle.name, "m", this.posture.paths[m].length]);
        rows.push([`moment arm about ${about}`, muscle.name, armUnit, this.arms[m]]);
      });
      return [["what", "of", "unit", "value"], ...rows];
    };
    const points = () => {
      const rows = this.posture.paths.flatMap(({ points: all }, m) =>
        Array.from({ length: all.length / 3 }, (_, i) => [
          this.description.muscles[m].name,
          i,
          ...all.subarray(3 * i, 3 * i + 3),
        ]),
      );
      return [["muscle", "point", "x_m", "y_m", "z_m"], ...rows];
    };
    const saved = (text, name, table) =>
      button(text, () => save(name, csv(table()), "text/csv"), { "aria-label": `Save ${text}` });
    return element(
      "div",
      { class: "live-tools" },
      element("span", { class: "soft" }, "Save"),
      saved("posture", "posture.csv", posture),
      saved("path points", "points.csv", points),
    );
  }

  /** Curves with all digits. */
  table(what) {
    const axis = this.axis();
    const unit = what === "length" || axis.unit === "deg" ? "_m" : "";
    const { values, curves } = this.swept;
    const name = ({ muscle }) => this.description.muscles[muscle].name;
    const head = [`${axis.name}_${axis.unit || "1"}`, ...curves.map((c) => `${name(c)}_${what}${unit}`)];
    return [head, ...values.map((v, k) => [v * axis.scale, ...curves.map((c) => c[what === "length" ? what : "arm"][k])])];
  }

  figures() {
    const panel = (figure, title, what) =>
      element(
        "figure",
        { class: "panel" },
        element(
          "figcaption",
          {},
          element("span", { class: "name" }, title),
          saveButtons(figure, () => what, () => this.table(what)),
        ),
        element("div", { class: "sub" }, figure.root),
      );
    return [panel(this.length, "Length", "length"), panel(this.arm, "Moment arm", "moment_arm")];
  }

  async open3d(holder) {
    const posture = this.scene.decoded(await this.remote.call("posture", { q: this.q }), this.description);
    const geometry = await block("live-geometry");
    const label =
      `${this.description.name} in three dimensions. Drag or arrow keys turn it, plus and minus bring it nearer, ` +
      "Home shows all of it.";
    try {
      this.view = new this.scene.View3d({ holder, description: this.description, geometry, posture, label });
    } catch (error) {
      const text = `This browser cannot draw in three dimensions (${error.message}). Lengths and moment arms are right.`;
      holder.append(element("p", { class: "soft" }, text));
      return;
    }
    const tip = element("div", { class: "tip", hidden: true });
    this.labels = element("div", { class: "live-labels" });
    holder.append(this.labels, tip);
    this.view.onDrawn = () => this.label();
    this.view.onSelect = (muscle) => this.muscles.toggle(muscle);
    this.view.onHover = (muscle, event) => {
      this.light(muscle);
      tip.hidden = muscle === null;
      if (muscle === null) return;
      const { name, max_isometric_force: force } = this.description.muscles[muscle];
      tip.replaceChildren(
        element("b", {}, name),
        element("div", {}, `length ${shown(1e3 * this.posture.paths[muscle].length, 4)}\u202fmm`),
        element("div", {}, `F\u2098\u2090\u2093 ${shown(force)}\u202fN`),
      );
      const box = holder.getBoundingClientRect();
      tip.style.setProperty("left", `${Math.min(event.clientX - box.left + 14, box.width - 150)}px`);
      tip.style.setProperty("top", `${event.clientY - box.top + 14}px`);
    };
  }
}

async function start() {
  const section = at("live");
  section.hidden = false;
  const began = performance.now();
  const [code, model, scene] = await Promise.all([block("live-module"), block("live-model"), sceneModule()]);
  const remote = Remote.ofPage();
  const description = await remote.call("openModel", { module: await WebAssembly.compile(code), bytes: model });
  const units = section.dataset.units.split("|");
  description.coordinates.forEach((c, i) => {
    c.unit = units[i];
    c.scale = c.unit === "deg" ? 180 / Math.PI : 1;
  });
  const page = new Page(remote, description, scene);
  await page.begin();
  at("live-coordinates").append(
    element(
      "div",
      { class: "heading" },
      element("h2", {}, "Coordinates"),
      button("As given", () => {
        page.q = [...page.start];
        page.ask();
      }),
    ),
    page.saves(),
    page.coordinates.root,
  );
  at("live-muscles").append(element("h2", {}, `Muscles (${description.muscles.length})`), page.muscles.root);
  const holder = at("live-stage");
  at("live-stage-tools").append(page.tools());
  await page.open3d(holder);
  at("live-curves").append(
    element("div", { class: "live-tools" }, page.axisChoice(), page.opensim.choice, page.opensim.remove),
    element("div", { class: "live-pair" }, ...page.figures()),
    page.opensim.said,
  );
  page.paint();
  page.chooseSurfaces();
  await page.ask();
  at("live-status").textContent = "";
  section.dataset.started = performance.now() - began;
}

start().catch((error) => {
  at("live-status").textContent = `This page cannot compute here: ${error.message}.`;
});
