// Where it fails: the residual as a turn of one joint against a driver.
"use strict";
function lrmTurn(page) {
  const { state, draw } = page;
  const { colour, binned, range, at } = lrmChart;

  function drawTurn() {
    const v = state.values, driver = v.drivers.find((d) => d.name === state.driver), step = v.steps[state.step];
    if (!driver || !step) return;
    const one = page.candidate(), all = step.turns[state.joint], rows = page.points(), sample = page.sample();
    const y = page.whatIf.active(state.step, one) ? page.whatIf.without(all, one.turns[state.joint]) : all;
    const means = binned(at(driver.values, sample), at(y, sample));
    const seen = range(at(y, rows), v.steps[0].turns[state.joint]); // the same for all steps
    const traces = [
      { type: "scatter", mode: "markers", name: "residual, as a turn", x: at(driver.values, rows), y: at(y, rows),
        selectedpoints: page.selected(rows), ...page.poseOf(rows), hovertemplate: "%{text}: %{y:.3f} deg<extra></extra>",
        marker: { size: 5, color: colour("model"), opacity: 0.55 } },
      { type: "scatter", mode: "lines+markers", name: "its mean", x: means.x, y: means.y, hoverinfo: "skip",
        line: { color: colour("ink"), width: 2 }, marker: { symbol: "square", size: 6 } },
    ];
    if (one && state.step === v.steps.length - 1) {
      const size = page.whatIf.size(), says = binned(at(driver.values, sample), at(one.turns[state.joint], sample).map((y) => y === null ? y : size * y));
      traces.push({ type: "scatter", mode: "lines+markers", name: `what ${one.title} would explain`, x: says.x, y: says.y,
        hoverinfo: "skip", line: { color: colour("held"), width: 3, dash: "dash" }, marker: { symbol: "diamond", size: 7 } });
    }
    const beyond = seen.beyond ? ` (${seen.beyond} beyond)` : "";
    draw("turn", traces, {
      xaxis: { title: { text: driver.label, standoff: 4 } },
      yaxis: { title: { text: `turn of joint ${state.joint + 1}, deg${beyond}`, standoff: 4 }, range: seen.limits },
    }, page.wireScatter);
  }

  return { drawTurn };
}
