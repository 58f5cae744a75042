// The box around a scene with its ground, grid and labels in mm, and the bar of the arrows' colours.
"use strict";
const lrmAxes = (() => {
  const END_ON = 40; // px
  const { colour, polygon, lettering } = lrmPen;

  function ticks(low, high) {
    const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough), out = [];
    for (let at = Math.ceil(low / step) * step; at <= high; at += step) out.push(Math.round(at / step) * step);
    return out;
  }

  // The plane that the arm's shadow falls on: the floor of the box.
  function ground(pen, [[left, front, down], [right, back]], at) {
    polygon(pen, [[left, front], [right, front], [right, back], [left, back]].map(([x, y]) => at([x, y, down])), colour("ground"));
  }

  function axes(pen, box, at) {
    const [low, high] = box, corner = (k, far) => {
      const ends = [[...low], [...low]];
      ends[1][k] = high[k];
      const behind = at(ends[0])[2] <= at(ends[1])[2] + 1e-6 ? low[k] : high[k];
      return far ? behind : low[k] + high[k] - behind;
    };
    const far = [0, 1, 2].map((k) => corner(k, true)), near = [0, 1, 2].map((k) => corner(k, false));
    const line = (from, to) => { const [a, b] = [at(from), at(to)]; pen.moveTo(a[0], a[1]); pen.lineTo(b[0], b[1]); };
    const grid = [0, 1, 2].map((k) => ticks(low[k], high[k]));
    pen.lineWidth = 1;
    pen.strokeStyle = colour("grid");
    pen.beginPath();
    for (let k = 0; k < 3; k++) {
      const others = [0, 1, 2].filter((j) => j !== k);
      for (const j of others) { // on the plane far in j: lines of constant k, along the third axis
        const along = 3 - k - j;
        for (const value of [low[k], ...grid[k], high[k]]) {
          const from = [...far], to = [...far];
          from[k] = to[k] = value;
          from[along] = low[along];
          to[along] = high[along];
          line(from, to);
        }
      }
    }
    pen.stroke();
    lettering(pen, 10, "soft", "center");
    const centre = at(low.map((l, k) => (l + high[k]) / 2));
    ["x", "y", "z"].forEach((name, k) => {
      const edge = [...far];
      if (k < 2) edge[1 - k] = near[1 - k];
      else { // the vertical edge that is farthest left
        const edges = [[far[0], near[1]], [near[0], far[1]]].map(([x, y]) => [x, y, low[2]]);
        const [x, y] = edges.reduce((a, b) => (at(a)[0] < at(b)[0] ? a : b));
        [edge[0], edge[1]] = [x, y];
      }
      const ends = [low[k], high[k]].map((value) => at(edge.map((c, j) => (j === k ? value : c))));
      if (Math.hypot(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]) < END_ON) return; // its labels would lie on one another
      const put = (value, text, right, down) => {
        const p = [...edge];
        p[k] = value;
        const [x, y] = at(p);
        pen.fillText(text, x + right, y + down);
      };
      const side = k < 2 ? 6 * Math.sign(at(edge)[0] - centre[0] || 1) : -13;
      for (const value of grid[k]) put(value, String(value), side, k < 2 ? 9 : 0);
      if (k < 2) put((low[k] + high[k]) / 2, `${name} mm`, 5 * side, 24);
      else put(high[k], `${name} mm`, 0, -9);
    });
  }

  function bar(pen, width, height, largest, colours) {
    const left = width - 16, top = 34, step = Math.min(18, (height - 90) / colours.length);
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

  return { ground, axes, bar };
})();
