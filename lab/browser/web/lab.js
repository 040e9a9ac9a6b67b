// The page: what a person sees and does. Data, model and search are the library's, behind its engine.

const $ = (selector) => document.querySelector(selector);
const nm = (um) => (um === null || um === undefined ? "–" : (1e3 * um).toFixed(1e3 * um >= 100 ? 0 : 1e3 * um >= 10 ? 1 : 2));
const spoken = (id) => id.replaceAll("_", " ");
const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
const escaped = (text) => String(text).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);
const told = document.documentElement.dataset;

const VERDICTS = {
  named: ["Named", "These effects are missing: every simplest model that the data cannot reject has them."],
  at_floor: ["Nothing missing", "The model leaves no more than the noise: nothing is missing that this data could show."],
  ambiguous: ["Ambiguous", "Where it says “or”, this data cannot distinguish the effects."],
  unexplained: ["Unexplained", "The error is above the noise, and no known effect is in all models that the data cannot reject."],
  undecidable: ["Undecidable", "Nothing can be decided, for the reason in the sentence."],
};
const SIGNALS = { t: "time", u: "drive", y: "displacement", force: "force" };
const ROLES = { identify: "fitted", validate: "held out", noise: "noise", test: "test" };

const lab = {
  engine: null,
  files: [],          // { name, bytes } as they were dropped
  planted: null,      // the order of a simulated recording, in place of files
  served: null,       // what the program was started with, in place of files
  said: { columns: {}, units: {}, roles: {} },
  data: null,         // what was read
  signals: [],        // drive and reading of each record, once asked for
  shown: 0,
  model: null,        // effects with parameters, as the library has it
  text: "",           // the same as a file
  off: new Set(),
  compared: null,     // errors of the model as it is shown
  start: "gain",      // effects that a search starts from; null: from the model itself
  found: null,        // the last explanation
  step: 0,            // how many of its steps are in the model
  ofSearch: false,    // the model is that of the search
  undo: [],
  seconds: 0,
};

// ---------------------------------------------------------------- messages and work that takes long

function say(text) {
  $("#message").textContent = text ?? "";
  $("#message").hidden = !text;
  if (!text) $("#otherwise").hidden = true;
  told.error = text ?? "";
}

/** Runs something that asks the library; its errors are shown, a cancelled one is silent. */
async function trying(work) {
  say(null);
  told.busy = "true";
  try {
    await work();
  } catch (error) {
    if (!(error instanceof Cancelled)) say(error.message);
    if (lab.engine?.knowsNothing && lab.text) {
      await again();
      if (!(error instanceof Cancelled)) say(`${error.message} Data and model have been handed to it again; repeat what you did.`);
    }
  } finally {
    told.busy = "false";
  }
}

async function ask(question, files) {
  return lab.engine.ask(question, files);
}

/** Work with a list of what goes on, and a button that ends it. */
async function watched(title, work) {
  const place = $("#finder");
  const before = [...place.childNodes];
  const began = performance.now();
  place.innerHTML = `<h2></h2><p class="row"><button id="cancel">Cancel</button> <span class="quiet" id="clock"></span></p><ol class="live"></ol>`;
  place.firstChild.textContent = title;
  told.state = "running";
  const clock = setInterval(() => ($("#clock").textContent = `${((performance.now() - began) / 1000).toFixed(0)} s`), 250);
  const list = place.querySelector("ol");
  let current = null;
  lab.engine.onprogress = ({ text, best, added }) => {
    current ??= list.insertBefore(document.createElement("li"), list.firstChild);
    current.textContent = text;
    current.classList.toggle("best", Boolean(best));
    if (added) current = null;
  };
  place.querySelector("#cancel").onclick = () => lab.engine.cancel();
  try {
    const answer = await work();
    lab.seconds = (performance.now() - began) / 1000;
    told.seconds = lab.seconds.toFixed(3);
    return answer;
  } catch (error) {
    clearInterval(clock);
    place.replaceChildren(...before);
    told.state = "loaded";
    throw error;
  } finally {
    clearInterval(clock);
    lab.engine.onprogress = () => {};
  }
}

/** Hands data and model to an engine that may know nothing of them. */
async function again() {
  lab.engine.knowsNothing = false;
  await ask(...reading());
  if (lab.text) await ask({ ask: "load", text: lab.text, name: "model.toml" });
  if (lab.found) {
    lab.found = null;
    showFinder();
  }
}

// ---------------------------------------------------------------- recordings

function reading() {
  if (lab.planted) return [{ ask: "plant", ...lab.planted }, []];
  if (lab.served) return [{ ask: "served", said: lab.said }, []];
  const files = lab.files.map(({ name, bytes }) => ({ name, bytes: bytes.length }));
  return [{ ask: "read", files, said: lab.said }, lab.files.map(({ bytes }) => bytes)];
}

/** The list in a file of effects to start from. */
const startOf = (text) => text.trim().split(/[\s,]+/).join(",");

