// The figures of a motion page, drawn with Plotly from the values of motion_page.py: errors step by step, and one move.
"use strict";
const lrmMotion = (() => {
  const { colour, layout, dots, CONFIG } = lrmChart;
  const place = (id) => document.getElementById("lrm-" + id);
  let values = null;

  function drawSteps() {
    const steps = values.steps;
    const bars = { type: "bar", orientation: "h", y: steps.map((_, k) => k), x: steps.map((one) => one.error), showlegend: false,
      marker: { color: colour("model") }, text: steps.map((one) => one.words), textposition: "auto", hoverinfo: "skip" };
    const noise = { type: "line", x0: values.noise, x1: values.noise, yref: "paper", y0: 0, y1: 1, line: { color: colour("ink"), dash: "dot" } };
    Plotly.react(place("steps"), [bars], layout({ dragmode: "zoom", shapes: [noise],
      xaxis: { rangemode: "tozero", title: { text: `held-out error, ${values.unit} RMS<br>(dotted: noise of a reading)` } },
      yaxis: { range: [steps.length - 0.5, -0.5], tickmode: "array", tickvals: steps.map((_, k) => k), ticktext: steps.map((one) => one.name), zeroline: false, showgrid: false },
    }), CONFIG);
  }

  function drawMove() {
    const what = values.what[place("what").value], move = what.moves[place("move").value];
    const x = move.told.map((_, k) => move.start + k * move.dt);
    const time = { range: [x[0], x[x.length - 1]] };
    const line = (y, name, color, ink) => lrmChart.line(name, x, y, { color, width: 1.5, ...ink }, { hoverinfo: "all" });
    place("errors").textContent = `${what.label}, all moves: ${what.words[0]} before, ${what.words[1]} after (RMS)`;
    Plotly.react(place("path"), [
      line(move.told, "command", colour("line"), { width: 1, shape: "hv" }), dots(values.read, x, move.read, { color: colour("ink"), size: 4 }),
      line(move.before, "predicted before", colour("held")), line(move.after, "predicted after", colour("model")),
    ], layout({ dragmode: "zoom", xaxis: time, yaxis: { title: { text: `${what.label}, ${values.unit}` } } }), CONFIG);
    Plotly.react(place("left"), [line(move.left[0], "before", colour("held")), line(move.left[1], "after", colour("model"))],
      layout({ dragmode: "zoom", xaxis: { ...time, title: { text: "time in the move, s" } },
        yaxis: { title: { text: `reading − prediction, ${values.unit}` } } }), CONFIG);
  }

  function fill(list, names, chosen) {
    list.replaceChildren(...names.map((name, k) => new Option(name, k, k === chosen, k === chosen)));
  }

  function redraw() {
    drawSteps();
    drawMove();
  }

  function show(given) {
    values = given;
    fill(place("what"), values.what.map((one) => one.label), values.first);
    const moves = () => { const one = values.what[place("what").value]; fill(place("move"), one.moves.map((m) => m.name), one.first); };
    place("what").onchange = () => { moves(); drawMove(); };
    place("move").onchange = drawMove;
    moves();
    lrmPlainPage(redraw);
    redraw();
  }

  return { show };
})();
