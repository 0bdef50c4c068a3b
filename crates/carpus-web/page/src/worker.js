// The side of the page that computes: the program itself, compiled to WebAssembly, in a worker.
//
// In: { id, call, ... }. Out: { id, result } or { id, error }; on the way { id, step }.
import init, { Page } from "carpus-web";

let page = null;

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
