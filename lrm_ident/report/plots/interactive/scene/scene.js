// The error field in three dimensions on a plain canvas: dots, arrows and arms in an orthographic view that can be turned.
// A canvas needs no graphics card, and is on paper what it is on the screen. All lengths in mm.
"use strict";
const lrmScene = (() => {
  const { colour, ring, frame } = lrmPen;
  const scenes = new Set();

  // From where scenes are seen: one orthographic view for all, so that two fields beside each other turn together. The box
  // fills a scene as it is seen `from`, and keeps that size while a person turns it. `shift`: in parts of the canvas.
  const THROUGH = 0.45, MARGIN = { left: 36, right: 20, top: 28, bottom: 34 }; // px, for the labels and the title
  const FIRST = [-45, 27], DEG = Math.PI / 180, view = {};
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  // The box that everything is in: the least and the greatest corner.
  function boxOf(points) {
    return [Math.min, Math.max].map((of) => points.reduce((so_far, p) => so_far.map((c, k) => of(c, p[k]))));
  }

  // Unit vectors of the screen, from an azimuth and an elevation (deg).
  function screenFrom([azimuth, elevation]) {
    const [a, e] = [azimuth * DEG, elevation * DEG];
    return { right: [-Math.sin(a), Math.cos(a), 0], up: [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)],
      towards: [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)] };
  }

  // Width and height (mm) of a box as it is seen from there.
  function extent([low, high], from) {
    const { right, up } = screenFrom(from);
    return [right, up].map((way) => way.reduce((sum, c, k) => sum + Math.abs(c) * (high[k] - low[k]), 0));
  }

  // From mm to the screen: [right, down, towards the viewer (mm)] for a canvas of a size in px; its `scale` in px/mm.
  function projection(box, width, height) {
    const { right, up, towards } = screenFrom([view.azimuth, view.elevation]), [across, tall] = extent(box, view.from);
    const middle = box[0].map((low, k) => (low + box[1][k]) / 2), { left, top } = MARGIN;
    const room = [width - left - MARGIN.right, height - top - MARGIN.bottom];
    const scale = view.zoom * Math.max(Math.min(room[0] / across, room[1] / tall), 1e-6);
    const at = (p) => {
      const q = p.map((c, k) => c - middle[k]);
      return [left + room[0] / 2 + scale * dot(q, right) + view.zoom * view.shift[0] * width,
        top + room[1] / 2 - scale * dot(q, up) - view.zoom * view.shift[1] * width, dot(q, towards)];
    };
    return Object.assign(at, { scale });
  }

  // A canvas in px of the page, and the pen on it.
  function layer() {
    const canvas = document.createElement("canvas"), pen = canvas.getContext("2d");
    const cleared = (width, height, ratio) => {
      Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) }); // this empties it
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      return pen;
    };
    return { canvas, cleared };
  }

  // A scene in an element. `on.hover(row)`, `on.toggle(row)`, `on.mark(rows)`: what a person does with its dots.
  function scene(element, on) {
    const screen = layer(), field = layer(), sheet = layer(), canvas = screen.canvas, title = document.createElement("p");
    Object.assign(canvas, { tabIndex: 0, className: "lrm-canvas", role: "img" });
    title.className = "lrm-scene-title";
    element.replaceChildren(title, canvas);
    const self = { canvas, content: null, dots: [], drag: null, ratio: 0, draw, later,
      show: (content) => { self.content = content; draw(); },
      point: (row, arms) => { Object.assign(self.content, { row, arms }); later(); }, // another pose
      seen: (row) => !self.content.rows || self.content.rows.has(row) || Boolean(self.content.marked && self.content.marked.has(row)) };
    let asked = 0;
    scenes.add(self);

    function later() { asked = asked || requestAnimationFrame(() => { asked = 0; draw(); }); }

    function draw() {
      const width = element.clientWidth, height = element.clientHeight, c = self.content;
      if (!c || !width || !height) return;
      const ratio = self.ratio || Math.max(window.devicePixelRatio || 1, 1), at = projection(c.box, width, height);
      const pen = screen.cleared(width, height, ratio);
      const laid = ({ canvas: over }, alpha) => {
        pen.globalAlpha = alpha;
        pen.drawImage(over, 0, 0, over.width / ratio, over.height / ratio);
        pen.globalAlpha = 1;
      };
      title.textContent = c.title;
      canvas.setAttribute("aria-label", `${c.title}; arrow keys turn it, plus and minus zoom, 0 resets`);
      self.dots = c.tcp.map(at);
      const things = lrmArrows.things(c, at, self.dots, self.seen), over = field.cleared(width, height, ratio);
      for (const thing of things) thing.put(over);
      lrmAxes.axes(pen, c.box, at);
      lrmSolids.shadow(sheet.cleared(width, height, ratio), c.arms[0], c.box, at);
      laid(sheet, lrmSolids.shade());
      lrmSolids.foot(pen, c.arms[0], c.box, at);
      laid(field, 1);
      for (const arm of c.arms) {
        const links = lrmSolids.capsules(arm, at);
        if (arm.solid) { lrmSolids.solid(pen, links, colour(arm.colour), things); continue; }
        lrmSolids.outline(sheet.cleared(width, height, ratio), arm, links, at);
        laid(sheet, 1);
      }
      laid(field, THROUGH); // arrows behind the arm shine through it
      if (c.bar) lrmAxes.bar(pen, width, height, c.largest, lrmArrows.steps(c.colours));
      if (self.dots[c.row]) ring(pen, self.dots[c.row]);
      if (self.drag && self.drag.box) frame(pen, ...self.drag.box);
    }

    wire(canvas, self, on);
    new ResizeObserver(later).observe(element);
    return self;
  }

  // Pointer, wheel, fingers and keys on a scene: drag turns it, with shift marks a box of dots, with the right button moves it.
  function wire(canvas, self, on) {
    const NEAR = 9, fingers = new Map();
    const place = (event) => [event.offsetX, event.offsetY];
    const nearest = (at) => {
      const near = self.dots.map((p, row) => [Math.hypot(p[0] - at[0], p[1] - at[1]), row]).filter(([d, row]) => d < NEAR && self.seen(row));
      return near.length ? near.reduce((a, b) => (b[0] < a[0] ? b : a))[1] : null;
    };
    const apart = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    canvas.onpointerdown = (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, place(event));
      self.drag = { from: place(event), last: place(event), moved: false, marks: event.shiftKey, box: null,
        pan: event.button === 2, apart: fingers.size === 2 ? apart() : 0 };
    };
    canvas.onpointermove = (event) => {
      const at = place(event), drag = self.drag;
      if (!drag) {
        const row = nearest(at);
        canvas.style.cursor = row === null ? "grab" : "pointer";
        if (row !== null) on.hover(row);
        return;
      }
      fingers.set(event.pointerId, at);
      const [dx, dy] = [at[0] - drag.last[0], at[1] - drag.last[1]];
      drag.moved = drag.moved || Math.hypot(at[0] - drag.from[0], at[1] - drag.from[1]) > 3;
      if (!drag.moved) return;
      if (fingers.size === 2 && drag.apart) {
        zoom(apart() / drag.apart);
        drag.apart = apart();
      } else if (drag.marks) {
        drag.box = [Math.min(at[0], drag.from[0]), Math.min(at[1], drag.from[1]), Math.abs(at[0] - drag.from[0]),
          Math.abs(at[1] - drag.from[1])];
      } else if (drag.pan) {
        view.shift = [view.shift[0] + dx / canvas.clientWidth / view.zoom, view.shift[1] - dy / canvas.clientWidth / view.zoom];
      } else turn(-0.5 * dx, 0.5 * dy);
      drag.last = at;
      redraw();
    };
    canvas.onpointerup = canvas.onpointercancel = (event) => {
      const drag = self.drag;
      fingers.delete(event.pointerId);
      if (!drag || fingers.size) return;
      self.drag = null;
      if (drag.box) {
        const [x, y, w, h] = drag.box, inside = (p) => p[0] >= x && p[0] <= x + w && p[1] >= y && p[1] <= y + h;
        on.mark([...self.dots.keys()].filter((row) => inside(self.dots[row]) && self.seen(row)));
      } else if (!drag.moved && event.type === "pointerup") {
        const row = nearest(drag.from);
        if (row !== null) on.toggle(row);
      }
      redraw();
    };
    canvas.oncontextmenu = (event) => event.preventDefault();
    canvas.onwheel = (event) => {
      if (document.activeElement !== canvas) return; // the wheel scrolls the page until the scene was clicked
      event.preventDefault();
      zoom(event.deltaY < 0 ? 1.15 : 1 / 1.15);
      redraw();
    };
    canvas.ondblclick = () => look();
    const nearer = () => zoom(1.2), KEYS = { ArrowLeft: () => turn(-10, 0), ArrowRight: () => turn(10, 0), ArrowUp: () => turn(0, 10),
      ArrowDown: () => turn(0, -10), "+": nearer, "=": nearer, "-": () => zoom(1 / 1.2), 0: () => look() };
    canvas.onkeydown = (event) => {
      if (!KEYS[event.key]) return;
      event.preventDefault();
      KEYS[event.key]();
      redraw();
    };
    const turn = (right, up) => {
      view.azimuth += right;
      view.elevation = Math.min(Math.max(view.elevation + up, -90), 90);
    };
    const zoom = (by) => { view.zoom = Math.min(Math.max(view.zoom * by, 0.3), 30); };
  }

  const redraw = () => { for (const one of scenes) one.later(); };

  // All scenes seen from an azimuth and an elevation (deg); from where they were first without.
  function look(from) {
    const [azimuth, elevation] = from || FIRST;
    Object.assign(view, { azimuth, elevation, from: [azimuth, elevation], zoom: 1, shift: [0, 0] });
    redraw();
  }
  look();

  // The height of an element in which a box fills its width: a style for it.
  function fitted(box) {
    const [across, tall] = extent(box, FIRST), { left, right, top, bottom } = MARGIN;
    return `calc(${(tall / across).toFixed(3)} * (100% - ${left + right}px) + ${top + bottom}px)`;
  }
  return Object.assign(scene, { boxOf, projection, fitted, look, view });
})();
