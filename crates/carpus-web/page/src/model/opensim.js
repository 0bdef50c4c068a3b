// Beside our own curves those of a table that OpenSim wrote, and in words how far they differ.
import { button, element, shown, words } from "../format.js";
import { comparison, largest, parse } from "./table.js";

/** Smaller differences are those of rounding [m]. */
const ROUNDING = 1e-9;
/** Largest file that is read [bytes]. */
const MOST_BYTES = 50e6;

export class OpenSimTable {
  /**
   * - `description`: of the model
   * - `onTable`: (what was read), to show it; null: nothing any more
   * - `about`: the coordinate that curves go over now
   */
  constructor(description, { onTable, about }) {
    Object.assign(this, { description, onTable, about, read: null });
    this.input = element("input", { type: "file", multiple: true, accept: ".sto,.mot,.csv,.txt,.tsv" });
    this.input.setAttribute("aria-label", "Tables of OpenSim to compare with");
    this.input.addEventListener("change", () => this.open([...this.input.files]));
    this.remove = button("Remove", () => this.close(), { hidden: true });
    this.said = element("div", { class: "live-table", hidden: true });
    this.said.setAttribute("role", "status");
    const title =
      "Lengths or moment arms by muscle with the coordinate in one file (.sto, .mot, .csv), or two files with the same times";
    this.choice = element("label", { class: "live-choice", title }, "OpenSim's table ", this.input);
  }

  async open(files) {
    if (!files.length) return;
    try {
      const large = files.find((file) => file.size > MOST_BYTES);
      if (large) throw new Error(`${large.name} is larger than ${MOST_BYTES / 1e6} MB.`);
      const tables = await Promise.all(files.map(async (file) => parse(await file.text(), file.name)));
      this.read = { ...comparison(tables, this.description, this.about()), name: files.map((f) => f.name).join(" and ") };
      this.remove.hidden = false;
    } catch (error) {
      this.read = null;
      this.remove.hidden = true;
      this.onTable(null);
      return this.say(element("p", { class: "live-table-error" }, error.message));
    }
    this.onTable(this.read);
  }

  close() {
    this.read = null;
    this.input.value = "";
    this.remove.hidden = true;
    this.say();
    this.onTable(null);
  }

  say(...lines) {
    this.said.hidden = lines.length === 0;
    this.said.replaceChildren(...lines);
  }

  /** Says that the curves go over another coordinate than the table. */
  away() {
    const over = words(this.description.coordinates[this.read.about].name);
    this.say(element("p", {}, `${this.read.name} goes over ${over}: choose it for the curves to see both.`));
  }

  /**
   * Says how far the table's curves are from ours at the same values of the coordinate.
   *
   * - `table`: that ours were computed for; nothing is said where it is no longer the one that was read
   */
  compare(table, ours) {
    if (!this.read || this.read !== table) return;
    const { coordinates, muscles } = this.description;
    const { about, x, curves, notes, name } = this.read;
    const axis = coordinates[about];
    const isLength = axis.unit === "deg";
    const place = (value) => `${words(axis.name)} = ${shown(value * axis.scale, 4)}${isLength ? "°" : `\u202f${axis.unit}`}`;
    const rows = curves.map(({ muscle, kind, y }, i) => ({ muscle, kind, worst: largest(x, y, ours[i]) }));
    const inUnit = ({ kind }, v, digits = 3) =>
      kind === "length" || isLength ? `${shown(1e3 * v, digits)}\u202fmm` : shown(v, digits);
    const line = (row) => {
      const what = `${muscles[row.muscle].name}, ${row.kind === "length" ? "length" : "moment arm"}`;
      if (!row.worst) return element("li", {}, `${what}: no value of the table can be compared`);
      const { size, theirs, ours: own, x: at } = row.worst;
      const values = `OpenSim's table ${inUnit(row, theirs, 6)}, here ${inUnit(row, own, 6)}`;
      const differs =
        Math.abs(size) < ROUNDING
          ? `agrees within ${inUnit(row, ROUNDING)}`
          : `differs by at most ${inUnit(row, Math.abs(size))}, at ${place(at)} (${values})`;
      const made = element("li", {}, `${what}: ${differs}`);
      Object.assign(made.dataset, { muscle: muscles[row.muscle].name, kind: row.kind, difference: size, at });
      return made;
    };
    rows.sort((a, b) => Math.abs(b.worst?.size ?? 0) - Math.abs(a.worst?.size ?? 0));
    const head = `${name}: ${x.length} values of ${words(axis.name)}, dashed. Other coordinates are as they are set on this page.`;
    this.say(
      element("p", {}, head),
      element("ul", {}, ...rows.map(line)),
      ...notes.map((note) => element("p", { class: "soft" }, `${note[0].toUpperCase()}${note.slice(1)}.`)),
    );
  }
}
