// Controls of the picture of the arm: views, a scrubber over the poses in measured order, which poses are drawn.
"use strict";
function lrmPicture(page) {
  const { state, place, options, hover, tool } = page;
  const VIEWS = { top: () => [-90, 90], side: () => [-90, 0], tool, oblique: () => null };
  let open = null;

  const error = (row) => Math.hypot(...state.values.steps[state.step].residual[row]);
  function kinds() {
    const v = state.values, joints = v.q[0].map((_, i) => [`q${i}`, `joint ${i + 1}, deg`, (row) => v.q[row][i]]);
    return [["", "all poses", () => 0], ["error", "error, mm", error], ...joints, ["load", "load, g", (row) => v.load[row]],
      ["pose", "pose number", (row) => v.pose[row]],
      ...(v.session ? [["session", "session", (row) => v.session[row]]] : [])];
  }
  const chosen = () => kinds().find(([key]) => key === place("filter").value);

  // The rows that are drawn, or null where all are: those of the fair sample that pass the filter.
  function rows() {
    const v = state.values, [by, , of] = chosen() || [""], low = place("filter-low").value, high = place("filter-high").value;
    if (!by && (!v.fair || state.worst)) return null;
    return new Set(page.sample().filter((row) => !by || ((low === "" || of(row) >= low) && (high === "" || of(row) <= high))));
  }

  function says() {
    const found = rows();
    place("picture-says").textContent = page.says(found ? found.size : state.values.pose.length);
  }

  const draw = () => { says(); page.drawField(); };

  // Another quantity to filter by: from its least value to its greatest.
  function by() {
    const [key, , of] = chosen(), all = state.values.pose.map((_, row) => of(row));
    place("filter-low").value = key ? Math.floor(100 * Math.min(...all)) / 100 : "";
    place("filter-high").value = key ? Math.ceil(100 * Math.max(...all)) / 100 : "";
    place("filter-range").hidden = !key;
    draw();
  }

  function wirePicture() {
    for (const one of document.querySelectorAll("[data-view]")) one.onclick = () => lrmScene.look(VIEWS[one.dataset.view]());
    place("scrub").oninput = (event) => hover(Number(event.target.value));
    place("filter").onchange = by;
    for (const end of ["low", "high"]) place("filter-" + end).onchange = draw;
    place("worst").onclick = () => {
      state.worst = !state.worst;
      draw(); page.drawTurn(); page.drawCandidate(); page.drawCards(); page.tellSample(); follow();
    };
  }

  // Follows the values and the pose that are shown.
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
    says();
  }

  return { rows, follow, wirePicture };
}
