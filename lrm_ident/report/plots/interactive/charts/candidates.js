// Which effect: the list of candidates, the chosen one beside the data, and what it would do at any size. `page`: of figures.js.
"use strict";
function lrmCandidates(page) {
  const { state, place, element, words, draw, selected, poseOf, wireScatter } = page;
  const { colour, range, at } = lrmChart;
  const NARROW_PX = 480, AXES = ["x", "y", "z"], SYMBOLS = ["circle", "triangle-up", "square"], MOST_PANELS = 3;
  const candidate = () => state.values.ranking.find((one) => one.name === state.candidate) || null;

  function drawCandidate() {
    const one = candidate(), detail = place("detail");
    for (const id of ["added", "form"]) if (place(id)) place(id).classList.toggle("lrm-empty", !one);
    if (detail) detail.replaceChildren(...(one ? details(one) : []));
    if (!one) return;
    drawAdded(one);
    const axis = (name) => state.values.drivers.find((d) => d.name === name), driver = axis(one.driver), second = axis(one.second);
    const levels = second ? [...new Set(second.values)].sort((a, b) => a - b) : [];
    if (second && levels.length <= MOST_PANELS) drawPanels(one, driver, second, levels);
    else if (driver && second) drawMaps(one, driver, second);
    else if (driver) drawForm(one, driver);
  }

  function drawAdded(one) {
    const v = state.values, rows = page.points(), last = v.steps[v.steps.length - 1].residual;
    const extent = Math.max(...one.added.flat().filter((c) => c !== null).map(Math.abs), 1e-6);
    const traces = AXES.map((axis, k) => ({ type: "scatter", mode: "markers", name: "along " + axis,
      x: rows.map((row) => one.added[row][k]), y: rows.map((row) => last[row][k]), selectedpoints: selected(rows), ...poseOf(rows),
      hovertemplate: "%{text}<extra></extra>",
      marker: { size: 5, opacity: 0.6, symbol: SYMBOLS[k], color: colour(["model", "held", "good"][k]) } }));
    traces.push({ type: "scatter", mode: "lines", name: "as it says", x: [-extent, extent], y: [-extent, extent],
      hoverinfo: "skip", line: { color: colour("ink"), dash: "dash", width: 1.5 } });
    draw("added", traces, { xaxis: { title: { text: "it would add, mm", standoff: 4 } },
      yaxis: { title: { text: "the fit leaves, mm", standoff: 4 } } }, wireScatter);
  }

  // The data and what the form says of each pose, as points: a form may follow more than is drawn, and no line hides that.
  function pointsOfForm(one, driver, rows, on) {
    const x = at(driver.values, rows);
    return [
      { type: "scatter", mode: "markers", name: "data", x, y: at(one.around, rows), ...on, selectedpoints: selected(rows), ...poseOf(rows),
        hovertemplate: "%{text}: %{y:.3f} deg<extra></extra>", marker: { size: 5, color: colour("model"), opacity: 0.55 } },
      { type: "scatter", mode: "markers", name: state.size ? `its form, ${state.size.toFixed(2)} times` : "its form", x,
        y: at(one.form, rows).map((y) => (y === null ? y : size() * y)), ...on, hoverinfo: "skip",
        marker: { symbol: "diamond", size: 5, color: colour("held") } },
    ];
  }

  function drawForm(one, driver) {
    draw("form", pointsOfForm(one, driver, page.points(), {}), { xaxis: { title: { text: driver.label, standoff: 4 } },
      yaxis: { title: { text: `turn of joint ${one.joint + 1}, deg`, standoff: 4 }, range: range(one.around).limits } }, wireScatter);
  }

  // A form of two quantities of which one has few levels: a panel for each level.
  function drawPanels(one, driver, second, levels) {
    const shown = page.points(), traces = [], axes = {}, n = levels.length, limits = range(one.around).limits;
    levels.forEach((level, k) => {
      const rows = shown.filter((row) => second.values[row] === level), key = k ? k + 1 : "", on = { xaxis: "x" + key, showlegend: !k };
      axes["xaxis" + key] = { domain: [(k + 0.04) / n, (k + 0.96) / n], anchor: "y", nticks: 4, tickangle: 0,
        title: { text: k === (n - 1) >> 1 ? `${driver.label}<br>left to right: ${second.label} ${levels.join(", ")}` : "", standoff: 4, font: { size: 12 } } };
      traces.push(...pointsOfForm(one, driver, rows, on));
    });
    draw("form", traces, { ...axes, yaxis: { title: { text: `turn of joint ${one.joint + 1}, deg`, standoff: 4 }, range: limits } }, wireScatter);
  }

  // A form of two quantities: a map of the data and one of the form, on one scale of colours; one above the other where
  // there is little room beside each other.
  function drawMaps(one, driver, second) {
    const limit = range(one.around).limits[1], scale = [[0, colour("model")], [0.5, colour("grid")], [1, colour("held")]];
    const rows = page.points();
    const map = (name, turns, axes, bar) => ({ type: "scatter", mode: "markers", name, x: at(driver.values, rows), y: at(second.values, rows),
      selectedpoints: selected(rows), ...poseOf(rows), hovertemplate: "%{text}: %{marker.color:.3f} deg<extra></extra>", ...axes,
      marker: { size: 6, color: at(turns, rows).map((turn) => (turn === null ? NaN : turn)), cmin: -limit, cmax: limit, colorscale: scale,
        showscale: bar, colorbar: { title: { text: "deg" }, thickness: 10, len: 0.9 } } });
    const title = (text, [x, y]) => ({ text, x, y, xref: "paper", yref: "paper", xanchor: "left", yanchor: "bottom", showarrow: false });
    const [along, up] = [driver, second].map((one) => ({ title: { text: one.label, standoff: 4 } }));
    const beside = place("form").clientWidth > NARROW_PX;
    const axes = beside ? { xaxis: { ...along, domain: [0, 0.48] }, xaxis2: { ...along, domain: [0.52, 1], anchor: "y" }, yaxis: up }
      : { xaxis: { showticklabels: false }, xaxis2: { title: { text: `${driver.label}<br>upwards: ${second.label}`, standoff: 4, font: { size: 12 } }, nticks: 4, tickangle: 0, anchor: "y2" }, yaxis: { domain: [0.56, 1] }, yaxis2: { domain: [0, 0.42], anchor: "x2" } };
    const data = `data: turn of joint ${one.joint + 1}`;
    draw("form", [map("data", one.around, {}, false), map("its form", one.form, { xaxis: "x2", ...(beside ? {} : { yaxis: "y2" }) }, true)], {
      showlegend: false, margin: { l: 8, r: 8, t: 22, b: 8 }, ...axes,
      annotations: [title(data, [0, 1]), title("its form", beside ? [0.52, 1] : [0, 0.42])] }, wireScatter);
  }

  function details(one) {
    const lines = [element("p", one.why)], numbers = element("details", "", "lrm-soft");
    lines.push(element("p", one.online ? "The rover can compensate it." : "Explains a measurement session; never deployed silently.",
      "lrm-soft"));
    if (one.rivals.length) lines.push(element("p", "These poses cannot distinguish it from " + one.rivals.join(", ") + ".", "lrm-soft"));
    numbers.append(element("summary", `${one.estimates.length} coefficient${one.estimates.length > 1 ? "s" : ""}, p ${one.p}`), element("p", one.estimates.join(", ")));
    return [...lines, explained(one.about), numbers];
  }

  function explained(about) {
    const box = element("details", "", "lrm-soft lrm-explain"), lines = [about.cause, about.formula, about.needs && `Shown by ${about.needs}.`, about.source];
    box.append(element("summary", "Explain"), ...lines.filter(Boolean).map((text) => element("p", text)));
    return box;
  }

  function drawHead() {
    const head = place("ranking-head"), v = state.values;
    if (!head) return;
    const row = element("div", "", "lrm-ranking-row"), marks = [...new Set(v.ranking.map((one) => one.mark))];
    row.append(element("span", "effect"), element("span", "held-out RMS left, mm"));
    if (v.ranking.some((one) => one.held.startsWith("≈"))) marks.push("≈ estimated, not refitted");
    if (v.ranking.some((one) => one.gain !== null)) marks.push("bar: what it takes away");
    const legend = element("p", "", "lrm-legend lrm-soft");
    legend.append(...marks.flatMap((mark) => [element("span", mark), "   "]));
    head.replaceChildren(...(v.ranking.length ? [row, legend] : []));
    lrmGlossary(head);
  }

  function drawRanking(choose) {
    const list = place("ranking"), v = state.values;
    drawHead();
    if (!list) return;
    const known = v.ranking.filter((one) => one.gain !== null), above = (one) => v.floor === null ? 0 : one.heldOut + one.gain - v.floor;
    const most = Math.max(...known.flatMap((one) => [one.gain, above(one)]), 1e-9);
    list.setAttribute("role", "radiogroup");
    list.replaceChildren(...v.ranking.map((one, number) => {
      const button = element("button", "", "lrm-candidate lrm-" + one.standing), is = one.name === state.candidate;
      button.type = "button";
      button.setAttribute("role", "radio");
      button.setAttribute("aria-checked", String(is));
      button.tabIndex = is || (!state.candidate && !number) ? 0 : -1;
      button.dataset.name = one.name;
      const bar = element("span", "", "lrm-bar"), name = element("span", one.title + " ", "lrm-name");
      bar.style.width = 100 * Math.max(0, one.gain) / most + "%";
      name.append(element("small", one.name, "lrm-soft"));
      button.append(bar, element("span", one.mark.split(" ")[0], "lrm-mark"), name, element("span", one.held, "lrm-held"));
      button.title = one.mark;
      button.addEventListener("click", () => choose(one.name));
      return button;
    }));
    list.onkeydown = (event) => {
      const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      const at = v.ranking.findIndex((one) => one.name === state.candidate);
      const next = v.ranking[Math.min(Math.max(at + step, 0), v.ranking.length - 1)];
      choose(next.name);
      list.querySelector('[aria-checked="true"]').focus();
    };
  }

  // What if the chosen effect had a size: arrows, turns and RMS of the last step without it, linear, before any refit.
  const MOST = 2; // times the estimate
  let shown = null;

  // What is left of a residual (rows of [x, y, z] or numbers) where a part `added` is explained.
  const without = (values, added) => values.map((value, row) => {
    const part = added[row];
    if (part === null || value === null || (Array.isArray(part) && part.includes(null))) return value;
    return Array.isArray(value) ? value.map((c, k) => c - state.size * part[k]) : value - state.size * part;
  });
  const size = () => state.size || 1; // times the estimate at which the form is drawn
  const square = (r) => r[0] ** 2 + r[1] ** 2 + r[2] ** 2;
  const rms = (residual) => Math.sqrt(page.sample().reduce((sum, row) => sum + square(residual[row]), 0) / page.sample().length);
  const active = (number, one) => state.size > 0 && one && number === state.values.steps.length - 1;

  function says(one) {
    const residual = state.values.steps[state.values.steps.length - 1].residual;
    if (!state.size) return "arrows and RMS as if the effect had that size";
    const size = one.size ? `of ${(state.size * one.size.value).toPrecision(2)}${one.size.unit}` : `at ${state.size.toFixed(2)} times its estimate`;
    return `${one.title} ${size}: RMS ${words(rms(without(residual, one.added)))} mm on the poses shown, ${words(rms(residual))} without; ` +
      "linear, before any refit";
  }

  function drawSlider(one) {
    const box = place("what-if");
    if (!box) return;
    if (shown === one && box.firstChild) return;
    [shown, state.size] = [one, 0];
    box.hidden = !one;
    if (!one) return box.replaceChildren();
    const label = element("label", "What if "), input = element("input"), said = element("output", says(one));
    Object.assign(input, { type: "range", min: 0, max: MOST, step: 0.02, value: 0, id: "lrm-what-if-size" });
    input.setAttribute("aria-label", `size of ${one.title}, in times its estimate`);
    said.htmlFor = input.id;
    said.id = "lrm-what-if-says";
    input.oninput = () => {
      state.size = Number(input.value);
      said.textContent = says(one);
      page.drawField(); page.drawTurn(); drawCandidate();
    };
    const scale = element("span", "", "lrm-marks"), marks = ["none", "estimate", "twice"];
    scale.append(...marks.map((text) => element("small", text)));
    const track = element("span", "", "lrm-track");
    track.append(input, scale);
    label.append(track);
    box.replaceChildren(label, said);
  }

  // What is drawn of the slider follows the effect chosen and the step shown.
  function drawWhatIf() {
    const tried = state.size;
    drawSlider(state.step === state.values.steps.length - 1 ? candidate() : null);
    if (tried && !state.size) page.drawField();
  }

  return { candidate, drawCandidate, drawRanking, drawWhatIf, whatIf: { without, active, rms, size } };
}
