// The scope: asks the program for what the board does, a few times a second, and draws it.

const token = new URLSearchParams(location.search).get("token") ?? "";
/** Time between two questions, ms. */
const EVERY_MS = 250;
const MODES = { rest: "at rest, servo off", "open loop": "open loop, servo off", "closed loop": "servo on", fault: "fault" };

const at = (id) => document.getElementById(id);
const ask = (path, method = "GET") => fetch(`${path}${path.includes("?") ? "&" : "?"}token=${token}`, { method, cache: "no-store" });

const time = new Link();
const frequency = new Link();
const minutes = new Link();
const over = { xLabel: "time in the block, s", link: time };
const place = at("plots");
const plots = {
  position: new Plot(place, { title: "Position", yLabel: "um", ...over }),
  drive: new Plot(place, { title: "Drive", yLabel: "V", ...over }),
  error: new Plot(place, { title: "Error: reference minus position", yLabel: "nm", wide: true, ...over }),
  spectrum: new Plot(place, { title: "Spectrum", xLabel: "frequency, Hz", yLabel: "nm/√Hz", logX: true, logY: true, wide: true, link: frequency }),
  livePosition: new Plot(place, { title: "Position, asked for now and then", xLabel: "time since the scope began, s", yLabel: "um", link: minutes, height: 150 }),
  liveDrive: new Plot(place, { title: "Drive, asked for now and then", xLabel: "time since the scope began, s", yLabel: "V", link: minutes, height: 150 }),
};

let shown = null; // the block that is drawn
let paused = false;
let lastWindow = null;

function say(text) {
  at("message").textContent = text;
  at("message").hidden = !text;
}

function rows(table, entries) {
  const body = at(table).tBodies[0];
  body.replaceChildren(...entries.map(([name, value]) => {
    const row = document.createElement("tr");
    const [left, right] = [document.createElement("td"), document.createElement("td")];
    left.textContent = name;
    right.textContent = value;
    right.className = "number";
    row.append(left, right);
    return row;
  }));
}

/** A length of time in words. */
function ago(seconds) {
  return seconds < 60 ? `${seconds.toFixed(1)} s` : `${Math.round(seconds / 60)} min`;
}

function showState({ connected, trouble, board, live, identification, now_s }) {
  const state = at("state");
  const last = live.time_s.length - 1;
  at("name").textContent = [board?.stage, identification].filter(Boolean).join(" · ");
  document.querySelectorAll("#now, #counts").forEach((one) => one.classList.toggle("stale", !connected));
  place.classList.toggle("stale", !connected || Boolean(board?.without_block));
  at("stop").disabled = !connected;
  if (!connected) {
    state.className = "gone";
    at("mode").textContent = trouble ? "the board does not answer" : "connecting";
    at("advice").textContent = trouble ? `${trouble}. It is asked for again until it is back; what is drawn is from before.` : "";
  } else if (board) {
    state.className = board.fault ? "fault" : board.mode === "closed loop" ? "closed" : "";
    at("mode").textContent = board.fault ? `fault: ${board.fault}` : (MODES[board.mode] ?? board.mode);
    const unzeroed = !board.fault && !board.zeroed ? "The sensor has not been zeroed since the board's start: positions count from an arbitrary zero (ATZ)." : "";
    const without = board.without_block ? " Nothing can be caught without one; what is drawn is from before." : "";
    at("advice").textContent = (board.what_to_do ?? unzeroed) + without;
    rows("counts", board.counts.map(([name, count]) => [name, String(count)]));
  }
  const now = last < 0 ? [] : [
    ["position", `${live.position_um[last].toFixed(4)} um`],
    ["drive", `${live.drive_v[last].toFixed(3)} V`],
    ["target of moves", live.target_um === null ? "servo off" : `${live.target_um.toFixed(4)} um`],
  ];
  rows("now", now);
  if (last < 0) at("live").textContent = "";
  else {
    const span = live.time_s[last] - live.time_s[Math.max(0, last - 20)];
    const rate = span > 0 ? `${(Math.min(last, 20) / span).toFixed(1)} a second at present` : "";
    const age = now_s - live.time_s[last];
    at("live").textContent = connected && age < 3 ? `Asked for between the blocks: ${rate}.` : `From ${ago(age)} ago.`;
  }
}

function showLive({ time_s, position_um, drive_v }) {
  if (time_s.length < 2) return;
  plots.livePosition.show({ series: [{ label: "position", colour: "--measured", x: time_s, y: position_um }] });
  plots.liveDrive.show({ series: [{ label: "drive", colour: "--drive", x: time_s, y: drive_v }] });
}

