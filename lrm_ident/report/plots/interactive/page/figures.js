// The interactive figures of the workbench and the report: drawn from the values of values.py.
// lrm.show(values) draws all of them into the elements of panels.html.
"use strict";
// What the parts of the page share: what is chosen, and how places and words are found. `page` of every other script is this,
// with what the scripts loaded before have added to it.
function lrmShared() {
  const state = { values: null, step: 0, beside: null, joint: 0, driver: "", candidate: null, brushed: null, pose: null, size: 0,
    worst: false, paired: false };
  const emit = (name, value) => { if (window.lrmEmit) window.lrmEmit(name, value); };
  const words = (value, digits = 2) => value === null ? "–" : value.toFixed(digits);
  const norm = (v) => Math.hypot(v[0], v[1], v[2]);
  const rowOfPose = () => Math.max(state.values.pose.indexOf(state.pose), 0);
  return { ...lrmElements, state, scenes: {}, emit, words, norm, rowOfPose };
}

const lrm = (() => {
  const PAIR_PX = 600, PAPER_RATIO = 3;
  const page = lrmShared(), { state, scenes, norm } = page;
  for (const part of [lrmQueue, lrmBrush, lrmCandidates, lrmStory, lrmSteps, lrmField, lrmControls]) Object.assign(page, part(page));
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
    if (same && values.story && before.story && !values.story.noise) [values.floor, values.story.noise] = [before.floor, before.story.noise];
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

  // On paper the cards come before the arm, which is drawn finer.
  let place = null;
  function arrange(paper) {
    const [field, cards] = ["field", "cards"].map((name) => document.getElementById("panel-" + name));
    if (paper) { place = [field.parentNode, field.nextSibling]; cards.after(field); } else if (place) place[0].insertBefore(field, place[1]);
    for (const one of Object.values(scenes)) one.ratio = paper ? PAPER_RATIO : 0;
  }
  function finish() {
    if (window.Plotly) page.drawAll();
    for (const one of Object.values(scenes)) one.draw();
  }

  const { theme, print } = lrmAppearance(redraw, arrange, finish);
  const { rover, nextPoses, soon: ready, brush, hover } = page;
  return { show, load, theme, print, rover, nextPoses, ready, choose, showStep, brush, hover, state, scenes };
})();
window.lrm = lrm;
