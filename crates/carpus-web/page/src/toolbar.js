// Models to go back to, fits, and what is saved.
import { Cancelled } from "./engine.js";
import { button, element } from "./format.js";
import { csv, save } from "./saving.js";
import { PROPERTIES } from "./state.js";

/** About how many steps a fit tells of. */
const STEPS = 8;

/** Models to go back to, fits, export. */
export function toolbar({ engine, state, trials, tell }) {
  const models = element("div", { class: "live-models", role: "group" });
  models.setAttribute("aria-label", "Models to go back to");
  const drawModels = () =>
    models.replaceChildren(
      ...state.models.map((model) => {
        const made = button(model.label, () => state.go(model));
        made.setAttribute("aria-pressed", model === state.model && !state.isChanged());
        return made;
      }),
    );
  drawModels();
  state.listeners.push(drawModels);

  const progress = element("progress", { max: 1, value: 0, hidden: true });
  progress.setAttribute("aria-label", "Progress of the fit");
  const cancel = button("Cancel", () => engine.cancel(), { hidden: true });
  const fit = async (effects) => {
    fits.forEach((b) => {
      b.disabled = true;
    });
    progress.hidden = cancel.hidden = false;
    progress.value = 0;
    tell("Fitting…");
    const began = performance.now();
    try {
      const model = await engine.fit(effects, ({ done }) => {
        progress.value = Math.min(done / STEPS, 0.95);
        tell(`Fitting, step ${done} of about ${STEPS}…`);
      });
      const seconds = ((performance.now() - began) / 1000).toFixed(1);
      state.models = [...state.models.filter((m) => m.label !== model.label), model];
      state.go(model);
      tell(`Fitted in ${seconds} s.`);
      document.getElementById("live").dataset.fitted = seconds;
    } catch (error) {
      tell(error instanceof Cancelled ? "Fit cancelled." : error.message);
    } finally {
      fits.forEach((b) => {
        b.disabled = false;
      });
      progress.hidden = cancel.hidden = true;
    }
  };
  const withEffects = button("Fit with the effects that are on", () => fit(state.effects.map((e) => e.id)));
  const fits = [button("Fit muscles", () => fit([]), { id: "live-fit" }), withEffects];
  const mayFit = () => {
    withEffects.hidden = state.effects.length === 0;
  };
  state.listeners.push(mayFit);
  mayFit();

  const saveModel = async () => {
    const { model, sideCar } = await engine.export(state.message());
    save("model.osim", model, "application/xml");
    if (sideCar) save("effects.toml", sideCar, "application/toml");
  };
  const exports = element(
    "div",
    { class: "live-tools" },
    element("span", { class: "soft" }, "Save"),
    button("model.osim", () => saveModel().catch((error) => tell(error.message)), { "aria-label": "Save model.osim" }),
    button("parameters", () => save("parameters.csv", csv(parameterTable(state)), "text/csv"), {
      "aria-label": "Save parameters",
    }),
    button("all curves", () => save("trials.csv", csv(trials.wholeTable()), "text/csv"), {
      "aria-label": "Save all curves",
    }),
  );
  return element(
    "div",
    { class: "live-toolbar" },
    models,
    element("div", { class: "live-tools" }, ...fits, progress, cancel),
    exports,
  );
}

/** Every parameter as it is now. */
function parameterTable(state) {
  const rows = [["of", "parameter", "unit", "as_given", "now"]];
  state.description.muscles.forEach((muscle, m) =>
    PROPERTIES.forEach((property, p) => {
      rows.push([muscle.name, property.name, property.unit, muscle.given[p], state.muscles[m][p]]);
    }),
  );
  for (const { id, values } of state.effects) {
    state.description.effects
      .find((e) => e.id === id)
      .parameters.forEach((p, i) => {
        rows.push([id, p.name, p.is_ratio ? "ln(ratio)" : p.unit, p.amplitude ? 0 : p.start, values[i]]);
      });
  }
  return rows;
}
