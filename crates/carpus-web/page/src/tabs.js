// Panels of which one is shown.
import { button, element } from "./format.js";

/** Panels of which one is shown; arrow keys go from one to the next. */
export function tabs(state, panels) {
  const buttons = panels.map(([title, panel], i) => {
    panel.id = `live-panel-${i}`;
    panel.setAttribute("role", "tabpanel");
    const made = button(title(), () => show(i), { role: "tab" });
    made.setAttribute("aria-controls", panel.id);
    state.listeners.push(() => {
      made.textContent = title();
    });
    made.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (step) show((i + step + panels.length) % panels.length, true);
    });
    return made;
  });
  const show = (chosen, focus = false) =>
    buttons.forEach((b, i) => {
      b.setAttribute("aria-selected", i === chosen);
      b.tabIndex = i === chosen ? 0 : -1;
      panels[i][1].hidden = i !== chosen;
      if (focus && i === chosen) b.focus();
    });
  show(0);
  return element(
    "div",
    { class: "live-tabs" },
    element("div", { role: "tablist" }, ...buttons),
    ...panels.map(([, panel]) => panel),
  );
}
