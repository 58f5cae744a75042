// Charts in view are drawn first, the others when there is nothing else to do; each in a task of its own, so that the page
// answers in between.
"use strict";
function lrmQueue(page) {
  const { state, place } = page;
  const waiting = new Map(), inView = new Set();
  const watcher = new IntersectionObserver((entries) => {
    for (const one of entries) inView[one.isIntersecting ? "add" : "delete"](one.target);
    soon();
  }, { rootMargin: "200px" });
  const whenIdle = window.requestIdleCallback || ((run) => setTimeout(run, 500)); // Safari has none

  function draw(id, traces, options, wire) {
    const figure = place(id);
    if (!figure) return;
    watcher.observe(figure);
    waiting.set(figure, () => Plotly.react(figure, traces, lrmChart.layout(options), lrmChart.CONFIG).then(() => {
      if (figure.dataset.wired) return;
      figure.dataset.wired = "yes";
      if (wire) wire(figure);
    }));
    soon();
  }

  function soon() {
    if (!soon.asked) soon.asked = setTimeout(() => {
      soon.asked = 0;
      if (drawWaiting((one) => inView.has(one), 1)) soon();
      else if (waiting.size) whenIdle(() => { if (drawWaiting(() => true, 1)) soon(); });
    });
  }

  // Draws charts that wait, `most` of them, and says whether it drew any.
  function drawWaiting(which, most = Infinity) {
    if (!window.Plotly || !state.values) return false;
    for (const one of waiting.keys()) if (!one.isConnected) waiting.delete(one);
    const now = [...waiting].filter(([one]) => which(one)).slice(0, most);
    for (const [figure, run] of now) { waiting.delete(figure); run(); }
    return now.length > 0;
  }

  return { draw, soon, drawWaiting };
}
