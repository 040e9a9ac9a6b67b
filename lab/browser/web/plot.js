// Curves on a canvas. From the true samples: where several fall on one pixel their least and greatest are
// drawn, else every sample.

/** Round numbers between two limits. */
function ticks(low, high, about) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const rough = span / about;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= rough);
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; k++) out.push(k * step);
  return out;
}

/** Powers of ten between two limits, thinned. */
function decades(low, high) {
  const from = Math.ceil(Math.log10(low) - 1e-9);
  const to = Math.floor(Math.log10(high) + 1e-9);
  const every = Math.max(1, Math.ceil((to - from) / 6));
  const out = [];
  for (let k = from; k <= to; k += every) out.push(10 ** k);
  return out;
}

/** A number as it is read beside an axis or a cursor. */
function readable(value, digits = 4) {
  if (value === 0 || !Number.isFinite(value)) return String(value);
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-4) return value.toExponential(2).replace("e+", "e");
  return String(Number(value.toPrecision(digits)));
}

function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** Views of x that several plots share. */
class Link {
  constructor() {
    this.plots = new Set();
    this.view = null;
    this.cursor = null;
  }
  show(view) {
    this.view = view;
    this.redraw();
  }
  redraw() {
    for (const plot of this.plots) plot.draw();
  }
}

/**
 * One plot. `data` is { series: [{ label, colour, y, x? }], rate?, from?, levels? }: without `x` the samples stand at from + k / rate.
 * With `loop` the series are drawn y over x in the order of the samples, those of the shared view.
 */
class Plot {
  constructor(place, { title, xLabel, yLabel, link = new Link(), logX = false, logY = false, loop = false, wide = false, height = 210 }) {
    Object.assign(this, { link, logX, logY, loop, height, xLabel, yLabel, data: null, own: null });
    this.box = document.createElement("div");
    this.box.className = wide ? "plot wide" : "plot";
    this.box.innerHTML = `<h3></h3><div class="legend"></div><canvas tabindex="0" role="img"></canvas>`;
    this.box.firstChild.textContent = title;
    this.legend = this.box.children[1];
    this.canvas = this.box.children[2];
    this.canvas.setAttribute("aria-label", `${title}: ${yLabel} over ${xLabel}. Zoom with + and -, move with arrows, 0 for all.`);
    this.canvas.style.height = `${height}px`;
    place.append(this.box);
    link.plots.add(this);
    this.listen();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  show(data) {
    this.data = data;
    this.draw();
  }

  get view() {
    return this.loop ? this.own : this.link.view;
  }
  set view(view) {
    if (this.loop) {
      this.own = view;
      this.draw();
    } else this.link.show(view);
  }

  /** Limits of x over all samples. */
  whole() {
    const { series, rate, from = 0 } = this.data;
    if (!this.loop && rate) return [from, from + Math.max(1, series[0].y.length - 1) / rate];
    let [low, high] = [Infinity, -Infinity];
    for (const { x } of series) for (const v of x) if (!this.logX || v > 0) { if (v < low) low = v; if (v > high) high = v; }
    return high > low ? [low, high] : [low - 1, low + 1];
  }

  /** Samples of the shared view. */
  range(count) {
    const { rate, from = 0 } = this.data;
    const view = this.link.view;
    if (!view || !rate) return [0, count];
    return [Math.max(0, Math.floor((view[0] - from) * rate)), Math.min(count, Math.ceil((view[1] - from) * rate) + 1)];
  }

  draw() {
    const width = this.canvas.clientWidth;
    if (!this.data || !width) return;
    const scale = window.devicePixelRatio || 1;
    const [w, h] = [Math.round(width * scale), Math.round(this.height * scale)];
    if (this.canvas.width !== w || this.canvas.height !== h) [this.canvas.width, this.canvas.height] = [w, h];
    this.canvas.style.height = `${this.height}px`;
    const pen = this.canvas.getContext("2d");
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, width, this.height);
    pen.font = "11px system-ui, sans-serif";
    this.area = { left: 58, right: width - 10, top: 6, bottom: this.height - 34 };
    this.x = this.loop ? this.own ?? this.whole() : this.link.view ?? this.whole();
    this.y = this.limitsOfY();
    this.axes(pen);
    pen.save();
    pen.beginPath();
    pen.rect(this.area.left, this.area.top, this.area.right - this.area.left, this.area.bottom - this.area.top);
    pen.clip();
    let nothing = true;
    for (const series of this.data.series) nothing = !(this.loop ? this.drawLoop(pen, series, scale) : this.drawOver(pen, series)) && nothing;
    for (const level of this.data.levels ?? []) this.level(pen, level);
    if (nothing) {
      pen.fillStyle = css("--quiet");
      pen.textAlign = "center";
      pen.fillText("no samples here", (this.area.left + this.area.right) / 2, (this.area.top + this.area.bottom) / 2);
    }
    pen.restore();
    this.drawCursor(pen);
    this.writeLegend();
  }

