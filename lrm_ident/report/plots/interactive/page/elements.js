// What every page is made of: HTML of templates, places by their names, lists to choose from; light and dark, and paper.
"use strict";
// HTML of a template: what is put in is escaped, unless it is HTML of such a template itself, or a list of such.
const lrmHtml = (() => {
  class Html extends String {}
  const shown = (one) => one instanceof Html ? one : Array.isArray(one) ? one.map(shown).join("")
    : String(one ?? "").replace(/[&<>"]/g, (sign) => `&#${sign.charCodeAt(0)};`);
  return ({ raw }, ...put) => new Html(String.raw({ raw }, ...put.map(shown)));
})();

const lrmElements = (() => {
  const filled = new WeakMap();
  const place = (id) => document.getElementById("lrm-" + id);

  // Fills an element with HTML; one that shows it already is left alone, with what a person has unfolded in it.
  function fill(id, content) {
    const box = place(id), html = String(content);
    if (filled.get(box) !== html) box.innerHTML = html;
    filled.set(box, html);
    return box;
  }

  // A list of [value, words] with the value that is chosen.
  function options(id, entries, value) {
    const list = fill(id, lrmHtml`${entries.map(([key, text]) => lrmHtml`<option value="${key}">${text}</option>`)}`);
    list.value = value;
    return list;
  }

  return { place, fill, options };
})();

// Light and dark, with the button for it, and paper, which is light and gets every figure in its own size (class lrm-paper)
// before the browser lays the pages out. `draw`: all figures anew; `arrange`: for paper or back; `finish`: draws what waits.
function lrmAppearance(draw, arrange = () => {}, finish = () => {}) {
  const page = document.documentElement, button = lrmElements.place("theme");
  const theme = (name) => { page.dataset.theme = name; draw(); };
  let onScreen = "light";
  function print(begin) {
    if (begin) onScreen = page.dataset.theme;
    page.classList.toggle("lrm-paper", begin);
    arrange(begin);
    theme(begin ? "light" : onScreen);
    finish();
    lrmChart.fit(begin);
  }
  addEventListener("beforeprint", () => print(true));
  addEventListener("afterprint", () => print(false));
  if (button) button.onclick = () => theme(lrmTheme());
  lrmTheme.follow(theme);
  return { theme, print };
}
