// Which poses are shown: all, or where these are too many a fair sample, or that and all of the worst; and which are marked
// in every figure: by a box around them, by a click, by why they are worth a look.
"use strict";
function lrmBrush(page) {
  const { state, place } = page;

  // Rows of the sample, in measured order.
  function sample() {
    const v = state.values;
    return v.fair && !state.worst ? v.fair : v.pose.map((_, row) => row);
  }

  // Rows of the points of flat charts: the sample, and what is marked beside it.
  function points() {
    const shown = sample();
    if (!state.brushed || shown.length === state.values.pose.length) return shown;
    const known = new Set(shown);
    return state.values.pose.map((_, row) => row).filter((row) => known.has(row) || state.brushed.has(state.values.pose[row]));
  }

  // Words on `count` poses that are shown; nothing where these are all.
  function says(count) {
    const v = state.values, which = v.fair ? (state.worst ? ", the worst among them" : ", a fair sample") : "";
    return count === v.poses ? "" : `shown: ${count} of ${v.poses} poses${which}`;
  }

  // The line beside every flat chart.
  function tellSample() {
    const line = says(points().length);
    for (const box of document.querySelectorAll(".lrm-sample")) box.textContent = line;
  }

  function brush(poses) {
    state.brushed = poses && poses.size ? poses : null;
    page.drawField(); page.drawTurn(); page.drawCandidate(); tellSample();
    place("brushed").textContent = state.brushed ? `${state.brushed.size} poses marked` : "";
  }

  function toggle(row) {
    if (row === undefined) return;
    const poses = new Set(state.brushed || []), pose = state.values.pose[row];
    if (!poses.delete(pose)) poses.add(pose);
    brush(poses);
  }

  // Rows that are marked, or null where none is.
  const marked = () => state.brushed && state.values.pose.flatMap((pose, row) => (state.brushed.has(pose) ? [row] : []));

  // Row and name of the points of a flat chart, and which of them are marked.
  const poseOf = (rows) => ({ customdata: rows, text: rows.map((row) => `pose ${state.values.pose[row]}`),
    selectedpoints: state.brushed ? rows.flatMap((row, i) => (state.brushed.has(state.values.pose[row]) ? [i] : [])) : null });

  // Events of a scatter whose points carry their row in customdata.
  function wireScatter(figure) {
    figure.on("plotly_hover", (event) => page.hover(event.points[0].customdata));
    figure.on("plotly_selected", (event) => {
      if (event) brush(new Set(event.points.map((p) => p.customdata).filter((row) => row !== undefined)
        .map((row) => state.values.pose[row])));
    });
    figure.on("plotly_deselect", () => brush(null));
    figure.on("plotly_click", (event) => toggle(event.points[0].customdata));
  }

  return { sample, points, says, tellSample, brush, toggle, marked, poseOf, wireScatter };
}
