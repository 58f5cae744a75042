// Pointer, wheel, fingers and keys on a scene: drag turns it, with shift marks a box of dots, with the right button moves it.
// `self`: the scene; `view`: that of all scenes, `first`: what it is reset to; `redraw`: draws them.
"use strict";
function lrmSceneInput(canvas, self, view, first, redraw, on) {
  const NEAR = 9;
  const place = (event) => {
    const frame = canvas.getBoundingClientRect();
    return [event.clientX - frame.left, event.clientY - frame.top];
  };
  function nearest(at) {
    let best = null, distance = NEAR;
    self.dots.forEach((p, row) => {
      const d = Math.hypot(p[0] - at[0], p[1] - at[1]);
      if (d < distance && self.seen(row)) [best, distance] = [row, d];
    });
    return best;
  }
  const fingers = new Map();
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
      const [x, y, w, h] = drag.box;
      on.mark(self.dots.flatMap((p, row) => (p[0] >= x && p[0] <= x + w && p[1] >= y && p[1] <= y + h && self.seen(row) ? [row] : [])));
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
  canvas.ondblclick = () => { reset(); redraw(); };
  canvas.onkeydown = (event) => {
    const moves = { ArrowLeft: [-10, 0], ArrowRight: [10, 0], ArrowUp: [0, 10], ArrowDown: [0, -10] }[event.key];
    if (moves) turn(...moves);
    else if (event.key === "+" || event.key === "=") zoom(1.2);
    else if (event.key === "-") zoom(1 / 1.2);
    else if (event.key === "0") reset();
    else return;
    event.preventDefault();
    redraw();
  };
  const turn = (right, up) => {
    view.azimuth += right;
    view.elevation = Math.min(Math.max(view.elevation + up, -90), 90);
  };
  const zoom = (by) => { view.zoom = Math.min(Math.max(view.zoom * by, 0.3), 30); };
  const reset = () => Object.assign(view, first, { shift: [0, 0] });
}