  pixelX(v) {
    const { left, right } = this.area;
    const [a, b] = this.x;
    return left + (right - left) * (this.logX ? Math.log(v / a) / Math.log(b / a) : (v - a) / (b - a));
  }
  valueX(pixel) {
    const { left, right } = this.area;
    const share = (pixel - left) / (right - left);
    const [a, b] = this.x;
    return this.logX ? a * (b / a) ** share : a + share * (b - a);
  }
  pixelY(v) {
    const { top, bottom } = this.area;
    const [a, b] = this.y;
    return bottom - (bottom - top) * (this.logY ? Math.log(v / a) / Math.log(b / a) : (v - a) / (b - a));
  }

  /** First and one past the last sample of a series with an x that rises. */
  between({ x, y }) {
    if (!x) return this.range(y.length);
    const first = (limit) => {
      let [a, b] = [0, x.length];
      while (a < b) {
        const m = (a + b) >> 1;
        if (x[m] < limit) a = m + 1;
        else b = m;
      }
      return a;
    };
    return [Math.max(0, first(this.x[0]) - 1), Math.min(x.length, first(this.x[1]) + 1)];
  }

  limitsOfY() {
    let [low, high] = [Infinity, -Infinity];
    for (const series of this.data.series) {
      const { y } = series;
      const [from, to] = this.loop ? this.range(y.length) : this.between(series);
      for (let k = from; k < to; k++) {
        const v = y[k];
        if (this.logY && !(v > 0)) continue;
        if (this.loop && this.own && (series.x[k] < this.x[0] || series.x[k] > this.x[1])) continue;
        if (v < low) low = v;
        if (v > high) high = v;
      }
    }
    for (const { value } of this.data.levels ?? []) if (!this.logY || value > 0) { low = Math.min(low, value); high = Math.max(high, value); }
    if (!(low <= high)) return this.logY ? [0.1, 1] : [-1, 1];
    if (this.logY) return [low / 1.3, high * 1.3];
    const margin = (high - low) * 0.05 || Math.abs(high) * 0.1 || 1;
    return [low - margin, high + margin];
  }

  axes(pen) {
    const { left, right, top, bottom } = this.area;
    pen.strokeStyle = css("--line");
    pen.fillStyle = css("--quiet");
    pen.lineWidth = 1;
    pen.textAlign = "center";
    for (const v of this.logX ? decades(...this.x) : ticks(...this.x, Math.max(2, (right - left) / 90))) {
      const px = this.pixelX(v);
      pen.beginPath();
      pen.moveTo(px, top);
      pen.lineTo(px, bottom);
      pen.stroke();
      pen.fillText(readable(v), px, bottom + 14);
    }
    pen.textAlign = "right";
    for (const v of this.logY ? decades(...this.y) : ticks(...this.y, 5)) {
      const py = this.pixelY(v);
      pen.beginPath();
      pen.moveTo(left, py);
      pen.lineTo(right, py);
      pen.stroke();
      pen.fillText(readable(v), left - 6, py + 4);
    }
    pen.fillText(this.xLabel, right, bottom + 28);
    pen.save();
    pen.translate(11, (top + bottom) / 2);
    pen.rotate(-Math.PI / 2);
    pen.textAlign = "center";
    pen.fillText(this.yLabel, 0, 0);
    pen.restore();
  }

