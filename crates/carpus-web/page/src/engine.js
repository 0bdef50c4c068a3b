// The page's side of the workers: one simulates, another fits, so that curves still move while a fit runs.

import { Remote } from "./remote.js";
import { block } from "./unpack.js";

export class Cancelled extends Error {}

export class Engine {
  /** Opens the case of the page: what there is to draw and to change. */
  static async open() {
    const engine = new Engine();
    const [code, bytes] = await Promise.all([block("live-module"), block("live-case")]);
    engine.message = { module: await WebAssembly.compile(code), bytes };
    const script = document.getElementById("live-worker").textContent;
    engine.url = URL.createObjectURL(new Blob([script], { type: "text/javascript" }));
    engine.remote = new Remote(engine.url);
    engine.opened = await engine.remote.call("open", engine.message);
    return engine;
  }

  /** Simulates the newest of the states that are asked for while one is computed; those between are left out. */
  async simulate(state) {
    this.wanted = state;
    if (this.busy) return null;
    this.busy = true;
    try {
      let result = null;
      while (this.wanted) {
        const now = this.wanted;
        this.wanted = null;
        result = await this.remote.call("simulate", now);
        this.onSimulated?.(result, now);
      }
      return result;
    } finally {
      this.busy = false;
    }
  }

  /** Fits the muscles, with these effects. */
  async fit(effects, onStep) {
    this.fitting = new Remote(this.url);
    try {
      await this.fitting.call("open", this.message);
      return await this.fitting.call("fit", { effects }, onStep);
    } finally {
      this.fitting?.end(new Cancelled());
      this.fitting = null;
    }
  }

  cancel() {
    this.fitting?.end(new Cancelled());
  }

  export(state) {
    return this.remote.call("export", state);
  }
}
