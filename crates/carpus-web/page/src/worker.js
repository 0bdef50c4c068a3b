// The side of the page that computes: the program itself, compiled to WebAssembly, in a worker.
//
// In: { id, call, ... }. Out: { id, result } or { id, error }; on the way { id, step }.
import init, { Page, Stage } from "carpus-web";

let page = null;
let stage = null;

const calls = {
  async open({ module, bytes }) {
    await init({ module_or_path: module });
    page = new Page(new Uint8Array(bytes));
    const description = JSON.parse(page.description());
    const recorded = description.trials.map((_, trial) => page.recorded(trial));
    return [{ description, recorded }, recorded.map((r) => r.buffer)];
  },
  simulate({ muscles, effects, anew = false }) {
    const errors = JSON.parse(page.simulate(Float64Array.from(muscles.flat()), JSON.stringify(effects), anew));
    const moments = errors.nrmse.map((_, trial) => page.moment(trial));
    return [{ errors, moments }, moments.map((m) => m.buffer)];
  },
  fit({ id, effects }) {
    let done = 0;
    const step = () => postMessage({ id, step: { done: (done += 1) } });
    return [JSON.parse(page.fit(JSON.stringify(effects), { step })), []];
  },
  async openModel({ module, bytes }) {
    await init({ module_or_path: module });
    stage = new Stage(new Uint8Array(bytes));
    return [JSON.parse(stage.description()), []];
  },
  openStage() {
    stage ??= page.stage();
    const geometry = page.geometry();
    return [{ description: JSON.parse(stage.description()), geometry }, [geometry.buffer]];
  },
  posture({ q }) {
    const flat = stage.posture(Float64Array.from(q));
    return [flat, [flat.buffer]];
  },
  momentArms({ q, about }) {
    const arms = stage.moment_arms(Float64Array.from(q), about);
    return [arms, [arms.buffer]];
  },
  sweep({ q, about, values, muscles }) {
    const flat = stage.sweep(Float64Array.from(q), about, Float64Array.from(values), Uint32Array.from(muscles));
    return [flat, [flat.buffer]];
  },
  lever({ q, about, muscle }) {
    return [stage.lever(Float64Array.from(q), about, muscle), []];
  },
  postureAt({ trial, sample }) {
    const flat = stage.posture(page.coordinates_at(trial, sample));
    return [flat, [flat.buffer]];
  },
  musclesOfTrial({ trial, muscles, effects }) {
    const flat = page.muscles_of_trial(trial, Float64Array.from(muscles.flat()), JSON.stringify(effects));
    return [flat, [flat.buffer]];
  },
  export({ muscles, effects }) {
    const model = page.export(Float64Array.from(muscles.flat()), JSON.stringify(effects));
    return [{ model, sideCar: page.side_car() ?? null }, [model.buffer]];
  },
};

onmessage = async ({ data }) => {
  try {
    const [result, buffers] = await calls[data.call](data);
    postMessage({ id: data.id, result }, buffers);
  } catch (error) {
    postMessage({ id: data.id, error: String(error?.message ?? error) });
  }
};
