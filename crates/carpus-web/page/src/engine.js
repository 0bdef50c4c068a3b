// The page's side of the workers: one simulates, another fits, so that curves still move while a fit runs.

/** Bytes of a compressed data block of the page (gzip, base64). */
async function block(id) {
  const text = document.getElementById(id).textContent.trim();
  const compressed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([compressed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

class Remote {
  constructor(url) {
    this.waiting = new Map();
    this.next = 0;
    this.worker = new Worker(url);
    this.worker.onmessage = ({ data }) => {
      const waiting = this.waiting.get(data.id);
      if (data.step) return waiting?.onStep?.(data.step);
      this.waiting.delete(data.id);
      if ("error" in data) waiting.reject(new Error(data.error));
      else waiting.resolve(data.result);
    };
    // A fault of the program itself, out of memory among them.
    this.worker.onerror = (event) => this.end(new Error(event.message || "the computation stopped"));
  }

  call(call, message = {}, onStep = null) {
    const id = this.next++;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject, onStep });
      this.worker.postMessage({ id, call, ...message });
    });
  }

  end(reason) {
    this.worker.terminate();
    for (const { reject } of this.waiting.values()) reject(reason);
    this.waiting.clear();
  }
}

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
