// How the error fell: a waterfall of the nominal arm, the fit and every effect, and what the error is where the model is used.
// Rows of text and bars, so that no label lies over another however narrow the page is.
"use strict";
function lrmStory(page) {
  const { state, fill } = page;

  // One row: what it is, its bar, the error that it leaves. One with a number shows its step; a longer bar is cut, and says so.
  function row(one, scale) {
    const of = (mm) => 100 * Math.min(mm / scale, 1), left = of(one.rms_mm), taken = of(one.before_rms_mm) - left, is = one.number === state.step;
    const small = [one.number && one.kind !== "effect" ? one.kind : "", one.note].filter(Boolean).map((note) => lrmHtml` <small>${note}</small>`);
    const name = one.number === null ? lrmHtml`<span class="lrm-fall-name">${one.title}${small}</span>`
      : lrmHtml`<button type="button" class="lrm-fall-name" data-step="${one.number}" title="show this step" aria-current="${is ? "step" : "false"}">${one.title}${small}</button>`;
    return lrmHtml`<li class="lrm-fall-row lrm-is-${one.kind.replace(" ", "-")}">${name}<span class="lrm-fall-bar"><i class="lrm-left" style="width: ${left}%"></i>
      ${taken > 0 ? lrmHtml`<i class="lrm-taken" style="left: ${left}%; width: ${taken}%"></i>` : ""}
      ${Math.max(one.rms_mm, one.before_rms_mm) > scale ? lrmHtml`<i class="lrm-torn"></i>` : ""}${one.rms_mm > scale ? lrmHtml`<small class="lrm-cut">cut, ${Math.round(one.rms_mm / scale)} × as long</small>` : ""}</span><span class="lrm-fall-mm">${one.left}</span></li>`;
  }

  function drawStory(showStep) {
    const v = state.values, story = v.story, one = page.candidate();
    if (!story) return fill("story", "");
    const { steps, longest, noise } = story, end = steps[steps.length - 1], added = one && one.gain !== null;
    const rows = [...steps.map((step) => ({ ...step, note: v.steps[step.number]?.here === false ? "fitted to other data" : "" })),
      ...(added ? [{ title: `if added: ${one.title}`, kind: "if added", number: null, left: one.held, rms_mm: one.heldOut, before_rms_mm: end.rms_mm }] : []),
      ...story.ends, ...(noise ? [noise] : [])];
    const what = [`RMS error ${story.held_out ? `${v.unseen} (held-out)` : "on these data"}, mm. Pale: error that remains. Solid: error taken away.`,
      added ? "Hatched: what the chosen effect would take away." : "", noise ? `Dotted line: ${noise.title}.` : "",
      steps.some((step) => step.rms_mm > longest) ? "Bars with a gap are cut short." : ""].filter(Boolean).join(" ");
    const box = fill("story", lrmHtml`<ol class="lrm-waterfall" style="--noise: ${noise ? `${100 * Math.min(noise.rms_mm / longest, 1)}%` : "-10%"}">${rows.map((each) => row(each, longest))}</ol>
      <p class="lrm-small lrm-soft">${what}</p>`);
    for (const button of box.querySelectorAll("button")) button.onclick = () => showStep(Number(button.dataset.step));
    lrmGlossary(box);
  }

  return { drawStory };
}
