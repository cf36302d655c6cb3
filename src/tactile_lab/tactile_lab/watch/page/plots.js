'use strict';
/* The two plots of a finger. Times on the page are seconds before the newest sample. */

const SHOWN_S = 10;

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

function axis(extra) {
  return {
    stroke: colour('--soft'), grid: { stroke: colour('--grid'), width: 1 },
    ticks: { stroke: colour('--grid'), width: 1, size: 4 }, font: '12px system-ui, sans-serif',
    gap: 4, ...extra,
  };
}

/* Returns the common options of all plots. They have no cursor and no legend, because they are not interactive. */
function options(element, more) {
  return {
    width: Math.max(120, element.clientWidth), height: element.clientHeight,
    cursor: { show: false }, legend: { show: false }, ...more,
  };
}

function follow(element, plot) {
  const observer = new ResizeObserver(() => {
    plot.setSize({ width: Math.max(120, element.clientWidth), height: element.clientHeight });
  });
  observer.observe(element);
  return observer;
}

/* Returns a range of at least 0.2 N, so that the noise of an unloaded finger does not look like a signal. */
function tensionRange(low, high) {
  if (low === null || high === null || !isFinite(low) || !isFinite(high)) return [-0.1, 0.1];
  const missing = Math.max(0, 0.2 - (high - low)) / 2;
  const margin = 0.06 * (high - low + 2 * missing);
  return [low - missing - margin, high + missing + margin];
}

class TensionPlot {
  constructor(element) {
    this.element = element;
    this.x = [];
    this.y = [];
    this.spans = [];
    this.window = null;
    this.build();
  }

  build() {
    if (this.plot) { this.observer.disconnect(); this.plot.destroy(); }
    this.plot = new uPlot(options(this.element, {
      scales: { x: { time: false, range: [-SHOWN_S, 0] }, y: { range: (u, low, high) => tensionRange(low, high) } },
      axes: [
        axis({ values: (u, ticks) => ticks.map((t) => (t === 0 ? 'now' : `${t} s`)), space: 60, size: 28 }),
        axis({ size: 48 }),
      ],
      series: [{}, { stroke: colour('--trace'), width: 1.5, points: { show: false }, spanGaps: false }],
      hooks: { drawClear: [(u) => this.shade(u)] },
    }), [[], []], this.element);
    this.observer = follow(this.element, this.plot);
    this.draw();
  }

  /* Draws the phases of the trial as coloured background, and a bar below the window that was classified. */
  shade(u) {
    const { ctx, bbox } = u;
    const place = (t) => Math.min(bbox.left + bbox.width, Math.max(bbox.left, u.valToPos(t, 'x', true)));
    ctx.save();
    ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    ctx.textBaseline = 'top';
    ctx.textAlign = 'left';
    for (const span of this.spans) {
      const left = place(span.from - this.now);
      const right = place(span.to === null ? 0 : span.to - this.now);
      if (right - left < 1) continue;
      ctx.fillStyle = colour(`--${span.phase}`) || 'transparent';
      ctx.fillRect(left, bbox.top, right - left, bbox.height);
      const name = span.phase;
      if (ctx.measureText(name).width + 8 < right - left) {
        ctx.fillStyle = colour('--soft');
        ctx.fillText(name, left + 4 * devicePixelRatio, bbox.top + 3 * devicePixelRatio);
      }
    }
    if (this.window) {
      const left = place(this.window.from - this.now);
      const right = place(this.window.to - this.now);
      if (right - left > 2) {
        ctx.fillStyle = colour('--spectrum');
        ctx.fillRect(left, bbox.top + bbox.height - 3 * devicePixelRatio, right - left, 3 * devicePixelRatio);
      }
    }
    ctx.restore();
  }

  begin() { this.x = []; this.y = []; }

