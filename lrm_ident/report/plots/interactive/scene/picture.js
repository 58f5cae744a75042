// Controls of the picture of the arm: views, a scrubber over the poses in measured order, which poses are drawn.
"use strict";
function lrmPicture(page) {
  const { state, place, element, hover, tool } = page;
  const filter = { by: "", low: null, high: null };
  let built = null;

  const error = (row) => Math.hypot(...state.values.steps[state.step].residual[row]);
  function kinds() {
    const v = state.values, joints = v.q[0].map((_, i) => [`q${i}`, `joint ${i + 1}, deg`, (row) => v.q[row][i]]);
    return [["", "all poses", () => 0], ["error", "error, mm", error], ...joints, ["load", "load, g", (row) => v.load[row]],
      ["pose", "pose number", (row) => v.pose[row]],
      ...(v.session ? [["session", "session", (row) => v.session[row]]] : [])];
  }

  // The rows that are drawn, or null where all are: those of the fair sample that pass the filter.
  function rows() {
    const v = state.values, of = kinds().find(([key]) => key === filter.by)[2];
    if (!filter.by && (!v.fair || state.worst)) return null;
    return new Set(page.sample().filter((row) => !filter.by || (of(row) >= filter.low && of(row) <= filter.high)));
  }

  function says() {
    const v = state.values, found = rows(), count = found ? found.size : v.pose.length, box = place("picture-says");
    if (box) box.textContent = page.says(count);
  }

  function button(text, label, action) {
    const out = element("button", text);
    out.type = "button";
    out.setAttribute("aria-label", label);
    out.onclick = action;
    return out;
  }

  function number(id, label, changed) {
    const input = element("input");
    Object.assign(input, { type: "number", step: "any", id: "lrm-" + id });
    input.setAttribute("aria-label", label);
    input.onchange = () => { if (input.value !== "") changed(Number(input.value)); draw(); };
    return input;
  }

  const draw = () => { says(); page.drawField(); };

  function by(key) {
    const v = state.values, all = v.pose.map((_, row) => kinds().find(([one]) => one === key)[2](row));
    const ends = key ? [Math.floor(100 * Math.min(...all)) / 100, Math.ceil(100 * Math.max(...all)) / 100] : [null, null];
    [filter.by, filter.low, filter.high] = [key, ...ends];
    [["low", ends[0]], ["high", ends[1]]].forEach(([end, value]) => {
      place("filter-" + end).value = value === null ? "" : value;
    });
    place("filter-range").hidden = !key;
    draw();
  }

  function build(box) {
    const v = state.values, scrub = element("input"), which = element("select");
    const views = [["top", () => [-90, 90]], ["side", () => [-90, 0]], ["tool", tool], ["oblique", () => null]];
    Object.assign(scrub, { type: "range", min: 0, max: v.pose.length - 1, step: 1, id: "lrm-scrub" });
    scrub.setAttribute("aria-label", "poses in measured order");
    scrub.oninput = () => hover(Number(scrub.value));
    which.id = "lrm-filter";
    which.setAttribute("aria-label", "draw only poses by");
    which.append(...kinds().map(([key, text]) => Object.assign(element("option", text), { value: key })));
    which.onchange = () => by(which.value);
    const low = number("filter-low", "from", (value) => { filter.low = value; });
    const high = number("filter-high", "to", (value) => { filter.high = value; });
    const limits = element("span");
    Object.assign(limits, { id: "lrm-filter-range", hidden: true });
    limits.append(" from ", low, " to ", high);
    const sample = button("fair sample / with the worst", "show a fair sample, or also all of the worst poses", () => {
      state.worst = !state.worst;
      sample.setAttribute("aria-pressed", state.worst);
      draw(); page.drawTurn(); page.drawCandidate(); page.drawCards(); page.tellSample();
    });
    sample.setAttribute("aria-pressed", state.worst);
    const said = element("output");
    said.id = "lrm-picture-says";
    const group = (...parts) => { const out = element("span", "", "lrm-group"); out.append(...parts); return out; };
    box.replaceChildren(group("from ", ...views.map(([name, at]) => button(name, `view from: ${name}`, () => lrmScene.look(at())))),
      group("poses ", scrub), group(which, limits), ...(v.fair ? [sample] : []), said);
  }

  // Follows the values and the pose that are shown.
  function follow() {
    const box = place("picture"), v = state.values;
    if (!box) return;
    const of = `${v.data} ${v.pose.length}`;
    if (built !== of) { Object.assign(filter, { by: "", low: null, high: null }); build(box); built = of; }
    place("scrub").value = Math.max(v.pose.indexOf(state.pose), 0);
    says();
  }

  return { rows, follow };
}
