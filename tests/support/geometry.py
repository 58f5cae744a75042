"""Geometry of a page in a browser: what lies over something else, what is cut, what is beyond the screen."""

from __future__ import annotations

from typing import Any

OVERLAPS = """() => {
  const shown = (one) => one.checkVisibility() && getComputedStyle(one).clipPath === "none";
  const seen = (selector) => [...document.querySelectorAll(selector)].filter(shown);
  const boxes = (selector) => seen(selector).map((one) => {
    const { left, right, top, bottom } = one.getBoundingClientRect();
    return { left, right, top, bottom, words: one.textContent.trim().slice(0, 40) };
  }).filter((one) => one.right > one.left && one.words);
  const found = [];
  const beside = (a, b) => a.right <= b.left + 1 || b.right <= a.left + 1;
  const apart = (a, b) => beside(a, b) || a.bottom <= b.top + 1 || b.bottom <= a.top + 1;
  const check = (all) => all.forEach((a, i) => all.slice(i + 1).forEach((b) => {
    if (!apart(a, b)) found.push(`${a.words} lies over ${b.words}`);
  }));
  check(boxes(`h1, h2:not(summary h2), h3, .lrm-fall-name, .lrm-fall-mm, .lrm-fall, #lrm-next, summary, dt, dd,
    .lrm-primary`));
  for (const plot of document.querySelectorAll(".js-plotly-plot")) {
    plot.id = plot.id || "plot";
    check(boxes(`#${plot.id} :is(.xtick, .ytick, .xtitle, .ytitle, .legendtext, .gtitle)`));
    const [legend, drawn] = [".legend", ".nsewdrag"].map((one) => plot.querySelector(one)?.getBoundingClientRect());
    if (legend?.height && drawn && !apart(legend, drawn)) found.push(`${plot.id}: the legend lies over the points`);
  }
  return found;
}"""
CUT = """() => {
  const found = [], wide = document.documentElement.clientWidth;
  const words = "h1, h2, h3, p, dd, .lrm-fall-name, .lrm-fall-mm, .lrm-card, .lrm-tour, .lrm-primary";
  for (const one of document.querySelectorAll(words)) {
    if (!one.checkVisibility() || getComputedStyle(one).clipPath !== "none") continue;
    const box = one.getBoundingClientRect();
    const wider = one.scrollWidth > one.clientWidth + 1 && getComputedStyle(one).display !== "inline";
    if (box.width && (box.left < -1 || box.right > wide + 1 || wider)) found.push(one.textContent.trim().slice(0, 60));
  }
  for (const plot of document.querySelectorAll(".js-plotly-plot")) {
    const frame = plot.getBoundingClientRect();
    for (const one of plot.querySelectorAll(".xtick text, .ytick text, .xtitle, .ytitle, .legendtext")) {
      const { left, right, top, bottom } = one.getBoundingClientRect();
      const aside = left < frame.left - 2 || right > frame.right + 2;
      const beyond = aside || top < frame.top - 2 || bottom > frame.bottom + 2;
      if (one.textContent && right > left && beyond) found.push(`${plot.id}: ${one.textContent}`);
    }
  }
  return found;
}"""


def faults_of_geometry(page: Any) -> list[str]:
    """Words that lie over one another, and words, labels and dialogs that are cut."""
    return [*page.evaluate(OVERLAPS), *(f"cut: {words}" for words in page.evaluate(CUT))]
