// The pose that is pointed at: its words, both arms, its place in every figure. Also a running rover's arms.
"use strict";
function lrmPose(page) {
  const { state, scenes, place, words, norm, rowOfPose } = page;

  function hover(row) {
    if (row === undefined || state.values.pose[row] === state.pose) return;
    state.pose = state.values.pose[row];
    tell();
    for (const id of ["field", "field-b"]) scenes[id]?.point(row, page.arms());
  }

  function tell() {
    const v = state.values, row = rowOfPose(), input = place("pose"), r = v.steps[state.step].residual[row];
    if (document.activeElement !== input) input.value = v.pose[row];
    page.tellFall();
    page.tellVerdict();
    page.follow();
    place("pose-note").textContent = `pose ${v.pose[row]}: q ${v.q[row].map((a) => a.toFixed(0)).join(" ")} deg, load ${v.load[row]} g, ` +
      `error ${words(norm(r))} mm (${r.map((c) => (c < 0 ? "" : "+") + c.toFixed(2)).join(" ")})`;
  }

  // Arms in a scene of their own, as round links through their frames (mm); their tips are dots.
  function armsIn(id, title, arms, thick) {
    const box = lrmScene.boxOf(arms.flatMap((one) => one.line)), tcp = arms.map(({ line }) => line[line.length - 1]);
    const radius = thick * Math.hypot(...box[1].map((c, k) => c - box[0][k])), residual = tcp.map(() => [0, 0, 0]);
    const linked = (one) => ({ ...one, points: one.line, links: one.line.slice(1).map((_, k) => [k, k + 1, radius]) });
    if (!scenes[id]?.canvas.isConnected) scenes[id] = lrmScene(place(id), { hover() {}, toggle() {}, mark() {} });
    scenes[id].show({ title, box, tcp, residual, magnification: 1, largest: 1, colours: 2, arms: arms.map(linked) });
  }

  // The arm at many poses.
  function nextPoses(lines) {
    const arms = lines.map((line) => ({ line, solid: true, colour: "model" }));
    if (lines.length) armsIn("next-arms", `the arm at ${lines.length} poses`, arms, 0.004);
  }

  // A running daemon: both arms and words; null: no daemon any longer.
  function rover(told) {
    place("rover").hidden = !told;
    if (!told) return;
    place("rover-words").textContent = told.words;
    if (!told.bent) return place("rover-arms").replaceChildren();
    armsIn("rover-arms", "bent arm, nominal outline", [{ line: told.bent, solid: true, colour: "model" },
      { line: told.nominal, solid: false, colour: "ink" }], 0.02);
  }

  return { hover, tell, rover, nextPoses };
}