  add(x, y) {
    this.x.push(...x);
    this.y.push(...y);
    const oldest = this.x[this.x.length - 1] - SHOWN_S - 1;
    let old = 0;
    while (old < this.x.length && this.x[old] < oldest) old += 1;
    if (old > 200) { this.x.splice(0, old); this.y.splice(0, old); }
  }

  get now() { return this.x.length ? this.x[this.x.length - 1] : 0; }

  /* Lowest and highest displayed tension; null if there is none. */
  get range() {
    const seen = this.y.filter((value) => value !== null);
    return seen.length ? [seen.reduce((a, b) => Math.min(a, b)), seen.reduce((a, b) => Math.max(a, b))] : null;
  }

  get last() {
    for (let i = this.y.length - 1; i >= 0; i -= 1) if (this.y[i] !== null) return this.y[i];
    return null;
  }

  draw() {
    const now = this.now;
    const from = this.x.findIndex((t) => t >= now - SHOWN_S);
    const start = Math.max(0, from - 1);
    this.plot.setData([this.x.slice(start).map((t) => t - now), this.y.slice(start)]);
  }
}

class SpectrumPlot {
  constructor(element) {
    this.element = element;
    this.spectrum = null;
    this.high = 0;
    this.build();
  }

  build() {
    if (this.plot) { this.observer.disconnect(); this.plot.destroy(); }
    this.plot = new uPlot(options(this.element, {
      scales: {
        x: { time: false, range: (u, low, high) => [0, high || 30] },
        y: { range: () => [0, this.high || 10] },
      },
      axes: [axis({ space: 60, size: 28 }), axis({ size: 48, space: 28 })],
      series: [{}, {
        stroke: colour('--spectrum'), fill: `${colour('--spectrum')}33`, width: 1.5, points: { show: false },
      }],
    }), [[], []], this.element);
    this.observer = follow(this.element, this.plot);
    this.draw(this.spectrum);
  }

  /* The largest component of the spectrum, except the mean. */
  get peak() {
    if (!this.spectrum || this.spectrum.values.length < 2) return null;
    const values = this.spectrum.values.slice(1);
    const k = values.indexOf(Math.max(...values));
    return { hz: (k + 1) * this.spectrum.step_hz, value: 1000 * values[k] };
  }

  draw(spectrum) {
    const isOther = !spectrum || !this.spectrum || spectrum.part !== this.spectrum.part;
    this.spectrum = spectrum;
    const values = (spectrum ? spectrum.values : []).map((v) => 1000 * v);
    const high = Math.max(2, ...values) * 1.1;
    this.high = isOther ? high : Math.max(high, 0.8 * this.high);  // the range decreases slowly, so that the plot does not jump
    this.plot.setData([values.map((_, k) => k * spectrum.step_hz), values]);
  }
}

/* The tension during a hold, and the least-squares line of its feature window. */
class HoldPlot {
  constructor(element) {
    this.element = element;
    this.hold = null;
    this.build();
  }

  build() {
    if (this.plot) { this.observer.disconnect(); this.plot.destroy(); }
    this.plot = new uPlot(options(this.element, {
      scales: {
        x: { time: false, range: (u, low, high) => [0, high || 3] },
        y: { range: (u, low, high) => tensionRange(low, high) },
      },
      axes: [axis({ space: 60, size: 28 }), axis({ size: 48, space: 28 })],
      series: [
        {},
        { stroke: colour('--trace'), width: 1.5, points: { show: false } },
        { stroke: colour('--spectrum'), width: 2, dash: [6, 4], points: { show: false }, spanGaps: true },
      ],
    }), [[], [], []], this.element);
    this.observer = follow(this.element, this.plot);
    this.draw(this.hold);
  }

  draw(hold) {
    this.hold = hold;
    if (!hold) { this.plot.setData([[], [], []]); return; }
    const [[from, first], [to, last]] = hold.line;
    const line = hold.x.map((t) => (t < from || t > to ? null : first + (last - first) * (t - from) / ((to - from) || 1)));
    this.plot.setData([hold.x, hold.y, line]);
  }
}