/** Takes files: recordings, or a model for the recording that is there. */
async function take(files) {
  const models = files.filter((file) => file.name.endsWith(".toml") && new TextDecoder().decode(file.bytes.slice(0, 4000)).includes("hysteron.model/"));
  const others = files.filter((file) => !models.includes(file));
  if (others.length) {
    const base = others.find((file) => /(^|\/)base_effects\.txt$/.test(file.name));
    await open({ files: others.filter((file) => !/(^|\/)(base_effects\.txt|truth\.json)$/.test(file.name) && !/(^|\/)\./.test(file.name)),
      start: base ? startOf(new TextDecoder().decode(base.bytes)) : "gain" });
  }
  if (models.length) {
    if (!lab.data) throw new Error(`${models[0].name}: is a model; drop a recording first, then the model`);
    remember();
    await setModel(ask({ ask: "load", text: new TextDecoder().decode(models[0].bytes), name: models[0].name }));
    lab.start = null;
    lab.found = null;
    showFinder();
  }
}

const nothingSaid = () => ({ columns: {}, units: {}, roles: {} });

async function open({ files = [], planted = null, served = null, start, said = nothingSaid() }) {
  try {
    await readOtherwise(() => Object.assign(lab, { files, planted, served, start, said }));
  } catch (error) {
    if (!(error instanceof Cancelled) && !planted) askHow({ files, served, start, said }, error.message);
    throw error;
  }
}

/** What is refused leaves room to say what it does not say itself; it is in the open where the message asks for it. */
function askHow(refused, message) {
  const column = (key, id) => `<input type="text" id="${id}" name="${key}" placeholder="as recognised" title="its number from 1, or its name">`;
  const form = $("#otherwise form");
  sayingForm(form, "refused", refused.said, column, `What is said here holds for ${refused.files.map((file) => escaped(file.name)).join(", ") || "all files"}.`);
  form.onsubmit = (event) => {
    event.preventDefault();
    trying(() => open({ ...refused, said: saidIn(form, refused.said) }));
  };
  $("#otherwise").open ||= /--(units|columns|sample-rate-hz)/.test(message);
  $("#otherwise").hidden = false;
}

/** Fills a form in which a person says what is what; `column` makes the element that chooses one. */
function sayingForm(form, name, said, column, about) {
  const lines = Object.entries(SIGNALS).map(([key, word]) =>
    `<label for="${name}-${key}">${word}</label>${column(key, `${name}-${key}`)}
     <input type="text" name="unit-${key}" placeholder="unit" aria-label="unit of ${word}" title="${key === "y" ? "nm, um, ... or a sensitivity such as 5um/V" : "as in the file where nothing is said"}">`);
  form.innerHTML = `${lines.join("")}<label for="${name}-rate">samples per s</label><input id="${name}-rate" type="text" name="rate" placeholder="from the file"><span></span>
    <label for="${name}-timing">a drive acts</label><select id="${name}-timing" name="timing"><option value="">as recognised</option>
    <option value="hold_after_sample">from its row on</option><option value="hold_before_sample">up to its row</option></select><span></span>
    <p class="quiet">${about}</p><p><button>Read again</button></p>`;
  for (const key of Object.keys(SIGNALS)) {
    form.elements[key].value = said.columns[key] ?? "";
    form.elements[`unit-${key}`].value = said.units[key] ?? "";
  }
  form.elements.rate.value = said.sample_rate_hz ?? "";
  form.elements.timing.value = said.timing ?? "";
}

/** What a form says, beside what was said before. */
function saidIn(form, before) {
  const of = (prefix) => Object.fromEntries(Object.keys(SIGNALS).map((key) => [key, form.elements[prefix + key].value.trim() || null]));
  const rate = form.elements.rate.value.trim();
  return { ...before, columns: of(""), units: of("unit-"), sample_rate_hz: rate ? Number(rate) : null, timing: form.elements.timing.value || null };
}

/** Reads after a change of what is read; where that fails or is cancelled, everything is as it was. */
async function readOtherwise(change) {
  const before = { ...lab, off: new Set(lab.off), said: structuredClone(lab.said) };
  change();
  try {
    await read();
  } catch (error) {
    // A file that is refused changes neither what the page shows nor what the engine knows.
    const refused = lab.data === before.data && !lab.engine.knowsNothing;
    Object.assign(lab, before);
    if (refused) throw error;
    $("#empty").hidden = Boolean(lab.data);
    $("#lab").hidden = !lab.data;
    told.state = lab.data ? "loaded" : "empty";
    if (lab.data) {
      await again();
      showRecording();
      showModel();
      showFinder();
      await compare();
    }
    throw error;
  }
}

/** Reads the files as they are said to be, and fits what the search will start from. */
async function read() {
  const { json } = await ask(...reading());
  Object.assign(lab, { data: json, signals: [], shown: 0, model: null, text: "", found: null, step: 0, ofSearch: false, undo: [], compared: null });
  lab.off.clear();
  lab.start ??= "gain";
  const moving = json.records.findIndex((record) => record.role === "validate");
  lab.shown = moving >= 0 ? moving : json.records.findIndex((record) => record.role !== "noise");
  $("#empty").hidden = true;
  $("#lab").hidden = false;
  time.view = null;
  showRecording();
  await watched(`Fitting ${lab.start.split(",").map(spoken).join(", ")}`, () => setModel(ask({ ask: "identify", effects: lab.start })));
  told.state = "loaded";
  showFinder();
}

