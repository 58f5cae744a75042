// Which poses are shown: all, or where these are too many a fair sample, or that and all of the worst; and which are marked
// in every figure: by a box around them, by a click, by why they are worth a look; in the scene those that pass a filter.
// The one that is pointed at: its words, both arms, its place in every figure.
"use strict";
function lrmBrush(page) {
  const { state, scenes, place, options, words, norm, rowOfPose } = page;
  let open = null;

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

  // What the scene may be filtered by: a key, its words, its value at a row.
  function kinds() {
    const v = state.values, error = (row) => norm(v.steps[state.step].residual[row]);
    const joints = v.q[0].map((_, i) => [`q${i}`, `joint ${i + 1}, deg`, (row) => v.q[row][i]]);
    const others = [["load", "load, g"], ["pose", "pose number"], ...(v.session ? [["session", "session"]] : [])];
    return [["", "all poses", () => 0], ["error", "error, mm", error], ...joints,
      ...others.map(([key, said]) => [key, said, (row) => v[key][row]])];
  }
  const chosen = () => kinds().find(([key]) => key === place("filter").value);

  // The rows that the scene draws, or null where all are: those of the fair sample that pass the filter.
  function rows() {
    const [by, , of] = chosen() || [""], [low, high] = ["low", "high"].map((end) => place("filter-" + end).value);
    if (!by && (!state.values.fair || state.worst)) return null;
    return new Set(sample().filter((row) => !by || ((low === "" || of(row) >= low) && (high === "" || of(row) <= high))));
  }

  function tellRows() {
    place("picture-says").textContent = says(rows()?.size ?? state.values.pose.length);
  }

  // Another quantity to filter by: from its least value to its greatest.
  function filterBy() {
    const [key, , of] = chosen(), all = state.values.pose.map((_, row) => of(row));
    place("filter-low").value = key ? Math.floor(100 * Math.min(...all)) / 100 : "";
    place("filter-high").value = key ? Math.ceil(100 * Math.max(...all)) / 100 : "";
    place("filter-range").hidden = !key;
  }

  function hover(row) {
    if (row === undefined || state.values.pose[row] === state.pose) return;
    state.pose = state.values.pose[row];
    tell();
    for (const id of ["field", "field-b"]) scenes[id]?.point(row, page.arms());
  }

  function tell() {
    const v = state.values, row = rowOfPose(), input = place("pose"), r = v.steps[state.step].residual[row];
    if (document.activeElement !== input) input.value = v.pose[row];
    page.tellFall();
    page.tellVerdict();
    follow();
    place("pose-note").textContent = `pose ${v.pose[row]}: q ${v.q[row].map((a) => a.toFixed(0)).join(" ")} deg, load ${v.load[row]} g, ` +
      `error ${words(norm(r))} mm (${r.map((c) => (c < 0 ? "" : "+") + c.toFixed(2)).join(" ")})`;
  }

  // The controls of the scene follow the values and the pose that are shown.
  function follow() {
    const v = state.values, of = `${v.data} ${v.pose.length}`;
    if (open !== of) {
      open = of;
      options("filter", kinds(), "");
      place("filter-range").hidden = true;
      place("scrub").max = v.pose.length - 1;
    }
    place("worst").hidden = !v.fair;
    place("worst").setAttribute("aria-pressed", state.worst);
    place("scrub").value = Math.max(v.pose.indexOf(state.pose), 0);
    tellRows();
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
    figure.on("plotly_hover", (event) => hover(event.points[0].customdata));
    figure.on("plotly_selected", (event) => {
      if (event) brush(new Set(event.points.map((p) => p.customdata).filter((row) => row !== undefined)
        .map((row) => state.values.pose[row])));
    });
    figure.on("plotly_deselect", () => brush(null));
    figure.on("plotly_click", (event) => toggle(event.points[0].customdata));
  }

  return { sample, points, tellSample, rows, tellRows, filterBy, hover, tell, follow, brush, toggle, marked, poseOf, wireScatter };
}
