// Strokes and marks on a canvas, in px.
"use strict";
const lrmPen = (() => {
  const { colour } = lrmChart;

  function stroke(pen, points, ink, width, dash) {
    Object.assign(pen, { strokeStyle: ink, lineWidth: width, lineCap: dash.length ? "butt" : "round" }).setLineDash(dash);
    pen.beginPath();
    for (const [x, y] of points) pen.lineTo(x, y);
    pen.stroke();
  }

  function filled(pen, ink, path) {
    pen.fillStyle = ink;
    pen.beginPath();
    path();
    pen.fill();
  }
  const disc = (pen, [x, y], ink, radius) => filled(pen, ink, () => pen.arc(x, y, radius, 0, 7));
  const polygon = (pen, points, ink) => filled(pen, ink, () => { for (const [x, y] of points) pen.lineTo(x, y); });
  const diamond = (pen, [x, y], ink) => polygon(pen, [[x, y - 6], [x + 6, y], [x, y + 6], [x - 6, y]], ink);

  function ring(pen, [x, y]) {
    const circle = new Path2D();
    circle.arc(x, y, 6, 0, 7);
    Object.assign(pen, { strokeStyle: colour("held"), lineWidth: 2 }).stroke(circle);
  }

  const frame = (pen, x, y, w, h) => stroke(pen, [[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]], colour("ink"), 1, [4, 3]);

  // The style of the words that follow.
  function lettering(pen, size, ink, align, baseline = "middle") {
    Object.assign(pen, { font: `${size}px system-ui, sans-serif`, fillStyle: colour(ink), textAlign: align, textBaseline: baseline });
  }

  return { colour, stroke, disc, polygon, diamond, ring, frame, lettering };
})();
