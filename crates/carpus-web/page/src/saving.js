// Files that a person takes away: figures, numbers, the model.
import { element } from "./format.js";

const DRAWN_AS = [
  "fill",
  "stroke",
  "stroke-width",
  "stroke-dasharray",
  "stroke-opacity",
  "opacity",
  "font-size",
  "font-family",
  "text-anchor",
];

export function save(name, content, type) {
  const url = URL.createObjectURL(new Blob([content], { type }));
  element("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

/** A table as CSV; a cell that a spreadsheet would take for a formula is text. */
export function csv(rows) {
  const cell = (value) => {
    let text = String(value ?? "");
    if (typeof value === "string" && /^[=+\-@\t\r]/.test(text)) text = `'${text}`;
    return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  return rows.map((row) => `${row.map(cell).join(",")}\r\n`).join("");
}

/** A figure as a file of its own, with its looks written into it. */
export function standalone(svg) {
  const copy = svg.cloneNode(true);
  const [from, to] = [svg, copy].map((s) => [s, ...s.querySelectorAll("*")]);
  from.forEach((original, i) => {
    const looks = getComputedStyle(original);
    for (const name of DRAWN_AS) to[i].setAttribute(name, looks.getPropertyValue(name));
  });
  const { width, height } = svg.viewBox.baseVal;
  copy.setAttribute("width", width);
  copy.setAttribute("height", height);
  const ground = document.createElementNS("http://www.w3.org/2000/svg", "rect");
  for (const [name, value] of [
    ["width", width],
    ["height", height],
    ["fill", getComputedStyle(document.body).backgroundColor],
  ]) {
    ground.setAttribute(name, value);
  }
  copy.insertBefore(ground, copy.firstChild);
  return new XMLSerializer().serializeToString(copy);
}

export async function savePng(name, svg) {
  const scale = 2;
  const { width, height } = svg.viewBox.baseVal;
  const image = new Image();
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(standalone(svg))}`;
  await image.decode();
  const canvas = element("canvas", { width: width * scale, height: height * scale });
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  canvas.toBlob((blob) => save(name, blob, "image/png"));
}

/** Buttons that save a figure. */
export function saveButtons(figure, name, table = () => figure.table()) {
  const button = (text, label, act) => {
    const made = element("button", { type: "button", class: "live-save" }, text);
    made.setAttribute("aria-label", `${label} ${figure.root.getAttribute("aria-label")}`);
    made.addEventListener("click", act);
    return made;
  };
  return element(
    "span",
    { class: "live-saves" },
    button("SVG", "Save as SVG:", () => save(`${name()}.svg`, standalone(figure.root), "image/svg+xml")),
    button("PNG", "Save as PNG:", () => savePng(`${name()}.png`, figure.root)),
    button("CSV", "Save numbers of:", () => save(`${name()}.csv`, csv(table()), "text/csv")),
  );
}