function showRecording() {
  $("#name").textContent = lab.data.name;
  document.querySelector('[data-save="manifest"]').hidden = !lab.data.manifest;
  const body = $("#records tbody");
  body.replaceChildren(
    ...lab.data.records.map((record, index) => {
      const row = document.createElement("tr");
      row.tabIndex = 0;
      row.innerHTML = `<td></td><td><select aria-label="role"></select></td><td>–</td>`;
      row.children[0].textContent = record.name;
      row.title = `${record.samples} samples at ${readable(record.sample_rate_hz)} Hz, ${readable(record.from_s)} to ${readable(record.to_s)} s, ${readable(record.range_um)} um wide`;
      const select = row.querySelector("select");
      select.innerHTML = Object.entries(ROLES).map(([role, word]) => `<option value="${role}">${word}</option>`).join("");
      select.value = record.role;
      select.disabled = Boolean(lab.planted);
      select.onclick = (event) => event.stopPropagation();
      select.onchange = () => trying(() => readOtherwise(() => (lab.said.roles[record.name] = select.value)));
      row.onclick = () => trying(() => showRecord(index));
      row.onkeydown = (event) => event.key === "Enter" && event.target === row && row.click();
      return row;
    }),
  );
  const notes = [...lab.data.notes, ...lab.data.floor.warnings];
  notes.push(lab.data.floor.rms_um === null ? "nothing in the data shows the noise" : `noise: ${nm(lab.data.floor.rms_um)} nm, from ${lab.data.floor.basis}`);
  $("#notes ul").replaceChildren(...notes.map((note) => Object.assign(document.createElement("li"), { textContent: note })));
  $("#notes").open = notes.some((note) => note.includes("doubtful") || note.includes("?"));
  showColumns();
}

/** Which column is what, with room to say it otherwise. */
function showColumns() {
  const form = $("#columns form");
  const choices = lab.data.table.map(({ number, name, unit }) => `<option value="${number}">${number}: ${escaped(name || "(no name)")}${unit ? ` [${escaped(unit)}]` : ""}</option>`).join("");
  const column = (key, id) => `<select id="${id}" name="${key}"><option value="">as recognised</option>${choices}</select>`;
  sayingForm(form, "column", lab.said, column, "These columns hold for all files.");
  $("#columns").hidden = Boolean(lab.planted);
  form.onsubmit = (event) => {
    event.preventDefault();
    trying(() => readOtherwise(() => (lab.said = saidIn(form, lab.said))));
  };
}

async function showRecord(index) {
  lab.shown = index;
  time.view = null;
  await compare();
}

// ---------------------------------------------------------------- the model

function remember() {
  if (lab.text) lab.undo.push({ text: lab.text, off: [...lab.off], step: lab.step, ofSearch: lab.ofSearch });
  $("#undo").disabled = !lab.undo.length;
}

async function undo() {
  const last = lab.undo.pop();
  $("#undo").disabled = !lab.undo.length;
  if (!last) return;
  lab.off = new Set(last.off);
  await setModel(ask({ ask: "load", text: last.text, name: "model.toml" }), true);
  lab.step = last.step;
  lab.ofSearch = last.ofSearch;
  showFinder();
}

/** Takes what the library answers as the model, keeps its text and shows all of it. */
async function setModel(answer, keepOff = false) {
  const { json } = await answer;
  lab.model = json;
  lab.text = (await ask({ ask: "save" })).json.text;
  if (!keepOff) lab.off.clear();
  lab.ofSearch = false;
  showModel();
  forgetServo();
  await compare();
}

const values = () => lab.model.effects.map((effect) => effect.parameters.map((parameter) => parameter.value));

/** Position of a slider, -100 to 100 about the value that was fitted, and back. */
const RATIO = 10;
function sliderValue(parameter, position) {
  const { fitted, step, lower, upper } = parameter;
  const share = position / 100;
  const value = step === null ? fitted * RATIO ** (share ** 3) : fitted + (share ** 3) * Math.max(100 * step, Math.abs(fitted));
  return Math.min(upper, Math.max(lower, value));
}
function sliderPosition(parameter) {
  const { fitted, value, step } = parameter;
  const share = step === null ? Math.log(value / fitted) / Math.log(RATIO) : (value - fitted) / Math.max(100 * step, Math.abs(fitted));
  return 100 * Math.cbrt(Math.min(1, Math.max(-1, share || 0)));
}

function showModel() {
  const place = $("#effects");
  const opened = new Set([...place.querySelectorAll("details[open]")].map((one) => one.dataset.effect));
  place.replaceChildren(...lab.model.effects.map((effect) => effectBox(effect, opened)));
  const there = new Set(lab.model.effects.map((effect) => effect.id));
  $("#more").innerHTML = `<option value="">Add an effect…</option>${lab.effects.filter(({ id }) => !there.has(id)).map(({ id, physics }) => `<option value="${id}" title="${escaped(physics)}">${spoken(id)}</option>`).join("")}`;
}

