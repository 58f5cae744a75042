// Which effect: the list of candidates, the chosen one beside the data, what it would do at any size, and where the model
// fails. `page`: of figures.js.
"use strict";
function lrmCandidates(page) {
  const { state, place, fill, words, draw, poseOf, wireScatter } = page;
  const { colour, means, range, at, dots, line, titled } = lrmChart;
  const AXES = ["x", "y", "z"], SYMBOLS = ["circle", "triangle-up", "square"];
  const candidate = () => state.values.ranking.find((one) => one.name === state.candidate) || null;

  function drawCandidate() {
    const one = candidate();
    for (const id of ["added", "form"]) place(id).classList.toggle("lrm-empty", !one);
    fill("detail", one ? details(one) : "");
    if (!one) return;
    drawAdded(one);
    drawForm(one);
  }

  function drawAdded(one) {
    const v = state.values, rows = page.points(), last = v.steps[v.steps.length - 1].residual;
    const extent = Math.max(...one.added.flat().filter((c) => c !== null).map(Math.abs), 1e-6);
    const traces = AXES.map((axis, k) => dots(axis, rows.map((row) => one.added[row][k]), rows.map((row) => last[row][k]),
      { opacity: 0.6, symbol: SYMBOLS[k], color: colour(["model", "held", "good"][k]) }, { ...poseOf(rows), hovertemplate: "%{text}<extra></extra>" }));
    traces.push(line("all explained", [-extent, extent], [-extent, extent], { color: colour("ink"), dash: "dash", width: 1.5 }));
    draw("added", traces, { xaxis: titled("motion that it would add, mm"), yaxis: titled("residual of the fit, mm") }, wireScatter);
  }

  // The data and what the form says of each pose, as points: a form may follow more than is drawn, and no line hides that.
  // A second quantity that it follows is the colour of both.
  function drawForm(one) {
    const [driver, second] = [one.driver, one.second].map((name) => state.values.drivers.find((d) => d.name === name)), rows = page.points();
    if (!driver) return;
    const x = at(driver.values, rows), known = second && at(second.values, rows).filter((value) => value !== null);
    const hue = (ink, bar) => !second ? { color: colour(ink) } : { color: at(second.values, rows).map((value) => value ?? NaN), cmin: Math.min(...known), cmax: Math.max(...known),
      colorscale: [[0, colour("held")], [0.5, colour("line")], [1, colour("model")]], showscale: bar, colorbar: { title: { text: second.label, side: "right" }, thickness: 10, len: 0.9 } };
    const hover = `%{text}: %{y:.3f} deg${second ? `; ${second.label} %{marker.color}` : ""}<extra></extra>`;
    const said = at(one.form, rows).map((y) => (y === null ? y : size() * y)), name = state.size ? `its form, ${state.size.toFixed(2)} times` : "its form";
    draw("form", [
      dots("data", x, at(one.around, rows), { opacity: 0.55, ...hue("model", Boolean(second)) }, { ...poseOf(rows), hovertemplate: hover }),
      dots(name, x, said, { symbol: second ? "diamond-open" : "diamond", size: second ? 7 : 5, ...hue("held", false) }, { hoverinfo: "skip" }),
    ], { xaxis: titled(driver.label), yaxis: titled(`turn of joint ${one.joint + 1}, deg`, { range: range(one.around).limits }) }, wireScatter);
  }

  // Where it fails: the residual as a turn of one joint against a driver.
  function drawTurn() {
    const v = state.values, driver = v.drivers.find((d) => d.name === state.driver), step = v.steps[state.step];
    place("turn").closest("section").hidden = !v.fails;
    if (!driver || !step || !v.fails) return;
    const one = candidate(), all = step.turns[state.joint], rows = page.points(), sample = page.sample();
    const y = active(state.step, one) ? without(all, one.turns[state.joint]) : all;
    const seen = range(at(y, rows), v.steps[0].turns[state.joint]), x = at(driver.values, sample); // the range is the same for all steps
    const traces = [
      dots("residual, as a turn", at(driver.values, rows), at(y, rows), { color: colour("model"), opacity: 0.55 },
        { ...poseOf(rows), hovertemplate: "%{text}: %{y:.3f} deg<extra></extra>" }),
      means("its mean", x, at(y, sample), { color: colour("ink"), width: 2 }),
    ];
    if (one && state.step === v.steps.length - 1) {
      const says = at(one.turns[state.joint], sample).map((y) => (y === null ? y : size() * y));
      traces.push(means("what the chosen effect would explain", x, says, { color: colour("held"), width: 3, dash: "dash" }, { marker: { symbol: "diamond", size: 7 } }));
    }
    const beyond = seen.beyond ? ` (${seen.beyond} beyond)` : "", y_title = `turn of joint ${state.joint + 1}, deg${beyond}`;
    draw("turn", traces, { xaxis: titled(driver.label), yaxis: titled(y_title, { range: seen.limits }) }, wireScatter);
  }

  function details(one) {
    const { cause, formula, needs, source } = one.about, about = [cause, formula, needs && `Shown by ${needs}.`, source].filter(Boolean);
    return lrmHtml`<p>${one.why}</p>
      <p class="lrm-soft">The deployed model ${one.online ? "corrects" : "does not correct"} it on the arm.</p>
      <details class="lrm-soft lrm-explain"><summary>Explain</summary>${about.map((text) => lrmHtml`<p>${text}</p>`)}</details>
      <details class="lrm-soft"><summary>${one.estimates.length} coefficient${one.estimates.length > 1 ? "s" : ""}, p ${one.p}</summary><p>${one.estimates.join(", ")}</p></details>`;
  }

  function drawRanking(choose) {
    const v = state.values, some = (test, mark) => v.ranking.some(test) ? [mark] : [];
    const drawn = (one) => one.gain !== null && !["no evidence", "cannot be the cause"].includes(one.standing); // no bar of what chance does as well
    const none = v.ranking.length && !v.ranking.some(drawn);
    place("title-effect").textContent = none ? "Effects that were tried" : "Which effect could be missing";
    place("effect-note").textContent = !v.verdict ? "the candidates appear when every effect has been tried"
      : none ? "Every known effect was tried; the likeliest are listed. None of them lowers the error more than chance does." : "";
    const marks = [...new Set(v.ranking.map((one) => one.mark)), ...some((one) => one.held.startsWith("≈"), "≈ estimated, without a fit of its own"), ...some((one) => one.held === "–", "– not refitted"),
      ...some(drawn, `bar: share of the error${v.floor === null ? "" : " above the noise"} that it takes away`)];
    lrmGlossary(fill("ranking-head", v.ranking.length ? lrmHtml`<div class="lrm-ranking-row"><span>effect</span><span>held-out RMS left, mm</span></div>
      <p class="lrm-legend lrm-soft">${marks.map((mark) => lrmHtml`<span>${mark}</span>   `)}</p>` : ""));
    const known = v.ranking.filter(drawn), above = (one) => one.heldOut + one.gain - (v.floor ?? 0);
    const most = Math.max(...known.flatMap((one) => [one.gain, above(one)]), 1e-9);
    const list = fill("ranking", lrmHtml`${v.ranking.map((one) => lrmHtml`<label class="lrm-candidate" data-name="${one.name}" title="${one.mark}">
        <input type="radio" name="lrm-candidate" value="${one.name}"${one.name === state.candidate ? lrmHtml` checked` : ""}>
        <span class="lrm-bar" style="width: ${drawn(one) ? 100 * Math.max(0, one.gain) / most : 0}%"></span><span class="lrm-mark">${one.mark.split(" ")[0]}</span>
        <span class="lrm-name">${one.title} <small class="lrm-soft">${one.name}</small></span><span class="lrm-held">${one.held}</span></label>`)}`);
    list.onchange = (event) => { choose(event.target.value); list.querySelector(":checked").focus({ preventScroll: true }); };
  }

  // What if the chosen effect had a size: arrows, turns and RMS of the last step without it, linear, before any refit.
  let shown = null;

  // What is left of a residual (rows of [x, y, z] or numbers) where a part `added` is explained.
  const without = (values, added) => values.map((value, row) => {
    const part = added[row];
    if (part === null || value === null || (Array.isArray(part) && part.includes(null))) return value;
    return Array.isArray(value) ? value.map((c, k) => c - state.size * part[k]) : value - state.size * part;
  });
  const size = () => state.size || 1; // times the estimate at which the form is drawn
  const rms = (residual) => Math.hypot(...page.sample().flatMap((row) => residual[row])) / Math.sqrt(page.sample().length);
  const active = (number, one) => state.size > 0 && one && number === state.values.steps.length - 1;

  function says(one) {
    const residual = state.values.steps[state.values.steps.length - 1].residual;
    if (!state.size) return "arrows and RMS as if the effect had that size";
    const size = one.size ? `of ${(state.size * one.size.value).toPrecision(2)}${one.size.unit}` : `at ${state.size.toFixed(2)} times its estimate`;
    return `${one.title} ${size}: RMS ${words(rms(without(residual, one.added)))} mm on the poses shown, ${words(rms(residual))} without; ` +
      "linear, before any refit";
  }

  // What is drawn of the slider follows the effect chosen and the step shown.
  function drawWhatIf() {
    const one = state.step === state.values.steps.length - 1 ? candidate() : null, input = place("what-if-size"), said = place("what-if-says");
    if (shown === one) return;
    const tried = state.size;
    [shown, state.size] = [one, 0];
    place("what-if").hidden = !one;
    if (tried) page.drawField();
    if (!one) return;
    input.value = 0;
    input.setAttribute("aria-label", `size of ${one.title}, in times its estimate`);
    said.textContent = says(one);
    input.oninput = () => {
      state.size = Number(input.value);
      said.textContent = says(one);
      page.drawField(); drawTurn(); drawCandidate();
    };
  }

  return { candidate, drawCandidate, drawTurn, drawRanking, drawWhatIf, whatIf: { without, active, rms, size } };
}
