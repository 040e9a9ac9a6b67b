// The engine of a page from disk: the library in its worker, questions one after the other.
//
// Both engines have `ask`, `cancel`, `example`, `onprogress`, and `knowsNothing` where data and model must be
// handed to them again.

class WorkerEngine {
  /** @param {ArrayBuffer} module the library */
  constructor(module) {
    this.module = module;
    this.workerUrl = URL.createObjectURL(new Blob([document.querySelector("#worker").textContent], { type: "text/javascript" }));
    this.waiting = new Map();
    this.lastId = 0;
    this.onprogress = () => {};
    this.knowsNothing = false;
    this.start();
  }

  start() {
    this.brokenBecause = "";
    this.worker = new Worker(this.workerUrl);
    this.worker.onmessage = ({ data }) => this.heard(data);
    this.worker.onerror = (event) => this.fail(new Error(event.message || "the worker stopped"));
    this.worker.postMessage({ module: this.module });
  }

  heard(data) {
    if (data.progress) {
      if (data.progress.broken) this.brokenBecause = data.progress.broken;
      else this.onprogress(data.progress);
    } else if (data.id !== undefined) {
      const { resolve, reject } = this.waiting.get(data.id) ?? {};
      this.waiting.delete(data.id);
      if (!resolve) return;
      if (data.broken) {
        reject(new Error(`The computation broke off. Please report this: ${this.brokenBecause || data.broken}`));
        this.cancel();
      } else if (data.json.error) reject(new Error(data.json.error));
      else resolve(data);
    } else if (data.broken) this.fail(new Error(data.broken));
  }

  fail(error) {
    for (const { reject } of this.waiting.values()) reject(error);
    this.waiting.clear();
  }

  /** Asks; `files` are arrays of bytes that stay with the caller. */
  ask(question, files = []) {
    return new Promise((resolve, reject) => {
      const id = ++this.lastId;
      this.waiting.set(id, { resolve, reject });
      this.worker.postMessage({ id, question, files });
    });
  }

  /** Ends whatever goes on; the new worker knows nothing of data and model. */
  cancel() {
    this.worker.terminate();
    this.knowsNothing = true;
    this.fail(new Cancelled("cancelled"));
    this.start();
  }

  /** The files of the example, by name. */
  async example() {
    return JSON.parse(new TextDecoder().decode(await unpacked(document.querySelector("#example-files").textContent)));
  }
}

/** Bytes behind base64, unpacked. */
async function unpacked(base64) {
  const packed = Uint8Array.from(atob(base64.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}
