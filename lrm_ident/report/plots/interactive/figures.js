// The interactive figures of the workbench and the report: drawn with Plotly from the values of values.py.
// lrm.show(values) draws all that has a place (an element with the figure's id) on the page.
"use strict";
const lrm = (() => {
  const PAPER_RATIO = 3, GLIDE_MS = 1000;
  const { colour, layout, binned, range, onPaper, CONFIG } = lrmChart;
  const state = { values: null, step: 0, beside: null, joint: 0, driver: "", candidate: null, brushed: null, pose: null, size: 0 };
  const scenes = {};
  const place = (id) => document.getElementById("lrm-" + id);
  const emit = (name, value) => { if (window.lrmEmit) window.lrmEmit(name, value); };
  const words = (value, digits = 2) => value === null ? "–" : value.toFixed(digits);
  const norm = (v) => Math.hypot(v[0], v[1], v[2]);

  function element(tag, text, name) {
    const out = document.createElement(tag);
    if (text) out.textContent = text;
    if (name) out.className = name;
    return out;
  }

  // ---- what the figures share

  // Charts in view are drawn first, the others when there is nothing else to do; each in a task of its own, so that the
  // page answers in between.
  const waiting = new Map(), inView = new Set();
  const watcher = new IntersectionObserver((entries) => {
    for (const one of entries) inView[one.isIntersecting ? "add" : "delete"](one.target);
    soon();
  }, { rootMargin: "200px" });

  function draw(id, traces, options, wire) {
    const element = place(id);
    if (!element) return;
    watcher.observe(element);
    waiting.set(element, () => Plotly.react(element, traces, layout(options), CONFIG).then(() => {
      if (element.dataset.wired) return;
      element.dataset.wired = "yes";
      if (wire) wire(element);
    }));
    soon();
  }

  const whenIdle = window.requestIdleCallback || ((run) => setTimeout(run, 500)); // Safari has none

  function soon() {
    if (!soon.asked) soon.asked = setTimeout(() => {
      soon.asked = 0;
      if (drawWaiting((one) => inView.has(one), 1)) soon();
      else if (waiting.size) whenIdle(() => { if (drawWaiting(() => true, 1)) soon(); });
    });
  }

  // Draws charts that wait, `most` of them, and says whether it drew any.
  function drawWaiting(which, most = Infinity) {
    if (!window.Plotly || !state.values) return false;
    for (const one of waiting.keys()) if (!one.isConnected) waiting.delete(one);
    const now = [...waiting].filter(([one]) => which(one)).slice(0, most);
    for (const [element, run] of now) { waiting.delete(element); run(); }
    return now.length > 0;
  }

  const selected = () => {
    if (!state.brushed) return null;
    const rows = [];
    state.values.pose.forEach((pose, row) => { if (state.brushed.has(pose)) rows.push(row); });
    return rows;
  };

  // Events of a scatter whose points carry their row in customdata.
  function wireScatter(element) {
    element.on("plotly_hover", (event) => hover(event.points[0].customdata));
    element.on("plotly_selected", (event) => {
      if (event) brush(new Set(event.points.map((p) => p.customdata).filter((row) => row !== undefined)
        .map((row) => state.values.pose[row])));
    });
    element.on("plotly_deselect", () => brush(null));
    element.on("plotly_click", (event) => toggle(event.points[0].customdata));
  }

  const page = { state, place, element, draw, selected, wireScatter, words };
  const { candidate, drawCandidate, drawRanking } = lrmCandidates(page);
  const whatIf = lrmWhatIf(page);
  const { tellFall, tellVerdict, drawHistory, drawCards } = lrmSteps(page);

  const picture = lrmPicture({ ...page, hover, drawField, tool });

  // ---- the error field

  function drawField() {
    const both = state.beside !== null, scale = place("scale"), v = state.values;
    document.documentElement.classList.toggle("lrm-beside", both);
    drawStep("field", state.step, !both);
    if (both) drawStep("field-b", state.beside, true);
    if (scale) scale.textContent = v.scale.words;
  }

  // The arrows go from those of another step to those of the step shown; at once where motion is not wished.
  function glide(from) {
    const of = state.values, number = state.step, to = of.steps[number].residual, begun = performance.now();
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches || document.hidden || !scenes.field;
    if (still || state.beside !== null || from.length !== to.length) return drawField();
    const frame = (now) => {
      const t = Math.min(Math.max((now - begun) / GLIDE_MS, 0), 1), part = t * t * (3 - 2 * t);
      if (state.values !== of || state.step !== number || state.beside !== null) return;
      drawStep("field", number, true, to.map((r, row) => r.map((c, k) => from[row][k] + part * (c - from[row][k]))));
      if (t < 1) requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  function drawStep(id, number, bar, residual = left(number)) {
    const v = state.values, step = v.steps[number], box = place(id), chosen = selected();
    if (!box || !step) return;
    const title = whatIf.active(number, candidate())
      ? `what if: RMS ${words(whatIf.rms(residual))} mm, before any refit` : `${number} ${step.title}: RMS ${step.rms} mm`;
    const deed = { hover, toggle, mark: (rows) => brush(new Set(rows.map((row) => v.pose[row]))) };
    scenes[id] = scenes[id] || lrmScene(box, deed);
    scenes[id].show({ title, box: boxOfField(), bar,
      tcp: v.tcp, residual, magnification: v.scale.magnification, largest: v.scale.largest,
      colours: v.scale.colours, marked: chosen && new Set(chosen), rows: picture.rows(), row: rowOfPose(), arms: arms() });
  }

  // The residual of a step; of the last one without what the chosen effect would explain at the size that is tried.
  function left(number) {
    const one = candidate(), residual = state.values.steps[number]?.residual;
    return residual && whatIf.active(number, one) ? whatIf.without(residual, one.added) : residual;
  }

  // The same for all steps and poses: the measured positions, the arms, and all but the longest arrows of the first step.
  function boxOfField() {
    const v = state.values, m = v.scale.magnification, ends = v.steps[0].residual.map((r, row) => norm(r) > v.scale.largest
      ? v.tcp[row] : v.tcp[row].map((p, k) => p + m * r[k]));
    if (boxOfField.of !== v) [boxOfField.of, boxOfField.box] = [v, lrmScene.boxOf([...v.tcp, ...v.nominal.flat(), ...ends])];
    return boxOfField.box;
  }

  function arms() {
    const v = state.values, row = rowOfPose();
    return [{ points: v.nominal[row], dash: [6, 4], colour: colour("soft"), width: 2.5 },
      { points: v.bent[row], dash: [], colour: colour("model"), width: 4 }];
  }

  // Azimuth and elevation (deg) from which the last link of the bent arm is seen from its tool's end.
  function tool() {
    const points = state.values.bent[rowOfPose()], tip = points[points.length - 1];
    const from = [...points].reverse().find((p) => Math.hypot(...p.map((c, k) => c - tip[k])) > 1) || [tip[0], tip[1], tip[2] - 1];
    const [x, y, z] = tip.map((c, k) => c - from[k]), degrees = (a) => a * 180 / Math.PI;
    return [degrees(Math.atan2(y, x)), degrees(Math.atan2(z, Math.hypot(x, y)))];
  }

  const rowOfPose = () => Math.max(state.values.pose.indexOf(state.pose), 0);

  function hover(row) {
    if (row === undefined || state.values.pose[row] === state.pose) return;
    state.pose = state.values.pose[row];
    tell();
    drawArm();
    for (const one of Object.values(scenes)) one.point(row, arms());
  }

  function tell() {
    const v = state.values, row = rowOfPose(), note = place("pose-note"), input = place("pose");
    if (input && document.activeElement !== input) input.value = v.pose[row];
    tellFall();
    tellVerdict();
    picture.follow();
    if (!note) return;
    const r = v.steps[state.step].residual[row];
    note.textContent = `pose ${v.pose[row]}: q ${v.q[row].map((a) => a.toFixed(0)).join(" ")} deg, load ${v.load[row]} g, ` +
      `error ${words(norm(r))} mm (${r.map((c) => (c < 0 ? "" : "+") + c.toFixed(2)).join(" ")})`;
  }

  // Both arms of a pose, flat, so that the pointer need not wait for the scene: from the side, in the vertical plane
  // through its TCP, and from above.
  function drawArm() {
    const box = place("arm"), v = state.values, row = rowOfPose();
    if (box) box.replaceChildren(...lrmArmViews(v.nominal[row], v.bent[row], v.tcp[row]));
  }

  // A running daemon: both arms and words; null: no daemon any longer.
  function rover(told) {
    const panel = place("rover"), arms = place("rover-arms");
    if (!panel) return;
    panel.hidden = !told;
    if (!told) return;
    place("rover-words").textContent = told.words;
    arms.replaceChildren(...(told.bent ? lrmArmViews(told.nominal, told.bent, null) : []));
  }

  // Paper is light, and gets every figure in full, also those that were not in view yet.
  function print(begin) {
    if (begin) print.theme = document.documentElement.dataset.theme;
    for (const one of Object.values(scenes)) one.ratio = begin ? PAPER_RATIO : 0;
    theme(begin ? "light" : print.theme);
    drawWaiting(() => true);
    onPaper(begin);
    for (const one of Object.values(scenes)) one.draw();
  }
  window.addEventListener("beforeprint", () => { if (state.values) print(true); });
  window.addEventListener("afterprint", () => { if (state.values) print(false); });

  // ---- where it fails: the residual as a turn of one joint against a driver

  function drawTurn() {
    const v = state.values, driver = v.drivers.find((d) => d.name === state.driver), step = v.steps[state.step];
    if (!driver || !step) return;
    const one = candidate(), turns = step.turns[state.joint];
    const y = whatIf.active(state.step, one) ? whatIf.without(turns, one.turns[state.joint]) : turns;
    const means = binned(driver.values, y);
    const seen = range(y, v.steps[0].turns[state.joint]); // the same for all steps
    const traces = [
      { type: "scatter", mode: "markers", name: "residual, as a turn", x: driver.values, y, selectedpoints: selected(),
        customdata: v.pose.map((_, row) => row), text: v.pose.map((pose) => `pose ${pose}`),
        hovertemplate: "%{text}: %{y:.3f} deg<extra></extra>", marker: { size: 5, color: colour("model"), opacity: 0.55 } },
      { type: "scatter", mode: "lines+markers", name: "its mean", x: means.x, y: means.y, hoverinfo: "skip",
        line: { color: colour("ink"), width: 2 }, marker: { symbol: "square", size: 6 } },
    ];
    if (one && state.step === v.steps.length - 1) {
      const says = binned(driver.values, one.turns[state.joint]);
      traces.push({ type: "scatter", mode: "lines+markers", name: `what ${one.title} would explain`, x: says.x, y: says.y,
        hoverinfo: "skip", line: { color: colour("held"), width: 3, dash: "dash" }, marker: { symbol: "diamond", size: 7 } });
    }
    const beyond = seen.beyond ? ` (${seen.beyond} beyond)` : "";
    draw("turn", traces, {
      xaxis: { title: { text: driver.label, standoff: 4 } },
      yaxis: { title: { text: `turn of joint ${state.joint + 1}, deg${beyond}`, standoff: 4 }, range: seen.limits },
    }, wireScatter);
  }

  // ---- the effect that may be added

  function drawWhatIf() {
    const tried = state.size;
    whatIf.draw(state.step === state.values.steps.length - 1 ? candidate() : null, () => { drawField(); drawTurn(); });
    if (tried && !state.size) drawField();
  }

  // ---- the steps that were taken

  function choose(name) {
    state.candidate = name;
    const one = candidate();
    if (one) {
      state.joint = one.joint;
      if (state.values.drivers.some((d) => d.name === one.driver)) state.driver = one.driver;
      fill();
    }
    drawRanking(choose);
    drawCandidate();
    drawWhatIf();
    drawTurn();
    emit("lrm_choose", name);
  }

  function showStep(number) {
    const from = state.values.steps[state.step];
    if (!state.values.steps[number]) return;
    state.step = number;
    fill();
    if (from) glide(from.residual);
    drawWhatIf(); drawTurn(); drawHistory(showStep); tell();
    emit("lrm_step", number);
  }

  // ---- brushing, controls, and drawing all

  function brush(poses) {
    state.brushed = poses && poses.size ? poses : null;
    drawField(); drawTurn(); drawCandidate();
    const note = place("brushed");
    if (note) note.textContent = state.brushed ? `${state.brushed.size} poses marked` : "";
  }

  function toggle(row) {
    if (row === undefined) return;
    const poses = new Set(state.brushed || []), pose = state.values.pose[row];
    if (!poses.delete(pose)) poses.add(pose);
    brush(poses);
  }

  function options(id, entries, value) {
    const select = place(id);
    if (!select) return;
    select.replaceChildren(...entries.map(([key, text]) => {
      const option = element("option", text);
      option.value = key;
      return option;
    }));
    select.value = value;
  }

  function fill() {
    const v = state.values, steps = v.steps.map((step, i) => [String(i), `${i} ${step.title}`]);
    options("joint", v.q[0].map((_, i) => [String(i), `joint ${i + 1}`]), String(state.joint));
    options("driver", v.drivers.map((d) => [d.name, d.name]), state.driver);
    options("step", steps, String(state.step));
    options("beside", [["", "alone"], ...steps.map(([key, text]) => [key, "beside " + text])],
      state.beside === null ? "" : String(state.beside));
    options("marked", [["", "mark poses"], ...Object.keys(v.marked).filter((why) => v.marked[why].length)
      .map((why) => [why, `mark the ${why}`])], "");
  }

  function wireControls() {
    const on = (id, action) => { if (place(id)) place(id).onchange = (event) => action(event.target.value); };
    on("joint", (value) => { state.joint = Number(value); drawTurn(); });
    on("driver", (value) => { state.driver = value; drawTurn(); });
    on("step", (value) => showStep(Number(value)));
    on("beside", (value) => { state.beside = value === "" ? null : Number(value); drawField(); resize(); drawHistory(showStep); });
    on("marked", (value) => brush(value ? new Set(state.values.marked[value]) : null));
    on("pose", (value) => { const row = state.values.pose.indexOf(Number(value)); if (row >= 0) hover(row); });
    if (place("clear")) place("clear").onclick = () => brush(null);
  }

  function resize() {
    for (const figure of document.querySelectorAll(".js-plotly-plot")) {
      if (figure.offsetParent) Plotly.Plots.resize(figure);
    }
  }

  function redraw() {
    if (!state.values) return;
    fill(); drawRanking(choose); drawWhatIf(); drawField(); drawArm(); tell(); drawTurn(); drawHistory(showStep); drawCandidate(); drawCards();
  }

  function show(values) {
    const before = state.values, known = new Set(values.drivers.map((d) => d.name));
    state.values = values;
    const same = before && before.data === values.data;
    if (same && values.floor === null && values.bound === null) [values.floor, values.bound] = [before.floor, before.bound];
    const last = values.steps.length - 1;
    if (!before || before.steps.length !== values.steps.length || state.step > last) state.step = last;
    if (state.beside !== null && state.beside > last) state.beside = null;
    if (!values.ranking.some((one) => one.name === state.candidate)) state.candidate = null;
    const other = !same, looked = !other && !before.compared && values.steps.length === 1;
    if (other || looked || !known.has(state.driver)) {
      state.joint = values.where.joint;
      state.driver = values.where.driver;
    }
    if (other) state.brushed = null;
    if (!values.pose.includes(state.pose)) {
      const sizes = values.steps[last].residual.map(norm);
      state.pose = values.pose[sizes.indexOf(Math.max(...sizes))];
    }
    wireControls();
    const first = values.ranking[0];
    if (!state.candidate && first && first.verdict !== "no_evidence") {
      [state.candidate, state.joint, state.driver] = [first.name, first.joint, first.driver];
    }
    const from = before && before.steps[before.steps.length - 1].residual;
    redraw();
    if (same && before.steps.length !== values.steps.length && String(before.pose) === String(values.pose)) glide(from);
    emit("lrm_choose", state.candidate);
  }

  function load(address) {
    return fetch(address).then((reply) => {
      if (!reply.ok) throw new Error(`the workbench answered ${reply.status}`);
      return reply.json();
    }).then(show);
  }

  function theme(name) {
    document.documentElement.dataset.theme = name;
    redraw();
  }

  return { show, load, theme, print, rover, ready: soon, resize, choose, showStep, brush, hover, state, scenes };
})();
window.lrm = lrm;