function effectBox(effect, opened) {
  const box = document.createElement("div");
  box.className = "effect";
  box.dataset.effect = effect.id;
  box.innerHTML = `<div><input type="checkbox" id="on-${effect.id}" checked><label for="on-${effect.id}">${spoken(effect.id)}</label></div>
    <details data-effect="${effect.id}"><summary class="quiet">${effect.parameters.length === 1 ? "1 value" : `${effect.parameters.length} values`}</summary><p class="quiet"></p></details>`;
  const [line, details] = box.children;
  details.open = opened.has(effect.id);
  details.querySelector("p").textContent = effect.physics;
  const check = line.firstChild;
  check.checked = !lab.off.has(effect.id);
  box.classList.toggle("off", !check.checked);
  check.onchange = () => {
    if (check.checked) lab.off.delete(effect.id);
    else lab.off.add(effect.id);
    box.classList.toggle("off", !check.checked);
    followed();
  };
  for (const parameter of effect.parameters) {
    parameter.fitted ??= parameter.value;
    const row = document.createElement("div");
    row.className = "parameter";
    const unit = parameter.unit && parameter.unit !== "1" ? `, ${parameter.unit}` : "";
    row.innerHTML = `<span><span class="label"></span> <span class="std"></span></span><input type="number" step="any"><input type="range" min="-100" max="100" step="0.5">`;
    // Names in files end in their unit.
    const suffix = `_${parameter.unit.replace(/[^A-Za-z0-9]+/g, "_")}`;
    const name = parameter.name.endsWith(suffix) && parameter.unit ? parameter.name.slice(0, -suffix.length) : parameter.name;
    row.querySelector(".label").textContent = spoken(name) + unit;
    row.querySelector(".std").textContent = parameter.std ? `± ${readable(parameter.std, 2)}` : "";
    const [, number, range] = row.children;
    number.setAttribute("aria-label", `${spoken(effect.id)} ${spoken(parameter.name)}`);
    range.setAttribute("aria-label", number.getAttribute("aria-label"));
    range.dataset.parameter = `${effect.id}.${parameter.name}`;
    const show = () => {
      number.value = readable(parameter.value, 5);
      range.value = sliderPosition(parameter);
    };
    show();
    let before = null;
    const set = (value) => {
      before ??= parameter.value;
      parameter.value = value;
      followed();
    };
    range.oninput = () => {
      set(sliderValue(parameter, Number(range.value)));
      number.value = readable(parameter.value, 5);
    };
    number.onchange = () => {
      const value = Number(number.value);
      if (Number.isFinite(value) && number.value !== "") set(Math.min(parameter.upper, Math.max(parameter.lower, value)));
      show();
      keep();
    };
    range.onchange = () => keep();
    range.ondblclick = () => {
      set(parameter.fitted);
      show();
      keep();
    };
    details.append(row);
  }
  return box;
}

/** Values that were dragged become those of the model. */
function keep() {
  trying(async () => {
    remember();
    const fitted = lab.model.effects.map((effect) => effect.parameters.map((parameter) => parameter.fitted));
    const { json } = await ask({ ask: "keep", trial: { values: values(), off: [] } });
    json.effects.forEach((effect, i) => effect.parameters.forEach((parameter, j) => (parameter.fitted = fitted[i][j])));
    lab.text = (await ask({ ask: "save" })).json.text;
    lab.ofSearch = false;
    forgetServo();
    // What a search starts from stays the list of effects; only a model from a file is searched from as it
    // is.
  });
}

let following = null;
/** Plots and errors follow the newest trial; those in between are left out. */
async function followed() {
  told.since = String(performance.now());
  if (following) {
    following.again = true;
    return;
  }
  following = { again: false };
  const began = performance.now();
  try {
    await compare(true);
    told.redrawMs = (performance.now() - began).toFixed(1);
  } catch (error) {
    say(error.message);
  }
  const { again: more } = following;
  following = null;
  if (more) followed();
  else {
    // The map of the other records follows when the hand rests.
    clearTimeout(resting);
    resting = setTimeout(() => following || compare().catch((error) => say(error.message)), 300);
  }
}

let resting = null;
async function compare(quick = false) {
  clearTimeout(resting);
  const record = lab.shown;
  if (!lab.signals[record]) {
    const { json, columns } = await ask({ ask: "signals", record });
    lab.signals[record] = { rate: json.rate_hz, from: json.from_s, drive: columns[0], measured: columns[1] };
  }
  const { json, columns } = await ask({ ask: "compare", record, trial: { values: lab.model ? values() : null, off: [...lab.off] }, quick });
  if (record !== lab.shown) return;
  json.map = json.map.map((row, i) => row ?? lab.compared.map[i]);
  lab.compared = { ...json, residual: columns[0], frequency: columns[1], density: columns[2] };
  showErrors();
  showPlots();
  showMap();
}

