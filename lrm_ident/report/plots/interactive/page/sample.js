// Which poses the picture and the flat charts show: all, or where these are too many a fair sample, or that and all of the worst.
"use strict";
function lrmSample(page) {
  const { state } = page;

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
  function tell() {
    const line = says(points().length);
    for (const box of document.querySelectorAll(".lrm-sample")) box.textContent = line;
  }

  return { sample, points, says, tellSample: tell };
}
