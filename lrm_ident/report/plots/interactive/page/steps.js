// The steps that were taken: the sentence of the step shown, the errors of all, and a card of each. `page`: of figures.js.
"use strict";
function lrmSteps(page) {
  const { state, place, element, draw, words } = page;
  const { colour, binned, at } = lrmChart, FIRST = ["estimate", "certainty", "repair", "empirical term", "could be", "acts most like", "hidden at most"];
  // The course of the error in one line; of an earlier step that is shown, where it stands in it.
  function tellFall() {
    const box = place("fall"), v = state.values, last = v.steps.length - 1;
    if (!box) return;
    const whole = v.story ? v.story.sentence.replaceAll(/(\d) mm/g, "$1\u00a0mm") : `RMS ${v.steps[last].rms} mm`;
    const first = v.ranking.find((one) => one.verdict !== "no_evidence");
    const caused = first && v.story && v.story.held_out && !v.facts.some(([label]) => label === "empirical term");
    const added = caused ? ` → ${first.held} mm with ${first.title}` : "";
    const shown = state.step === last ? "" : ` Shown: step ${state.step}, ${v.steps[state.step].title}.`;
    box.replaceChildren(element("span", whole + added, "lrm-fall-figure"), element("span", shown, "lrm-soft"));
  }

  // What a step found; what the data cannot tell it from is named with it.
  function named(card) {
    const others = card.equivalent, more = others.length > 2 ? `, or one of ${others.length - 1} more` : "";
    const rivals = others.length ? ` (or ${others.slice(0, others.length > 2 ? 1 : 2).join(", or ")}${more}: these poses cannot distinguish them)` : "";
    return [card.title, card.estimate].filter(Boolean).join(", ") + rivals;
  }

  // The verdict is of the model that is shown; the diagnosis of an earlier one says what led to the next step.
  function tellVerdict() {
    const box = place("verdict"), v = state.values, last = v.steps.length - 1, next = place("next");
    if (next) next.replaceChildren(...(state.step === last ? following(v) : []));
    if (!box) return;
    const first = v.ranking.find((one) => one.verdict !== "no_evidence"), sketch = place("sketch");
    const caused = first && !v.facts.some(([label]) => label === "empirical term"); // what has no cause has no picture of one
    if (sketch) sketch.replaceChildren(...(caused && state.step === last ? [lrmSketch(first.name)] : []));
    drawFacts(place("facts"), state.step === last ? v.facts : []);
    const own = state.step === last ? v.verdict : v.steps[state.step].verdict;
    const earlier = own ? `At step ${state.step}, before what came next: ${own}` : `Step ${state.step} of ${last} is shown; its diagnosis is not kept.`;
    box.textContent = state.step === last ? own : earlier;
  }

  // What to do next: in words, and as commands to copy.
  function following({ next, commands }) {
    const copied = commands.flatMap(([command, words, then], k) => [element("br", ""), k ? "or: " : "", element("code", command), ` – ${words}`,
      ...(then ? [" Then: ", element("code", then)] : [])]);
    const said = [next || commands.length ? `Next: ${next}` : "", ...copied];
    return said.filter(Boolean);
  }

  // Labelled facts of the verdict that is shown: how sure it is first, the others folded.
  function drawFacts(box, facts) {
    if (!box) return;
    const listed = (rows) => {
      const list = element("dl", "", "facts");
      list.append(...rows.flatMap(([label, said]) => [element("dt", label), element("dd", said)]));
      return rows.length ? [list] : [];
    };
    const first = facts.filter(([label]) => FIRST.includes(label)), rest = facts.filter(([label]) => !FIRST.includes(label));
    const more = element("details", "");
    more.append(element("summary", "More figures"), ...listed(rest));
    box.replaceChildren(...listed(first), ...(rest.length ? [more] : []));
    lrmGlossary(box);
  }

  // ---- cards

  function drawCards() {
    const box = place("cards"), v = state.values;
    if (!box) return;
    if (drawCards.of !== v) box.replaceChildren(...v.cards.map(article), together());
    drawCards.of = v;
    box.closest("section").hidden = !v.cards.length;
    v.cards.forEach(drawCard);
    lrmGlossary(box);
  }

  // The end of the course: what all steps did.
  function together() {
    const v = state.values, all = v.together;
    if (all) return element("p", `All ${all.steps} steps together: ${all.fall} mm${all.held_out ? ", held out" : ""}.`, "lrm-together");
    return "";
  }

  // What is known of other effects where none is listed; else how to learn it.
  function others(card) {
    if (card.asked) return "No other effect came close.";
    const steps = state.values.steps.length - card.number, times = steps > 1 ? ` ${steps} times` : "";
    return `What else it could have been is not in the model file: undo ${steps > 1 ? "these steps" : "this step"}` +
      ` (lrm-ident undo${times}) and diagnose the model before it (lrm-ident diagnose).`;
  }

  function article(card) {
    const out = element("article", "", "lrm-card-of-step"), fall = `${card.fall} mm`.replaceAll(" ", "\u00a0");
    const heading = element("h3", `${card.number}. ${named(card)}: ${fall}`);
    const share = card.share === null ? "" : `; explains ${Math.round(100 * card.share)} % of the squared error above the noise`;
    const left = card.shows !== "possible_cause" || card.ratio === null ? "" : ` ${words(card.ratio)} times as much squared error stays unexplained, so another cause may stand behind it.`;
    const says = element("div", "", "lrm-card-says");
    if (card.label) heading.append(" ", element("span", card.label, "lrm-label lrm-shows-" + card.shows));
    says.append(lrmSketch(card.name));
    says.append(element("p", `${card.claim ? (card.equivalent.length ? "If it is this one: " : "") + card.claim + ". " : ""}${card.held_out ? "Held-out RMS" : "RMS on these data"}: ${fall}${share}.${left}`));
    if (card.unrivalled) says.append(element("p", "No other effect explained it as well."));
    if (card.rivals.length) {
      const list = element("ul");
      list.append(...card.rivals.map((one) => element("li", `${one.title} (${one.name}): ${one.why}`)));
      says.append(element("h4", card.equivalent.length ? "What else it could be" : "The other candidates, and why they were not taken"), list);
    } else if (!card.unrivalled) says.append(element("p", others(card), "lrm-soft"));
    const figure = element("div", "", "lrm-figure lrm-card-figure"), more = element("details", "", "lrm-soft");
    figure.id = "lrm-card-" + card.number;
    more.append(element("summary", `${card.estimates.length} coefficient${card.estimates.length > 1 ? "s" : ""} of ${card.name}`), element("p", card.estimates.join(", ")));
    out.append(heading, says, figure, element("p", "", "lrm-sample lrm-soft"), ...(card.estimates.length ? [more] : []));
    return out;
  }

  // The residual against what the effect follows, before and after the step: what it took away is the area between the means.
  function drawCard(card) {
    const v = state.values, driver = v.drivers.find((one) => one.name === card.driver);
    const [before, after] = [v.steps[card.number - 1].turns[card.joint], v.steps[card.number].turns[card.joint]];
    if (!driver) return;
    const rows = page.sample(), x = at(driver.values, rows);
    const points = (name, y, ink, symbol) => ({ type: "scatter", mode: "markers", name, x, y: at(y, rows), hoverinfo: "skip",
      marker: { size: 5, symbol, color: ink, opacity: 0.35 } });
    const mean = (name, y, ink, more) => ({ type: "scatter", mode: "lines+markers", name, ...binned(x, at(y, rows)), hoverinfo: "skip",
      line: { color: ink, width: 3 }, marker: { size: 6, symbol: "square" }, ...more });
    const traces = [points("before", before, colour("held"), "circle-open"), points("after", after, colour("model"), "circle"),
      mean("mean before", before, colour("held")), mean("mean after", after, colour("model"), { fill: "tonexty", fillcolor: colour("bar") })];
    const means = traces.slice(2).flatMap((one) => one.y).map(Math.abs), sizes = at(before, rows).filter((y) => y !== null).map(Math.abs);
    const most = Math.max(2.2 * Math.max(...means), sizes.sort((a, b) => a - b)[sizes.length >> 1] || 0) || 1, beyond = sizes.filter((y) => y > most).length;
    draw("card-" + card.number, traces, { dragmode: false, xaxis: { title: { text: driver.label + (beyond ? `<br>${beyond} points are beyond` : ""), standoff: 4, font: { size: 12 } } },
      yaxis: { title: { text: `turn of joint ${card.joint + 1}, deg`, standoff: 4, font: { size: 12 } }, range: [-most, most] } });
  }

  return { tellFall, tellVerdict, drawCards };
}