function showErrors() {
  const { compared, data } = lab;
  const floor = data.floor.rms_um;
  const error = compared.held_out_um ?? compared.fitted_um;
  lab.largest = Math.max(lab.found?.steps[0].held_out_um ?? lab.found?.steps[0].fitted_um ?? 0, error);
  // From a third of the noise (or of a thousandth of the largest) to the largest, by ratios.
  const low = (floor ?? lab.largest / 1000) / 2;
  const share = (um) => 100 * Math.min(1, Math.max(0.01, Math.log(um / low) / Math.log(Math.max(lab.largest, 4 * low) / low)));
  const near = floor !== null && error < 1.05 * floor;
  told.heldOutNm = compared.held_out_um === null ? "" : String(1e3 * compared.held_out_um);
  told.floorNm = floor === null ? "" : String(1e3 * floor);
  $("#errors").innerHTML = `
    <div class="figure"><b id="held-out">${nm(compared.held_out_um)} nm</b>error on held-out records</div>
    <div class="figure"><b>${nm(compared.fitted_um)} nm</b>error on fitted records</div>
    <div class="figure"><b>${nm(floor)}${floor === null ? "" : " nm"}</b>${floor === null ? "noise: not shown by the data" : "noise"}</div>
    <div class="bar" title="held-out error, by ratios"><i style="width: ${share(error)}%"></i>${floor === null ? "" : `<u style="left: ${share(floor)}%"></u><span style="left: ${Math.min(95, Math.max(4, share(floor)))}%">noise</span>`}</div>
    <div class="note">${near ? "The error is at the noise." : ""}</div>`;
  document.querySelectorAll("#records tbody tr").forEach((row, i) => {
    row.classList.toggle("shown", i === lab.shown);
    row.children[2].textContent = nm(compared.records[i].rms_um);
    row.children[2].title = `largest ${nm(compared.records[i].max_um)} nm`;
  });
}

// ---------------------------------------------------------------- plots

const time = new Link();
const plots = {};

function makePlots() {
  const place = $("#plots");
  place.innerHTML = `<h2>Record <span id="shown"></span></h2>`;
  plots.over = new Plot(place, { title: "Measured and modelled", xLabel: "time, s", yLabel: "displacement, um", link: time, wide: true, height: 230 });
  plots.residual = new Plot(place, { title: "Residual: measured less modelled", xLabel: "time, s", yLabel: "nm", link: time, wide: true, height: 170 });
  plots.drive = new Plot(place, { title: "Drive", xLabel: "time, s", yLabel: "V", link: time, wide: true, height: 110 });
  plots.loop = new Plot(place, { title: "Displacement over drive", xLabel: "drive, V", yLabel: "displacement, um", link: time, loop: true, height: 260 });
  plots.loopResidual = new Plot(place, { title: "Residual over drive", xLabel: "drive, V", yLabel: "nm", link: time, loop: true, height: 260 });
  plots.spectrum = new Plot(place, { title: "Spectrum of the residual", xLabel: "frequency, Hz", yLabel: "nm/√Hz", logX: true, logY: true, wide: true, height: 200 });
  const hint = document.createElement("p");
  hint.className = "quiet";
  hint.style.gridColumn = "1 / -1";
  hint.textContent = "Drag over a plot to look closer, double-click for all of it; with the keyboard: +, -, arrows, 0. Plots over time and over drive show the same span of time.";
  place.append(hint);
}

function showPlots() {
  const { rate, from, drive, measured } = lab.signals[lab.shown];
  const { residual, frequency, density } = lab.compared;
  const record = lab.data.records[lab.shown];
  const [modelled, nanometres] = [new Float64Array(residual.length), new Float64Array(residual.length)];
  for (let k = 0; k < residual.length; k++) {
    modelled[k] = measured[k] - residual[k];
    nanometres[k] = 1e3 * residual[k];
  }
  $("#shown").textContent = `${record.name}, ${ROLES[record.role]}: ${nm(lab.compared.records[lab.shown].rms_um)} nm RMS`;
  const floor = lab.data.floor.rms_um;
  const levels = floor === null ? [] : [{ value: 1e3 * floor, label: "noise, RMS" }, { value: -1e3 * floor }];
  const pair = [{ label: "measured", colour: "--measured", y: measured, thick: true }, { label: "modelled", colour: "--modelled", y: modelled }];
  plots.over.show({ rate, from, series: pair });
  plots.residual.show({ rate, from, series: [{ label: "residual", colour: "--residual", y: nanometres }], levels });
  plots.drive.show({ rate, from, series: [{ label: "drive", colour: "--drive", y: drive }] });
  plots.loop.show({ rate, from, series: pair.map((series) => ({ ...series, x: drive })) });
  plots.loopResidual.show({ rate, from, series: [{ label: "residual", colour: "--residual", x: drive, y: nanometres }], levels });
  plots.spectrum.show({ series: [{ label: "residual", colour: "--residual", x: frequency, y: density.map((v) => 1e3 * v) }] });
}

