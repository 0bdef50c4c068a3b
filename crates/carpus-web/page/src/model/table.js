// Tables of lengths and moment arms that OpenSim wrote: .sto and .mot files of its tools and plots, and CSV.

/** Most rows that are read. */
const MOST_ROWS = 20_000;
/** Values of a coordinate that differ by less are the same [rad or m]. */
const SAME = 1e-6;
/** Times that differ by less are the same [s]. */
const SAME_TIME = 1e-7;

/** A text as columns: { name, labels, columns, inDegrees: true, false or null, title }. Throws what a person can act on. */
export function parse(text, name) {
  const lines = text.replace(/^\ufeff/, "").split(/\r\n|\r|\n/);
  const end = lines.findIndex((line) => /^\s*endheader\s*$/i.test(line));
  const head = lines.slice(0, Math.max(end, 0));
  const degrees = head.map((line) => line.match(/^\s*inDegrees\s*=\s*(\w+)/i)?.[1].toLowerCase()).find(Boolean);
  let at = end + 1;
  while (at < lines.length && (!lines[at].trim() || lines[at].startsWith("#"))) at += 1;
  if (at >= lines.length) throw new Error(`${name} holds no table: there is no line with the names of columns.`);
  const separator = ["\t", ";", ","].find((s) => lines[at].includes(s)) ?? " ";
  const split = (line) => {
    const cells = separator === " " ? line.trim().split(/\s+/) : line.split(separator);
    return cells.map((cell) => cell.trim().replace(/^"(.*)"$/, "$1"));
  };
  const labels = split(lines[at]);
  while (labels.length && !labels.at(-1)) labels.pop();
  if (labels.length < 2 || labels.every((label) => Number.isFinite(Number(label)))) {
    throw new Error(`${name}, line ${at + 1}: expected the names of at least two columns, found “${lines[at].slice(0, 60)}”.`);
  }
  const columns = labels.map(() => []);
  for (let i = at + 1; i < lines.length; i += 1) {
    if (!lines[i].trim()) continue;
    const cells = split(lines[i]);
    while (cells.length > labels.length && !cells.at(-1)) cells.pop();
    if (cells.length !== labels.length) {
      throw new Error(`${name}, line ${i + 1}: expected ${labels.length} values as in the heading, found ${cells.length}.`);
    }
    if (columns[0].length >= MOST_ROWS) throw new Error(`${name} has more than ${MOST_ROWS} rows: save fewer.`);
    cells.forEach((cell, k) => {
      const number = /^(nan|-nan|)$/i.test(cell) ? NaN : Number(separator === "," ? cell : cell.replace(",", "."));
      if (Number.isNaN(number) && !/^(nan|-nan|)$/i.test(cell)) {
        throw new Error(`${name}, line ${i + 1}: expected a number in column ${labels[k]}, found “${cell.slice(0, 30)}”.`);
      }
      columns[k].push(number);
    });
  }
  if (columns[0].length < 2) throw new Error(`${name} has fewer than two rows of numbers.`);
  const inDegrees = degrees === undefined ? null : degrees === "yes" || degrees === "true";
  return { name, title: head[0] ?? "", labels, columns, inDegrees };
}

const isTime = (label) => /^(time|t|time[ _]*[[(]?s[\])]?)$/i.test(label.trim());
const plain = (label) => label.toLowerCase().replaceAll(/[\s_]+/g, " ").trim();

