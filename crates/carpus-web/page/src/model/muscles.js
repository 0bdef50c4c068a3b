// The list of muscles: length and moment arm of each in the present posture; chosen ones are drawn as curves.
import { button, element, shown } from "../format.js";

export class Muscles {
  /** - `onChoose`: (set of muscles); `onHover`: (muscle or null) */
  constructor({ muscles }, { onChoose, onHover }) {
    Object.assign(this, { onChoose, chosen: new Set() });
    this.rows = muscles.map((muscle, m) => {
      const box = element("input", { type: "checkbox" });
      box.setAttribute("aria-label", `Draw the curves of ${muscle.name}`);
      box.addEventListener("change", () => this.toggle(m));
      const [length, arm] = [element("td", { class: "n" }), element("td", { class: "n" })];
      const title = `maximum isometric force ${shown(muscle.max_isometric_force)} N`;
      const name = element("label", { title }, box, element("span", { class: "live-swatch" }), muscle.name);
      const root = element("tr", {}, element("th", { scope: "row" }, name), length, arm);
      root.dataset.muscle = muscle.name;
      root.addEventListener("pointerenter", () => onHover(m));
      root.addEventListener("pointerleave", () => onHover(null));
      box.addEventListener("focus", () => onHover(m));
      box.addEventListener("blur", () => onHover(null));
      return { root, box, length, arm, swatch: name.children[1] };
    });
    this.filter = element("input", { type: "search", class: "live-filter", placeholder: "Find a muscle" });
    this.filter.setAttribute("aria-label", "Find a muscle");
    this.filter.addEventListener("input", () => this.search(muscles));
    this.armHead = element("th", { scope: "col", class: "n" });
    const head = element(
      "tr",
      {},
      element("th", { scope: "col" }, "Muscle"),
      element("th", { scope: "col", class: "n", title: "Length of the muscle and its tendon" }, "Length mm"),
      this.armHead,
    );
    const table = element(
      "table",
      { class: "live-list" },
      element("thead", {}, head),
      element("tbody", {}, ...this.rows.map((r) => r.root)),
    );
    this.root = element(
      "div",
      {},
      element(
        "div",
        { class: "live-tools" },
        this.filter,
        button("None", () => this.choose(new Set())),
        button("All that turn it", () => this.choose(new Set(this.turning())), {
          title: "Muscles with a moment arm about the coordinate of the curves",
        }),
      ),
      table,
    );
  }

  search(muscles) {
    const wanted = this.filter.value.trim().toLowerCase();
    this.rows.forEach((row, m) => {
      row.root.hidden = !muscles[m].name.toLowerCase().includes(wanted);
    });
  }

  toggle(m) {
    const chosen = new Set(this.chosen);
    if (!chosen.delete(m)) chosen.add(m);
    this.choose(chosen);
  }

  choose(chosen) {
    this.chosen = chosen;
    this.rows.forEach((row, m) => {
      row.box.checked = chosen.has(m);
      row.root.classList.toggle("picked", chosen.has(m));
    });
    this.onChoose(chosen);
  }

  /** Muscles with a moment arm, the largest first. */
  turning() {
    const NO_ARM = 1e-5;
    const arms = [...(this.arms ?? [])].map((arm, m) => [Math.abs(arm), m]).filter(([arm]) => arm > NO_ARM);
    return arms.sort((a, b) => b[0] - a[0]).map(([, m]) => m);
  }

  /** - `unit`: of the coordinate: about a translation a moment arm has none */
  show({ paths }, arms, unit) {
    this.arms = arms;
    const isLength = unit === "deg";
    this.armHead.textContent = isLength ? "Arm mm" : "Arm";
    this.armHead.title = "Moment arm about the coordinate of the curves, couplers followed";
    this.rows.forEach((row, m) => {
      row.length.textContent = shown(1e3 * paths[m].length, 4);
      row.arm.textContent = Math.abs(arms[m]) < 1e-8 ? "0" : shown(isLength ? 1e3 * arms[m] : arms[m], 3);
      [row.root.dataset.length, row.root.dataset.arm] = [paths[m].length, arms[m]];
    });
  }

  paint(colors) {
    this.rows.forEach((row, m) => row.swatch.style.setProperty("background", colors[m]));
  }

  light(lit) {
    this.rows.forEach((row, m) => row.root.classList.toggle("lit", m === lit));
  }
}
