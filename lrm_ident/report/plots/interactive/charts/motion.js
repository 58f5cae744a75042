// The figures of a motion page, drawn with Plotly from the values of motion_page.py: errors step by step, and one move.
"use strict";
const lrmMotion = (() => {
  const { colour, dots, upright, named } = lrmChart, { place, options } = lrmElements;
  let values = null;

  const draw = (id, traces, more) => lrmChart.draw(place(id), traces, { dragmode: "zoom", ...more });
  const BELOW = { margin: { l: 64, r: 8, t: 8, b: 8 } }; // time is at the same place in charts below each other

  function drawSteps() {
    const steps = values.steps;
    const bars = { type: "bar", orientation: "h", y: steps.map((_, k) => k), x: steps.map((one) => one.error), showlegend: false,
      marker: { color: colour("model") }, text: steps.map((one) => one.words), textposition: "auto", hoverinfo: "skip" };
    draw("steps", [bars], { shapes: [upright(values.noise, { color: colour("ink"), dash: "dot" })],
      xaxis: { rangemode: "tozero", title: { text: `held-out error, ${values.unit} RMS<br>(dotted: noise of a reading)` } },
      yaxis: { ...named(steps.map((one) => one.name)), showgrid: false } });
  }

  function drawMove() {
    const what = values.what[place("what").value], move = what.moves[place("move").value];
    const x = move.told.map((_, k) => move.start + k * move.dt);
    const time = { range: [x[0], x[x.length - 1]] };
    const line = (y, name, color, ink) => lrmChart.line(name, x, y, { color, width: 1.5, ...ink }, { hoverinfo: "all" });
    place("errors").textContent = `${what.label}, all moves: ${what.added ? `${what.words[0]} before, ${what.words[1]} after (RMS)`
      : `${what.words[1]} RMS. Nothing was added to the servo response here, so there is one prediction.`}`;
    const drawn = what.added ? [["before", move.before, move.left[0], "held"], ["after", move.after, move.left[1], "model"]]
      : [["", move.after, move.left[1], "model"]];
    draw("path", [
      line(move.told, "command", colour("line"), { width: 1, shape: "hv" }), dots(values.read, x, move.read, { color: colour("ink"), size: 4 }),
      ...drawn.map(([when, way, , ink]) => line(way, `predicted ${when}`.trim(), colour(ink))),
    ], { ...BELOW, xaxis: time, yaxis: { title: { text: `${what.label}, ${values.unit}` } } });
    draw("left", drawn.map(([when, , left, ink]) => line(left, when || "remaining error", colour(ink))),
      { ...BELOW, xaxis: { ...time, title: { text: "time in the move, s" } }, yaxis: { title: { text: `reading − prediction, ${values.unit}` } } });
  }

  function redraw() {
    drawSteps();
    drawMove();
  }

  const choose = (id, names, first, then) => { options(id, names.map((name, k) => [k, name]), first).onchange = then; };

  function show(given) {
    values = given;
    const moves = () => {
      const one = values.what[place("what").value];
      choose("move", one.moves.map((m) => m.name), one.first, drawMove);
      drawMove();
    };
    choose("what", values.what.map((one) => one.label), values.first, moves);
    moves();
    lrmAppearance(redraw);
    drawSteps();
  }

  return { show };
})();
