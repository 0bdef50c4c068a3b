"use strict";
(() => {
  const root = document.documentElement;
  const button = document.getElementById("theme");
  if (button) {
    button.hidden = false;
    button.addEventListener("click", () => {
      const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
      root.dataset.theme = dark ? "light" : "dark";
    });
  }
  // Values are read back from the drawn curves: data = d0 + (drawn - p0) / (p1 - p0) * (d1 - d0).
  const inverse = (text) => {
    const [d0, d1, p0, p1] = text.split(" ").map(Number);
    return (p) => d0 + ((p - p0) / (p1 - p0)) * (d1 - d0);
  };
  const show = (value) => (Math.abs(value) < 1e-12 ? "0" : String(Number(value.toPrecision(3)))).replace("-", "\u2212");
  const read = (line) => line.getAttribute("points").split(" ").map((pair) => pair.split(",").map(Number));
  const nearest = (points, x) => {
    let low = 0, high = points.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (points[middle][0] < x) low = middle; else high = middle;
    }
    return x - points[low][0] < points[high][0] - x ? points[low] : points[high];
  };
  for (const svg of document.querySelectorAll("svg.figure")) {
    const holder = svg.parentElement;
    let curves = null, cross = null, tip = null;
    const leave = () => { if (cross) { cross.remove(); tip.remove(); cross = tip = null; } };
    svg.addEventListener("pointerleave", leave);
    svg.addEventListener("pointermove", (event) => {
      curves ??= [...svg.querySelectorAll("polyline.curve")].filter((line) => line.getAttribute("points")).map((line) => ({ line, points: read(line) }));
      if (!curves.length) return;
      const matrix = svg.getScreenCTM().inverse();
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix);
      const [, , left, right] = svg.dataset.x.split(" ").map(Number);
      if (at.x < left - 2 || at.x > right + 2) return leave();
      const x = nearest(curves[0].points, at.x)[0];
      if (!cross) {
        cross = svg.insertBefore(document.createElementNS("http://www.w3.org/2000/svg", "line"), svg.firstChild);
        cross.setAttribute("class", "cross");
        tip = holder.appendChild(document.createElement("div"));
        tip.className = "tip";
      }
      const box = svg.viewBox.baseVal;
      cross.setAttribute("x1", x); cross.setAttribute("x2", x); cross.setAttribute("y1", 4); cross.setAttribute("y2", box.height - 20);
      tip.textContent = "";
      const row = (name, value, unit) => {
        const line = tip.appendChild(document.createElement("div"));
        line.append(name + " ");
        line.appendChild(document.createElement("b")).textContent = value;
        line.append("\u202f" + unit);
      };
      row(svg.dataset.xName, show(inverse(svg.dataset.x)(x)), svg.dataset.xUnit);
      for (const { line, points } of curves) {
        row(line.dataset.name, show(inverse(line.dataset.y || svg.dataset.y)(nearest(points, x)[1])), line.dataset.unit || svg.dataset.unit);
      }
      const drawn = svg.getBoundingClientRect(), around = holder.getBoundingClientRect();
      const px = drawn.left - around.left + (x / box.width) * drawn.width;
      const side = x > box.width / 2;
      tip.style.setProperty("left", (side ? px - tip.offsetWidth - 10 : px + 10) + "px");
      tip.style.setProperty("top", drawn.top - around.top + 10 + "px");
    });
  }
})();
