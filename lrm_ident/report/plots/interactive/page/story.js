// How the error fell: a waterfall of the nominal arm, the fit and every effect, and what the error is where the model is used.
// Rows of text and bars, so that no label lies over another however narrow the page is.
"use strict";
function lrmStory(page) {
  const { state, fill, words } = page;
  const ROOM = 1.4, TORN = 2.2; // the longest bar beside the others; the nominal one is torn off where it is so much longer

  // One row: what it is, its bar, the error that it leaves. One with a number shows its step.
  function row(one, scale) {
    const of = (mm) => 100 * Math.min(mm / scale, 1), left = of(one.rms_mm), taken = of(one.before_rms_mm) - left, is = one.number === state.step;
    const small = [one.number && one.kind !== "effect" ? one.kind : "", one.note].filter(Boolean).map((note) => lrmHtml` <small>${note}</small>`);
    const name = one.number === null ? lrmHtml`<span class="lrm-fall-name">${one.title}${small}</span>`
      : lrmHtml`<button type="button" class="lrm-fall-name" data-step="${one.number}" title="show this step" aria-current="${is ? "step" : "false"}">${one.title}${small}</button>`;
    return lrmHtml`<li class="lrm-fall-row lrm-is-${one.kind.replace(" ", "-")}">${name}<span class="lrm-fall-bar"><i class="lrm-left" style="width: ${left}%"></i>
      ${taken > 0 ? lrmHtml`<i class="lrm-taken" style="left: ${left}%; width: ${taken}%"></i>` : ""}
      ${Math.max(one.rms_mm, one.before_rms_mm) > scale ? lrmHtml`<i class="lrm-torn"></i>` : ""}</span><span class="lrm-fall-mm">${one.left}</span></li>`;
  }

  function drawStory(showStep) {
    const v = state.values, story = v.story, one = page.candidate();
    if (!story) return fill("story", "");
    const steps = story.steps, end = steps[steps.length - 1], added = one && one.gain !== null;
    const later = Math.max(...steps.slice(1).map((step) => step.rms_mm)), most = Math.max(...steps.map((step) => step.rms_mm));
    const scale = most > TORN * later ? ROOM * later : most, noise = story.noise_rms_mm ?? story.noise_bound_rms_mm ?? null;
    const dotted = "measurement noise" + (story.noise_rms_mm === null ? ", at most" : "");
    const other = end.deployed_rms_mm !== null && words(end.deployed_rms_mm) !== words(end.rms_mm);
    const ends = [["as deployed", other ? end.deployed_rms_mm : null], ["nested", story.nested_rms_mm],
      [dotted, noise]].filter(([, mm]) => mm !== null);
    const rows = [...steps.map((step) => ({ ...step, note: v.history[step.number]?.here === false ? "fitted to other data" : "" })),
      ...(added ? [{ title: `if added: ${one.title}`, kind: "if added", number: null, left: one.held, rms_mm: one.heldOut, before_rms_mm: end.rms_mm }] : []),
      ...ends.map(([title, mm]) => ({ title, kind: "end", number: null, left: words(mm), rms_mm: mm, before_rms_mm: mm }))];
    const what = [`RMS error ${story.held_out ? `${v.unseen} (held-out)` : "on these data"}, mm. Pale: error that remains. Solid: error taken away.`,
      added ? "Hatched: what the chosen effect would take away." : "", noise === null ? "" : `Dotted line: ${dotted}.`,
      scale < most ? "Bars with a gap are cut short." : ""].filter(Boolean).join(" ");
    const box = fill("story", lrmHtml`<ol class="lrm-waterfall" style="--noise: ${noise === null ? "-10%" : 100 * Math.min(noise / scale, 1) + "%"}">${rows.map((each) => row(each, scale))}</ol>
      <p class="lrm-small lrm-soft">${what}</p>`);
    for (const button of box.querySelectorAll("button")) button.onclick = () => showStep(Number(button.dataset.step));
    lrmGlossary(box);
  }

  return { drawStory };
}
