// The error field: the scene of the step shown, or of two beside each other, and how the arrows get from step to step.
// Arms without errors: at the next poses, and those of a running rover.
"use strict";
function lrmField(page) {
  const GLIDE_MS = 1000;
  const { state, scenes, place, words, norm, rowOfPose } = page;

  function drawField() {
    const both = state.beside !== null, v = state.values;
    document.documentElement.classList.toggle("lrm-beside", both);
    place("field").parentElement.style.setProperty("--tall", lrmScene.fitted(boxOfField()));
    drawStep("field", both ? Math.min(state.step, state.beside) : state.step, !both); // before left, after right
    if (both) drawStep("field-b", Math.max(state.step, state.beside), true);
    place("scale").textContent = v.scale.words + " Solid arm: the model at the ringed pose. Outline and dashed line: the nominal arm." +
      (v.solids.shaped ? "" : " Links are drawn as tubes: the arm's file has no shapes.");
  }

  // The arrows go from those of another step to those of the step shown; at once where motion is not wished.
  function glide(from) {
    const of = state.values, number = state.step, to = of.steps[number].residual, begun = performance.now();
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches || document.hidden || !scenes.field;
    const paired = state.beside, id = paired === null ? "field" : "field-b";
    if (still || number < paired || from.length !== to.length) return drawField();
    document.documentElement.classList.toggle("lrm-beside", paired !== null);
    if (paired !== null) drawStep("field", paired, false);
    const frame = (now) => {
      const t = Math.min(Math.max((now - begun) / GLIDE_MS, 0), 1), part = t * t * (3 - 2 * t);
      if (state.values !== of || state.step !== number || state.beside !== paired) return;
      drawStep(id, number, true, to.map((r, row) => r.map((c, k) => from[row][k] + part * (c - from[row][k]))));
      if (t < 1) requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  function drawStep(id, number, bar, residual = left(number)) {
    const v = state.values, step = v.steps[number], box = place(id), chosen = page.marked();
    if (!step) return;
    const alone = `${step.title}: RMS ${step.rms} mm${step.held ? ` (held out ${step.held})` : " on these data"}`;
    const when = number === Math.max(state.step, state.beside) ? "after" : "before";
    const error = state.beside === null ? alone : `${when}: ${step.held ? `${step.held} mm RMS held out` : `${step.rms} mm RMS`}`;
    const title = page.whatIf.active(number, page.candidate()) ? `what if: RMS ${words(page.whatIf.rms(residual))} mm, before any refit` : error;
    const deed = { hover: page.hover, toggle: page.toggle, mark: (rows) => page.brush(new Set(rows.map((row) => v.pose[row]))) };
    scenes[id] = scenes[id] || lrmScene(box, deed);
    scenes[id].show({ title, box: boxOfField(), bar,
      tcp: v.tcp, residual, magnification: v.scale.magnification, largest: v.scale.largest,
      colours: v.scale.colours, marked: chosen && new Set(chosen), rows: page.rows(), row: rowOfPose(), arms: arms() });
  }

  // The residual of a step; of the last one without what the chosen effect would explain at the size that is tried.
  function left(number) {
    const one = page.candidate(), residual = state.values.steps[number]?.residual;
    return residual && page.whatIf.active(number, one) ? page.whatIf.without(residual, one.added) : residual;
  }

  // The same for all steps and poses: the measured positions, the arms, and all but the longest arrows of the first step.
  function boxOfField() {
    const v = state.values, m = v.scale.magnification, ends = v.steps[0].residual.map((r, row) => norm(r) > v.scale.largest
      ? v.tcp[row] : v.tcp[row].map((p, k) => p + m * r[k]));
    if (boxOfField.of !== v) [boxOfField.of, boxOfField.box] = [v, lrmScene.boxOf([...v.tcp, ...v.nominal.flat(), ...ends])];
    return boxOfField.box;
  }

  // Both arms of the pose: links as solids between points, and the line through the frames' origins.
  function arms() {
    const v = state.values, row = rowOfPose(), links = v.solids.links;
    const one = (line, more, solid, ink) => ({ line: line[row], points: [...line[row], ...more[row]], links, solid, colour: ink });
    return [one(v.bent, v.solids.bent, true, "model"), one(v.nominal, v.solids.nominal, false, "ink")];
  }

  // Azimuth and elevation (deg) from which the last link of the bent arm is seen from its tool's end.
  function tool() {
    const points = state.values.bent[rowOfPose()], tip = points[points.length - 1];
    const from = [...points].reverse().find((p) => Math.hypot(...p.map((c, k) => c - tip[k])) > 1) || [tip[0], tip[1], tip[2] - 1];
    const [x, y, z] = tip.map((c, k) => c - from[k]), degrees = (a) => a * 180 / Math.PI;
    return [degrees(Math.atan2(y, x)), degrees(Math.atan2(z, Math.hypot(x, y)))];
  }

  // Arms in a scene of their own, as round links through their frames (mm); their tips are dots.
  function armsIn(id, title, arms, thick) {
    const points = arms.flatMap((one) => one.line), tcp = arms.map(({ line }) => line[line.length - 1]);
    const box = lrmScene.boxOf([...points, ...(scenes[id]?.content.box || [])]); // it grows, so that nothing jumps
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

  return { drawField, glide, arms, tool, rover, nextPoses };
}
