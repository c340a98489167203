// Plots of the columns of a log, one below another, with a common zoom. The server sends the minimum and the maximum of
// each time bin in view, so the amount of data does not grow with the length of the log.
import { ask, byId, element, tidy } from "./tools.js";

const HEIGHT = 104;

export class Plots {
  // `picked(from, to)` is called for an interval dragged in the mode "leave out"; the intervals `stretches()` are shaded.
  // The column `heading()` is shown without jumps of whole turns.
  constructor(stage, { picked, stretches, needed, heading, timeUnit }) {
    Object.assign(this, { stage, picked, stretches, needed, heading, timeUnit, charts: new Map(), data: new Map(), view: null, whole: [0, 1] });
    this.seen = new IntersectionObserver((entries) => {
      for (const { target, isIntersecting } of entries) if (isIntersecting) this.draw(target);
    }, { rootMargin: "300px" });
    this.sized = new ResizeObserver((entries) => {
      for (const { target } of entries) this.charts.get(target)?.setSize({ width: target.clientWidth, height: HEIGHT });
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
  }

  async open(path, signal) {
    this.path = path;
    this.view = null;
    return this.load(signal);
  }

  async load(signal) {
    const asked = new URLSearchParams({ log: this.path, bins: String(Math.max(200, Math.round((this.stage.clientWidth || 900) / 2))) });
    for (const source of this.needed()) asked.append("needed", source);
    const { source = "", unit = "" } = this.heading() ?? {};
    asked.set("heading", source);
    asked.set("unit", unit);
    asked.set("time_unit", this.timeUnit());
    if (this.view) {
      asked.set("from", this.view[0]);
      asked.set("to", this.view[1]);
    }
    const document = await ask(`columns?${asked}`, { signal });
    this.whole = [document.begin, Math.max(document.end, document.begin + 1e-3)];
    this.data = new Map(document.columns.map((column) => [column.source, column]));
    this.redraw();
    byId("span").textContent = `${tidy(this.shown[0], 5)} … ${tidy(this.shown[1], 5)} s of ${tidy(this.whole[1] - this.whole[0], 5)} s.`;
    return document;
  }

  get shown() { return this.view ?? this.whole; }

  show(from, to) {
    const [start, end] = this.whole;
    const length = Math.min(Math.max(to - from, (end - start) * 1e-5, 1e-3), end - start);
    const begin = Math.min(Math.max((from + to - length) / 2, start), end - length);
    this.view = length >= end - start ? null : [begin, begin + length];
    for (const chart of this.charts.values()) chart.setScale("x", { min: this.shown[0], max: this.shown[1] });
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.loading?.abort();
      this.loading = new AbortController();
      this.load(this.loading.signal).catch((error) => { if (error.name !== "AbortError") throw error; });
    }, 120);
  }

  zoom(factor) {
    const [from, to] = this.shown, middle = (from + to) / 2, half = ((to - from) / 2) * factor;
    this.show(middle - half, middle + half);
  }

  pan(share) {
    const [from, to] = this.shown, step = share * (to - from);
    this.show(from + step, to + step);
  }

  all() { this.show(...this.whole); }

  // The chart elements, one a column. Each plot is drawn when it comes into view.
  place(targets) {
    for (const chart of this.charts.values()) chart.destroy();
    this.charts.clear();
    this.seen.disconnect();
    this.sized.disconnect();
    for (const target of targets) this.seen.observe(target);
  }

  // Replace one chart element by another.
  swap(before, after) {
    this.charts.get(before)?.destroy();
    this.charts.delete(before);
    for (const watch of [this.seen, this.sized]) watch.unobserve(before);
    this.seen.observe(after);
  }

  redraw() {
    const targets = [...this.charts.keys()];
    for (const chart of this.charts.values()) chart.destroy();
    this.charts.clear();
    for (const target of targets) this.draw(target);
  }

  shade() {
    for (const chart of this.charts.values()) chart.redraw(false);
  }

  draw(target) {
    const column = this.data.get(target.dataset.source);
    if (this.charts.has(target) || !column || !target.clientWidth) return;
    target.replaceChildren();
    if (!column.samples) {
      target.textContent = "No numbers in this log.";
      return;
    }
    const chart = new uPlot(this.options(target), [column.time, column.high, column.low], target);
    this.charts.set(target, chart);
    this.sized.observe(target);
  }

