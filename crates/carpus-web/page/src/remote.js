// A worker that answers calls.

export class Remote {
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

  /** The worker that the page carries. */
  static ofPage() {
    const script = document.getElementById("live-worker").textContent;
    return new Remote(URL.createObjectURL(new Blob([script], { type: "text/javascript" })));
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

/** Runs the newest of what is asked for while one is computed; those between are left out. */
export class Newest {
  /** - `act`: (asked) → promise */
  constructor(act) {
    this.act = act;
  }

  async ask(what) {
    this.wanted = { what };
    if (this.busy) return;
    this.busy = true;
    try {
      while (this.wanted) {
        const { what: now } = this.wanted;
        this.wanted = null;
        await this.act(now);
      }
    } finally {
      this.busy = false;
    }
  }
}
