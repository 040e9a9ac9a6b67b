// From the model to a servo: design, margins, a reference followed in simulation, files for the amplifier.

const servo = { reference_hz: 150, hz: 50, amplitude_um: null, designed: null, followed: null, refused: "" };

/** A model that changed has no servo yet. */
function forgetServo() {
  Object.assign(servo, { amplitude_um: null, designed: null, followed: null, refused: "" });
  showServo();
}

const aboutServo = (about) => ask({ ask: "servo", about });

/** A refusal is an answer: it says which drive is missing. */
async function answered(work) {
  servo.refused = "";
  try {
    await work();
  } catch (error) {
    if (error instanceof Cancelled || lab.engine?.knowsNothing) throw error;
    servo.refused = error.message;
  } finally {
    showServo();
  }
}

const design = () => answered(async () => {
  Object.assign(servo, { designed: null, followed: null });
  if (lab.off.size) throw new Error(`${[...lab.off].map(spoken).join(", ")} is switched off, but belongs to the model: switch it on, or fit again without it`);
  const before = told.state;
  const { json, columns } = await watched("Designing a servo", () => aboutServo({ design: { reference_hz: servo.reference_hz } }));
  told.state = before;
  showFinder();
  servo.designed = { ...json, columns };
  servo.amplitude_um ??= Number(json.amplitude_um.toPrecision(2));
});

const follow = () => answered(async () => {
  servo.followed = null;
  const { json, columns } = await aboutServo({ follow: { hz: servo.hz, amplitude_um: servo.amplitude_um } });
  servo.followed = { ...json, columns };
});

async function saveServo() {
  save("servo.toml", (await aboutServo({ save: {} })).json.text, "text/plain");
}

const saveBlock = () => answered(async () => {
  const { json } = await aboutServo({ block: { reference_hz: servo.reference_hz } });
  save("servo.block", new Blob([new Uint8Array(json.bytes)]));
  save("servo.block.commands", json.commands, "text/plain");
});

function showServo() {
  const place = $("#servo");
  const { designed, followed } = servo;
  const paragraphs = (texts) => (texts ?? []).map((text) => `<p>${escaped(text)}</p>`).join("");
  place.innerHTML = `<h2>Servo</h2>
    <p class="row"><label for="servo-hz">For references up to</label> <input id="servo-hz" type="number" min="0.1" step="any" value="${servo.reference_hz}"> Hz
      <button id="design">${designed ? "Design again" : "Design a servo for this model"}</button></p>
    ${servo.refused ? `<p class="refused" role="alert">${escaped(servo.refused)}</p>` : ""}
    ${designed ? `${paragraphs(designed.explanation)}<div class="pair" id="loop-plots"></div>
      <details><summary>Margins on this model</summary>${paragraphs(designed.margins) || "<p>none</p>"}</details>
      <p class="row"><label for="sine-hz">Follow a sine of</label> <input id="sine-hz" type="number" min="0.01" step="any" value="${servo.hz}"> Hz,
        <input id="sine-um" type="number" min="0" step="any" value="${servo.amplitude_um}" aria-label="amplitude"> um <button id="follow">Follow it in simulation</button>
        <button id="save-servo">Save servo.toml</button> <button id="save-block" title="For an amplifier with the usual wiring; beside it the lines that bring it to a running one">Save parameter block</button></p>` : ""}
    ${followed ? `<p>The integer servo on the simulated model: the true position is <b>${nm(followed.true_rms_um)} nm</b> RMS off, ${nm(followed.true_max_um)} nm at most; the sensor reads ${nm(followed.read_rms_um)} nm.
      ${followed.trouble ? `</p><p class="refused">${escaped(followed.trouble)}</p><p>` : ""}</p><ul id="servo-band">${followed.band.map((line) => `<li>${escaped(line)}</li>`).join("")}</ul>
      <div class="pair" id="follow-plots"></div>` : ""}`;
  const act = (selector, work) => place.querySelector(selector)?.addEventListener("click", () => trying(work));
  const takes = (selector, key) => place.querySelector(selector)?.addEventListener("change", (event) => (servo[key] = Number(event.target.value)));
  takes("#servo-hz", "reference_hz");
  takes("#sine-hz", "hz");
  takes("#sine-um", "amplitude_um");
  act("#design", design);
  act("#follow", follow);
  act("#save-servo", saveServo);
  act("#save-block", saveBlock);
  if (designed) showLoop(place.querySelector("#loop-plots"), designed);
  if (followed) showFollowed(place.querySelector("#follow-plots"), followed);
}

/** What is left of a disturbance over frequency, and what other tunings would have cost. */
function showLoop(place, { columns: [hz, sensitivity, complementary, noise, disturbance, chosen] }) {
  const decibel = (column) => Array.from(column, (v) => 20 * Math.log10(Math.max(v, 1e-6)));
  new Plot(place, { title: "What the loop leaves of a disturbance", xLabel: "frequency, Hz", yLabel: "dB", logX: true }).show({
    series: [{ label: "sensitivity", colour: "--residual", x: hz, y: decibel(sensitivity) }, { label: "complementary sensitivity", colour: "--modelled", x: hz, y: decibel(complementary) }],
    levels: [{ value: 0, label: "0 dB" }],
  });
  const nanometres = (column) => Array.from(column, (v) => 1e3 * v);
  new Plot(place, { title: "Trade-off: every point keeps all margins", xLabel: "sensor noise passed on, nm", yLabel: "model error let through, nm", loop: true }).show({
    series: [{ label: "tunings", colour: "--measured", x: nanometres(noise), y: nanometres(disturbance) },
      { label: "chosen", colour: "--modelled", x: nanometres(chosen.slice(0, 1)), y: nanometres(chosen.slice(1)) }],
  });
}

function showFollowed(place, { from_s: from, rate_hz: rate, step, step_from_s: stepFrom, columns: [reference, read, error, , wanted, reached] }) {
  const link = new Link();
  new Plot(place, { title: "Reference and position", xLabel: "time, s", yLabel: "um", link, wide: true }).show({
    rate, from, series: [{ label: "reference", colour: "--measured", y: reference, thick: true }, { label: "position", colour: "--modelled", y: read }],
  });
  new Plot(place, { title: "Error: position less reference", xLabel: "time, s", yLabel: "nm", link, wide: true, height: 150 }).show({
    rate, from, series: [{ label: "error", colour: "--residual", y: Array.from(error, (v) => 1e3 * v) }],
  });
  if (!step) return;
  // From 5 ms before the step to 20 ms behind it.
  const last = wanted[wanted.length - 1];
  const at = wanted.findIndex((value) => value === last);
  const begin = Math.max(0, at - Math.round(0.005 * rate));
  const cut = (column) => column.slice(begin, at + Math.round(0.02 * rate));
  new Plot(place, { title: `A small step: ${step}`, xLabel: "time, s", yLabel: "um", wide: true, height: 190 }).show({
    rate, from: stepFrom + begin / rate,
    series: [{ label: "reference", colour: "--measured", y: cut(wanted), thick: true }, { label: "position", colour: "--modelled", y: cut(reached) }],
  });
}
