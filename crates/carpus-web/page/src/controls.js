// The controls: every muscle's parameters and every effect.
import { element, words } from "./format.js";
import { Slider } from "./slider.js";
import { PROPERTIES } from "./state.js";

const STAGES = {
  excitation: "EMG",
  activation: "Activation",
  muscle: "Muscles",
  geometry: "Geometry",
  joint: "Joint",
  inertia: "Weight and inertia",
  sensor: "Sensor",
};

export function muscleControls(state) {
  const rows = state.description.muscles.map((muscle, m) =>
    PROPERTIES.map(
      (property, p) =>
        new Slider({
          label: property.short,
          title: `${muscle.name}: ${property.about}`,
          unit: property.unit,
          range: muscle.bounds[p],
          mark: muscle.given[p],
          onChange: (value) => state.setMuscle(m, p, value),
        }),
    ),
  );
  const show = () =>
    rows.forEach((sliders, m) =>
      sliders.forEach((slider, p) => {
        slider.show(state.muscles[m][p]);
        slider.interval(state.intervals()[m]?.[p]);
      }),
    );
  state.listeners.push((what) => {
    if (what === "all") show();
  });
  show();
  const root = element("div", { class: "live-muscles" });
  state.description.muscles.forEach((muscle, m) => {
    const legend = element("legend", {}, muscle.name);
    root.append(element("fieldset", {}, legend, ...rows[m].map((s) => s.root)));
  });
  return root;
}

export function effectControls(state) {
  const root = element("div", { class: "live-effects" });
  if (state.description.given_effects.length) {
    root.append(
      element("p", { class: "soft" }, `Beside the model already: ${state.description.given_effects.join(", ")}.`),
    );
  }
  // Effects of fitted models come first.
  const fitted = state.models.flatMap((m) => m.effects.map((e) => e.id));
  const groups = [
    ["In fitted models", (e) => fitted.includes(e.id)],
    ...Object.entries(STAGES).map(([stage, title]) => [title, (e) => e.stage === stage && !fitted.includes(e.id)]),
  ];
  for (const [title, belongs] of groups) {
    const effects = state.description.effects.filter(belongs);
    if (effects.length) root.append(element("h4", {}, title), ...effects.map((e) => effectControl(state, e)));
  }
  return root;
}

function effectControl(state, effect) {
  const toggle = element("input", { type: "checkbox", role: "switch" });
  const name = element(
    "label",
    { title: `${effect.signature}\n${effect.equation}` },
    toggle,
    element("span", {}, effect.name),
  );
  const body = element("div", { class: "live-shapes", hidden: true });
  const root = element("div", { class: "live-effect" }, name, body);
  root.dataset.effect = effect.id;
  let sliders = [];
  const show = () => {
    const on = state.effect(effect.id);
    toggle.checked = on !== null;
    body.hidden = on === null;
    if (on && !sliders.length) {
      sliders = effect.parameters.map((p, i) => parameterSlider(state, effect, p, i));
      body.append(element("p", { class: "soft" }, effect.equation), ...sliders.map((s) => s.root));
    }
    const intervals = state.model.effects.find((e) => e.id === effect.id)?.intervals;
    if (on)
      sliders.forEach((s, i) => {
        s.show(on.values[i]);
        s.interval(intervals?.[i]?.map(s.toValue));
      });
  };
  toggle.addEventListener("change", () => state.switchEffect(effect.id, toggle.checked));
  state.listeners.push((what) => {
    if (what === "all" || what === "effects") show();
  });
  show();
  return root;
}

function parameterSlider(state, effect, parameter, i) {
  const {
    range: [low, high],
    start,
    is_ratio: isRatio,
    at_zero: atZero,
  } = parameter;
  return new Slider({
    label: words(parameter.name),
    title: `${effect.name}, ${words(parameter.name)}: ${parameter.source}`,
    unit: parameter.unit === "1" ? "" : parameter.unit,
    range: [Math.min(low, start), Math.max(high, start)],
    mark: start,
    onChange: (value) => state.setEffect(effect.id, i, value),
    toShown: (v) => (isRatio ? atZero * Math.exp(v) : v),
    toValue: (v) => (isRatio ? Math.log(v / atZero) : v),
  });
}
