// The engine of a page that `hysteron lab` serves: the program itself, asked over HTTP, questions one after
// the other.

/** How often a search is asked how far it is, ms. */
const LOOK_EVERY_MS = 200;

class ServedEngine {
  constructor() {
    // Every page has a session of its own at the program.
    this.page = crypto.randomUUID();
    this.token = new URLSearchParams(location.search).get("token");
    this.onprogress = () => {};
    this.knowsNothing = false;
    this.before = Promise.resolve();
    this.expectCancel();
  }

  expectCancel() {
    this.cancelled = new Promise((_, reject) => (this.cancelNow = () => reject(new Cancelled("cancelled"))));
    this.cancelled.catch(() => {});
  }

  /** Asks; `files` are arrays of bytes that stay with the caller. */
  ask(question, files = []) {
    const cancelled = this.cancelled;
    const answer = this.before.then(() => this.exchange(question, files, cancelled));
    this.before = answer.catch(() => {});
    return Promise.race([answer, cancelled]);
  }

  async exchange(question, files, cancelled) {
    if (cancelled !== this.cancelled) throw new Cancelled("cancelled");
    const look = setInterval(() => this.look().catch(() => {}), LOOK_EVERY_MS);
    try {
      const { json, columns } = answerOf(await (await this.send("ask", questionBytes(question, files))).arrayBuffer());
      if (json.knows_nothing) this.knowsNothing = true;
      if (json.error) throw new Error(json.error);
      // Answered in the moment of the cancellation: what the program has now is not what the page shows.
      if (cancelled !== this.cancelled) this.knowsNothing = true;
      return { json, columns };
    } finally {
      clearInterval(look);
    }
  }

  /** Tells what the search has done since it was last asked. */
  async look() {
    for (const step of await (await this.send("progress")).json()) this.onprogress(step);
  }

  async send(what, body) {
    const address = `${what}?token=${this.token}&page=${this.page}`;
    let response;
    try {
      response = await fetch(address, { method: body === undefined ? "GET" : "POST", body, cache: "no-store" });
    } catch {
      throw new Error("The program `hysteron lab` has ended. Start it again.");
    }
    if (!response.ok) throw new Error(await response.text());
    return response;
  }

  /** Takes back whatever was asked; the program ends it at its next step and keeps data and model as they were. */
  cancel() {
    this.cancelNow();
    this.expectCancel();
    this.send("cancel", "").catch(() => {});
  }

  /** The files of the example, by name. */
  async example() {
    return (await this.send("example")).json();
  }
}
