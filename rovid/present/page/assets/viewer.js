// The viewer of the trials: panels one under another that zoom and pan together, and a switch for each cause that was
// found. What it draws stands in the page as JSON; rovid/report/viewer.py says what that holds.
(() => {
  "use strict";
  const block = document.getElementById("viewer-data");
  if (!block) return;
  const { panels, trials, causes, stages, missed, measures } = JSON.parse(block.textContent);
  const byId = (name) => document.getElementById(`viewer-${name}`);
  const [root, list, stage, range, detail] = ["root", "trial", "panels", "range", "detail"].map(byId);
  const switches = [...document.querySelectorAll("#viewer-causes input")];

  // Width and dashes tell lines apart where colour does not.
  const LOOKS = {
    applied: { width: 1.3 },
    measured: { width: 5 },
    without: { width: 1.4, dash: [6, 4] },
    simulated: { width: 1.4 },
  };
  const LEAST_SAMPLES = 8; // no closer zoom than to so many
  const AXIS_WIDTH = 62; // of all panels alike: instants stand one under another
  const ALL = stages.length - 1;
  const RATE = measures.length - 1; // which measure the trials are ranked by
  let charts = [], readings = [], trial, view = [0, 1], on = ALL; // which stage the simulation shows

  // ---- data

  function decoded({ rows, data }) {
    const text = atob(data), bytes = new Uint8Array(text.length);
    for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
    const columns = [];
    for (let at = 0; at < bytes.length; at += 4 * rows) columns.push(new Float32Array(bytes.buffer, at, rows));
    return columns;
  }

  function firstFrom(time, value) {
    let low = 0, high = time.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (time[middle] < value) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  // The coarsest level with two rows for each pixel, and its rows in view with one beyond either end.
  function rowsInView() {
    const wanted = 2 * stage.clientWidth;
    for (let k = trial.columns.length - 1; ; k--) {
      const level = trial.columns[k], time = level[0];
      const first = Math.max(firstFrom(time, view[0]) - 1, 0);
      const last = Math.min(firstFrom(time, view[1]) + 2, time.length);
      if (k === 0 || last - first >= wanted) return { level, first, last };
    }
  }

  function values(level, { look, column, plus, less, staged }, first, last) {
    const out = new Array(last - first).fill(null);
    if (look === "without" && on === 0) return out; // the simulation is that itself
    const own = level[column + (look === "simulated" ? staged * on : 0)];
    for (let k = first; k < last; k++) {
      const value = own[k] + (plus === null ? 0 : level[plus][k]) - (less === null ? 0 : level[less][k]);
      if (!Number.isNaN(value)) out[k - first] = value;
    }
    return out;
  }

  // ---- view

  const whole = () => {
    const time = trial.columns[0][0];
    return [time[0], time[time.length - 1]];
  };
  const span = () => view[1] - view[0];

  function show(from, to) {
    const [start, end] = whole(), least = ((end - start) * LEAST_SAMPLES) / trial.samples;
    const length = Math.min(Math.max(to - from, least), end - start);
    const middle = (from + to) / 2;
    const begin = Math.min(Math.max(middle - length / 2, start), end - length);
    view = [begin, begin + length];
    draw();
  }

  function draw() {
    const { level, first, last } = rowsInView();
    const time = Array.from(level[0].subarray(first, last));
    charts.forEach((chart, k) => {
      const lines = panels[k].lines.map((line) => values(level, line, first, last));
      chart.batch(() => {
        chart.setData([time, ...lines], false);
        chart.setScale("x", { min: view[0], max: view[1] });
      });
    });
    const [start, end] = whole(), digits = span() < 10 ? 2 : 1;
    range.textContent = `${view[0].toFixed(digits)} … ${view[1].toFixed(digits)} s of ${(end - start).toFixed(1)} s`;
    const kept = level[0].length, ratio = (trial.samples / kept).toFixed(1);
    detail.textContent = kept === trial.samples ? "Every sample is drawn."
      : `One sample in ${ratio} is drawn, the lowest and highest of every stretch among them.`;
  }

  const zoom = (factor, at = cursorTime()) => show(at - (at - view[0]) * factor, at + (view[1] - at) * factor);
  const pan = (share) => show(view[0] + share * span(), view[1] + share * span());
  const reset = () => show(...whole());

  function choose(index) {
    trial = trials[index];
    trial.columns ??= trial.levels.map(decoded);
    reset();
    tell();
  }

  // ---- causes

  const same = (one, other) => one.every((each, k) => each === other[k]);
  const stageOf = (wanted) => stages.findIndex((each) => same(each, wanted));

  function turnTo(number) {
    on = number;
    switches.forEach((each, k) => { each.checked = stages[on][k]; });
    draw();
    tell();
  }

  // Of many causes there are not all combinations: then one comes after another, as they stand.
  function switched(k) {
    const wanted = switches.map((each) => each.checked), exact = stageOf(wanted);
    const count = wanted[k] ? k + 1 : k;
    turnTo(exact >= 0 ? exact : stageOf(wanted.map((_, at) => at < count)));
  }

  // One cause more, in their order; after all of them none.
  function step() {
    const count = on === ALL ? 0 : stages[on].filter(Boolean).length + 1;
    turnTo(stageOf(causes.map((_, k) => k < count)));
  }

  // ---- numbers

  const rounded = (value, { decimals }) => (value === null ? "–" : value.toFixed(decimals));

  // A bar as long as the share of what is missed without any cause, with a tick at what a perfect model would miss.
  function bar(cell, value, most, floor) {
    cell.replaceChildren();
    if (value === null || !most) return;
    const track = element("span", "", cell), share = (one) => `${Math.min((100 * one) / most, 100)}%`;
    track.className = "bar";
    element("i", "", track).style.width = share(value);
    if (floor === null) return;
    const tick = element("b", "", track);
    tick.style.left = share(floor);
  }

  function tell() {
    const rows = document.querySelectorAll("#viewer-numbers tbody tr");
    rows.forEach((row, k) => {
      const measure = measures[k], { unit, floor } = measure;
      [trial.missed, missed].forEach((numbers, column) => {
        const cell = row.cells[1 + column], value = numbers[on][k];
        const most = Math.max(...numbers.map((each) => each[k] ?? 0));
        const [words, drawn] = cell.children;
        words.textContent = value === null ? "–" : `${rounded(value, measure)} ${unit}`;
        bar(drawn, value, most, floor);
      });
    });
    const shown = stages[on].flatMap((each, k) => (each ? [causes[k]] : []));
    const named = shown.length ? `with ${shown.join(", ")}` : causes.length ? "without any of the causes" : "simulated";
    for (const each of document.querySelectorAll(".viewer-simulated")) each.textContent = named;
    for (const each of document.querySelectorAll(".viewer-without")) each.hidden = on === 0;
    trials.forEach((each, k) => {
      const [before, now] = [each.missed[0][RATE], each.missed[on][RATE]].map((one) => rounded(one, measures[RATE]));
      const pair = on === 0 ? now : `${before} → ${now}`;
      // The list is narrow: the error first, and of a long name the end, which distinguishes logs.
      const name = each.name.length > 24 ? `…${each.name.slice(-23)}` : each.name;
      list.options[k].textContent = `${pair} ${measures[RATE].unit}: ${name}`;
      list.options[k].title = each.name;
    });
  }

  // ---- cursor

  function cursorTime() {
    const left = charts[0].cursor.left;
    return left >= 0 ? charts[0].posToVal(left, "x") : (view[0] + view[1]) / 2;
  }

  function moveCursor(pixels) {
    const { left, idx } = charts[0].cursor, width = charts[0].over.clientWidth;
    const from = left >= 0 && idx !== null ? left : width / 2;
    stage.setAttribute("aria-live", "polite"); // read out what a key has led to, not what a mouse passes
    for (const chart of charts) chart.setCursor({ left: Math.min(Math.max(from + pixels, 0), width - 1), top: 1 });
  }

  const tidy = (value, digits) => String(+value.toPrecision(digits)).replace("-", "−");
  const shown = (value, digits) => (value === null || value === undefined ? "–" : tidy(value, digits));

  function read(chart, k) {
    const at = chart.cursor.idx, known = at !== null && at !== undefined && chart.cursor.left >= 0;
    readings[k].forEach((cell, line) => {
      cell.textContent = known ? shown(chart.data[line + 1][at], 4) : "";
    });
    if (k === 0) byId("time").textContent = known ? `at ${chart.data[0][at].toFixed(2)} s` : "";
  }

  // ---- charts

  const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();

  function element(name, text = "", parent = null) {
    const made = document.createElement(name);
    made.textContent = text;
    parent?.append(made);
    return made;
  }

  function swatch(look, parent) {
    const { width, dash } = LOOKS[look], entry = element("span", "", parent);
    entry.innerHTML = '<svg width="30" height="10" aria-hidden="true"><line x1="0" y1="5" x2="30" y2="5"/></svg> ';
    const line = entry.querySelector("line");
    line.setAttribute("style", `stroke:var(--${look});stroke-width:${width}`);
    if (dash) line.setAttribute("stroke-dasharray", dash.join(" "));
    if (look === "without") entry.className = "viewer-without";
    return entry;
  }

  // Which line is what, once for all panels; what is applied has a panel to itself.
  function legend() {
    const row = element("p");
    row.className = "viewer-key";
    for (const { look } of panels[0].lines) {
      const words = element("span", look, swatch(look, row));
      if (look === "simulated") words.className = "viewer-simulated";
    }
    return row;
  }

  // What the panel shows, and each line's value at the cursor.
  function heading({ title, unit, lines }) {
    const row = element("p");
    row.className = "viewer-key";
    element("strong", `${title}, ${unit}`, row);
    readings.push(lines.map(({ look }) => {
      const entry = swatch(look, row);
      element("span", `${look} `, entry).className = "heard";
      return element("b", "", entry);
    }));
    return row;
  }

  function options({ lines, height }, k) {
    const last = k === panels.length - 1, ink = colour("soft");
    const axis = {
      stroke: ink,
      font: "12px system-ui, sans-serif",
      grid: { stroke: colour("line"), width: 1 },
      ticks: { stroke: colour("line"), width: 1, size: 5 },
      values: (_, splits) => splits.map((value) => tidy(value, 7)),
    };
    return {
      width: stage.clientWidth,
      height: height + (last ? 46 : 8),
      padding: [6, 12, last ? 0 : 4, 0],
      legend: { show: false },
      scales: { x: { time: false } },
      axes: [
        last ? { ...axis, label: "time, s", labelSize: 18, labelFont: axis.font, size: 28 }
          : { ...axis, values: (_, splits) => splits.map(() => ""), size: 0, ticks: { show: false } },
        { ...axis, size: AXIS_WIDTH, space: 26 },
      ],
      series: [{}, ...lines.map(({ look }) => ({
        stroke: colour(look),
        width: LOOKS[look].width,
        dash: LOOKS[look].dash,
        paths: look === "applied" ? uPlot.paths.stepped({ align: 1 }) : undefined,
        points: { show: false },
      }))],
      cursor: {
        y: false,
        points: { size: 7 },
        drag: { setScale: false, dist: 5 },
        sync: { key: "viewer", filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } },
        bind: {
          mousedown: (_, __, start) => (event) => { if (event.button === 0 && !event.shiftKey) start(event); },
          dblclick: () => reset,
        },
      },
      hooks: { setSelect: [zoomToSelection], setCursor: [(chart) => read(chart, k)] },
    };
  }

  function zoomToSelection(chart) {
    const { left, width } = chart.select;
    if (!width) return;
    show(chart.posToVal(left, "x"), chart.posToVal(left + width, "x"));
    chart.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }

  function build() {
    for (const chart of charts) chart.destroy();
    readings = [];
    stage.replaceChildren(legend());
    charts = panels.map((panel, k) => {
      stage.append(heading(panel));
      const blank = [[0, 1], ...panel.lines.map(() => [null, null])];
      const chart = new uPlot(options(panel, k), blank, stage);
      listen(chart);
      return chart;
    });
  }

  // ---- wheel, fingers, keys

  function listen(chart) {
    const { over } = chart, held = new Map(); // pointer -> where it is, as a share of the width
    const share = (event) => {
      const box = over.getBoundingClientRect();
      return (event.clientX - box.left) / box.width;
    };
    const timeAt = (place) => view[0] + place * span();
    over.addEventListener("wheel", (event) => {
      // Scrolling down the page must not end in a plot: the wheel zooms once a plot was clicked, a pinch always.
      if (!event.ctrlKey && document.activeElement !== stage) return;
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 16 : 1;
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) pan((lines * event.deltaX) / over.clientWidth);
      else zoom(Math.exp(Math.min(Math.max(lines * event.deltaY, -120), 120) * 0.004), timeAt(share(event)));
    }, { passive: false });
    over.addEventListener("pointerdown", (event) => {
      stage.focus({ preventScroll: true });
      stage.setAttribute("aria-live", "off");
      if (event.pointerType !== "touch" && !event.shiftKey) return; // a plain drag of the mouse selects
      held.set(event.pointerId, share(event));
      over.setPointerCapture(event.pointerId);
    });
    over.addEventListener("pointermove", (event) => {
      if (!held.has(event.pointerId)) return;
      const before = [...held.values()];
      held.set(event.pointerId, share(event));
      follow(before, [...held.values()], timeAt);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      over.addEventListener(end, (event) => held.delete(event.pointerId));
    }
  }

  // Keep the instants under one pointer or two where the pointers are.
  function follow(before, after, timeAt) {
    const [first, second] = before.map(timeAt);
    if (before.length === 1) return pan(before[0] - after[0]);
    const apart = after[1] - after[0];
    if (Math.abs(apart) < 0.05) return undefined;
    const length = Math.min((second - first) / apart, whole()[1] - whole()[0]);
    return length > 0 ? show(first - after[0] * length, first + (1 - after[0]) * length) : undefined;
  }

  const KEYS = {
    "+": () => zoom(0.5),
    "=": () => zoom(0.5),
    "-": () => zoom(2),
    "0": reset,
    Home: reset,
    ArrowLeft: (event) => (event.shiftKey ? moveCursor(-8) : pan(-0.2)),
    ArrowRight: (event) => (event.shiftKey ? moveCursor(8) : pan(0.2)),
  };
  root.addEventListener("keydown", (event) => {
    const act = KEYS[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey || event.target === list) return;
    event.preventDefault();
    act(event);
  });
  const BUTTONS = {
    in: () => zoom(0.5),
    out: () => zoom(2),
    earlier: () => pan(-0.4),
    later: () => pan(0.4),
    whole: reset,
  };
  for (const [name, act] of Object.entries(BUTTONS)) byId(name).addEventListener("click", act);
  // Some browsers let a list lose its choice.
  list.addEventListener("change", () => (list.selectedIndex < 0 ? undefined : choose(list.selectedIndex)));

  switches.forEach((each, k) => each.addEventListener("change", () => switched(k)));
  const STAGES = { without: () => turnTo(0), step, all: () => turnTo(ALL) };
  for (const [name, act] of Object.entries(STAGES)) byId(name)?.addEventListener("click", act);

  // ---- what is folded

  // A link into a folded section unfolds it; all of them are printed, also where the style cannot see to it.
  const sections = [...document.querySelectorAll("details.section")];
  const unfold = () => {
    const part = sections.find((each) => `#${each.id}` === location.hash);
    if (part) part.open = true;
  };
  addEventListener("hashchange", unfold);
  let closed = [];
  addEventListener("beforeprint", () => {
    closed = sections.filter((each) => !each.open);
    for (const each of closed) each.open = true;
  });
  addEventListener("afterprint", () => { for (const each of closed) each.open = false; });

  // ---- start

  unfold();
  root.hidden = false;
  build();
  list.selectedIndex = 0;
  choose(0);
  new ResizeObserver(() => {
    if (!stage.clientWidth || charts[0].width === stage.clientWidth) return;
    charts.forEach((chart) => chart.setSize({ width: stage.clientWidth, height: chart.height }));
    draw();
  }).observe(stage);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    build();
    draw();
    tell();
  });
})();
