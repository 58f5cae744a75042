// From where scenes are seen: one orthographic view for all, so that two fields beside each other turn together.
"use strict";
const lrmView = (() => {
  const FIRST = { azimuth: -45, elevation: 27, zoom: 1, shift: [0, 0] }, DEG = Math.PI / 180;
  const view = { ...FIRST, shift: [0, 0] };
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  // The box that everything is in: the least and the greatest corner.
  function boxOf(points) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const p of points) {
      for (let k = 0; k < 3; k++) { low[k] = Math.min(low[k], p[k]); high[k] = Math.max(high[k], p[k]); }
    }
    return [low, high];
  }

  // From mm to the screen: [right, down, towards the viewer (mm)] for a canvas of a size in px; its `scale` in px/mm.
  function projection(box, width, height) {
    const a = view.azimuth * DEG, e = view.elevation * DEG, steep = FIRST.elevation * DEG;
    const right = [-Math.sin(a), Math.cos(a), 0], towards = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    const up = [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)];
    const [low, high] = box, middle = low.map((l, k) => (l + high[k]) / 2), size = low.map((l, k) => high[k] - l);
    const across = Math.hypot(size[0], size[1]), tall = size[2] * Math.cos(steep) + across * Math.sin(steep);
    const scale = view.zoom * Math.min((width - Math.min(64, 0.18 * width)) / across, (height - 56) / tall);
    const at = (p) => {
      const q = p.map((c, k) => c - middle[k]);
      return [width / 2 + scale * (dot(q, right) + view.shift[0] * across), height / 2 + 6 - scale * (dot(q, up) + view.shift[1] * across),
        dot(q, towards)];
    };
    return Object.assign(at, { scale });
  }

  return { FIRST, view, boxOf, projection };
})();
