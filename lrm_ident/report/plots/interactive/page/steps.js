// The steps that were taken: the sentence of the step shown, the errors of all, and a card of each. `page`: of figures.js.
"use strict";
function lrmSteps(page) {
  const { state, place, element, draw, words } = page;
  const { colour, binned, range, at } = lrmChart, PAPER_PX = 700, FEWEST_LETTERS = 12; // of a step's title, else its number stands alone
  const inMm = (value) => `${words(Number(value))}\u00a0mm`; // no line ends before its unit
  const floorWords = () => {
    const v = state.values;
    return v.floor !== null ? `noise ${inMm(v.floor)}` : v.bound !== null ? `noise at most ${inMm(v.bound)}` : "";
  };

  // One sentence and figure on the step shown; what it says and what is drawn are of the same step.
  function tellFall() {
    const box = place("fall"), v = state.values, number = state.step, card = v.cards.find((one) => one.number === number);
    if (!box) return;
    const what = card ? named(card) : number ? v.steps[number].title : `${v.fitted} parameters fitted`;
    const whole = number && number === v.steps.length - 1 && number > 1 ? storyOf(number) : "";
    const [from, to] = card ? [card.before, card.after] : [number ? v.steps[number - 1].rms : v.nominalRms, v.steps[number].rms];
    const held = number || heldOut(0) === null ? "" : `; ${inMm(heldOut(0))} held out`;
    const kind = card && card.held_out ? "held-out RMS" : number ? "RMS on these data" : `RMS from nominal to fitted${held}`;
    const figure = element("span", `${words(Number(from))} → ${inMm(to)}`, "lrm-fall-figure");
    if (whole) {
      box.replaceChildren(element("span", whole, "lrm-fall-figure"), " ",
        element("span", ["held-out RMS", deployedWords(number), floorWords()].filter(Boolean).join(", "), "lrm-soft"));
    } else box.replaceChildren(element("span", what + ": ", "lrm-fall-what"), figure, " ",
      element("span", [kind, deployedWords(number), floorWords()].filter(Boolean).join(", "), "lrm-soft"));
    lrmGlossary(box);
  }

  // The whole course: nominal, after the fit, after the last step; nothing where held-out errors are not known.
  function storyOf(last) {
    if (heldOut(0) === null || heldOut(last) === null) return "";
    const steps = `${last} effect${last > 1 ? "s" : ""}`;
    return `nominal ${words(Number(state.values.nominalRms))} → fit ${words(heldOut(0))} → ${steps} ${inMm(heldOut(last))}`;
  }

  // What the arm gets of a step: its held-out error without what no rover can know.
  function deployedWords(number) {
    const entry = state.values.history[number];
    return entry && entry.here && entry.deployed !== null ? `as deployed ${inMm(entry.deployed)}` : "";
  }

  // Held-out error (mm) of a step, by default the last one, on the open data; null if it is not known.
  function heldOut(number = state.values.history.length - 1) {
    const entry = state.values.history[number];
    return entry && entry.here && entry.held !== null ? entry.held : null;
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
    if (next) next.textContent = state.step === last && v.next ? `Next: ${v.next}` : "";
    if (!box) return;
    drawFacts(place("facts"), state.step === last ? v.facts : []);
    const own = state.step === last ? v.verdict : v.steps[state.step].verdict;
    const earlier = own ? `At step ${state.step}, before what came next: ${own}` : `Step ${state.step} of ${last} is shown; its diagnosis is not kept.`;
    box.textContent = state.step === last ? own : earlier;
  }

  // Labelled facts of the verdict that is shown.
  function drawFacts(box, facts) {
    if (!box) return;
    const list = element("dl", "", "facts");
    list.append(...facts.flatMap(([label, said]) => [element("dt", label), element("dd", said)]));
    box.replaceChildren(...(facts.length ? [list] : []));
  }

  // Titles of steps stand at their ticks where they fit, which is known once the figure is on the screen.
  function watchWidth(box, showStep) {
    if (!watchWidth.of) watchWidth.of = new ResizeObserver(() => { if (box.clientWidth !== watchWidth.drawn) drawHistory(showStep); });
    watchWidth.of.observe(box);
    watchWidth.drawn = box.clientWidth;
  }

  function drawHistory(showStep) {
    const v = state.values, h = v.history;
    if (!h.length) return;
    const x = h.map((_, i) => i), names = h.map((one, i) => `${i} ${one.title}`), other = h.some((one) => !one.here);
    const line = (name, y, dash, symbol, ink) => ({ type: "scatter", mode: "lines+markers", name, x, y, customdata: x,
      text: h.map((one, i) => names[i] + (one.data ? `<br>data ${one.data}` : "")), hovertemplate: "%{text}<br>%{y:.2f} mm<extra></extra>",
      line: { color: ink, dash, width: 2 }, marker: { symbol, size: x.map((i) => i === state.step ? 14 : 9) } });
    const here = (key) => h.map((one) => (one.here ? one[key] : null));
    const traces = [line("fit", here("fit"), "solid", "circle", colour("model")),
      line("held out", here("held"), "dash", "diamond", colour("held"))];
    if (h.some((one) => one.here && one.deployed !== null)) traces.push(line("as deployed, held out", here("deployed"), "dot", "square", colour("ink")));
    if (other) {
      traces.push({ ...line("fitted to other data, error on these", h.map((one) => (one.here ? null : one.rms)), "solid",
        "circle-open", colour("soft")), mode: "markers" });
    }
    const one = page.candidate();
    if (one && one.gain !== null && heldOut() !== null) {
      traces.push({ type: "scatter", mode: "markers", name: "held out, if added", x: [h.length], y: [one.heldOut],
        hovertemplate: `${one.title}<br>%{y:.2f} mm<extra></extra>`, marker: { symbol: "diamond-open", size: 11, color: colour("held") } });
    }
    const floor = v.floor !== null ? v.floor : v.bound;
    const shapes = floor === null ? [] : [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: floor, y1: floor, name: floorWords(),
      showlegend: true, line: { dash: "dot", color: colour("ink") } }];
    const most = Math.max(...h.map((one) => (one.here ? Math.max(one.fit, one.held || 0, one.deployed || 0) : one.rms)));
    const box = place("history"), wide = Math.min(box ? box.clientWidth : PAPER_PX, PAPER_PX), fits = Math.floor(wide / 7 / h.length) - 2; // letters
    if (box) watchWidth(box, showStep);
    const short = (name) => name.length > fits ? name.slice(0, fits - 1) + "…" : name;
    draw("history", traces, { shapes, dragmode: false,
      xaxis: { tickvals: x, ticktext: fits < FEWEST_LETTERS ? x.map(String) : names.map(short), tickangle: 0,
        title: { text: `${v.poses} poses, data ${v.data.slice(0, 8)}`, font: { size: 11 }, standoff: 4 },
        range: [-0.4, h.length + 0.4], fixedrange: true },
      yaxis: { title: { text: "RMS error, mm", standoff: 4 }, range: [0, 1.15 * most], fixedrange: true } },
    (figure) => figure.on("plotly_click", (event) => {
      const number = event.points[0].customdata;
      if (number !== undefined) showStep(number);
    }));
  }

  // ---- cards

  function drawCards() {
    const box = place("cards"), v = state.values;
    if (!box) return;
    if (drawCards.of !== v) box.replaceChildren(...v.cards.map(article), together());
    drawCards.of = v;
    v.cards.forEach(drawCard);
    lrmGlossary(box);
  }

  // The end of the course: what all steps did.
  function together() {
    const v = state.values, all = v.together;
    if (all) return element("p", `All ${all.steps} steps together: ${words(all.before)} → ${words(all.after)} mm${all.held_out ? ", held out" : ""}.`, "lrm-together");
    return v.cards.length ? "" : element("p", "No step beyond the fit was taken.", "lrm-soft");
  }

  // What is known of other effects where none is listed; else how to learn it.
  function others(card) {
    if (card.asked) return "No other effect came close.";
    const steps = state.values.steps.length - card.number, times = steps > 1 ? ` ${steps} times` : "";
    return `What else it could have been is not in the model file: undo ${steps > 1 ? "these steps" : "this step"}` +
      ` (lrm-ident undo${times}) and diagnose the model before it (lrm-ident diagnose).`;
  }

  function article(card) {
    const out = element("article", "", "lrm-card-of-step"), fall = `${words(card.before)}\u00a0→\u00a0${inMm(card.after)}`;
    const heading = element("h3", `${card.number}. ${named(card)}: ${fall}`);
    const share = card.share === null ? "" : `; explains ${Math.round(100 * card.share)} % of the squared error above the noise`;
    const left = card.shows !== "possible_cause" || card.ratio === null ? "" : ` ${words(card.ratio)} times as much squared error stays unexplained, so another cause may stand behind it.`;
    const says = element("div", "", "lrm-card-says");
    if (card.label) heading.append(" ", element("span", card.label, "lrm-label lrm-shows-" + card.shows));
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

  // The residual against what the effect follows, before and after the step.
  function drawCard(card) {
    const v = state.values, driver = v.drivers.find((one) => one.name === card.driver);
    const [before, after] = [v.steps[card.number - 1].turns[card.joint], v.steps[card.number].turns[card.joint]];
    if (!driver) return;
    const rows = page.sample(), x = at(driver.values, rows);
    const points = (name, y, ink, symbol) => ({ type: "scatter", mode: "markers", name, x, y: at(y, rows), hoverinfo: "skip",
      marker: { size: 5, symbol, color: ink, opacity: 0.55 } });
    const mean = (name, y, ink) => ({ type: "scatter", mode: "lines", name, ...binned(x, at(y, rows)), hoverinfo: "skip",
      line: { color: ink, width: 2.5 } });
    draw("card-" + card.number, [points("before", before, colour("held"), "circle-open"), points("after", after, colour("model"), "circle"),
      mean("mean before", before, colour("held")), mean("mean after", after, colour("model"))], { dragmode: false,
      xaxis: { title: { text: driver.label, standoff: 4 } },
      yaxis: { title: { text: `turn of joint ${card.joint + 1}, deg`, standoff: 4 }, range: range(before).limits } });
  }

  return { tellFall, tellVerdict, drawHistory, drawCards };
}
