// Arrows of the error field and the dots at their feet, each with its depth, ready to be put on a canvas from behind to front.
"use strict";
const lrmArrows = (() => {
  const { colour, stroke, disc, diamond } = lrmPen;

  // Steps of one scale from light to dark (dark to light on a dark page) that keep their order without colour.
  function steps(count) {
    const ends = document.documentElement.dataset.theme === "dark" ? [[84, 110, 140], [70, 170, 200], [255, 190, 80]]
      : [[150, 172, 196], [0, 114, 178], [110, 0, 70]];
    return Array.from({ length: count }, (_, i) => {
      const t = 2 * i / (count - 1), k = Math.min(Math.floor(t), 1);
      return `rgb(${ends[k].map((c, j) => Math.round(c + (t - k) * (ends[k + 1][j] - c)))})`;
    });
  }

  // The two strokes of an arrow's head, from its tip: a third of its length back, to either side.
  function head(r, size) {
    const flat = Math.hypot(r[0], r[1]), side = flat > 0.1 * size ? [-r[1] / flat, r[0] / flat, 0] : [1, 0, 0];
    return [-1, 1].map((sign) => r.map((c, k) => -0.3 * c + sign * 0.15 * size * side[k]));
  }

  // `dots`: the feet on the screen. Things with `at` [right, down, towards the viewer] and `put(pen)`, in the order of depth.
  function things(content, at, dots, seen) {
    const c = content, colours = steps(c.colours), out = [], ink = colour("ink"), pale = colour("grid"), accent = colour("accent");
    c.residual.forEach((r, row) => {
      if (!seen(row)) return;
      const size = Math.hypot(...r), foot = dots[row], is = c.marked && c.marked.has(row), dim = c.marked && !is;
      const tip = c.tcp[row].map((p, k) => p + c.magnification * r[k]), end = at(tip), hue = colours[
        Math.min(Math.floor(size / c.largest * c.colours), c.colours - 1)];
      const heads = size ? head(r, size).map((h) => at(tip.map((p, k) => p + c.magnification * h[k]))) : [];
      const path = [foot, end, ...heads.flatMap((h) => [h, end])];
      out.push({ at: foot.map((f, k) => (f + end[k]) / 2), put: (pen) => stroke(pen, path, hue, 1.8, []) });
      out.push({ at: [foot[0], foot[1], foot[2] + 0.01], put: (pen) => (is ? diamond(pen, foot, accent) : disc(pen, foot, dim ? pale : ink, 1.7)) });
    });
    return out.sort((a, b) => a.at[2] - b.at[2]);
  }

  return { steps, things };
})();
