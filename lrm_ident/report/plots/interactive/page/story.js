// How the error fell: a waterfall of the nominal arm, the fit and every effect, and what the error is where the model is used.
// Rows of text and bars, so that no label lies over another however narrow the page is.
"use strict";
function lrmStory(page) {
  const { state, place, element, words } = page;
  const ROOM = 1.4, TORN = 2.2; // the longest bar beside the others; the nominal one is torn off where it is so much longer
  const SOLID = { nominal: "nominal arm", fit: "geometry and springs", "identified cause": "identified cause",
    "indistinguishable cause": "indistinguishable cause",
    "candidate cause": "candidate cause", "empirical term": "empirical term", effect: "effect" };
  const slug = (kind) => kind.replace(" ", "-");

  function bar(one, scale) {
    const box = element("span", "", "lrm-fall-bar"), of = (mm) => 100 * Math.min(mm / scale, 1), left = element("i", "", "lrm-left");
    left.style.width = of(one.left_mm) + "%";
    box.append(left);
    if (one.before_mm > one.left_mm) {
      const taken = element("i", "", "lrm-taken");
      Object.assign(taken.style, { left: of(one.left_mm) + "%", width: of(one.before_mm) - of(one.left_mm) + "%" });
      box.append(taken);
    }
    if (Math.max(one.left_mm, one.before_mm || 0) > scale) box.append(element("i", "", "lrm-torn"));
    return box;
  }

  // One row: what it is, its bar, the error that it leaves. `show`: makes the step the one that is shown.
  function row(one, scale, show) {
    const out = element("li", "", "lrm-fall-row lrm-is-" + slug(one.kind)), name = element(show ? "button" : "span", "", "lrm-fall-name");
    name.append(one.title);
    if (SOLID[one.kind] && one.number) name.append(" ", element("small", one.kind === "effect" ? "" : one.kind));
    if (one.note) name.append(" ", element("small", one.note));
    if (show) {
      Object.assign(name, { type: "button", onclick: show, title: "show this step" });
      name.setAttribute("aria-current", one.number === state.step ? "step" : "false");
    }
    out.append(name, bar(one, scale), element("span", one.left, "lrm-fall-mm"));
    return out;
  }

  function drawStory(showStep) {
    const box = place("story"), v = state.values, story = v.story;
    if (!box) return;
    if (!story) return box.replaceChildren();
    const steps = story.steps, later = Math.max(...steps.slice(1).map((one) => one.left_mm)), most = Math.max(...steps.map((one) => one.left_mm));
    const scale = most > TORN * later ? ROOM * later : most, list = element("ol", "", "lrm-waterfall"), one = page.candidate();
    const noise = story.noise_rms_mm ?? story.noise_bound_rms_mm ?? null;
    const known = (number) => v.history[number] && !v.history[number].here ? "fitted to other data" : "";
    list.append(...steps.map((step) => row({ ...step, note: step.number === null ? "" : known(step.number) }, scale,
      step.number === null ? null : () => showStep(step.number))));
    if (one && one.gain !== null) {
      const now = steps[steps.length - 1].left_mm;
      list.append(row({ title: `if added: ${one.title}`, kind: "if added", number: null, left: one.held, left_mm: one.heldOut, before_mm: now }, scale));
    }
    const end = steps[steps.length - 1], other = end.deployed_mm !== null && end.deployed_mm !== undefined && words(end.deployed_mm) !== words(end.left_mm);
    const ends = [["as deployed", other ? end.deployed_mm : null], ["nested", story.nested_rms_mm],
      [story.noise_rms_mm === null ? "noise at most" : "measurement noise", noise]].filter(([, mm]) => mm !== null && mm !== undefined);
    list.append(...ends.map(([title, mm]) => row({ title, kind: "end", number: null, left: words(mm), left_mm: mm, before_mm: mm }, scale)));
    list.style.setProperty("--noise", noise === null ? "-10%" : 100 * Math.min(noise / scale, 1) + "%");
    const what = `${story.held_out ? "RMS error at poses that the fit did not use (held-out)" : "RMS error on these data"}, mm. Pale: error that remains. Solid: error taken away.${one && one.gain !== null ? " Hatched: what the chosen effect would take away." : ""}` +
      (noise === null ? "" : " Dotted line: measurement noise.") + (scale < most ? " The bar of the nominal arm is cut short." : "");
    box.replaceChildren(list, element("p", what, "lrm-small lrm-soft"));
    lrmGlossary(box);
  }

  return { drawStory };
}
