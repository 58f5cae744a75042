// The figures of a fleet's page, drawn with Plotly from the values of fleet_figures.py. In all of them a column is an arm.
"use strict";
const lrmFleet = (() => {
  const { colour, dots, line, upright, named } = lrmChart, { place, options } = lrmElements;
  const LEVELS = ["--model", "--held", "--good", "--accent", "#e69f00", "#999999", "#882255", "#8c6d31"];
  const MOST_NAMES = 40, MOST_LEVEL = 8, ROW_PX = 36, WIDE_PX = 700, LEFT_PX = 260;
  const TICKS = [-3, -2, -1, 0, 1, 2].flatMap((p) => [1, 2, 5].map((k) => Number((k * 10 ** p).toPrecision(1))));
  const state = { values: null, tag: "", key: "", marked: null };

  const levelOf = (arm) => (state.tag ? arm.tags[state.tag] || "(none)" : "all arms");
  const levels = () => [...new Set(state.values.arms.map(levelOf))].sort();
  function colourOf(level) {
    const found = LEVELS[levels().indexOf(level) % LEVELS.length];
    return found.startsWith("--") ? colour(found.slice(2)) : found;
  }

  // Numbers of the arms from left to right: by the chosen tag, then as in the manifest.
  function order() {
    const arms = state.values.arms, numbers = arms.map((_, number) => number);
    return numbers.sort((a, b) => levelOf(arms[a]).localeCompare(levelOf(arms[b]), undefined, { numeric: true }) || a - b);
  }

  function columns(more) {
    const sorted = order(), names = sorted.map((number) => state.values.arms[number].name);
    const marked = state.marked === null ? [] : [upright(sorted.indexOf(state.marked), { color: colour("accent"), width: 1 })];
    const few = names.length <= MOST_NAMES, wide = place("errors").clientWidth > WIDE_PX;
    return { dragmode: "zoom", ...more,
      margin: { l: wide ? LEFT_PX : 8, r: 8, t: 8, b: 8 }, // on a wide page an arm is at the same place in all figures
      yaxis: { ...more.yaxis, automargin: !wide },
      shapes: [...(more.shapes || []), ...marked],
      xaxis: { range: [-0.7, names.length - 0.3], tickmode: "array", tickvals: few ? names.map((_, k) => k) : [], ticktext: names,
        tickangle: names.length > MOST_LEVEL ? 90 : 0,
        title: { text: few ? "" : "arms" + (state.tag ? ", sorted by " + state.tag : "") }, showgrid: false, zeroline: false },
    };
  }

  const about = (arm) => [arm.name, ...Object.entries(arm.tags).map(([name, level]) => `${name}: ${level || "(none)"}`),
    `error ${arm.nominal === null ? "–" : arm.nominal + " → " + arm.held_out + " mm"}`, ...arm.effects.map((e) => e.words)];

  const draw = (id, traces, more) => lrmChart.draw(place(id), traces, columns(more),
    (figure) => figure.on("plotly_click", (event) => mark(event.points[0].customdata)));

  // One trace for each level of the tag: `points` are [number of the arm, y, more].
  function byLevel(points, marker, more = () => ({})) {
    const at = new Map(order().map((number, column) => [number, column])), arms = state.values.arms;
    return levels().map((level) => {
      const own = points.filter(([number]) => levelOf(arms[number]) === level);
      const text = own.map(([number, , words]) => [...about(arms[number]), ...(words ? [words] : [])].join("<br>"));
      return dots(level, own.map(([number]) => at.get(number)), own.map(([, y]) => y), { color: colourOf(level), ...marker(own) },
        { legendgroup: level, customdata: own.map(([number]) => number), hoverinfo: "text", text, ...more(own) });
    }).filter((trace) => trace.x.length);
  }

  function drawErrors() {
    const arms = state.values.arms, done = order().map((number, column) => [arms[number], column]).filter(([a]) => a.nominal !== null);
    const lines = line("", done.flatMap(([, k]) => [k, k, null]), done.flatMap(([a]) => [a.nominal, a.held_out, null]),
      { color: colour("line"), width: 1 }, { showlegend: false });
    const before = dots("nominal", done.map(([, k]) => k), done.map(([a]) => a.nominal), { color: colour("line"), symbol: "circle-open", size: 6 },
      { hoverinfo: "skip" });
    const points = arms.flatMap((arm, number) => (arm.held_out === null ? [] : [[number, arm.held_out]]));
    const after = byLevel(points, () => ({ size: 7 })).map((one) => ({ ...one, name: "identified, held out" + (state.tag ? ": " + one.name : "") }));
    draw("errors", [lines, before, ...after], { yaxis: { type: "log", tickmode: "array", tickvals: TICKS, title: { text: "RMS error of the tip, mm" } } });
  }

  function drawEffects() {
    const names = state.values.effects, box = place("effects");
    if (!names.length) return;
    box.style.height = `${90 + ROW_PX * Math.max(names.length, 2)}px`;
    const size = Math.max(4, Math.min(11, 0.6 * box.clientWidth / state.values.arms.length));
    const row = new Map(names.map((one, k) => [one.name, k]));
    const points = state.values.arms.flatMap((arm, number) => arm.effects.map((e) => [number, row.get(e.name), e.words, e.sure]));
    const traces = byLevel(points, (own) => ({ size, symbol: own.map((one) => (one[3] ? "square" : "square-open")) }));
    draw("effects", traces, { showlegend: Boolean(state.tag), yaxis: named(names.map((one) => one.words)) });
  }

  function drawParameter() {
    const one = state.values.parameters.find((p) => p.key === state.key);
    if (!one) return;
    const points = one.arms.map((number, k) => [number, one.value[k], `${one.value[k]} ± ${one.error[k]} ${one.unit}`, one.error[k]]);
    const traces = byLevel(points, () => ({ size: 7 }), (own) => ({ error_y: { array: own.map((p) => p[3]), thickness: 1, width: 2 } }));
    const across = { type: "line", xref: "paper", x0: 0, x1: 1, y0: one.mean, y1: one.mean, line: { color: colour("ink"), dash: "dot" } };
    const band = { type: "rect", xref: "paper", x0: 0, x1: 1, y0: one.mean - one.spread, y1: one.mean + one.spread,
      fillcolor: colour("bar"), line: { width: 0 }, layer: "below" };
    const at = new Map(order().map((number, column) => [number, column]));
    const named = one.outliers.map((number) => ({ x: at.get(number), y: one.value[one.arms.indexOf(number)],
      text: state.values.arms[number].name, font: { color: colour("accent") }, arrowcolor: colour("accent"),
      ax: at.get(number) < at.size / 2 ? 28 : -28, ay: -18 })); // towards the middle: there is room
    draw("parameter", traces, { showlegend: Boolean(state.tag), shapes: one.mean === null ? [] : [band, across], annotations: named,
      yaxis: { title: { text: `${one.label}, ${one.unit}` } } });
  }

  function redraw() {
    drawErrors();
    drawEffects();
    drawParameter();
    place("marked").textContent = state.marked === null ? "" : about(state.values.arms[state.marked]).join("; ");
  }

  function mark(number) {
    state.marked = state.marked === number ? null : number;
    redraw();
  }

  function choose(what, entries) {
    options(what, entries, state[what]).onchange = (event) => { state[what] = event.target.value; redraw(); };
  }

  function show(values) {
    Object.assign(state, { values, tag: values.first_tag, key: values.first_parameter });
    choose("tag", [["", "as in the manifest"], ...values.tags.map((name) => [name, name])]);
    choose("key", values.parameters.map((p) => [p.key, p.label + (p.outliers.length ? " (an arm stands out)" : "")]));
    lrmAppearance(redraw);
    redraw();
  }

  return { show, mark, state };
})();
window.lrmFleet = lrmFleet;
