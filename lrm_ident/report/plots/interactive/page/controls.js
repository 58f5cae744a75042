// Selects and buttons beside the figures: joint, driver, step, poses; and what a choice changes.
"use strict";
function lrmControls(page) {
  const { state, place, options, emit } = page;

  function fillControls() {
    const v = state.values, steps = v.steps.map((step, i) => [String(i), `${i} ${step.title}`]);
    options("joint", v.q[0].map((_, i) => [String(i), `joint ${i + 1}`]), String(state.joint));
    options("driver", v.drivers.map((d) => [d.name, d.name]), state.driver);
    options("step", steps, String(state.step));
    options("beside", [["", "alone"], ...steps.map(([key, text]) => [key, "beside " + text])],
      state.beside === null ? "" : String(state.beside));
    options("marked", [["", "mark poses"], ...Object.keys(v.marked).filter((why) => v.marked[why].length)
      .map((why) => [why, `mark the ${why}`])], "");
  }

  const VIEWS = { top: () => [-90, 90], side: () => [-90, 0], tool: page.tool, oblique: () => null };

  function wireControls() {
    const on = (id, action) => { place(id).onchange = (event) => action(event.target.value); };
    on("joint", (value) => { state.joint = Number(value); page.drawTurn(); });
    on("driver", (value) => { state.driver = value; page.drawTurn(); });
    on("step", (value) => showStep(Number(value)));
    on("beside", (value) => {
      [state.beside, state.paired] = [value === "" ? null : Number(value), true];
      page.drawField(); page.drawStory(showStep);
    });
    on("marked", (value) => page.brush(value ? new Set(state.values.marked[value]) : null));
    on("pose", (value) => { const row = state.values.pose.indexOf(Number(value)); if (row >= 0) page.hover(row); });
    place("clear").onclick = () => page.brush(null);
    const draw = () => { page.tellRows(); page.drawField(); };
    for (const one of document.querySelectorAll("[data-view]")) one.onclick = () => lrmScene.look(VIEWS[one.dataset.view]());
    place("scrub").oninput = (event) => page.hover(Number(event.target.value));
    on("filter", () => { page.filterBy(); draw(); });
    for (const end of ["low", "high"]) on("filter-" + end, draw);
    place("worst").onclick = () => {
      state.worst = !state.worst;
      draw(); page.drawTurn(); page.drawCandidate(); page.drawCards(); page.tellSample(); page.follow();
    };
  }

  // Tells the page around the figures which effect may be added.
  function tellChosen() {
    const one = page.candidate();
    emit("lrm_choose", one && { name: one.name, title: one.title });
  }

  // The effect that may be added.
  function choose(name) {
    state.candidate = name;
    const one = page.candidate();
    if (one) {
      [state.joint, state.driver] = [one.shown.joint, one.shown.driver];
      fillControls();
    }
    page.drawRanking(choose); page.drawCandidate(); page.drawWhatIf(); page.drawTurn(); page.drawStory(showStep);
    tellChosen();
  }

  function showStep(number) {
    const from = state.values.steps[state.step];
    if (!state.values.steps[number]) return;
    state.step = number;
    fillControls();
    if (from) page.glide(from.residual);
    page.drawWhatIf(); page.drawTurn(); page.drawStory(showStep); page.tell();
    emit("lrm_step", number);
  }

  return { fillControls, wireControls, tellChosen, choose, showStep };
}