/** Unit that a label ends with: "deg", "rad", "mm", "cm", "m" or null; and the label without it. */
function unitOf(label) {
  const found = label.match(/^(.*?)[\s_]*[[(]?(deg|degrees|°|rad|radians|mm|cm|m)[\])]?$/i);
  if (!found || !found[1] || !/[\s_[(°]/.test(label.slice(found[1].length))) return { unit: null, bare: label };
  const unit = { degrees: "deg", "°": "deg", radians: "rad" }[found[2].toLowerCase()] ?? found[2].toLowerCase();
  return { unit, bare: found[1] };
}

/** Index of the coordinate that a column holds; −1: none. */
function coordinateOf(label, coordinates) {
  const { bare } = unitOf(label);
  const parts = bare.split(/[/|]/).filter(Boolean);
  if (/^(speed|acceleration|u|udot)$/i.test(parts.at(-1) ?? "")) return -1;
  if (parts.at(-1) === "value") parts.pop();
  return coordinates.findIndex((c) => plain(c.name) === plain(parts.at(-1) ?? ""));
}

/** The longest of some names that stands in a text as a word of its own; −1: none. */
function named(text, names) {
  const letter = /[\p{L}\p{N}]/u;
  let best = -1;
  names.forEach((name, i) => {
    const at = plain(text).indexOf(plain(name));
    if (at < 0 || (best >= 0 && names[best].length >= name.length)) return;
    const [before, after] = [plain(text)[at - 1] ?? " ", plain(text)[at + plain(name).length] ?? " "];
    if (!letter.test(before) && !letter.test(after)) best = i;
  });
  return best;
}

/** "length", "arm", "other" (a quantity that is neither), or null where the words do not say. */
function kindOf(words) {
  const text = plain(words).replaceAll("-", " ");
  if (/fib(er|re)|tendon|normali[sz]ed|speed|velocity|force|power|moment$|activation|excitation/.test(text)) return "other";
  if (/moment ?arm|(^|\W)(arm|ma)(\W|$)/.test(text)) return "arm";
  return /length/.test(text) ? "length" : null;
}

/** A column of a muscle: { muscle, kind, about, factor to metres }; null: none. */
function muscleOf(label, table, { muscles, coordinates }) {
  const { unit, bare } = unitOf(label);
  const muscle = named(bare.replaceAll(/[/|]/g, " "), muscles.map((m) => m.name));
  if (muscle < 0) return null;
  const words = plain(bare.replaceAll(/[/|]|forceset/g, " ")).replace(plain(muscles[muscle].name), " ");
  const whole = `${table.name.replace(/\.\w+$/, "")} ${table.title}`;
  const kind = kindOf(words) ?? kindOf(whole);
  const names = coordinates.map((c) => c.name);
  const ofLabel = named(words, names);
  const about = kind === "arm" ? (ofLabel >= 0 ? ofLabel : named(whole.replace(/moment_?arm/i, " "), names)) : -1;
  return { label, muscle, kind, about, factor: { mm: 1e-3, cm: 1e-2 }[unit] ?? 1 };
}

/** Values [rad or m] of a coordinate's column, and how its unit was known. */
function inRadians(values, label, table, coordinate) {
  if (coordinate.unit !== "deg") return { values: Float64Array.from(values), said: null };
  const { unit } = unitOf(label);
  const largest = values.reduce((most, v) => Math.max(most, Math.abs(v) || 0), 0);
  const stated = unit === "deg" ? true : unit === "rad" ? false : table.inDegrees;
  const inDegrees = stated ?? largest > 2 * Math.PI;
  const said = stated === null ? `its values are taken for ${inDegrees ? "degrees" : "radians"}` : null;
  const scale = inDegrees ? Math.PI / 180 : 1;
  return { values: Float64Array.from(values, (v) => v * scale), said };
}

/** The values of a table's column at the times of another; both with time. */
function atTimes(times, table, k) {
  const own = table.columns[table.labels.findIndex(isTime)];
  let i = 0;
  let before = -Infinity;
  return times.map((t) => {
    // Times ascend, so that the search goes on where it was; where they fall back, it begins anew.
    if (!(t >= before)) i = 0;
    before = t;
    while (i < own.length && !(own[i] >= t - SAME_TIME)) i += 1;
    if (i === own.length) return NaN;
    if (Math.abs(own[i] - t) <= SAME_TIME) return table.columns[k][i];
    if (i === 0) return NaN;
    const part = (t - own[i - 1]) / (own[i] - own[i - 1]);
    return table.columns[k][i - 1] + part * (table.columns[k][i] - table.columns[k][i - 1]);
  });
}

/**
 * What tables say of a model: { about, x [rad or m], held: [[coordinate, value]], curves: [{ muscle, kind, y [m] }], notes }.
 *
 * - `tables`: one with quantities, and the coordinate in it or in another table with the same times
 * - `about`: the coordinate that curves go over now
 */
export function comparison(tables, description, about) {
  const { coordinates } = description;
  const free = (i) => i >= 0 && !coordinates[i].locked && !coordinates[i].follows && !coordinates[i].prescribed;
  const quantities = tables.filter((t) => t.labels.some((l) => coordinateOf(l, coordinates) < 0 && muscleOf(l, t, description)));
  if (!quantities.length) {
    const found = tables[0].labels.slice(0, 6).join(", ");
    throw new Error(`${tables[0].name} has no column of a muscle of this model: its columns are ${found}.`);
  }
  const [first] = quantities;
  const notes = [];
  // Coordinates: in the table itself, else in another by time.
  const moved = new Map();
  const take = (table, values) => {
    table.labels.forEach((label, k) => {
      const i = coordinateOf(label, coordinates);
      if (!free(i) || moved.has(i)) return;
      const { values: own, said } = inRadians(values(k), label, table, coordinates[i]);
      moved.set(i, { own, said });
    });
  };
  take(first, (k) => first.columns[k]);
  const time = first.labels.findIndex(isTime);
  if (time >= 0) {
    const others = tables.filter((t) => t !== first && t.labels.some(isTime));
    others.forEach((t) => take(t, (k) => atTimes(first.columns[time], t, k)));
  }
  const span = ({ own }) => {
    const known = own.filter((v) => Number.isFinite(v));
    return known.reduce((m, v) => Math.max(m, v), -Infinity) - known.reduce((m, v) => Math.min(m, v), Infinity);
  };
  const moving = [...moved].filter(([, c]) => span(c) > SAME).map(([i]) => i);
  if (!moving.length) {
    const where = time >= 0 ? "; choose the file of coordinates, too (of OpenSim's analysis Kinematics, or the motion)" : "";
    throw new Error(
      `${first.name} has no column of a coordinate that changes: expected one named ${coordinates[about].name}${where}.`,
    );
  }
  const names = (list) => list.map((i) => coordinates[i].name).join(", ");
  if (moving.length > 1) {
    throw new Error(
      `In ${first.name} several coordinates change (${names(moving)}): a curve over one of them needs the others at rest.`,
    );
  }
  const [over] = moving;
  const { own: x, said } = moved.get(over);
  if (said) notes.push(`${coordinates[over].name}: ${said}`);
  const held = [...moved].filter(([i]) => i !== over).map(([i, { own }]) => [i, own.find((v) => Number.isFinite(v))]);
  const curves = [];
  const [unused, unclear] = [[], []];
  for (const table of quantities) {
    const same = table === first || (table.columns[0].length === x.length && table.labels.some(isTime) === time >= 0);
    table.labels.forEach((label, k) => {
      if (isTime(label) || coordinateOf(label, coordinates) >= 0) return;
      const of = muscleOf(label, table, description);
      if (!of || of.kind === "other" || !same) unused.push(label);
      else if (of.kind === null) unclear.push({ ...of, y: table.columns[k] });
      else if (of.kind === "arm" && of.about >= 0 && of.about !== over) {
        throw new Error(
          `${table.name}: ${label} is a moment arm about ${coordinates[of.about].name}, but ${coordinates[over].name} ` +
            `changes. Choose the table of moment arms about ${coordinates[over].name}.`,
        );
      } else curves.push({ ...of, y: table.columns[k] });
    });
  }
  for (const of of unclear) {
    // Lengths of muscles are above zero and longer than moment arms.
    const kind = of.y.every((v) => !(v * of.factor < 0.03)) ? "length" : "arm";
    curves.push({ ...of, kind });
  }
  if (unclear.length) {
    const said = unclear.slice(0, 4).map((u) => u.label).join(", ");
    notes.push(`whether ${said} are lengths or moment arms is not named: by size taken for ${curves.at(-1).kind}s`);
  }
  if (!curves.length) {
    throw new Error(`${first.name} has neither lengths nor moment arms: its columns are ${first.labels.slice(0, 6).join(", ")}.`);
  }
  if (unused.length) notes.push(`not compared: ${unused.slice(0, 6).join(", ")}${unused.length > 6 ? " and others" : ""}`);
  const scaled = curves.map(({ muscle, kind, factor, y }) => ({ muscle, kind, y: Float64Array.from(y, (v) => v * factor) }));
  return { about: over, x, held, curves: scaled, notes };
}

/** The largest difference of two curves: { size, theirs, ours, x, count }; null where no point can be compared. */
export function largest(x, theirs, ours) {
  let found = null;
  let count = 0;
  for (let i = 0; i < x.length; i += 1) {
    const size = theirs[i] - ours[i];
    if (!Number.isFinite(size)) continue;
    count += 1;
    if (!found || Math.abs(size) > Math.abs(found.size)) found = { size, theirs: theirs[i], ours: ours[i], x: x[i] };
  }
  return found && { ...found, count };
}
