// What if the chosen effect had a size: arrows, turns and RMS of the last step without it, linear, before any refit.
"use strict";
function lrmWhatIf(page) {
  const { state, place, element, words } = page;
  const MOST = 2; // times the estimate
  let shown = null;

  // What is left of a residual (rows of [x, y, z] or numbers) where a part `added` is explained.
  const without = (values, added) => values.map((value, row) => {
    const part = added[row];
    if (part === null || value === null || (Array.isArray(part) && part.includes(null))) return value;
    return Array.isArray(value) ? value.map((c, k) => c - state.size * part[k]) : value - state.size * part;
  });
  const square = (r) => r[0] ** 2 + r[1] ** 2 + r[2] ** 2;
  const rms = (residual) => Math.sqrt(page.sample().reduce((sum, row) => sum + square(residual[row]), 0) / page.sample().length);
  const active = (number, one) => state.size > 0 && one && number === state.values.steps.length - 1;

  function says(one) {
    const residual = state.values.steps[state.values.steps.length - 1].residual;
    if (!state.size) return "arrows and RMS as if the effect had that size";
    const size = one.size ? `of ${(state.size * one.size.value).toPrecision(2)}${one.size.unit}` : `at ${state.size.toFixed(2)} times its estimate`;
    return `${one.title} ${size}: RMS ${words(rms(without(residual, one.added)))} mm on the poses shown, ${words(rms(residual))} without; ` +
      "linear, before any refit";
  }

  // The slider of the chosen effect. `moved`: draws what depends on it.
  function draw(one, moved) {
    const box = place("what-if");
    if (!box) return;
    if (shown === one && box.firstChild) return;
    [shown, state.size] = [one, 0];
    box.hidden = !one;
    if (!one) return box.replaceChildren();
    const label = element("label", "What if "), input = element("input"), said = element("output", says(one));
    Object.assign(input, { type: "range", min: 0, max: MOST, step: 0.02, value: 0, id: "lrm-what-if-size" });
    input.setAttribute("aria-label", `size of ${one.title}, in times its estimate`);
    said.htmlFor = input.id;
    said.id = "lrm-what-if-says";
    input.oninput = () => {
      state.size = Number(input.value);
      said.textContent = says(one);
      moved();
    };
    label.append(input);
    box.replaceChildren(label, said);
  }

  // What is drawn of the slider follows the effect chosen and the step shown.
  function drawWhatIf() {
    const tried = state.size;
    draw(state.step === state.values.steps.length - 1 ? page.candidate() : null, () => { page.drawField(); page.drawTurn(); });
    if (tried && !state.size) page.drawField();
  }

  return { drawWhatIf, whatIf: { without, active, rms } };
}
