// The part of a report that computes: opened from disk, without a network.
import { effectControls, muscleControls } from "./controls.js";
import { Cancelled, Engine } from "./engine.js";
import { element } from "./format.js";
import { Residuals } from "./residuals.js";
import { csv, save } from "./saving.js";
import { PROPERTIES, State } from "./state.js";
import { Summary } from "./summary.js";
import { Trials } from "./trials.js";

/** How long after the last change the residuals against angle, velocity and activation follow [ms]. */
const CALM = 120;

const at = (id) => document.getElementById(id);
const button = (text, act, properties = {}) => {
  const made = element("button", { type: "button", ...properties }, text);
  made.addEventListener("click", act);
  return made;
};

async function start() {
  const section = at("live");
  section.hidden = false;
  const status = at("live-status");
  const tell = (text) => { status.textContent = text; };
  tell("Starting…");
  const began = performance.now();
  const engine = await Engine.open();
  const { description, recorded } = engine.opened;
  const state = new State(description);
  const [trials, summary] = [new Trials(description, recorded), new Summary()];
  const residuals = new Residuals(trials.trials);
  const given = await engine.remote.call("simulate", state.message());

  at("live-controls").append(toolbar({ engine, state, trials, tell }), tabs([["Muscles", muscleControls(state)], ["Effects", effectControls(state)]]));
  at("live-figures").append(summary.cards, summary.conditions, trials.focus, trials.grid, residuals.root);

  let calm = 0;
  engine.onSimulated = (now) => {
    requestAnimationFrame(() => {
      summary.show(given, now);
      trials.show(given, now);
      section.dataset.renewed = performance.now();
    });
    clearTimeout(calm);
    calm = setTimeout(() => residuals.show(given, now), CALM);
  };
  const simulate = () => {
    section.dataset.changed = performance.now();
    engine.simulate(state.message()).then(() => tell(description.averaged ? AVERAGED : "")).catch((error) => tell(error.message));
  };
  state.listeners.push(simulate);
  trials.choose(description.trials.findIndex((t) => t.use === "test") === -1 ? 0 : description.trials.findIndex((t) => t.use === "test"));
  state.go(state.models.at(-1));
  section.dataset.started = performance.now() - began;
}

const AVERAGED = "Samples are averaged to 100 Hz here, as fits take them; the tables of this report are of all samples.";

/** Models to go back to, fits, export. */
function toolbar({ engine, state, trials, tell }) {
  const models = element("div", { class: "live-models", role: "group" });
  models.setAttribute("aria-label", "Models to go back to");
  const drawModels = () => models.replaceChildren(...state.models.map((model) => {
    const made = button(model.label, () => state.go(model));
    made.setAttribute("aria-pressed", model === state.model && !state.isChanged());
    return made;
  }));
  drawModels();
  state.listeners.push(drawModels);

  const progress = element("progress", { max: 1, value: 0, hidden: true });
  progress.setAttribute("aria-label", "Progress of the fit");
  const cancel = button("Cancel", () => engine.cancel(), { hidden: true });
  const fit = async (effects) => {
    fits.forEach((b) => { b.disabled = true; });
    progress.hidden = cancel.hidden = false;
    progress.removeAttribute("value");
    tell("Fitting…");
    const began = performance.now();
    try {
      const model = await engine.fit(effects, ({ done, text }) => tell(`Fitting, step ${done}: ${text}`));
      const seconds = ((performance.now() - began) / 1000).toFixed(1);
      state.models = [...state.models.filter((m) => m.label !== model.label), model];
      state.go(model);
      tell(`Fitted in ${seconds} s.`);
      at("live").dataset.fitted = seconds;
    } catch (error) {
      tell(error instanceof Cancelled ? "Fit cancelled." : error.message);
    } finally {
      fits.forEach((b) => { b.disabled = false; });
      progress.hidden = cancel.hidden = true;
    }
  };
  const withEffects = button("Fit with the effects that are on", () => fit(state.effects.map((e) => e.id)));
  const fits = [button("Fit muscles", () => fit([]), { id: "live-fit" }), withEffects];
  const mayFit = () => { withEffects.hidden = state.effects.length === 0; };
  state.listeners.push(mayFit);
  mayFit();

  const saveModel = async () => {
    const { model, sideCar } = await engine.export(state.message());
    save("model.osim", model, "application/xml");
    if (sideCar) save("effects.toml", sideCar, "application/toml");
  };
  const exports = element("div", { class: "live-tools" },
    button("Save model.osim", () => saveModel().catch((error) => tell(error.message))),
    button("Save parameters", () => save("parameters.csv", csv(parameterTable(state)), "text/csv")),
    button("Save all curves", () => save("trials.csv", csv(trials.wholeTable()), "text/csv")));
  return element("div", { class: "live-toolbar" }, models, element("div", { class: "live-tools" }, ...fits, progress, cancel), exports);
}

/** Every parameter as it is now. */
function parameterTable(state) {
  const rows = [["of", "parameter", "unit", "as_given", "now"]];
  state.description.muscles.forEach((muscle, m) => PROPERTIES.forEach((property, p) => {
    rows.push([muscle.name, property.name, property.unit, muscle.given[p], state.muscles[m][p]]);
  }));
  for (const { id, values } of state.effects) {
    state.description.effects.find((e) => e.id === id).parameters.forEach((p, i) => {
      rows.push([id, p.name, p.is_ratio ? "ln(ratio)" : p.unit, p.amplitude ? 0 : p.start, values[i]]);
    });
  }
  return rows;
}

/** Panels of which one is shown; arrow keys go from one to the next. */
function tabs(panels) {
  const buttons = panels.map(([title, panel], i) => {
    panel.id = `live-panel-${i}`;
    panel.setAttribute("role", "tabpanel");
    const made = button(title, () => show(i), { role: "tab" });
    made.setAttribute("aria-controls", panel.id);
    made.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (step) show((i + step + panels.length) % panels.length, true);
    });
    return made;
  });
  const show = (chosen, focus = false) => buttons.forEach((b, i) => {
    b.setAttribute("aria-selected", i === chosen);
    b.tabIndex = i === chosen ? 0 : -1;
    panels[i][1].hidden = i !== chosen;
    if (focus && i === chosen) b.focus();
  });
  show(0);
  return element("div", { class: "live-tabs" }, element("div", { role: "tablist" }, ...buttons), ...panels.map(([, panel]) => panel));
}

start().catch((error) => {
  at("live-status").textContent = `This part of the report cannot compute here: ${error.message}. The report below is complete without it.`;
});
