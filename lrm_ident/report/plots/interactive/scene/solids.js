// Arms as solids: capsules with the light from above on the left, their shadow on the ground, and the outline of an arm that
// is only thought of. A capsule is the same from everywhere: a thick line with round ends, so nothing has to be meshed.
// An arm: `points` (mm), `links` [point, point, radius in mm], the `line` through its frames, `colour`.
"use strict";
const lrmSolids = (() => {
  const { colour, stroke } = lrmPen;
  const LIGHT = [-0.5, -0.85], FLAT = 1.5; // px
  const white = [255, 255, 255], black = [0, 0, 0];
  const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));
  const mixed = (a, b, part) => `rgb(${a.map((c, k) => Math.round(c + part * (b[k] - c)))})`;

  // Links on the screen, from behind to front: ends, radius in px, and how near their front is at a place.
  function capsules(arm, at) {
    const ends = arm.points.map(at);
    return arm.links.map(([i, j, radius]) => capsule(ends[i], ends[j], radius, at.scale)).sort((one, other) => one.depth - other.depth);
  }

  function capsule(a, b, radius, scale) {
    const along = [b[0] - a[0], b[1] - a[1]], length = Math.hypot(...along), size = scale * radius;
    // The nearest place of its surface (mm towards the viewer) under a place on the screen; −∞ where it is beside it.
    const surface = ([x, y]) => {
      const t = length < FLAT ? 0.5 : Math.min(Math.max(((x - a[0]) * along[0] + (y - a[1]) * along[1]) / length ** 2, 0), 1);
      const fronts = [0, t, 1].map((one) => {
        const beside = Math.hypot(x - a[0] - one * along[0], y - a[1] - one * along[1]) / size;
        return beside > 1 ? -Infinity : a[2] + one * (b[2] - a[2]) + radius * Math.sqrt(1 - beside ** 2);
      });
      return Math.max(...fronts);
    };
    return { a, b, along, length, size, surface, depth: (a[2] + b[2]) / 2 };
  }

  // Light and shade across a capsule, or around its end where it is seen end on.
  function shading(pen, one, ink) {
    const { a, along, length, size } = one, base = rgb(ink);
    let gradient;
    if (length < FLAT) {
      gradient = pen.createRadialGradient(a[0] + 0.4 * size * LIGHT[0], a[1] + 0.4 * size * LIGHT[1], 0, a[0], a[1], size);
    } else {
      const sign = -along[1] * LIGHT[0] + along[0] * LIGHT[1] > 0 ? 1 : -1;
      const to = [sign * -along[1] / length * size, sign * along[0] / length * size];
      gradient = pen.createLinearGradient(a[0] + to[0], a[1] + to[1], a[0] - to[0], a[1] - to[1]);
    }
    const stops = [[0, mixed(base, white, 0.3)], [0.25, mixed(base, white, 0.5)], [0.55, mixed(base, white, 0.05)], [1, mixed(base, black, 0.45)]];
    for (const [where, tint] of stops) gradient.addColorStop(where, tint);
    return gradient;
  }

  function put(pen, one, ink) {
    stroke(pen, [one.a, one.b], mixed(rgb(ink), black, 0.55), 2 * one.size + 1.5, []);
    stroke(pen, [one.a, one.b], shading(pen, one, ink), 2 * one.size, []);
  }

  // Puts links on a canvas, and again those things that are before them: `things` were put already, all of them behind.
  function solid(pen, links, ink, things) {
    const before = links.map(() => []);
    for (const thing of things) {
      for (let k = links.length - 1; k >= 0; k--) {
        const near = links[k].surface(thing.at);
        if (near > -Infinity && thing.at[2] > near) { before[k].push(thing); break; }
      }
    }
    links.forEach((one, k) => {
      put(pen, one, ink);
      for (const thing of before[k]) thing.put(pen);
    });
  }

  // The outline of all links together, on a sheet of its own, with the line through the frames dashed.
  function outline(sheet, arm, links, at) {
    const ink = colour(arm.colour);
    for (const one of links) stroke(sheet, [one.a, one.b], ink, 2 * one.size + 2.4, []);
    sheet.globalCompositeOperation = "destination-out";
    for (const one of links) stroke(sheet, [one.a, one.b], ink, 2 * one.size, []);
    sheet.globalCompositeOperation = "source-over";
    stroke(sheet, arm.line.map(at), ink, 1.5, [6, 4]);
  }

  // The shadow on the floor of the box, on a sheet of its own; none where the floor is seen edge on.
  function shadow(sheet, arm, box, at) {
    const level = box[0][2], o = at([0, 0, level]), x = at([1, 0, level]), y = at([0, 1, level]);
    const plane = [x[0] - o[0], x[1] - o[1], y[0] - o[0], y[1] - o[1]];
    if (Math.abs(plane[0] * plane[3] - plane[1] * plane[2]) < 0.02 * at.scale ** 2) return;
    sheet.save();
    sheet.transform(...plane, o[0], o[1]);
    for (const [i, j, radius] of arm.links) stroke(sheet, [arm.points[i], arm.points[j]], "black", 2 * radius, []);
    sheet.restore();
  }

  // A thin line from the base down to the floor, so that an arm that stands higher does not seem to hang in the air.
  function foot(pen, arm, box, at) {
    const [x, y, z] = arm.line[0];
    if (z > box[0][2]) stroke(pen, [at([x, y, z]), at([x, y, box[0][2]])], colour("line"), 3, []);
  }

  const shade = () => (document.documentElement.dataset.theme === "dark" ? 0.6 : 0.3);
  return { shade, capsules, solid, outline, shadow, foot };
})();
