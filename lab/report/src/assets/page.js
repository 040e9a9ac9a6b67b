// Draws the figures of a page from the data at its end. No dependencies, no network.
//
// A figure is redrawn whole into an SVG string: a few thousand points take a few milliseconds, and what is on
// screen is a function of the data, the choices in the bar (`chosen`) and the figure's own view (zoom, hidden
// series), nothing else.
"use strict";
(() => {
const page = JSON.parse(document.getElementById("page-data").textContent);
const root = document.documentElement;
const decoded = [];
const gap = NaN;

/** Column number `index` as an array; gaps are NaN. */
function column(index) {
  if (decoded[index]) return decoded[index];
  const stored = page.columns[index];
  let values;
  if (stored.plain) {
    values = Float64Array.from(stored.plain, value => value === null ? gap : value);
  } else {
    const text = atob(stored.packed), bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    const view = new DataView(bytes.buffer), wide = stored.bits === 32, top = wide ? 4294967294 : 65534;
    values = new Float64Array(bytes.length / (wide ? 4 : 2));
    const scale = (stored.high - stored.low) / top;
    for (let i = 0; i < values.length; i++) {
      const code = wide ? view.getUint32(4 * i, true) : view.getUint16(2 * i, true);
      values[i] = code > top ? gap : stored.low + scale * code;
    }
  }
  let rising = true;
  for (let i = 1; i < values.length && rising; i++) rising = values[i - 1] <= values[i];
  values.rising = rising;
  return decoded[index] = values;
}

// ---- text -------------------------------------------------------------------------------------------------
const escapes = { "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" };
const safe = text => String(text).replace(/[&<>"]/g, c => escapes[c]);
const minus = text => text.replace("-", "\u2212");
/** A number with about `digits` significant digits. */
function number(value, digits = 4) {
  if (!Number.isFinite(value)) return "\u2013";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return minus(value.toExponential(Math.max(0, digits - 2)));
  return minus(value.toFixed(Math.max(0, digits - 1 - Math.floor(Math.log10(size)))));
}
const withUnit = (text, unit) => unit ? text + "\u202f" + unit : text;
const axisTitle = axis => axis.label + (axis.unit ? ", " + axis.unit.replace("rtHz", "\u221aHz") : "");

// ---- choices ----------------------------------------------------------------------------------------------
const chosen = {};
let holdScales = false;
const stepSelectors = new Set(page.selectors.filter(s => s.steps).map(s => s.id));
for (const selector of page.selectors) chosen[selector.id] = selector.selected;
for (const part of location.hash.slice(1).split("&")) {
  const [id, option] = part.split("=");
  const selector = page.selectors.find(s => s.id === id);
  if (selector && Number(option) < selector.options.length && Number(option) >= 0) chosen[id] = Number(option) | 0;
}
// A selector with a single option is not in the bar; its conditions hold for that option.
const standing = id => id in chosen ? chosen[id] : 0;
const matches = when => (when || []).every(([id, option]) => standing(id) === option);
const matchesAnyStep = when => (when || []).every(([id, option]) => stepSelectors.has(id) || standing(id) === option);
const listeners = [];
function choose(id, option) {
  if (!(id in chosen) || chosen[id] === option) return;
  chosen[id] = option;
  // A copied address shows the same choice; where a browser forbids it for files, nothing else is lost.
  try { history.replaceState(null, "", "#" + Object.entries(chosen).map(([key, value]) => key + "=" + value).join("&")); } catch { /* stays as it was */ }
  for (const listener of listeners) listener(id);
}

function buildBar() {
  const bar = document.getElementById("bar");
  for (const selector of page.selectors) {
    const box = document.createElement("div");
    box.className = "choice";
    const name = document.createElement("label");
    name.className = "name";
    name.textContent = selector.label;
    box.append(name);
    if (selector.steps) {
      const button = (text, title, act) => {
        const made = document.createElement("button");
        made.textContent = text;
        if (title) made.title = made.ariaLabel = title;
        made.onclick = act;
        box.append(made);
        return made;
      };
      const move = by => choose(selector.id, Math.min(selector.options.length - 1, Math.max(0, chosen[selector.id] + by)));
      const previous = button("\u25c0", "previous step", () => move(-1));
      const buttons = selector.options.map((text, i) => button(text, "", () => choose(selector.id, i)));
      const next = button("\u25b6", "next step", () => move(1));
      const hold = document.createElement("label");
      hold.innerHTML = '<input type="checkbox"> keep scales';
      hold.title = "Hold the axes over all steps, so that the error is seen to shrink";
      hold.firstChild.onchange = event => { holdScales = event.target.checked; for (const listener of listeners) listener("scales"); };
      box.append(hold);
      const show = () => {
        buttons.forEach((b, i) => b.setAttribute("aria-pressed", String(i === chosen[selector.id])));
        previous.disabled = chosen[selector.id] === 0;
        next.disabled = chosen[selector.id] === selector.options.length - 1;
      };
      listeners.push(show);
      show();
    } else {
      const list = document.createElement("select");
      list.id = name.htmlFor = "choose-" + selector.id;
      selector.options.forEach(text => list.add(new Option(text)));
      list.onchange = () => choose(selector.id, list.selectedIndex);
      box.append(list);
      const show = () => { list.selectedIndex = chosen[selector.id]; };
      listeners.push(show);
      show();
    }
    bar.append(box);
  }
}

// ---- axes -------------------------------------------------------------------------------------------------
/** Maps values to pixels; `log` keeps to positive values. */
function scale(low, high, from, to, log) {
  const f = log ? Math.log10 : v => v, a = f(low), b = f(high);
  const map = v => from + (f(v) - a) / (b - a) * (to - from);
  map.back = p => { const v = a + (p - from) / (to - from) * (b - a); return log ? 10 ** v : v; };
  map.low = low; map.high = high; map.log = log;
  return map;
}
/** Positions and texts of tick marks between the ends of a scale. */
function ticks(map, wanted) {
  const { low, high, log } = map;
  if (log && high / low > 8) {
    const first = Math.ceil(Math.log10(low) - 1e-9), last = Math.floor(Math.log10(high) + 1e-9), every = Math.max(1, Math.ceil((last - first) / wanted));
    const found = [];
    for (let e = first; e <= last; e += every) found.push({ at: 10 ** e, text: e < -3 || e > 4 ? "10" + superscript(e) : number(10 ** e, 1) });
    if (last - first < 2) for (let e = first - 1; e <= last; e++) for (const m of [2, 5]) { const at = m * 10 ** e; if (at > low && at < high) found.push({ at, text: number(at, 1) }); }
    return found;
  }
  const raw = (high - low) / wanted, power = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].find(m => m * power >= raw * 0.999) * power;
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), found = [];
  const small = step < 1e-5, large = Math.max(Math.abs(low), Math.abs(high)) >= 1e6;
  const power_of = value => Math.floor(Math.log10(Math.abs(value)) + 1e-9), digits = at => Math.max(1, power_of(at) - power_of(step));
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) {
    const at = k * step;
    found.push({ at, text: at === 0 ? "0" : small || large ? minus(at.toExponential(digits(at))) : minus(at.toFixed(decimals)) });
  }
  return found;
}
const superscript = e => String(e).replace(/./g, c => "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"["-0123456789".indexOf(c)]);
/** The ends of an axis that shows `low` to `high` with a little air. */
function padded(low, high, log) {
  if (!(low <= high)) return log ? [0.1, 1] : [0, 1];
  if (log) return low === high ? [low / 2, high * 2] : [low / (high / low) ** 0.04, high * (high / low) ** 0.04];
  const air = high > low ? 0.05 * (high - low) : Math.abs(high) * 0.1 || 1;
  return [low - air, high + air];
}
/** The ends of what is shown of `values` where few of them lie far outside: one in a hundred on either side may; null where all are shown. */
function withoutFew(values) {
  if (values.length < 200) return null;
  const sorted = Float64Array.from(values).sort(), n = sorted.length - 1;
  const low = sorted[Math.floor(0.01 * n)], high = sorted[Math.ceil(0.99 * n)], wide = high - low;
  if (!(wide > 0) || sorted[n] - sorted[0] < 3 * wide) return null;
  return [Math.max(sorted[0], low - 0.5 * wide), Math.min(sorted[n], high + 0.5 * wide)];
}
/** Index of the first value of a rising array that is not below `value`. */
function lowerBound(values, value) {
  let low = 0, high = values.length;
  while (low < high) { const middle = (low + high) >> 1; if (values[middle] < value) low = middle + 1; else high = middle; }
  return low;
}

// ---- plots ------------------------------------------------------------------------------------------------
const links = {};
const margin = { left: 58, right: 14, top: 8, bottom: 38 };
let clips = 0;

class Plot {
  constructor(frame, spec) {
    this.spec = spec;
    this.hidden = new Set();
    this.view = {};
    this.whole = false;
    this.height = (spec.height || 280);
    const drawing = frame.querySelector(".drawing");
    this.legend = document.createElement("div");
    this.legend.className = "legend";
    this.surface = document.createElement("div");
    this.surface.className = "surface";
    this.surface.tabIndex = 0;
    this.surface.setAttribute("role", "img");
    this.surface.setAttribute("aria-label", `${spec.title}: ${axisTitle(spec.y)} over ${axisTitle(spec.x)}`);
    drawing.append(this.legend, this.surface);
    this.clip = "clip" + clips++;
    if (spec.link) (links[spec.link] ||= []).push(this);
    this.listen();
    listeners.push(id => {
      if (!stepSelectors.has(id) && id !== "scales" && spec.series.some(s => s.when.some(w => w[0] === id))) this.view = {};
      this.draw();
    });
    new ResizeObserver(() => { if (Math.abs(this.surface.clientWidth - this.width) > 1) this.draw(); }).observe(this.surface);
    this.draw();
  }
  linked() { return this.spec.link ? links[this.spec.link] : [this]; }
  /** Series for the present choices; with `anyStep` those of every step. */
  shown(anyStep = false) {
    return this.spec.series.filter(s => (anyStep ? matchesAnyStep : matches)(s.when) && !this.hidden.has(s.label));
  }
  extents() {
    const { x: xAxis, y: yAxis } = this.spec;
    const series = this.shown(holdScales);
    let x0 = Infinity, x1 = -Infinity, y0 = Infinity, y1 = -Infinity;
    for (const s of series) for (const v of column(s.x)) if (Number.isFinite(v) && !(xAxis.log && v <= 0)) { if (v < x0) x0 = v; if (v > x1) x1 = v; }
    let xs = this.view.x || (series.some(s => !column(s.x).rising) || xAxis.log ? padded(x0, x1, xAxis.log) : x0 < x1 ? [x0, x1] : padded(x0, x1, false));
    const seen = [];
    for (const s of series) {
      const x = column(s.x), y = column(s.y);
      for (let i = 0; i < y.length; i++) {
        const v = y[i];
        if (x[i] >= xs[0] && x[i] <= xs[1] && Number.isFinite(v) && !(yAxis.log && v <= 0)) { if (v < y0) y0 = v; if (v > y1) y1 = v; if (this.spec.percentiles) seen.push(v); }
      }
    }
    const most = withoutFew(seen);
    this.cut = most !== null && !this.view.y;
    if (this.cut && !this.whole) [y0, y1] = most;
    if (!yAxis.log) for (const level of this.spec.levels) if (matches(level.when) && !this.view.x) { y0 = Math.min(y0, level.value); y1 = Math.max(y1, level.value); }
    let ys = this.view.y || padded(y0, y1, yAxis.log);
    if (this.spec.equal && !this.view.x && !this.view.y) {
      // The tighter axis gets as many units a pixel as the other one.
      const w = (this.surface.clientWidth || 640) - margin.left - margin.right, h = this.height - margin.top - margin.bottom;
      const unit = Math.max((xs[1] - xs[0]) / w, (ys[1] - ys[0]) / h), about = ([a, b], pixels) => [(a + b - unit * pixels) / 2, (a + b + unit * pixels) / 2];
      xs = about(xs, w); ys = about(ys, h);
    }
    return [xs, ys];
  }
  draw() {
    const width = this.width = this.surface.clientWidth || 640, height = this.height, spec = this.spec;
    const [xs, ys] = this.extents();
    const right = width - margin.right, bottom = height - margin.bottom;
    const X = this.X = scale(xs[0], xs[1], margin.left, right, spec.x.log), Y = this.Y = scale(ys[0], ys[1], bottom, margin.top, spec.y.log);
    const out = [];
    for (const tick of ticks(X, width / 95)) { const p = X(tick.at).toFixed(1); out.push(`<path class="grid" d="M${p} ${margin.top}V${bottom}"/><text x="${p}" y="${bottom + 15}" text-anchor="middle">${tick.text}</text>`); }
    for (const tick of ticks(Y, height / 48)) { const p = Y(tick.at); out.push(`<path class="grid" d="M${margin.left} ${p.toFixed(1)}H${right}"/><text x="${margin.left - 6}" y="${(p + 4).toFixed(1)}" text-anchor="end">${tick.text}</text>`); }
    out.push(`<text x="${(margin.left + right) / 2}" y="${height - 6}" text-anchor="middle">${safe(axisTitle(spec.x))}</text>`);
    out.push(`<text transform="translate(12 ${(margin.top + bottom) / 2}) rotate(-90)" text-anchor="middle">${safe(axisTitle(spec.y))}</text>`);
    out.push(`<clipPath id="${this.clip}"><rect x="${margin.left}" y="${margin.top}" width="${right - margin.left}" height="${bottom - margin.top}"/></clipPath><g clip-path="url(#${this.clip})">`);
    const inside = p => Math.max(-1e4, Math.min(1e4, p));
    for (const band of spec.bands.filter(b => matches(b.when))) {
      const a = inside((band.along_x ? X : Y)(band.from)), b = inside((band.along_x ? X : Y)(band.to)), low = Math.min(a, b), long = Math.abs(a - b);
      out.push(band.along_x ? `<rect class="band" x="${low}" y="0" width="${long}" height="${height}"/><text x="${Math.max(low, margin.left) + 5}" y="${margin.top + 13}">${safe(band.label)}</text>` : `<rect class="band" x="0" y="${low}" width="${width}" height="${long}"/>`);
    }
    const series = this.shown();
    // Clouds below, lines over them, single dots on top.
    const depth = s => s.style !== "points" ? 1 : column(s.x).length > 300 ? 0 : 2;
    for (const s of [...series].sort((a, b) => depth(a) - depth(b))) out.push(this.curve(s));
    for (const level of spec.levels.filter(l => matches(l.when) && !(spec.y.log && l.value <= 0))) {
      const p = inside(Y(level.value)).toFixed(1);
      out.push(`<path class="level" d="M${margin.left} ${p}H${right}"/><text x="${right - 4}" y="${p < margin.top + 14 ? +p + 13 : p - 4}" text-anchor="end">${safe(level.label)}</text>`);
    }
    out.push(`<g class="over"></g></g><path class="frame" d="M${margin.left} ${margin.top}V${bottom}H${right}"/>`);
    this.surface.innerHTML = `<svg viewBox="0 0 ${width} ${height}" aria-hidden="true">${out.join("")}</svg>${series.some(s => column(s.x).length) ? "" : '<div class="empty">nothing to show for this choice</div>'}`;
    this.over = this.surface.querySelector(".over");
    this.drawLegend();
  }
  curve(s) {
    const x = column(s.x), y = column(s.y), { X, Y } = this, log = this.spec.y.log, xlog = this.spec.x.log, dots = s.style === "points";
    let from = 0, to = Math.min(x.length, y.length);
    if (x.rising) { from = Math.max(0, lowerBound(x, X.low) - 1); to = Math.min(to, lowerBound(x, X.high) + 2); }
    const path = [];
    let pen = false, lastX = NaN, lastY = NaN, pixel = NaN, low = 0, high = 0;
    const flush = () => { if (high - low > 0.6 && pen) path.push(`V${low.toFixed(1)}V${high.toFixed(1)}V${lastY.toFixed(1)}`); };
    for (let i = from; i < to; i++) {
      const v = y[i];
      if (!Number.isFinite(v) || !Number.isFinite(x[i]) || (log && v <= 0) || (xlog && x[i] <= 0)) { flush(); pen = false; pixel = NaN; low = high = 0; continue; }
      const px = X(x[i]), py = Math.max(-2000, Math.min(4000, Y(v)));
      if (dots) { path.push(`M${px.toFixed(1)} ${py.toFixed(1)}h0`); continue; }
      // Points that share a pixel column become one vertical stroke.
      if (x.rising && Math.round(px) === pixel && pen) { low = Math.min(low, py); high = Math.max(high, py); lastY = py; continue; }
      flush();
      const place = `${px.toFixed(1)} ${py.toFixed(1)}`;
      if (!pen) path.push("M" + place); else if (s.style === "steps") path.push(`H${px.toFixed(1)}V${py.toFixed(1)}`); else if (Math.abs(px - lastX) + Math.abs(py - lastY) > 0.3) path.push("L" + place);
      pen = true; lastX = px; lastY = low = high = py; pixel = Math.round(px);
    }
    flush();
    return `<path class="${dots ? "dots" + (to - from > 300 ? " many" : to - from < 4 ? " few" : "") : `curve ${s.role}${x.rising || x.length < 1500 ? "" : " loop"}`}" data-series="${safe(s.label)}" style="stroke:var(--${s.role})"${s.style === "dashed" ? ' stroke-dasharray="6 4"' : ""} d="${path.join("")}"/>`;
  }
  drawLegend() {
    const labels = new Map();
    for (const s of this.spec.series) if (matches(s.when) && !labels.has(s.label)) labels.set(s.label, s);
    this.legend.replaceChildren(...[...labels.values()].map(s => {
      const button = document.createElement("button");
      button.setAttribute("aria-pressed", String(!this.hidden.has(s.label)));
      button.title = "show or hide";
      button.innerHTML = `<svg viewBox="0 0 18 10" aria-hidden="true"><path d="${s.style === "points" ? "M4 5h0M9 5h0M14 5h0" : "M1 5H17"}" style="stroke:var(--${s.role});stroke-width:${s.style === "points" ? 4 : 2.5};stroke-linecap:round"${s.style === "dashed" ? ' stroke-dasharray="5 4"' : ""}/></svg><span>${safe(s.label)}</span> <b></b>`;
      button.onclick = () => { this.hidden.has(s.label) ? this.hidden.delete(s.label) : this.hidden.add(s.label); this.draw(); };
      button.series = s;
      return button;
    }));
    if (this.cut) {
      const button = document.createElement("button");
      button.className = "whole";
      button.textContent = this.whole ? "without the few largest values" : "the few largest values are outside: show all";
      button.onclick = () => { this.whole = !this.whole; this.draw(); };
      this.legend.append(button);
    }
    this.at = document.createElement("span");
    this.at.className = "at";
    this.legend.append(this.at);
  }
  /** Shows the values at abscissa `value`, or, where x goes back and forth, those of the point nearest to the pointer. */
  point(value, pointer) {
    const { X, Y, spec } = this, marks = [];
    if (value === null) { this.over.innerHTML = ""; this.at.textContent = ""; for (const b of this.legend.querySelectorAll("b")) b.textContent = ""; return; }
    let where = value, line = true;
    for (const button of this.legend.querySelectorAll("button:not(.whole)")) {
      const s = button.series, text = button.querySelector("b");
      text.textContent = "";
      if (this.hidden.has(s.label)) continue;
      const x = column(s.x), y = column(s.y);
      let best = -1;
      if (x.rising) {
        best = lowerBound(x, value);
        if (s.style === "steps") { if (x[best] > value) best--; } else if (best > 0 && (best === x.length || value - x[best - 1] < x[best] - value)) best--;
      } else {
        line = false;
        if (pointer) {
          let nearest = 900;
          for (let i = 0; i < x.length; i++) {
            const d = (X(x[i]) - pointer[0]) ** 2 + (Y(y[i]) - pointer[1]) ** 2;
            if (d < nearest) { nearest = d; best = i; }
          }
          if (best >= 0) where = x[best];
        }
      }
      if (best < 0 || best >= x.length || !Number.isFinite(y[best])) continue;
      text.textContent = withUnit(number(y[best]), spec.y.unit.replace("rtHz", "\u221aHz"));
      marks.push(`<circle cx="${X(x[best]).toFixed(1)}" cy="${Y(y[best]).toFixed(1)}" r="3.5" style="fill:var(--${s.role})"/>`);
    }
    this.at.textContent = "at " + withUnit(number(where, 5), spec.x.unit);
    this.over.innerHTML = (line ? `<path class="cursor" d="M${X(value).toFixed(1)} 0V${this.height}"/>` : "") + marks.join("");
  }
  setView(view) {
    for (const plot of this.linked()) { plot.view = plot === this ? view : { x: view.x }; plot.draw(); }
  }
  /** Zooms by `factor` about the abscissa `about`, or moves by `shift` of the width. */
  change(factor, about, shift = 0) {
    const { X } = this, f = X.log ? Math.log10 : v => v, g = X.log ? v => 10 ** v : v => v;
    const a = f(X.low), b = f(X.high), c = f(about), move = shift * (b - a);
    const low = c + (a - c) * factor + move, high = c + (b - c) * factor + move;
    if (high - low > 1e-12 * Math.max(Math.abs(low), Math.abs(high), 1e-9)) this.setView({ x: [g(low), g(high)] });
  }
  listen() {
    const surface = this.surface;
    const place = event => { const box = surface.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
    let start = null;
    surface.addEventListener("pointerdown", event => { if (event.button === 0 && event.pointerType !== "touch") { start = place(event); surface.setPointerCapture(event.pointerId); surface.focus({ preventScroll: true }); event.preventDefault(); } });
    surface.addEventListener("pointermove", event => {
      const [px, py] = place(event);
      if (start) {
        const w = Math.abs(px - start[0]), h = Math.abs(py - start[1]), box = h > 30;
        this.over.innerHTML = `<rect class="drag" x="${Math.min(px, start[0])}" width="${w}" y="${box ? Math.min(py, start[1]) : 0}" height="${box ? h : this.height}"/>`;
      } else {
        const value = this.X.back(Math.max(margin.left, Math.min(this.width - margin.right, px)));
        for (const plot of this.linked()) plot.point(value, plot === this ? [px, py] : null);
      }
    });
    surface.addEventListener("pointerup", event => {
      if (!start) return;
      const [px, py] = place(event), [sx, sy] = start;
      start = null;
      if (Math.abs(px - sx) > 6) {
        const view = { x: [this.X.back(Math.min(px, sx)), this.X.back(Math.max(px, sx))] };
        if (Math.abs(py - sy) > 30) view.y = [this.Y.back(Math.max(py, sy)), this.Y.back(Math.min(py, sy))];
        this.setView(view);
      } else this.over.innerHTML = "";
    });
    surface.addEventListener("pointercancel", () => { start = null; this.over.innerHTML = ""; });
    surface.addEventListener("pointerleave", () => { if (!start) for (const plot of this.linked()) plot.point(null); });
    surface.addEventListener("dblclick", () => this.setView({}));
    // The wheel belongs to the page until a plot has been clicked or reached by keyboard.
    surface.addEventListener("wheel", event => {
      if (document.activeElement !== surface) return;
      event.preventDefault();
      this.change(event.deltaY > 0 ? 1.25 : 0.8, this.X.back(place(event)[0]));
    }, { passive: false });
    surface.addEventListener("keydown", event => {
      const middle = this.X.back((margin.left + this.width - margin.right) / 2);
      const act = { "+": () => this.change(0.7, middle), "=": () => this.change(0.7, middle), "-": () => this.change(1 / 0.7, middle), "0": () => this.setView({}),
        ArrowLeft: () => this.change(1, middle, -0.15), ArrowRight: () => this.change(1, middle, 0.15) }[event.key];
      if (act && !event.ctrlKey && !event.metaKey && !event.altKey) { event.preventDefault(); act(); }
    });
  }
}

// ---- the falling error ------------------------------------------------------------------------------------
function waterfall(frame, spec) {
  const drawing = frame.querySelector(".drawing");
  const draw = () => {
    const width = drawing.clientWidth || 900, height = 300, left = 58, right = width - (spec.floor ? 120 : 14), top = 26, bottom = height - 34;
    const values = spec.steps.flatMap(s => [s.value, s.beside]).concat(spec.floor ? [spec.floor[1]] : []).filter(v => v > 0);
    const low = Math.min(...values) / 1.6, high = Math.max(...values) * 1.25, Y = scale(low, high, bottom, top, true);
    const slot = Math.min(260, (right - left) / spec.steps.length), bar = Math.min(74, slot * 0.45), out = [];
    for (const tick of ticks(Y, 6)) { const p = Y(tick.at).toFixed(1); out.push(`<path class="grid" d="M${left} ${p}H${right}"/><text x="${left - 6}" y="${+p + 4}" text-anchor="end">${tick.text}</text>`); }
    out.push(`<text transform="translate(12 ${(top + bottom) / 2}) rotate(-90)" text-anchor="middle">${safe(spec.unit)}</text>`);
    spec.steps.forEach((step, i) => {
      const x = left + slot * i + (slot - bar) / 2, y = step.value > 0 ? Y(step.value) : bottom, before = i ? spec.steps[i - 1].value : NaN;
      const change = before > 0 ? Math.round(100 * (step.value / before - 1)) : null;
      const told = `${step.label}: ${number(step.value, 3)} ${spec.unit}`;
      out.push(`<g class="step" data-step="${i}" tabindex="0" role="button" aria-label="${safe(told)}"><title>${safe(told)}</title><rect x="${x - 8}" y="${top}" width="${bar + 16}" height="${height - top}" fill="transparent"/>`);
      if (before > step.value) out.push(`<rect class="taken" x="${x}" y="${Y(before)}" width="${bar}" height="${y - Y(before)}"/>`);
      out.push(`<rect class="value" x="${x}" y="${y}" width="${bar}" height="${bottom - y}"/>`);
      if (step.beside > 0) out.push(`<path d="M${x - 7} ${Y(step.beside)}h${bar + 14}" style="stroke:var(--model);stroke-width:2.5"/>`);
      const above = before > step.value ? Math.min(y, Y(before)) : y;
      out.push(`<text class="strong" x="${x + bar / 2}" y="${Math.min(above, step.beside > 0 ? Y(step.beside) : above) - 6}" text-anchor="middle">${number(step.value, 3)}${change === null ? "" : change < 0 ? ` (\u2212${-change} %)` : ` (+${change} %)`}</text>`);
      out.push(`<text class="strong" x="${x + bar / 2}" y="${bottom + 16}" text-anchor="middle">${safe(step.label)}</text></g>`);
    });
    if (spec.floor && spec.floor[1] > 0) { const p = Y(spec.floor[1]); out.push(`<path class="level" d="M${left} ${p}H${right}"/><text class="strong" x="${right + 6}" y="${p + 4}">${safe(spec.floor[0])} ${number(spec.floor[1], 3)}</text>`); }
    out.push(`<path class="frame" d="M${left} ${top}V${bottom}H${right}"/>`);
    drawing.innerHTML = `<div class="legend"><span><svg viewBox="0 0 18 10"><rect width="18" height="10" style="fill:var(--residual)"/></svg> ${safe(spec.labels[0])}</span>${spec.labels[1] ? `<span>&ensp;<svg viewBox="0 0 18 10"><path d="M0 5H18" style="stroke:var(--model);stroke-width:2.5"/></svg> ${safe(spec.labels[1])}</span>` : ""}</div><svg viewBox="0 0 ${width} ${height}">${out.join("")}</svg>`;
    mark();
  };
  const mark = () => drawing.querySelectorAll(".step").forEach((g, i) => g.classList.toggle("chosen", spec.selector in chosen && chosen[spec.selector] === i));
  const act = event => { const step = event.target.closest(".step"); if (step && spec.selector) choose(spec.selector, Number(step.dataset.step)); };
  drawing.addEventListener("click", act);
  drawing.addEventListener("keydown", event => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); act(event); } });
  listeners.push(mark);
  let width = 0;
  new ResizeObserver(() => { if (drawing.clientWidth !== width) { width = drawing.clientWidth; draw(); } }).observe(drawing);
  draw();
}

