// The part of a report that computes: opened from disk, without a network.
import { effectControls, muscleControls } from "./controls.js";
import { Engine } from "./engine.js";
import { Motion } from "./motion.js";
import { Residuals } from "./residuals.js";
import { State } from "./state.js";
import { Summary } from "./summary.js";
import { tabs } from "./tabs.js";
import { toolbar } from "./toolbar.js";
import { Trials } from "./trials.js";
import { Waterfall } from "./waterfall.js";

/** How long after the last change all is computed anew, and waterfall and residuals against other axes follow [ms]. */
const CALM = 250;

const at = (id) => document.getElementById(id);

async function start() {
  const section = at("live");
  section.hidden = false;
  const status = at("live-status");
  const tell = (text) => {
    status.textContent = text;
  };
  tell("Starting…");
  const began = performance.now();
  const engine = await Engine.open();
  const { description, recorded } = engine.opened;
  const state = new State(description);
  const [trials, summary] = [new Trials(description, recorded), new Summary()];
  const [residuals, waterfall] = [new Residuals(trials.trials), new Waterfall(engine)];
  const given = await engine.remote.call("simulate", { ...state.message(), anew: true });

  const muscles = muscleControls(state);
  const motion = new Motion({ engine, state, trials, tell, fieldsets: [...muscles.children] });
  at("live-controls").append(
    toolbar({ engine, state, trials, tell }),
    tabs(state, [
      [() => "Muscles", muscles],
      [() => (state.effects.length ? `Effects (${state.effects.length} on)` : "Effects"), effectControls(state)],
    ]),
  );
  const ofOne = [trials.focus, motion.root, trials.grid];
  trials.onChoose = () => motion.renew();
  at("live-figures").append(summary.cards, summary.conditions, waterfall.root, ...ofOne, residuals.root);

  const show = (now, settled) =>
    requestAnimationFrame(() => {
      summary.show(given, now);
      trials.show(given, now);
      if (settled) residuals.show(given, now);
      section.dataset.renewed = performance.now();
      section.dataset.settled = settled;
    });
  let [calm, changes] = [0, 0];
  engine.onSimulated = (now, message) => {
    show(now, false);
    motion.renew();
    clearTimeout(calm);
    const anew = async () => {
      const found = await engine.remote.call("simulate", { ...message, anew: true });
      // What was changed meanwhile is newer.
      const isNewest = () => message.change === changes;
      if (isNewest()) await waterfall.show(given, found, message, isNewest);
      if (isNewest()) show(found, true);
    };
    calm = setTimeout(() => anew().catch((error) => tell(error.message)), CALM);
  };
  const standing = description.averaged ? AVERAGED : "";
  let failed = false;
  const simulate = () => {
    section.dataset.changed = performance.now();
    section.dataset.settled = false;
    engine
      .simulate({ ...state.message(), change: (changes += 1) })
      .then(() => {
        if (failed) tell(standing);
        failed = false;
      })
      .catch((error) => {
        failed = true;
        tell(error.message);
      });
  };
  state.listeners.push(simulate);
  trials.choose(
    Math.max(
      0,
      description.trials.findIndex((t) => t.use === "test"),
    ),
  );
  state.go(state.models[section.dataset.current] ?? state.models.at(-1));
  tell(standing);
  section.dataset.started = performance.now() - began;
}

const AVERAGED =
  "Samples are averaged to 100 Hz here, as fits take them; the tables of this report are of all samples.";

start().catch((error) => {
  at("live-status").textContent =
    `This part of the report cannot compute here: ${error.message}. The report below is complete without it.`;
});
