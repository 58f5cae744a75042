// The box around a scene with its floor, grid and labels in mm, and the bar of the arrows' colours.
"use strict";
const lrmAxes = (() => {
  const END_ON = 40; // px
  const { colour, stroke, polygon, lettering } = lrmPen;

  function ticks(low, high) {
    const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough), out = [];
    for (let at = Math.ceil(low / step) * step; at <= high; at += step) out.push(Math.round(at / step) * step);
    return out;
  }

  const moved = (p, k, value) => p.map((c, j) => (j === k ? value : c));

  function axes(pen, box, at) {
    const [low, high] = box, grid = [0, 1, 2].map((k) => ticks(low[k], high[k]));
    const far = [0, 1, 2].map((k) => (at(low)[2] <= at(moved(low, k, high[k]))[2] + 1e-6 ? low[k] : high[k]));
    const near = far.map((c, k) => low[k] + high[k] - c);
    const floor = [low, moved(low, 0, high[0]), moved(high, 2, low[2]), moved(low, 1, high[1])]; // the arm's shadow falls on it
    polygon(pen, floor.map(at), colour("ground"));
    for (const k of [0, 1, 2]) {
      for (const along of [0, 1, 2].filter((j) => j !== k)) { // on the plane that is far in the third axis: lines of constant k
        for (const value of [low[k], ...grid[k], high[k]]) {
          stroke(pen, [low, high].map((end) => at(moved(moved(far, k, value), along, end[along]))), colour("grid"), 1, []);
        }
      }
    }
    lettering(pen, 10, "soft", "center");
    const centre = at(low.map((l, k) => (l + high[k]) / 2));
    const upright = [[far[0], near[1], far[2]], [near[0], far[1], far[2]]]; // of these the edge that is farthest left
    ["x", "y", "z"].forEach((name, k) => {
      const edge = k < 2 ? moved(far, 1 - k, near[1 - k]) : upright.reduce((a, b) => (at(a)[0] < at(b)[0] ? a : b));
      const ends = [low[k], high[k]].map((value) => at(moved(edge, k, value)));
      if (Math.hypot(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]) < END_ON) return; // its labels would lie on one another
      const put = (value, text, right, down) => {
        const [x, y] = at(moved(edge, k, value));
        pen.fillText(text, x + right, y + down);
      };
      const side = k < 2 ? 6 * Math.sign(at(edge)[0] - centre[0] || 1) : -13;
      for (const value of grid[k]) put(value, String(value), side, k < 2 ? 9 : 0);
      if (k < 2) put((low[k] + high[k]) / 2, `${name} mm`, 5 * side, 24);
      else put(high[k], `${name} mm`, 0, -9);
    });
  }

  function bar(pen, width, height, largest, colours) {
    const left = width - 16, top = 34, step = Math.min(11, (height - 90) / colours.length);
    lettering(pen, 11, "ink", "right");
    pen.fillText("mm", width - 4, top - 14);
    colours.forEach((ink, i) => {
      const y = top + (colours.length - 1 - i) * step;
      pen.fillStyle = ink;
      pen.fillRect(left, y, 12, step);
      pen.fillStyle = colour("soft");
      if (i % 2 === 0) pen.fillText(String(Math.round(1000 * i * largest / colours.length) / 1000), left - 4, y + step);
    });
    pen.fillText(`≥ ${Math.round(1000 * largest) / 1000}`, left - 4, top);
  }

  return { axes, bar };
})();
