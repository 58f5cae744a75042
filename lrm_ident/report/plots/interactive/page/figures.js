// The interactive figures of the workbench and the report: drawn from the values of values.py.
// lrm.show(values) draws all of them into the elements of panels.html.
"use strict";
// What the parts of the page share: what is chosen, and how places and words are found. `page` of every other script is this,
// with what the scripts loaded before have added to it.
function lrmShared() {
  const state = { values: null, step: 0, beside: null, joint: 0, driver: "", candidate: null, brushed: null, pose: null, size: 0,
    worst: false, paired: false };
  const place = (id) => document.getElementById("lrm-" + id);
  const emit = (name, value) => { if (window.lrmEmit) window.lrmEmit(name, value); };
  const words = (value, digits = 2) => value === null ? "–" : value.toFixed(digits);
  const norm = (v) => Math.hypot(v[0], v[1], v[2]);
  const rowOfPose = () => Math.max(state.values.pose.indexOf(state.pose), 0);

  // Fills an element with HTML; one that shows it already is left alone, with what a person has unfolded in it.
  const filled = new WeakMap();
  function fill(id, content) {
    const box = place(id), html = String(content);
    if (filled.get(box) !== html) box.innerHTML = html;
    filled.set(box, html);
    return box;
  }

  function options(id, entries, value) {
    fill(id, lrmHtml`${entries.map(([key, text]) => lrmHtml`<option value="${key}">${text}</option>`)}`).value = value;
  }

  return { state, scenes: {}, place, fill, options, emit, words, norm, rowOfPose };
}

// Paper is light, and gets every figure in full, also those that were not in view yet.
function lrmPrint(page) {
  const PAPER_RATIO = 3;
  const { state, scenes } = page;

  function print(begin) {
    if (begin) print.theme = document.documentElement.dataset.theme;
    const field = document.getElementById("panel-field"), cards = document.getElementById("panel-cards");
    if (begin) { [print.before, print.of] = [field.nextSibling, field.parentNode]; cards.after(field); } // paper: cards first
    else if (print.of) print.of.insertBefore(field, print.before);
    for (const one of Object.values(scenes)) one.ratio = begin ? PAPER_RATIO : 0;
    page.theme(begin ? "light" : print.theme);
    if (window.Plotly) page.drawAll();
    lrmChart.onPaper(begin);
    for (const one of Object.values(scenes)) one.draw();
  }
  window.addEventListener("beforeprint", () => { if (state.values) print(true); });
  window.addEventListener("afterprint", () => { if (state.values) print(false); });
  return { print };
}

const lrm = (() => {
  const PAIR_PX = 600;
  const page = lrmShared(), { state, norm } = page;
  for (const part of [lrmQueue, lrmBrush, lrmCandidates, lrmStory, lrmSteps, lrmField,
    lrmControls, lrmPrint]) Object.assign(page, part(page));
  const { choose, showStep, glide } = page;

  function redraw() {
    if (!state.values) return;
    page.fillControls(); page.drawRanking(choose); page.drawWhatIf(); page.drawField(); page.tell(); page.drawTurn();
    page.drawStory(showStep); page.drawCandidate(); page.drawCards(); page.tellSample();
  }

  function show(values) {
    const before = state.values, known = new Set(values.drivers.map((d) => d.name));
    state.values = values;
    const same = before && before.data === values.data;
    if (same && values.floor === null && values.bound === null) {
      [values.floor, values.bound] = [before.floor, before.bound];
      for (const key of ["noise_rms_mm", "noise_bound_rms_mm"]) if (values.story && before.story) values.story[key] = before.story[key];
    }
    const last = values.steps.length - 1;
    if (!before || before.steps.length !== values.steps.length || state.step > last) state.step = last;
    if (state.beside !== null && state.beside > last) state.beside = null;
    const room = page.place("field").parentElement.clientWidth;
    if (!state.paired) state.beside = last > 0 && room > PAIR_PX ? 0 : null; // before and after, until a person chooses
    if (!values.ranking.some((one) => one.name === state.candidate)) state.candidate = null;
    const other = !same;
    if (other || !known.has(state.driver)) {
      state.joint = values.where.joint;
      state.driver = values.where.driver;
    }
    if (other) [state.brushed, state.worst] = [null, false];
    if (!values.pose.includes(state.pose)) {
      const sizes = values.steps[last].residual.map(norm);
      state.pose = values.pose[sizes.indexOf(Math.max(...sizes))];
    }
    page.wireControls();
    const first = values.ranking[0];
    if (!state.candidate && first && first.verdict !== "no_evidence") {
      [state.candidate, state.joint, state.driver] = [first.name, first.shown.joint, first.shown.driver];
    }
    const from = before && before.steps[before.steps.length - 1].residual;
    redraw();
    if (same && before.steps.length !== values.steps.length && String(before.pose) === String(values.pose)) glide(from);
    page.tellChosen();
  }

  function load(address) {
    return fetch(address).then((reply) => {
      if (!reply.ok) throw new Error(`the workbench answered ${reply.status}`);
      return reply.json();
    }).then(show);
  }

  page.theme = (name) => {
    document.documentElement.dataset.theme = name;
    redraw();
  };

  const { theme, print, rover, nextPoses, soon: ready, resize, brush, hover, scenes } = page;
  return { show, load, theme, print, rover, nextPoses, ready, resize, choose, showStep, brush, hover, state, scenes };
})();
window.lrm = lrm;
