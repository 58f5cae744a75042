// The error field in three dimensions on a plain canvas: dots, arrows and arms in an orthographic view that can be turned.
// A canvas needs no graphics card, and is on paper what it is on the screen. All lengths in mm.
"use strict";
const lrmScene = (() => {
  const { FIRST, view, boxOf, projection } = lrmView;
  const { colour, ring, frame } = lrmPen;
  const scenes = new Set();

  function layer() {
    const canvas = document.createElement("canvas");
    return { canvas, pen: canvas.getContext("2d") };
  }

  // Empties a layer, whose unit is a px of the page from then on.
  function cleared({ canvas, pen }, [width, height], ratio) {
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    return pen;
  }

  function laid(pen, over, alpha = 1) {
    pen.save();
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.globalAlpha = alpha;
    pen.drawImage(over.canvas, 0, 0);
    pen.restore();
  }

  // A scene in an element. `on.hover(row)`, `on.toggle(row)`, `on.mark(rows)`: what a person does with its dots.
  function scene(element, on) {
    const screen = layer(), floor = layer(), still = layer(), sheet = layer(), canvas = screen.canvas;
    canvas.tabIndex = 0;
    canvas.className = "lrm-canvas";
    canvas.setAttribute("role", "img");
    element.replaceChildren(canvas);
    const self = { canvas, content: null, dots: [], drag: null, draw, show, later, point, ratio: 0,
      seen: (row) => !self.content.rows || self.content.rows.has(row) || Boolean(self.content.marked && self.content.marked.has(row)) };
    let asked = 0, stale = true, at = null, things = [];
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
      if (stale || still.canvas.width !== size[0] || still.canvas.height !== size[1]) paintStill(width, height, size, ratio);
      const pen = cleared(screen, size, ratio), drawn = c.arms.map((arm) => lrmSolids.capsules(arm, at));
      laid(pen, floor);
      lrmSolids.shadow(cleared(sheet, size, ratio), c.arms[0], c.box, at);
      laid(pen, sheet, lrmSolids.shade());
      lrmSolids.foot(pen, c.arms[0], c.box, at);
      laid(pen, still);
      c.arms.forEach((arm, i) => {
        if (arm.solid) return lrmSolids.solid(pen, drawn[i], colour(arm.colour), things);
        lrmSolids.outline(cleared(sheet, size, ratio), arm, drawn[i], at);
        laid(pen, sheet);
      });
      if (self.dots[c.row]) ring(pen, self.dots[c.row]);
      if (self.drag && self.drag.box) frame(pen, ...self.drag.box);
    }

    // All but the arms of the pose.
    function paintStill(width, height, size, ratio) {
      const c = self.content, ground = cleared(floor, size, ratio), pen = cleared(still, size, ratio);
      stale = false;
      canvas.setAttribute("aria-label", `${c.title}; arrow keys turn it, plus and minus zoom, 0 resets`);
      at = projection(c.box, width, height);
      lrmAxes.ground(ground, c.box, at);
      lrmAxes.axes(ground, c.box, at);
      self.dots = c.tcp.map(at);
      things = lrmArrows.things(c, at, self.dots, self.seen);
      for (const thing of things) thing.put(pen);
      if (c.bar) lrmAxes.bar(pen, width, height, c.largest, lrmArrows.steps(c.colours));
      pen.font = "12px system-ui, sans-serif";
      pen.fillStyle = colour("ink");
      pen.textAlign = "left";
      pen.textBaseline = "top";
      pen.fillText(c.title, 6, 4);
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