  level(pen, { value, label, colour }) {
    const py = this.pixelY(value);
    pen.strokeStyle = pen.fillStyle = css(colour ?? "--floor");
    pen.setLineDash([6, 4]);
    pen.beginPath();
    pen.moveTo(this.area.left, py);
    pen.lineTo(this.area.right, py);
    pen.stroke();
    pen.setLineDash([]);
    if (label) {
      pen.textAlign = "right";
      // On a ground of its own: curves go behind it.
      const width = pen.measureText(label).width;
      pen.fillStyle = css("--card");
      pen.globalAlpha = 0.8;
      pen.fillRect(this.area.right - width - 8, py - 15, width + 8, 13);
      pen.globalAlpha = 1;
      pen.fillStyle = css(colour ?? "--floor");
      pen.fillText(label, this.area.right - 4, py - 4);
    }
  }

  drawOver(pen, series) {
    const { y, x, colour, thick } = series;
    const { rate, from = 0 } = this.data;
    const [begin, end] = this.between(series);
    if (end <= begin) return false;
    const at = x ? (k) => this.pixelX(x[k]) : (k) => this.pixelX(from + k / rate);
    pen.strokeStyle = pen.fillStyle = css(colour);
    pen.lineWidth = thick ? 3 : 1.3;
    pen.globalAlpha = thick ? 0.45 : 1;
    pen.lineJoin = "round";
    pen.beginPath();
    const width = this.area.right - this.area.left;
    if (end - begin <= 2 * width) {
      for (let k = begin; k < end; k++) pen.lineTo(at(k), this.pixelY(y[k]));
      pen.stroke();
      if (end - begin < width / 6) {
        for (let k = begin; k < end; k++) {
          pen.beginPath();
          pen.arc(at(k), this.pixelY(y[k]), thick ? 3 : 2, 0, 7);
          pen.fill();
        }
      }
    } else {
      let k = begin;
      while (k < end) {
        const column = Math.floor(at(k));
        let [low, high, first, last] = [y[k], y[k], y[k], y[k]];
        for (; k < end && at(k) < column + 1; k++) {
          last = y[k];
          if (last < low) low = last;
          if (last > high) high = last;
        }
        pen.lineTo(column, this.pixelY(first));
        pen.lineTo(column, this.pixelY(low));
        pen.lineTo(column, this.pixelY(high));
        pen.lineTo(column, this.pixelY(last));
      }
      pen.stroke();
    }
    pen.globalAlpha = 1;
    return true;
  }

  /** Many samples as dots, each on its own pixel; few as a line. */
  drawLoop(pen, { x, y, colour, thick }, scale) {
    const [begin, end] = this.range(y.length);
    if (end <= begin) return false;
    pen.strokeStyle = pen.fillStyle = css(colour);
    if (y.length === 1) {
      pen.beginPath();
      pen.arc(this.pixelX(x[0]), this.pixelY(y[0]), 5, 0, 2 * Math.PI);
      pen.fill();
      return true;
    }
    pen.globalAlpha = thick ? 0.45 : 1;
    if (end - begin <= 20000) {
      pen.lineWidth = thick ? 3 : 1.2;
      pen.beginPath();
      let [oldX, oldY] = [NaN, NaN];
      for (let k = begin; k < end; k++) {
        const [px, py] = [Math.round(2 * this.pixelX(x[k])) / 2, Math.round(2 * this.pixelY(y[k])) / 2];
        if (px === oldX && py === oldY) continue;
        pen.lineTo(px, py);
        [oldX, oldY] = [px, py];
      }
      pen.stroke();
    } else {
      const { left, right, top, bottom } = this.area;
      const [columns, rows] = [Math.ceil((right - left) * scale), Math.ceil((bottom - top) * scale)];
      const hit = new Uint8Array(columns * rows);
      for (let k = begin; k < end; k++) {
        const c = Math.floor((this.pixelX(x[k]) - left) * scale);
        const r = Math.floor((this.pixelY(y[k]) - top) * scale);
        if (c >= 0 && c < columns && r >= 0 && r < rows) hit[r * columns + c] = 1;
      }
      const dot = thick ? 2.5 : 1.2;
      for (let r = 0; r < rows; r++) {
        for (let c = 0; c < columns; c++) {
          if (!hit[r * columns + c]) continue;
          let end = c + 1;
          while (end < columns && hit[r * columns + end]) end++;
          pen.fillRect(left + c / scale - dot / 2 + 0.5, top + r / scale - dot / 2 + 0.5, (end - c) / scale + dot - 1, dot);
          c = end;
        }
      }
    }
    pen.globalAlpha = 1;
    return true;
  }

