// Strokes and marks on a canvas, in px.
"use strict";
const lrmPen = (() => {
  const { colour } = lrmChart;

  function stroke(pen, points, ink, width, dash) {
    pen.strokeStyle = ink;
    pen.lineWidth = width;
    pen.lineCap = dash.length ? "butt" : "round";
    pen.setLineDash(dash);
    pen.beginPath();
    points.forEach((p, i) => (i ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])));
    pen.stroke();
    pen.setLineDash([]);
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

  function ring(pen, p) {
    pen.strokeStyle = colour("held");
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(p[0], p[1], 6, 0, 7);
    pen.stroke();
  }

  const frame = (pen, x, y, w, h) => stroke(pen, [[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]], colour("ink"), 1, [4, 3]);

  // The style of the words that follow.
  function lettering(pen, size, ink, align, baseline = "middle") {
    Object.assign(pen, { font: `${size}px system-ui, sans-serif`, fillStyle: colour(ink), textAlign: align, textBaseline: baseline });
  }

  return { colour, stroke, disc, polygon, diamond, ring, frame, lettering };
})();