/** RMS of the residual by what the drive does, in every record: one colour, darker where more is left. */
function showMap() {
  const { features } = lab.data;
  const { map } = lab.compared;
  const used = features.map((_, i) => map.some((row) => row[i] !== null));
  const groups = [];
  features.forEach(({ group }, i) => {
    if (!used[i]) return;
    if (groups.at(-1)?.group === group) groups.at(-1).count++;
    else groups.push({ group, count: 1 });
  });
  const floor = lab.data.floor.rms_um;
  const largest = Math.max(...map.flat().filter((v) => v !== null), 1e-12);
  const low = floor ?? largest / 100;
  const shade = (um) => Math.min(1, Math.max(0, Math.log(um / low) / Math.log(Math.max(largest, 3 * low) / low)));
  const cell = (um) => um === null ? "<td></td>" : `<td style="background: color-mix(in srgb, var(--residual) ${Math.round(85 * shade(um))}%, var(--fill)); color: ${shade(um) > 0.7 ? "var(--card)" : "inherit"}">${nm(um)}</td>`;
  $("#map").innerHTML = `<h2>Where the model fails <span class="quiet" style="font-weight: 400">RMS of the residual in nm; darker is more</span></h2><div class="scroll"><table class="cells">
    <tr><th></th>${groups.map(({ group, count }) => `<th colspan="${count}">${escaped(group)}</th>`).join("")}</tr>
    <tr><th>record</th>${features.filter((_, i) => used[i]).map(({ label }) => `<th>${escaped(label)}</th>`).join("")}</tr>
    ${map.map((row, r) => `<tr><th>${escaped(lab.data.records[r].name)}</th>${row.filter((_, i) => used[i]).map(cell).join("")}</tr>`).join("")}</table></div>`;
}

// ---------------------------------------------------------------- what is missing

function showFinder() {
  const place = $("#finder");
  if (!lab.found) {
    const from = lab.start === null ? "the model that was loaded" : lab.start.split(",").map(spoken).join(", ");
    place.innerHTML = `<p class="row"><button class="primary" id="find">What is missing?</button> <span class="quiet">Looks for the physical effects that the data show and the model lacks, starting from ${escaped(from)}.</span></p>${riddle()}`;
    place.querySelector("#find").onclick = () => trying(find);
    listenToRiddle(place);
    return;
  }
  const { found } = lab;
  const [word, meaning] = VERDICTS[found.verdict];
  const next = found.steps.slice(lab.step + 1);
  const rows = found.steps.map((step, i) => {
    const um = step.held_out_um ?? step.fitted_um;
    const most = found.steps[0].held_out_um ?? found.steps[0].fitted_um;
    return `<tr class="${i === lab.step && lab.ofSearch ? "now" : ""}" title="${escaped(step.why)}"><td>${i === 0 ? "start" : step.added ? `+ ${spoken(step.added)}` : "fitted again"}</td><td><span class="bar" style="width: ${Math.min(100, (100 * um) / most)}%"></span></td><td class="number">${nm(um)} nm</td></tr>`;
  });
  const alternatives = found.candidates.filter(({ effect }) => !found.steps.some((step) => step.added === effect)).slice(0, 8);
  const others = alternatives.map((c) => `<tr><td>${spoken(c.effect)}</td><td class="number">${(100 * c.share).toFixed(0)} %</td><td class="number">${c.after_um === null ? "–" : `${nm(c.after_um)} nm`}</td><td>${escaped(c.why)}${c.unlikely_because ? `; ${escaped(c.unlikely_because)}` : ""}</td>
    <td>${found.named.includes(c.effect) ? `<button data-add="${c.effect}">Add this one instead</button>` : ""}</td></tr>`);
  const button = next.length === 0 ? "" : `<button class="primary" id="add">${next[0].added ? `Add ${spoken(next[0].added)}` : "Fit again"}</button>${next.length > 1 ? ` <button id="add-all">Add all</button>` : ""}`;
  place.innerHTML = `<p class="sentence"><span class="verdict">${word}</span>${escaped(found.sentence)}</p><p class="quiet">${meaning}</p>
    <p class="row">${button} <button id="find">Look again</button></p>
    <table class="steps"><tr><th>model</th><th>error on ${found.steps[0].held_out_um === null ? "fitted" : "held-out"} records</th><th></th></tr>${rows.join("")}</table>
    ${found.changed ? `<p>Other values here: ${escaped(found.changed)}</p>` : ""}${found.issues.map((text) => `<p>${escaped(text)}.</p>`).join("")}
    <div id="evidence"></div>
    <details ${found.verdict === "ambiguous" ? "open" : ""}><summary>Alternatives, and why not</summary><div class="scroll"><table><tr><th>effect</th><th class="number">explains</th><th class="number">held out with it</th><th>why not</th><th></th></tr>${others.join("") || "<tr><td>none</td></tr>"}</table></div></details>
    ${found.cannot_identify.length ? `<details><summary>What this data leaves open</summary><ul>${found.cannot_identify.map((text) => `<li>${escaped(text)}</li>`).join("")}</ul></details>` : ""}
    ${found.next_experiment ? `<p>${escaped(found.next_experiment.sentence)} <button id="next-drive">Save this drive</button></p>` : ""}${riddle()}`;
  place.querySelector("#find").onclick = () => trying(find);
  const act = (selector, work) => place.querySelector(selector)?.addEventListener("click", () => trying(work));
  act("#add", () => takeStep(lab.step + 1));
  act("#add-all", () => takeStep(found.steps.length - 1));
  act("#next-drive", async () => save("next_drive.csv", found.next_experiment.csv, "text/csv"));
  for (const one of place.querySelectorAll("[data-add]")) one.onclick = () => trying(() => addEffect(one.dataset.add));
  showEvidence();
  listenToRiddle(place);
}