// ---- coloured cells ---------------------------------------------------------------------------------------
function heatMap(frame, spec) {
  const drawing = frame.querySelector(".drawing");
  const all = spec.layers.flatMap(layer => layer.values.flat()).filter(v => v > 0);
  const neutral = spec.neutral || Math.min(...all), hottest = Math.max(...all, neutral * 3);
  const draw = () => {
    const layer = spec.layers.find(l => matches(l.when)) || spec.layers[0];
    const out = ['<div class="scroll"><table class="heat"><thead><tr><th></th>'];
    for (const [group, columns] of spec.groups) out.push(`<th class="group" scope="colgroup" colspan="${columns.length}">${safe(group)}</th>`);
    out.push("</tr><tr><th></th>");
    for (const [, columns] of spec.groups) for (const name of columns) out.push(`<th scope="col">${safe(name)}</th>`);
    out.push("</tr></thead><tbody>");
    const names = spec.groups.flatMap(([group, columns]) => columns.map(c => `${group}: ${c}`));
    spec.rows.forEach((row, r) => {
      out.push(`<tr data-row="${r}" class="${spec.selector in chosen && chosen[spec.selector] === r ? "chosen" : ""}"><th scope="row">${safe(row)}</th>`);
      (layer ? layer.values[r] : []).forEach((value, c) => {
        if (value === null) { out.push('<td class="none"></td>'); return; }
        const heat = Math.max(0, Math.min(1, Math.log(value / neutral) / Math.log(hottest / neutral)));
        out.push(`<td style="background:color-mix(in srgb, var(--hot) ${Math.round(85 * heat)}%, var(--grid))" title="${safe(`${row}, ${names[c]}: ${number(value, 3)} ${spec.unit}`)}">${number(value, value < 10 ? 2 : 3)}</td>`);
      });
      out.push("</tr>");
    });
    drawing.innerHTML = out.join("") + "</tbody></table></div>";
  };
  drawing.addEventListener("click", event => { const row = event.target.closest("tr[data-row]"); if (row && spec.selector) choose(spec.selector, Number(row.dataset.row)); });
  listeners.push(draw);
  draw();
}

buildBar();
let drawn = 0;
for (const frame of document.querySelectorAll("[data-figure]")) {
  const spec = page.figures[Number(frame.dataset.figure)];
  if (spec.kind === "plot") new Plot(frame, spec);
  else if (spec.kind === "waterfall") waterfall(frame, spec);
  else if (spec.kind === "heatmap") heatMap(frame, spec);
  drawn += 1;
}
root.dataset.drawn = String(drawn);
})();
