// What all flat charts share: colours of the page's style, and Plotly's layout and buttons.
"use strict";
const lrmChart = (() => {
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();

  function layout(extra) {
    const ink = colour("ink"), axis = { gridcolor: colour("grid"), zerolinecolor: colour("line"), automargin: true };
    const base = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink, size: 12, family: "system-ui, sans-serif" },
      margin: { l: 8, r: 8, t: 8, b: 8 }, showlegend: true, hovermode: "closest", dragmode: "select",
      legend: { orientation: "h", x: 0, y: 1, yanchor: "bottom", font: { size: 11 } }, uirevision: "kept",
    };
    const out = Object.assign(base, extra);
    for (const key of ["xaxis", "yaxis"]) if (out[key]) out[key] = Object.assign({}, axis, out[key]);
    return out;
  }

  const CONFIG = { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["toImage", "sendDataToCloud"] };
  return { colour, layout, CONFIG };
})();
