// Paper is light, and gets every figure in full, also those that were not in view yet.
"use strict";
function lrmPrint(page) {
  const PAPER_RATIO = 3;
  const { state, scenes } = page;

  function print(begin) {
    if (begin) print.theme = document.documentElement.dataset.theme;
    for (const one of Object.values(scenes)) one.ratio = begin ? PAPER_RATIO : 0;
    page.theme(begin ? "light" : print.theme);
    page.drawWaiting(() => true);
    lrmChart.onPaper(begin);
    for (const one of Object.values(scenes)) one.draw();
  }
  window.addEventListener("beforeprint", () => { if (state.values) print(true); });
  window.addEventListener("afterprint", () => { if (state.values) print(false); });
  return { print };
}