  options(target) {
    const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    const ink = colour("soft"), line = colour("line"), used = target.dataset.used ? "applied" : "soft";
    const axis = {
      stroke: ink, font: "12px system-ui, sans-serif", grid: { stroke: line, width: 1 }, ticks: { stroke: line, width: 1, size: 4 },
      values: (_, splits) => splits.map((value) => tidy(value, 7)),
    };
    const [min, max] = this.shown;
    return {
      width: target.clientWidth,
      height: HEIGHT,
      padding: [6, 24, 0, 0], // half of a label at the right edge
      legend: { show: false },
      scales: {
        x: { time: false, min, max, auto: false },
        y: { range: (_, low, high) => (high > low ? uPlot.rangeNum(low, high, 0.1, false) : [low - 1, high + 1]) },
      },
      axes: [{ ...axis, size: 24, values: (_, splits) => splits.map((value) => `${tidy(value, 7)} s`) }, { ...axis, size: 52, space: 24, label: target.dataset.unit || " ", labelSize: 16, labelGap: 0, labelFont: axis.font }],
      series: [{}, ...[1, 2].map(() => ({ stroke: colour(used), width: 1.2, points: { show: false } }))],
      bands: [{ series: [1, 2], fill: colour(used) }],
      cursor: { y: false, points: { show: false }, drag: { setScale: false, dist: 4 }, sync: { key: "columns", filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } }, bind: { dblclick: () => () => this.all() } },
      hooks: {
        setSelect: [(chart) => this.selected(chart)],
        drawClear: [(chart) => this.shadeOne(chart, colour("note"), colour("alarm"))],
      },
    };
  }

  shadeOne(chart, fill, edge) {
    const { ctx, bbox } = chart;
    ctx.save();
    for (const [from, to] of this.stretches()) {
      const at = (value) => Math.min(Math.max(chart.valToPos(value, "x", true), bbox.left), bbox.left + bbox.width);
      const left = at(from), right = at(Math.min(to, this.whole[1]));
      ctx.fillStyle = fill;
      ctx.fillRect(left, bbox.top, right - left, bbox.height);
      ctx.fillStyle = edge;
      for (const side of [left, right]) ctx.fillRect(side - 1, bbox.top, 2, bbox.height);
    }
    ctx.restore();
  }

  selected(chart) {
    const { left, width } = chart.select;
    if (!width) return;
    const from = chart.posToVal(left, "x"), to = chart.posToVal(left + width, "x");
    chart.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    if (document.querySelector("input[name=drag]:checked").value === "leave") this.picked(from, to);
    else this.show(from, to);
  }
}

// The signal around a fault of a log, with the instants of the fault.
export function drawSpot({ title, label, time, values, at }, parent) {
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const box = element("figure", "", parent);
  element("figcaption", title, box);
  const axis = { stroke: colour("soft"), font: "12px system-ui, sans-serif", grid: { stroke: colour("line"), width: 1 } };
  const mark = ({ ctx, bbox, valToPos }) => {
    ctx.strokeStyle = colour("alarm");
    for (const instant of at) {
      const x = valToPos(instant, "x", true);
      if (x >= bbox.left && x <= bbox.left + bbox.width) ctx.strokeRect(x, bbox.top, 0, bbox.height);
    }
  };
  return new uPlot({
    width: box.clientWidth || 600,
    height: HEIGHT + 60,
    legend: { show: false },
    cursor: { drag: { setScale: false } },
    scales: { x: { time: false } },
    axes: [{ ...axis, values: (_, splits) => splits.map((value) => `${tidy(value, 7)} s`) }, { ...axis, size: 60, label, labelFont: axis.font }],
    series: [{}, { stroke: colour("applied"), width: 1.2, points: { show: true, size: 4 } }],
    hooks: { draw: [(chart) => mark({ ctx: chart.ctx, bbox: chart.bbox, valToPos: chart.valToPos.bind(chart) })] },
  }, [time, values], box);
}
