// The steps that were taken: the sentence of the step shown, the errors of all, and a card of each. `page`: of figures.js.
"use strict";
function lrmSteps(page) {
  const { state, place, fill, draw, words } = page;
  const { colour, means, at, dots, titled } = lrmChart;
  const plural = (count, word) => `${count} ${word}${count > 1 ? "s" : ""}`;

  // The candidate that the verdict names, if it is a cause: what has none has no picture of one.
  function cause() {
    const { ranking, facts } = state.values, first = ranking.find((one) => one.verdict !== "no_evidence");
    return first && !facts.some(([label]) => label === "empirical term") ? first : null;
  }

  // The course of the error in one line; of an earlier step that is shown, where it stands in it.
  function tellFall() {
    const v = state.values, last = v.steps.length - 1, first = cause();
    const added = first && v.story?.held_out ? ` → with ${first.title}: ${first.held}` : "";
    const whole = v.story ? v.story.sentence.replace(" mm RMS", added + "\u00a0mm RMS") : `RMS ${v.steps[last].rms} mm`;
    const shown = state.step === last ? "" : ` Shown: step ${state.step}, ${v.steps[state.step].title}.`;
    lrmGlossary(fill("fall", lrmHtml`<span class="lrm-fall-figure">${whole}</span><span class="lrm-soft">${shown}</span>`));
  }

  // The verdict is of the model that is shown; the diagnosis of an earlier one says what led to the next step.
  function tellVerdict() {
    const v = state.values, last = v.steps.length - 1, now = state.step === last, own = now ? v.verdict : v.steps[state.step].verdict;
    fill("next", now ? following(v.next) : "");
    fill("sketch", now ? lrmSketch(cause()?.sketch) : "");
    fillFacts(now ? v.facts : []);
    const earlier = own ? `At step ${state.step}, before what came next: ${own}` : `Step ${state.step} of ${last} is shown; its diagnosis is not kept.`;
    place("verdict").textContent = now ? own : earlier;
  }

  // A command to copy, whose lines break between its words; one that is longer than a line, after a comma or slash.
  const parts = (word) => word.split(/(?<=[,/])/).map((part, k) => lrmHtml`${k ? lrmHtml`<wbr>` : ""}${part}`);
  const code = (command) => lrmHtml`<code>${command.split(" ").map((word, k) => lrmHtml`${k ? " " : ""}<span>${parts(word)}</span>`)}</code>`;

  // What to do next, in order: in words, and the commands to copy.
  const following = (steps) => steps.length ? lrmHtml`<b>Next</b> ${steps.map(([label, said, commands]) => lrmHtml`<div class="lrm-next-step"><b>${label}</b> ${said}${commands.map(code)}</div>`)}` : "";

  // Labelled facts of the verdict that is shown: how sure it is first, the others folded.
  function fillFacts(facts) {
    const first = facts.filter(([, , early]) => early), rest = facts.filter(([, , early]) => !early);
    const listed = (rows) => rows.length ? lrmHtml`<dl class="facts">${rows.map(([label, said]) => lrmHtml`<dt>${label}</dt><dd>${said}</dd>`)}</dl>` : "";
    lrmGlossary(fill("facts", lrmHtml`${listed(first)}${rest.length ? lrmHtml`<details><summary>More figures</summary>${listed(rest)}</details>` : ""}`));
  }

  // ---- cards

  function drawCards() {
    const box = place("cards"), v = state.values;
    if (drawCards.of !== v) fill("cards", lrmHtml`${v.cards.map(article)}`);
    drawCards.of = v;
    box.closest("section").hidden = !v.cards.length;
    v.cards.forEach(drawCard);
    lrmGlossary(box);
  }

  // What a step found; what the data cannot tell it from is named with it.
  function named(card) {
    const others = card.equivalent, more = others.length > 2 ? `, or one of ${others.length - 1} more` : "";
    const rivals = others.length ? ` (or ${others.slice(0, others.length > 2 ? 1 : 2).join(", or ")}${more}: these poses cannot distinguish them)` : "";
    return [card.title, card.estimate].filter(Boolean).join(", ") + rivals;
  }

  // What is known of other effects where none is listed; else how to learn it.
  function others(card) {
    if (card.asked) return "No other effect came close.";
    const steps = state.values.steps.length - card.number, times = steps > 1 ? ` ${steps} times` : "";
    return `What else it could have been is not in the model file: undo ${steps > 1 ? "these steps" : "this step"}` +
      ` (lrm-ident undo${times}) and diagnose the model before it (lrm-ident diagnose).`;
  }

  function article(card) {
    const fall = `${card.fall} mm`.replaceAll(" ", "\u00a0"), one = card.equivalent.length ? "If it is this one: " : "";
    const share = card.share === null || !card.adds ? "" : `; explains ${Math.round(100 * card.share)} % of the squared error above the noise`;
    const left = card.shows !== "possible_cause" || card.ratio === null ? "" : ` ${Number(card.ratio.toPrecision(2))} times as much squared error stays unexplained, so another cause may stand behind it.`;
    const rivals = lrmHtml`<h4>${card.equivalent.length ? "What else it could be" : "The other candidates"}, and what each alone would have left</h4>
      <ul>${card.rivals.map((rival) => lrmHtml`<li>${rival.title} (${rival.name}): ${rival.why}</li>`)}</ul>`;
    return lrmHtml`<article class="lrm-card-of-step lrm-shows-${card.shows}"><h3>${card.number}. ${named(card)}: ${fall}${card.label ? lrmHtml` <span class="lrm-label">${card.label}</span>` : ""}</h3>
      <div class="lrm-card-says">${lrmSketch(card.sketch)}
        <p>${card.claim ? `${one}${card.claim}. ` : ""}RMS error ${card.held_out ? state.values.unseen : "on these data"}: ${fall}${share}.${left}</p>
        ${card.unrivalled ? lrmHtml`<p>No other effect explained it as well.</p>` : ""}
        ${card.rivals.length ? rivals : card.unrivalled || !card.adds ? "" : lrmHtml`<p class="lrm-soft">${others(card)}</p>`}</div>
      <div class="lrm-figure lrm-card-figure" id="lrm-card-${card.number}"></div><p class="lrm-sample lrm-soft"></p>
      ${card.estimates.length ? lrmHtml`<details class="lrm-soft"><summary>${plural(card.estimates.length, "coefficient")} of ${card.name}</summary><p>${card.estimates.join(", ")}</p></details>` : ""}</article>`;
  }

  // The residual against what the effect follows, before and after the step: what it took away is the area between the means.
  function drawCard(card) {
    const v = state.values, driver = v.drivers.find((one) => one.name === card.driver);
    const [before, after] = [v.steps[card.number - 1].turns[card.joint], v.steps[card.number].turns[card.joint]];
    if (!driver) return;
    const rows = page.sample(), x = at(driver.values, rows);
    const points = (name, y, color, symbol) => dots(name, x, at(y, rows), { symbol, color, opacity: 0.35 }, { hoverinfo: "skip" });
    const mean = (name, y, color, more) => means(name, x, at(y, rows), { color, width: 3 }, more);
    const traces = [points("before", before, colour("held"), "circle-open"), points("after", after, colour("model"), "circle"),
      mean("mean before", before, colour("held")), mean("mean after", after, colour("model"), { fill: "tonexty", fillcolor: colour("bar") })];
    const heights = traces.slice(2).flatMap((one) => one.y).map(Math.abs), sizes = at(before, rows).filter((y) => y !== null).map(Math.abs);
    const most = Math.max(2.2 * Math.max(...heights), sizes.sort((a, b) => a - b)[sizes.length >> 1] || 0) || 1, beyond = sizes.filter((y) => y > most).length;
    draw("card-" + card.number, traces, { dragmode: false, xaxis: titled(driver.label + (beyond ? `<br>not shown: ${plural(beyond, "point")} beyond` : "")),
      yaxis: titled(`turn of joint ${card.joint + 1}, deg`, { range: [-most, most] }) });
  }

  return { tellFall, tellVerdict, drawCards };
}