  drawCursor(pen) {
    const v = this.link.cursor;
    if (this.loop || v === null || v < this.x[0] || v > this.x[1]) return;
    pen.strokeStyle = css("--quiet");
    pen.beginPath();
    pen.moveTo(this.pixelX(v), this.area.top);
    pen.lineTo(this.pixelX(v), this.area.bottom);
    pen.stroke();
  }

  writeLegend() {
    const { series, rate, from = 0 } = this.data;
    const v = this.loop ? null : this.link.cursor;
    const parts = series.map(({ label, colour, y, x }) => {
      let value = "";
      if (v !== null) {
        let k = x ? x.findIndex((one) => one >= v) : Math.round((v - from) * rate);
        if (k >= 0 && k < y.length) value = ` <b>${readable(y[k], 5)}</b>`;
      }
      return `<span><i style="background: ${css(colour)}"></i>${label}${value}</span>`;
    });
    if (v !== null) parts.push(`<span>at <b>${readable(v, 6)}</b></span>`);
    this.legend.innerHTML = parts.join("");
  }

  listen() {
    const { canvas } = this;
    const inside = (event) => event.clientX - canvas.getBoundingClientRect().left;
    canvas.addEventListener("wheel", (event) => {
      if (!this.data || !(event.ctrlKey || event.shiftKey || document.activeElement === canvas)) return;
      event.preventDefault();
      this.zoom(this.valueX(inside(event)), (event.deltaY || event.deltaX) > 0 ? 1.3 : 1 / 1.3);
    }, { passive: false });
    canvas.addEventListener("dblclick", () => (this.view = null));
    let pressed = null;
    canvas.addEventListener("pointerdown", (event) => {
      if (!this.data || event.button) return;
      pressed = inside(event);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!this.data || !this.area) return;
      this.link.cursor = this.valueX(inside(event));
      if (!this.loop) this.link.redraw();
      if (pressed !== null && Math.abs(inside(event) - pressed) > 3) {
        const pen = canvas.getContext("2d");
        pen.globalAlpha = 0.2;
        pen.fillStyle = css("--accent");
        pen.fillRect(Math.min(pressed, inside(event)), this.area.top, Math.abs(inside(event) - pressed), this.area.bottom - this.area.top);
        pen.globalAlpha = 1;
      }
    });
    canvas.addEventListener("pointerup", (event) => {
      const [a, b] = [pressed, inside(event)].sort((one, other) => one - other);
      if (pressed !== null && b - a > 6) this.limit(this.valueX(a), this.valueX(b));
      pressed = null;
    });
    canvas.addEventListener("pointerleave", () => {
      this.link.cursor = null;
      if (!this.loop) this.link.redraw();
    });
    canvas.addEventListener("keydown", (event) => {
      if (!this.data || event.ctrlKey || event.metaKey) return;
      const [a, b] = this.x;
      const middle = this.logX ? Math.sqrt(a * b) : (a + b) / 2;
      const move = (share) => (this.logX ? this.limit(a * (b / a) ** share, b * (b / a) ** share) : this.limit(a + share * (b - a), b + share * (b - a)));
      const keys = { "+": () => this.zoom(middle, 1 / 1.5), "=": () => this.zoom(middle, 1 / 1.5), "-": () => this.zoom(middle, 1.5),
        ArrowLeft: () => move(-0.2), ArrowRight: () => move(0.2), 0: () => (this.view = null), Home: () => (this.view = null) };
      if (!keys[event.key]) return;
      event.preventDefault();
      keys[event.key]();
    });
  }

  zoom(around, by) {
    const [a, b] = this.x;
    if (this.logX) this.limit(around * (a / around) ** by, around * (b / around) ** by);
    else this.limit(around + (a - around) * by, around + (b - around) * by);
  }

  /** A view inside the record, of at least four samples. */
  limit(a, b) {
    const [low, high] = this.whole();
    if (!this.logX && !this.loop && this.data.rate && b - a < 4 / this.data.rate) {
      const middle = (a + b) / 2;
      [a, b] = [middle - 2 / this.data.rate, middle + 2 / this.data.rate];
    }
    if (a < low) [a, b] = [low, Math.min(high, b + (this.logX ? 0 : low - a))];
    if (b > high) [a, b] = [Math.max(low, a - (this.logX ? 0 : b - high)), high];
    this.view = a <= low && b >= high ? null : [a, b];
  }
}
