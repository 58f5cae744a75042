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

  function disc(pen, p, ink, radius) {
    pen.fillStyle = ink;
    pen.beginPath();
    pen.arc(p[0], p[1], radius, 0, 7);
    pen.fill();
  }

  function diamond(pen, p, ink) {
    pen.fillStyle = ink;
    pen.beginPath();
    for (const [x, y] of [[0, -6], [6, 0], [0, 6], [-6, 0]]) pen.lineTo(p[0] + x, p[1] + y);
    pen.fill();
  }

  function ring(pen, p) {
    pen.strokeStyle = colour("held");
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(p[0], p[1], 6, 0, 7);
    pen.stroke();
  }

  function frame(pen, x, y, w, h) {
    pen.strokeStyle = colour("ink");
    pen.setLineDash([4, 3]);
    pen.lineWidth = 1;
    pen.strokeRect(x, y, w, h);
    pen.setLineDash([]);
  }

  return { colour, stroke, disc, diamond, ring, frame };
})();
