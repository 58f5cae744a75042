// What all flat charts share: colours of the page's style, Plotly's layout and buttons, means and ranges of points.
"use strict";
const lrmChart = (() => {
  const BINS = 12, SETTLED_MS = 200;
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();

  function layout(extra) {
    const ink = colour("ink"), axis = { gridcolor: colour("grid"), zerolinecolor: colour("line"), automargin: true };
    const base = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink, size: 12, family: "system-ui, sans-serif" },
      margin: { l: 8, r: 8, t: 8, b: 8 }, showlegend: true, hovermode: "closest", dragmode: "select",
      legend: { orientation: "h", x: 0, y: 1, yanchor: "bottom", font: { size: 11 }, traceorder: "normal" }, uirevision: "kept",
    };
    const out = Object.assign(base, extra);
    for (const key of Object.keys(out)) if (/^[xy]axis\d*$/.test(key)) out[key] = Object.assign({}, axis, out[key]);
    return out;
  }

  // Marks at points, and a line through points, as Plotly takes them; an axis with a title.
  const dots = (name, x, y, marker, more) => ({ type: "scatter", mode: "markers", name, x, y, marker: { size: 5, ...marker }, ...more });
  const line = (name, x, y, ink, more) => ({ type: "scatter", mode: "lines", name, x, y, line: ink, hoverinfo: "skip", ...more });
  const titled = (text, more) => ({ title: { text, standoff: 4, font: { size: 12 } }, ...more });
  // An upright line across a chart, and an axis of names from above to below.
  const upright = (x, ink) => ({ type: "line", x0: x, x1: x, yref: "paper", y0: 0, y1: 1, line: ink });
  const named = (names) => ({ range: [names.length - 0.5, -0.5], tickmode: "array", tickvals: names.map((_, k) => k), ticktext: names, zeroline: false });

  // Draws a chart; `wire` adds its events, once.
  function draw(figure, traces, options, wire) {
    return Plotly.react(figure, traces, layout(options), CONFIG).then(() => {
      if (wire && !figure.dataset.wired) wire(figure);
      figure.dataset.wired = "yes";
    });
  }

  const at = (values, rows) => rows.map((row) => values[row]);

  // A curve through points: those of equal x are one, at their mean, so that no line joins them.
  function curve(x, y) {
    const at = new Map();
    x.forEach((value, i) => {
      if (value === null || y[i] === null || y[i] === undefined) return;
      if (!at.has(value)) at.set(value, []);
      at.get(value).push(y[i]);
    });
    const xs = [...at.keys()].sort((a, b) => a - b);
    return { x: xs, y: xs.map((value) => at.get(value).reduce((sum, one) => sum + one, 0) / at.get(value).length) };
  }

  // Means of y over groups of neighbours in x, or over the levels of x where these are few.
  function binned(x, y) {
    const rows = x.map((_, i) => i).filter((i) => x[i] !== null && y[i] !== null).sort((a, b) => x[a] - x[b]);
    if (new Set(rows.map((i) => x[i])).size <= BINS) return curve(rows.map((i) => x[i]), rows.map((i) => y[i]));
    const groups = Array.from({ length: BINS }, (_, k) =>
      rows.slice(Math.floor(k * rows.length / BINS), Math.floor((k + 1) * rows.length / BINS))).filter((one) => one.length);
    const mean = (group, of) => group.reduce((sum, i) => sum + of[i], 0) / group.length;
    return curve(groups.map((g) => mean(g, x)), groups.map((g) => mean(g, y)));
  }

  // These means as squares joined by a line.
  const means = (name, x, y, ink, more) => ({ ...line(name, [], [], ink), ...binned(x, y), mode: "lines+markers", marker: { symbol: "square", size: 6 }, ...more });

  // A range for most of some values, and how many of others are beyond; a joint that hardly moves the TCP makes a few
  // enormous turns.
  function range(values, most = values) {
    const sizes = (of) => of.filter((y) => y !== null).map(Math.abs).sort((a, b) => a - b), known = sizes(most);
    const limit = 1.4 * (known[Math.floor(0.98 * (known.length - 1))] || 1);
    return { limits: [-limit, limit], beyond: sizes(values).filter((y) => y > limit).length };
  }

  // Charts take the sizes that they have on paper, or that of the screen again.
  function fit(paper) {
    for (const figure of document.querySelectorAll(".js-plotly-plot")) {
      if (!figure.clientWidth) continue;
      Plotly.relayout(figure, paper ? { width: figure.clientWidth, height: figure.clientHeight, autosize: false }
        : { width: null, height: null, autosize: true });
      Plotly.redraw(figure); // the legend's rows changed with the width, and with them the room above the chart
    }
  }

  let resized = 0;
  addEventListener("resize", () => {
    clearTimeout(resized);
    if (window.Plotly && !document.documentElement.classList.contains("lrm-paper")) resized = setTimeout(fit, SETTLED_MS, false);
  });

  const CONFIG = { displaylogo: false, responsive: true, modeBarButtons: [["zoom2d", "select2d", "resetScale2d"]] };
  return { colour, dots, line, titled, upright, named, draw, at, means, range, fit };
})();

// Charts are drawn one at a time, the nearest to what is seen first, so that the page answers in between.
function lrmQueue(page) {
  const { state, place } = page, waiting = new Map();

  function draw(id, traces, options, wire) {
    const figure = place(id);
    waiting.set(figure, () => lrmChart.draw(figure, traces, options, wire));
    soon();
  }

  // Out of view they wait until there is nothing else to do; Safari does not say when that is.
  const away = (figure) => Math.abs(figure.getBoundingClientRect().top + figure.clientHeight / 2 - innerHeight / 2);
  const here = () => [...waiting.keys()].filter((one) => one.isConnected).sort((a, b) => away(a) - away(b));
  const whenIdle = window.requestIdleCallback || ((run) => setTimeout(run, 500));
  function soon() {
    if (!soon.asked) soon.asked = setTimeout(() => {
      soon.asked = 0;
      const [next] = window.Plotly && state.values ? here() : [];
      const run = () => { here().slice(0, 1).forEach(drawNow); soon(); };
      if (next && away(next) < innerHeight) run();
      else if (next) whenIdle(run);
    });
  }

  function drawNow(figure) {
    const run = waiting.get(figure);
    waiting.delete(figure);
    run();
  }

  const drawAll = () => here().forEach(drawNow);
  return { draw, soon, drawAll };
}