async function find() {
  remember();
  lab.off.clear();
  const { json, columns } = await watched("Looking for what is missing", () => ask({ ask: "explain", from: lab.start }));
  lab.found = { ...json, columns };
  await takeStep(0, false);
  told.state = json.verdict;
}

/** The model of a step of the search; the error falls. */
async function takeStep(step, undoable = true) {
  if (undoable) remember();
  await setModel(ask({ ask: "take", step }));
  lab.step = step;
  lab.ofSearch = true;
  showFinder();
}

/** One more effect, all values fitted again; one that was chosen by hand belongs to what the next search starts from. */
async function addEffect(effect, byHand = false) {
  remember();
  await watched(`Adding ${spoken(effect)}`, () => setModel(ask({ ask: "add", effect })));
  if (byHand) {
    if (lab.start !== null) lab.start = lab.model.effects.map(({ id }) => id).join(",");
    lab.found = null;
  }
  told.state = "loaded";
  showFinder();
}

async function refit() {
  remember();
  const effects = lab.model.effects.map(({ id }) => id).filter((id) => !lab.off.has(id)).join(",");
  await watched("Fitting again", () => setModel(ask({ ask: "identify", effects })));
  lab.start = effects;
  lab.found = null;
  told.state = "loaded";
  showFinder();
}

/** What the residual does, and what the named effect predicts, in the record that shows it best. */
function showEvidence() {
  const place = $("#evidence");
  for (const effect of new Set(lab.found.curves.map((curve) => curve.effect))) {
    const curves = lab.found.curves.filter((curve) => curve.effect === effect);
    const power = ({ column }) => lab.found.columns[column + 2].reduce((sum, v) => sum + v * v, 0) / (lab.found.columns[column + 2].length || 1);
    const best = curves.reduce((a, b) => (power(b) > power(a) ? b : a));
    const [samples, residual, predicted] = lab.found.columns.slice(best.column, best.column + 3);
    const index = lab.data.records.findIndex((record) => record.name === best.record);
    const { sample_rate_hz: rate, from_s: from } = lab.data.records[index];
    const x = samples.map((k) => from + k / rate);
    const plot = new Plot(place, { title: `Evidence of ${spoken(effect)} in ${best.record}`, xLabel: "time, s", yLabel: "nm", wide: true, height: 190 });
    plot.show({ series: [{ label: "residual without it", colour: "--residual", x, y: residual.map((v) => 1e3 * v), thick: true }, { label: `what ${spoken(effect)} predicts`, colour: "--predicted", x, y: predicted.map((v) => 1e3 * v) }] });
    place.append(Object.assign(document.createElement("p"), { className: "quiet", textContent: best.caption }));
  }
}

// ---------------------------------------------------------------- teaching: guess before the finder tells

const HIDEABLE = ["creep", "delay", "amplifier_bandwidth", "rate_dependence", "second_mode", "mains_hum", "friction", "thermal_drift", "sensor_nonlinearity"];

function riddle() {
  if (!lab.planted) return "";
  return `<p class="row" id="riddle">One effect is hidden in this simulated recording. Your guess: <select aria-label="Your guess">${HIDEABLE.map((id) => `<option value="${id}">${spoken(id)}</option>`).join("")}</select><button>I guess so</button> <b></b></p>`;
}

function listenToRiddle(place) {
  const row = place.querySelector("#riddle");
  if (!row) return;
  row.querySelector("button").onclick = () => {
    const hidden = lab.planted.hidden[0][0];
    row.querySelector("b").textContent = row.querySelector("select").value === hidden ? `Yes: ${spoken(hidden)}.` : "No. Look again, or ask what is missing.";
  };
}

// ---------------------------------------------------------------- files out

