// The pose that is pointed at: its words, both arms, its place in every figure. Also a running rover's arms.
"use strict";
function lrmPose(page) {
  const { state, scenes, place, words, norm, rowOfPose } = page;
  const { colour } = lrmChart;

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

  // Both arms of a pose, flat, so that the pointer need not wait for the scene.
  function drawArm() {
    const box = place("arm"), v = state.values, row = rowOfPose();
    if (box) box.replaceChildren(...armViews(v.nominal[row], v.bent[row], v.tcp[row]));
  }

  // Arms at many poses over one another, their tips as dots, from the side and from above.
  function nextPoses(lines) {
    const box = place("next-arms"), all = lines.flat();
    if (!box || !lines.length) return;
    box.replaceChildren(...[["from the side", (p) => [Math.sign(p[0] || 1) * Math.hypot(p[0], p[1]), -p[2]]], ["from above", (p) => [p[0], -p[1]]]].map(([name, flat]) => {
      const xy = all.map(flat), low = [0, 1].map((k) => Math.min(...xy.map((p) => p[k]))), high = [0, 1].map((k) => Math.max(...xy.map((p) => p[k])));
      const size = Math.max(high[0] - low[0], high[1] - low[1]), pad = 0.06 * size, from = [0, 1].map((k) => (low[k] + high[k] - size) / 2 - pad);
      const svg = made("svg", { role: "img", "aria-label": `the arm at ${lines.length} poses ${name}`, viewBox: [...from, size + 2 * pad, size + 2 * pad].join(" ") });
      for (const line of lines) svg.append(made("polyline", { points: line.map((p) => flat(p).join()).join(" "), fill: "none",
        stroke: colour("model"), "stroke-opacity": 0.3, "stroke-width": 0.012 * size, "stroke-linejoin": "round" }));
      for (const line of lines) {
        const [cx, cy] = flat(line[line.length - 1]);
        svg.append(made("circle", { cx, cy, r: 0.015 * size, fill: colour("held") }));
      }
      return captioned(svg, name);
    }));
  }

  function made(tag, attributes) {
    const out = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const key in attributes) out.setAttribute(key, attributes[key]);
    return out;
  }

  function captioned(svg, name) {
    const figure = document.createElement("figure"), caption = document.createElement("figcaption");
    figure.className = "lrm-arm-view";
    caption.textContent = name;
    figure.append(svg, caption);
    return figure;
  }

  // Both arms, from the side in the vertical plane through the TCP and from above.
  function armViews(nominal, bent, measured) {
    const base = nominal[0], tip = nominal[nominal.length - 1];
    const reach = Math.hypot(tip[0] - base[0], tip[1] - base[1]) || 1;
    const along = [(tip[0] - base[0]) / reach, (tip[1] - base[1]) / reach];
    const views = [["from the side", (p) => [(p[0] - base[0]) * along[0] + (p[1] - base[1]) * along[1], -p[2]]],
      ["from above", (p) => [p[0], -p[1]]]];
    return views.map(([name, flat]) => {
      const arms = [nominal.map(flat), bent.map(flat)], seen = measured ? [flat(measured)] : [];
      const all = [...arms[0], ...arms[1], ...seen], xs = all.map((p) => p[0]), ys = all.map((p) => p[1]);
      const size = Math.max(Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys), 1), pad = 0.12 * size;
      const middle = [(Math.max(...xs) + Math.min(...xs)) / 2, (Math.max(...ys) + Math.min(...ys)) / 2];
      const svg = made("svg", { role: "img", "aria-label": `nominal and bent arm ${name}`,
        viewBox: [middle[0] - size / 2 - pad, middle[1] - size / 2 - pad, size + 2 * pad, size + 2 * pad].join(" ") });
      const line = (points, ink, dash, width) => svg.append(made("polyline", { points: points.map((p) => p.join()).join(" "),
        fill: "none", stroke: ink, "stroke-width": width * size, "stroke-dasharray": dash * size, "stroke-linecap": "round" }));
      line(arms[0], colour("soft"), 0.03, 0.014);
      line(arms[1], colour("model"), 0, 0.02);
      for (const at of seen) {
        svg.append(made("circle", { cx: at[0], cy: at[1], r: 0.03 * size, fill: "none", stroke: colour("held"),
          "stroke-width": 0.015 * size }));
      }
      return captioned(svg, name);
    });
  }

  // A running daemon: both arms and words; null: no daemon any longer.
  function rover(told) {
    const panel = place("rover"), arms = place("rover-arms");
    if (!panel) return;
    panel.hidden = !told;
    if (!told) return;
    place("rover-words").textContent = told.words;
    arms.replaceChildren(...(told.bent ? armViews(told.nominal, told.bent, null) : []));
  }

  return { hover, tell, drawArm, rover, nextPoses };
}
