// Numbers and elements.

/** A number as reports show it: so many significant digits, with a true minus sign. */
export function shown(value, digits = 3) {
  if (value === null || !Number.isFinite(value)) return "–";
  const text = Math.abs(value) < 1e-12 ? "0" : String(Number(value.toPrecision(digits)));
  return text.replace("-", "\u2212");
}

/** A part as percent. */
export function percent(part, digits = 3) {
  return part === null || part === undefined ? "–" : `${shown(100 * part, digits)}\u202f%`;
}

/** A name that is an identifier, for people. */
export function words(identifier) {
  return identifier.replaceAll("_", " ");
}

/** An element with properties and children; text is only ever text. */
export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name === "class") made.className = value;
    else if (name in made && name !== "list") made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children.filter((c) => c !== null));
  return made;
}

/** A button. */
export function button(text, act, properties = {}) {
  const made = element("button", { type: "button", ...properties }, text);
  made.addEventListener("click", act);
  return made;
}

const SVG = "http://www.w3.org/2000/svg";

/** The same of a drawing. */
export function drawn(tag, attributes = {}, text = null) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== null) made.textContent = text;
  return made;
}

/** Round numbers that divide a range into about so many parts. */
export function ticks([low, high], parts) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(span / parts));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => span / s <= parts + 0.5) ?? 10 * power;
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; k += 1) out.push(k * step);
  return out;
}
