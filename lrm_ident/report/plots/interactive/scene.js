// The error field in three dimensions on a plain canvas: dots, arrows and arms in an orthographic view that can be turned.
// A canvas needs no graphics card, and is on paper what it is on the screen. All lengths in mm.
"use strict";
const lrmScene = (() => {
  const FIRST = { azimuth: -45, elevation: 27, zoom: 1, shift: [0, 0] }, DEG = Math.PI / 180, END_ON = 40; // px
  const view = { ...FIRST, shift: [0, 0] }; // one for all scenes: two fields beside each other turn together
  const scenes = new Set();
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const norm = (v) => Math.hypot(v[0], v[1], v[2]);
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();

  // Steps of one scale from light to dark (dark to light on a dark page) that keep their order without colour.
  function steps(count) {
    const ends = [[68, 1, 84], [33, 145, 140], [253, 231, 37]];
    if (document.documentElement.dataset.theme !== "dark") ends.reverse();
    return Array.from({ length: count }, (_, i) => {
      const t = 2 * i / (count - 1), k = Math.min(Math.floor(t), 1);
      return `rgb(${ends[k].map((c, j) => Math.round(c + (t - k) * (ends[k + 1][j] - c)))})`;
    });
  }

  // The two strokes of an arrow's head, from its tip: a third of its length back, to either side.
  function arrowHead(r, size) {
    const flat = Math.hypot(r[0], r[1]), side = flat > 0.1 * size ? [-r[1] / flat, r[0] / flat, 0] : [1, 0, 0];
    return [-1, 1].map((sign) => r.map((c, k) => -0.3 * c + sign * 0.15 * size * side[k]));
  }

  // The box that everything is in: the least and the greatest corner.
  function boxOf(points) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const p of points) {
      for (let k = 0; k < 3; k++) { low[k] = Math.min(low[k], p[k]); high[k] = Math.max(high[k], p[k]); }
    }
    return [low, high];
  }

  function ticks(low, high) {
    const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough), out = [];
    for (let at = Math.ceil(low / step) * step; at <= high; at += step) out.push(Math.round(at / step) * step);
    return out;
  }

  // From mm to the screen: [right, down, towards the viewer] for a canvas of a size in px.
  function projection(box, width, height) {
    const a = view.azimuth * DEG, e = view.elevation * DEG, steep = FIRST.elevation * DEG;
    const right = [-Math.sin(a), Math.cos(a), 0], towards = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    const up = [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)];
    const [low, high] = box, middle = low.map((l, k) => (l + high[k]) / 2), size = low.map((l, k) => high[k] - l);
    const across = Math.hypot(size[0], size[1]), tall = size[2] * Math.cos(steep) + across * Math.sin(steep);
    const scale = view.zoom * Math.min((width - Math.min(64, 0.18 * width)) / across, (height - 56) / tall);
    return (p) => {
      const q = p.map((c, k) => c - middle[k]);
      return [width / 2 + scale * (dot(q, right) + view.shift[0] * across), height / 2 + 6 - scale * (dot(q, up) + view.shift[1] * across),
        dot(q, towards)];
    };
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
    pen.font = "10px system-ui, sans-serif";
    pen.fillStyle = colour("soft");
    pen.textAlign = "center";
    pen.textBaseline = "middle";
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
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = colour("ink");
    pen.textAlign = "right";
    pen.textBaseline = "middle";
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

  // A scene in an element. `on.hover(row)`, `on.toggle(row)`, `on.mark(rows)`: what a person does with its dots.
  function scene(element, on) {
    const canvas = document.createElement("canvas"), still = document.createElement("canvas");
    const screen = canvas.getContext("2d"), behind = still.getContext("2d");
    canvas.tabIndex = 0;
    canvas.className = "lrm-canvas";
    canvas.setAttribute("role", "img");
    element.replaceChildren(canvas);
    const self = { canvas, content: null, dots: [], drag: null, draw, show, later, point, ratio: 0,
      seen: (row) => !self.content.rows || self.content.rows.has(row) || Boolean(self.content.marked && self.content.marked.has(row)) };
    let asked = 0, stale = true, at = null, pen = behind;
    scenes.add(self);

    function show(content) { self.content = content; draw(); }
    function later() { stale = true; soon(); }
    function soon() { if (!asked) asked = requestAnimationFrame(() => { asked = 0; paint(); }); }

    // Another pose: what does not move is kept, so that it costs the same for any number of arrows.
    function point(row, arms) { Object.assign(self.content, { row, arms }); soon(); }

    function draw() { stale = true; paint(); }

    function paint() {
      const width = element.clientWidth, height = element.clientHeight, c = self.content;
      if (!c || !width || !height) return;
      const ratio = self.ratio || Math.max(window.devicePixelRatio || 1, 1);
      const size = [Math.round(width * ratio), Math.round(height * ratio)];
      if (stale || still.width !== size[0] || still.height !== size[1]) paintStill(width, height, size, ratio);
      if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
      pen = screen;
      pen.setTransform(1, 0, 0, 1, 0, 0);
      pen.clearRect(0, 0, ...size);
      pen.drawImage(still, 0, 0);
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      for (const arm of c.arms) stroke(arm.points.map(at), arm.colour, arm.width, arm.dash);
      ring(self.dots[c.row]);
      if (self.drag && self.drag.box) frame(...self.drag.box);
    }

    // All but the arms of the pose.
    function paintStill(width, height, size, ratio) {
      const c = self.content, colours = steps(c.colours), things = [];
      [still.width, still.height] = size;
      stale = false;
      pen = behind;
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      canvas.setAttribute("aria-label", `${c.title}; arrow keys turn it, plus and minus zoom, 0 resets`);
      at = projection(c.box, width, height);
      axes(pen, c.box, at);
      self.dots = c.tcp.map(at);
      const ink = colour("ink"), pale = colour("grid"), accent = colour("accent");
      c.residual.forEach((r, row) => {
        if (!self.seen(row)) return;
        const size = norm(r), foot = self.dots[row], is = c.marked && c.marked.has(row), dim = c.marked && !is;
        const tip = c.tcp[row].map((p, k) => p + c.magnification * r[k]), end = at(tip), hue = colours[
          Math.min(Math.floor(size / c.largest * c.colours), c.colours - 1)];
        const heads = size ? arrowHead(r, size).map((h) => at(tip.map((p, k) => p + c.magnification * h[k]))) : [];
        things.push([(foot[2] + end[2]) / 2, () => stroke([foot, end, ...heads.flatMap((h) => [h, end])], hue, 1.8, [])]);
        things.push([foot[2] + 0.01, () => (is ? diamond(foot, accent) : disc(foot, dim ? pale : ink, 1.7))]);
      });
      things.sort((a, b) => a[0] - b[0]);
      for (const [, put] of things) put();
      if (c.bar) bar(pen, width, height, c.largest, colours);
      pen.font = "12px system-ui, sans-serif";
      pen.fillStyle = ink;
      pen.textAlign = "left";
      pen.textBaseline = "top";
      pen.fillText(c.title, 6, 4);
    }

    function frame(x, y, w, h) {
      pen.strokeStyle = colour("ink");
      pen.setLineDash([4, 3]);
      pen.lineWidth = 1;
      pen.strokeRect(x, y, w, h);
      pen.setLineDash([]);
    }
    function stroke(points, ink, width, dash) {
      pen.strokeStyle = ink;
      pen.lineWidth = width;
      pen.lineCap = dash.length ? "butt" : "round";
      pen.setLineDash(dash);
      pen.beginPath();
      points.forEach((p, i) => (i ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])));
      pen.stroke();
      pen.setLineDash([]);
    }
    function disc(p, ink, radius) {
      pen.fillStyle = ink;
      pen.beginPath();
      pen.arc(p[0], p[1], radius, 0, 7);
      pen.fill();
    }
    function diamond(p, ink) {
      pen.fillStyle = ink;
      pen.beginPath();
      for (const [x, y] of [[0, -6], [6, 0], [0, 6], [-6, 0]]) pen.lineTo(p[0] + x, p[1] + y);
      pen.fill();
    }
    function ring(p) {
      if (!p) return;
      pen.strokeStyle = colour("held");
      pen.lineWidth = 2;
      pen.beginPath();
      pen.arc(p[0], p[1], 6, 0, 7);
      pen.stroke();
    }

    lrmSceneInput(canvas, self, view, FIRST, () => { for (const one of scenes) one.later(); }, on);
    new ResizeObserver(later).observe(element);
    return self;
  }
  // All scenes seen from an azimuth and an elevation (deg); from where they were first without.
  function look(from) {
    Object.assign(view, FIRST, { shift: [0, 0] }, from ? { azimuth: from[0], elevation: from[1] } : {});
    for (const one of scenes) one.later();
  }
  return Object.assign(scene, { boxOf, look, view });
})();
