// The pose that is pointed at: its words, both arms, its place in every figure. Also a running rover's arms.
"use strict";
function lrmPose(page) {
  const { state, scenes, place, fill, words, norm, rowOfPose } = page;
  const { colour } = lrmChart;

  function hover(row) {
    if (row === undefined || state.values.pose[row] === state.pose) return;
    state.pose = state.values.pose[row];
    tell();
    for (const one of Object.values(scenes)) one.point(row, page.arms());
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

  // Lines and rings in mm, flat: from the side, where `side` says how far to the right a point is, and from above.
  // Widths, dashes, radii: in parts of the size of the picture.
  function flat(about, side, lines, rings) {
    const all = [...lines.flatMap((one) => one.points), ...rings.map((one) => one.at)];
    return lrmHtml`${[["from the side", (p) => [side(p), -p[2], 0]], ["from above", (p) => [p[0], -p[1], 0]]].map(([from, on]) => {
      const [low, high] = lrmScene.boxOf(all.map(on)), size = Math.max(high[0] - low[0], high[1] - low[1], 1), wide = 1.24 * size;
      const [left, top] = [0, 1].map((k) => (low[k] + high[k] - wide) / 2);
      return lrmHtml`<figure class="lrm-arm-view"><svg role="img" aria-label="${about} ${from}" viewBox="${left} ${top} ${wide} ${wide}">
        ${lines.map((one) => lrmHtml`<polyline points="${one.points.map((p) => on(p).slice(0, 2).join()).join(" ")}" fill="none" stroke="${one.ink}"
          stroke-width="${one.width * size}" stroke-dasharray="${one.dash * size}" stroke-opacity="${one.opacity}" stroke-linecap="round" stroke-linejoin="round"/>`)}
        ${rings.map((one) => lrmHtml`<circle cx="${on(one.at)[0]}" cy="${on(one.at)[1]}" r="${one.radius * size}" fill="${one.fill}" stroke="${colour("held")}"
          stroke-width="${0.015 * size}"/>`)}</svg><figcaption>${from}</figcaption></figure>`;
    })}`;
  }

  // Both arms, from the side in the vertical plane through the TCP and from above.
  function armViews(nominal, bent) {
    const base = nominal[0], tip = nominal[nominal.length - 1], along = [tip[0] - base[0], tip[1] - base[1]], reach = Math.hypot(...along) || 1;
    const arms = [{ points: nominal, ink: colour("soft"), dash: 0.03, width: 0.014, opacity: 1 }, { points: bent, ink: colour("model"), dash: 0, width: 0.02, opacity: 1 }];
    return flat("nominal and bent arm", (p) => ((p[0] - base[0]) * along[0] + (p[1] - base[1]) * along[1]) / reach, arms, []);
  }

  // Arms at many poses over one another, their tips as dots.
  function nextPoses(lines) {
    if (!lines.length) return;
    fill("next-arms", flat(`the arm at ${lines.length} poses`, (p) => Math.sign(p[0] || 1) * Math.hypot(p[0], p[1]),
      lines.map((points) => ({ points, ink: colour("model"), width: 0.012, dash: 0, opacity: 0.3 })),
      lines.map((line) => ({ at: line[line.length - 1], radius: 0.008, fill: colour("held") }))));
  }

  // A running daemon: both arms and words; null: no daemon any longer.
  function rover(told) {
    place("rover").hidden = !told;
    if (!told) return;
    place("rover-words").textContent = told.words;
    fill("rover-arms", told.bent ? armViews(told.nominal, told.bent) : "");
  }

  return { hover, tell, rover, nextPoses };
}
