// Where it fails: the residual as a turn of one joint against a driver.
"use strict";
function lrmTurn(page) {
  const { state, draw } = page;
  const { colour, binned, range, at, dots, line, titled } = lrmChart;

  function drawTurn() {
    const v = state.values, driver = v.drivers.find((d) => d.name === state.driver), step = v.steps[state.step];
    if (!driver || !step) return;
    const one = page.candidate(), all = step.turns[state.joint], rows = page.points(), sample = page.sample();
    const y = page.whatIf.active(state.step, one) ? page.whatIf.without(all, one.turns[state.joint]) : all;
    const means = binned(at(driver.values, sample), at(y, sample));
    const seen = range(at(y, rows), v.steps[0].turns[state.joint]), marks = { mode: "lines+markers" }; // the range is the same for all steps
    const traces = [
      dots("residual, as a turn", at(driver.values, rows), at(y, rows), { color: colour("model"), opacity: 0.55 },
        { ...page.poseOf(rows), hovertemplate: "%{text}: %{y:.3f} deg<extra></extra>" }),
      line("its mean", means.x, means.y, { color: colour("ink"), width: 2 }, { ...marks, marker: { symbol: "square", size: 6 } }),
    ];
    if (one && state.step === v.steps.length - 1) {
      const size = page.whatIf.size(), says = binned(at(driver.values, sample), at(one.turns[state.joint], sample).map((y) => y === null ? y : size * y));
      traces.push(line(`what ${one.title} would explain`, says.x, says.y, { color: colour("held"), width: 3, dash: "dash" },
        { ...marks, marker: { symbol: "diamond", size: 7 } }));
    }
    const beyond = seen.beyond ? ` (${seen.beyond} beyond)` : "", y_title = `turn of joint ${state.joint + 1}, deg${beyond}`;
    draw("turn", traces, { xaxis: titled(driver.label), yaxis: titled(y_title, { range: seen.limits }) }, page.wireScatter);
  }

  return { drawTurn };
}