function showBlock(block) {
  shown = block;
  at("save").disabled = false;
  const rate = block.sample_rate_hz;
  const position = { label: "position", colour: "--measured", y: block.position_um };
  const reference = block.reference_um && { label: "reference", colour: "--modelled", y: block.reference_um };
  // A view of a longer block would lie outside a shorter one.
  if (time.view && time.view[1] > block.samples / rate) time.view = null;
  plots.position.show({ rate, series: reference ? [reference, position] : [position] });
  plots.drive.show({ rate, series: [{ label: "drive", colour: "--drive", y: block.drive_v }] });
  plots.error.box.hidden = !block.error_um;
  if (block.error_um) plots.error.show({ rate, series: [{ label: `error, ${(1e3 * block.error_rms_um).toFixed(2)} nm RMS`, colour: "--residual", y: block.error_um.map((e) => 1e3 * e) }] });
  const line = (label, colour, { frequency_hz, density_nm }) => ({ label, colour, x: frequency_hz, y: density_nm });
  const lines = [line("position", "--measured", block.position_spectrum)];
  if (block.error_spectrum) lines.push(line("error", "--residual", block.error_spectrum));
  plots.spectrum.show({ series: lines });
}

/** What the block is, and what lies between it and the one before. */
function sayCaught(age_s) {
  if (!shown) {
    at("caught").textContent = "No block yet.";
    return;
  }
  const { number, samples, sample_rate_hz, ticks_per_sample, unseen_s, mode_changed, error_um } = shown;
  const every = ticks_per_sample === 1 ? "every tick" : `every ${ticks_per_sample}th tick, the others are not seen`;
  const gap = unseen_s === null ? "" : ` ${unseen_s.toFixed(2)} s passed unseen between it and the one before.`;
  const parts = [
    `${paused ? "Paused on block" : "Block"} ${number}: ${samples} samples at ${sample_rate_hz} Hz (${every}), ${(samples / sample_rate_hz).toFixed(4)} s without a gap.${gap}`,
    error_um ? "" : mode_changed ? "The servo was not on all the time: no error is drawn." : "The servo is off: there is no reference and no error.",
    age_s === null ? "" : `The newest block is ${ago(age_s)} old.`,
  ];
  at("caught").textContent = parts.filter(Boolean).join(" ");
}

function offerWindows({ windows, window }) {
  const text = JSON.stringify([windows, window]);
  if (text === lastWindow) return;
  lastWindow = text;
  at("window").replaceChildren(...windows.map((name, nth) => new Option(name, String(nth), false, nth === window)));
}

async function refresh() {
  try {
    const answer = await ask(`/state?since=${paused ? Number.MAX_SAFE_INTEGER : (shown?.number ?? 0)}`);
    if (!answer.ok) throw new Error(await answer.text());
    const state = await answer.json();
    showState(state);
    offerWindows(state);
    if (state.block && !paused) showBlock(state.block);
    if (!paused) showLive(state.live);
    sayCaught(state.block_age_s);
    if (at("message").dataset.from === "program") say("");
  } catch (problem) {
    say(`The program that serves this page does not answer (${problem.message}). What is drawn is from before; STOP does not work from here.`);
    at("message").dataset.from = "program";
    at("state").className = "gone";
    at("mode").textContent = "nothing is known";
    at("stop").disabled = true;
  }
  setTimeout(refresh, EVERY_MS);
}

async function told(answer) {
  const reply = await answer.catch((problem) => ({ ok: false, text: async () => problem.message }));
  at("message").dataset.from = "";
  say(reply.ok ? "" : await reply.text());
  return reply;
}

at("stop").addEventListener("click", () => told(ask("/stop", "POST")));
at("pause").addEventListener("click", () => {
  paused = !paused;
  at("pause").setAttribute("aria-pressed", String(paused));
  at("pause").textContent = paused ? "Go on" : "Pause";
  if (paused && shown) told(ask(`/hold?block=${shown.number}`, "POST"));
});
at("save").addEventListener("click", async () => {
  const { number } = shown;
  const reply = await told(ask(`/save?block=${number}`));
  if (!reply.ok) return;
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await reply.blob());
  link.download = `block_${number}.csv`;
  link.click();
  URL.revokeObjectURL(link.href);
});
at("window").addEventListener("change", (event) => told(ask(`/window?window=${event.target.value}`, "POST")));
at("theme").addEventListener("click", () => {
  const chosen = document.documentElement.dataset.theme;
  const dark = chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = dark ? "light" : "dark";
  for (const plot of Object.values(plots)) plot.draw();
});
document.addEventListener("keydown", (event) => {
  if (event.key !== " " || event.target.closest("button, select, input, canvas")) return;
  event.preventDefault();
  at("pause").click();
});
refresh();