function save(name, content, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

const SAVED = {
  model: async () => save("model.toml", (await ask({ ask: "save" })).json.text, "text/plain"),
  report: async () => save("report.html", (await ask({ ask: "report", of_search: lab.ofSearch })).json.text, "text/html"),
  figures: async () => save("figures.json", (await ask({ ask: "figures", seconds: lab.seconds, of_search: lab.ofSearch })).json.text, "application/json"),
  series: async () => {
    const { json } = await ask({ ask: "series", record: lab.shown, trial: { values: values(), off: [...lab.off] } });
    save(json.name, json.text, "text/csv");
  },
  manifest: async () => save("dataset.toml", lab.data.manifest, "text/plain"),
  picture: () => {
    const shown = Object.values(plots);
    const width = Math.max(...shown.map(({ canvas }) => canvas.width));
    const gap = Math.round(26 * (window.devicePixelRatio || 1));
    const paper = Object.assign(document.createElement("canvas"), { width, height: shown.reduce((sum, { canvas }) => sum + canvas.height + gap, 0) });
    const pen = paper.getContext("2d");
    pen.fillStyle = css("--card");
    pen.fillRect(0, 0, paper.width, paper.height);
    pen.fillStyle = css("--text");
    pen.font = `${Math.round(gap / 2)}px system-ui, sans-serif`;
    let top = 0;
    for (const { canvas, box } of shown) {
      pen.fillText(`${lab.data.records[lab.shown].name}: ${box.firstChild.textContent}`, gap / 2, top + gap * 0.75);
      pen.drawImage(canvas, 0, top + gap);
      top += canvas.height + gap;
    }
    return new Promise((done) => paper.toBlob((blob) => done(save("plots.png", blob))));
  },
};

// ---------------------------------------------------------------- drops, choices, keys

async function bytesOf(file, name) {
  return { name: name ?? file.name, bytes: new Uint8Array(await file.arrayBuffer()) };
}

/** All files of what was dropped. Folders are walked, where the browser lets a page do so: Chromium refuses it to pages from disk. */
async function dropped(transfer) {
  const walk = async (entry, folder) => {
    if (entry.isFile) return [await bytesOf(await new Promise((done, wrong) => entry.file(done, wrong)), folder + entry.name)];
    const reader = entry.createReader();
    const out = [];
    for (;;) {
      const some = await new Promise((done, wrong) => reader.readEntries(done, wrong));
      if (!some.length) return out;
      for (const one of some) out.push(...(await walk(one, `${folder}${entry.name}/`)));
    }
  };
  // What was dropped is gone after the first wait.
  const parts = [...transfer.items].filter((item) => item.kind === "file").map((item) => ({ entry: item.webkitGetAsEntry?.(), file: item.getAsFile() }));
  const found = parts.map(async ({ entry, file }) => {
    if (!entry?.isDirectory) return [await bytesOf(file)];
    try {
      return await walk(entry, "");
    } catch {
      throw new Error(`${entry.name}: this browser does not let a page from disk open a dropped folder; drop the files in it instead`);
    }
  });
  return (await Promise.all(found)).flat();
}

async function example() {
  const files = await lab.engine.example();
  await take(Object.entries(files).map(([name, text]) => ({ name, bytes: new TextEncoder().encode(text) })));
}

function hideOne() {
  const hidden = [[HIDEABLE[Math.floor(Math.random() * HIDEABLE.length)], 2]];
  return open({ planted: { hidden, base: ["hysteresis", "initial_curve", "vibration"], seed: Math.floor(Math.random() * 1e6) }, start: "hysteresis,initial_curve,vibration" });
}

function listen() {
  for (const id of ["#open", "#open2"]) $(id).onclick = () => $("#files").click();
  for (const id of ["#example", "#example2"]) $(id).onclick = () => trying(example);
  $("#hide").onclick = () => trying(hideOne);
  $("#files").onchange = (event) => trying(async () => {
    const files = await Promise.all([...event.target.files].map((file) => bytesOf(file)));
    event.target.value = "";
    if (files.length) await take(files);
  });
  $("#undo").onclick = () => trying(undo);
  $("#refit").onclick = () => trying(refit);
  $("#more").onchange = (event) => event.target.value && trying(() => addEffect(event.target.value, true));
  for (const button of document.querySelectorAll("[data-save]")) {
    button.onclick = () => trying(async () => {
      $("#save").open = false;
      if (!lab.model) throw new Error("there is no model yet; drop a recording first");
      await SAVED[button.dataset.save]();
    });
  }
  $("#theme").onclick = () => {
    const dark = told.theme ? told.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    told.theme = dark ? "light" : "dark";
    for (const plot of Object.values(plots)) plot.draw();
    if (lab.found) showFinder();
  };
  let over = 0;
  addEventListener("dragenter", (event) => { event.preventDefault(); over++; $("#drop").hidden = false; });
  addEventListener("dragleave", () => { if (--over <= 0) { over = 0; $("#drop").hidden = true; } });
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    over = 0;
    $("#drop").hidden = true;
    trying(async () => {
      const files = await dropped(event.dataTransfer);
      if (files.length) await take(files);
    });
  });
  addEventListener("keydown", (event) => {
    if ((event.ctrlKey || event.metaKey) && event.key === "z" && !event.target.matches("input, select")) {
      event.preventDefault();
      trying(undo);
    }
  });
}

async function begin() {
  makePlots();
  listen();
  await trying(async () => {
    lab.engine = $("#module").textContent ? new WorkerEngine(await unpacked($("#module").textContent)) : new ServedEngine();
    const { effects, served } = (await ask({ ask: "begin" })).json;
    lab.effects = effects;
    told.state = "empty";
    if (served) await open({ served, start: served.base_effects ? startOf(served.base_effects) : "gain" });
    if (location.hash === "#example") {
      await example();
      await find();
    }
  });
}

begin();
