// The pose that is pointed at: its words, both arms, its place in every figure. Also a running rover's arms.
"use strict";
function lrmPose(page) {
  const { state, scenes, place, words, norm, rowOfPose } = page;

  function hover(row) {
    if (row === undefined || state.values.pose[row] === state.pose) return;
    state.pose = state.values.pose[row];
    tell();
    drawArm();
    for (const one of Object.values(scenes)) one.point(row, page.arms());
  }

  function tell() {
    const v = state.values, row = rowOfPose(), note = place("pose-note"), input = place("pose");
    if (input && document.activeElement !== input) input.value = v.pose[row];
    page.tellFall();
    page.tellVerdict();
    page.follow();
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

  return { hover, tell, drawArm, rover };
}
