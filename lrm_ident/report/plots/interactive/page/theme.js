// Light or dark: as a person chose it last on this page, else as the browser wishes. A page in a file may have no memory.
"use strict";
const lrmTheme = (() => {
  const KEY = "lrm-theme", page = document.documentElement, wish = matchMedia("(prefers-color-scheme: dark)");
  const remembered = () => { try { return localStorage.getItem(KEY); } catch { return null; } };
  const wished = () => (wish.matches ? "dark" : "light");
  page.dataset.theme = remembered() || wished();
  // The other one from now on; gives its name.
  function turn() {
    const name = page.dataset.theme === "dark" ? "light" : "dark";
    try { localStorage.setItem(KEY, name); } catch { /* it is forgotten when the page is closed */ }
    return name;
  }
  // Draws anew when the browser, or the notebook around the page, turns dark or light; paper is always light.
  turn.follow = (draw) => {
    if (!remembered()) page.dataset.theme = wished(); // it may have turned since this file ran
    wish.addEventListener("change", () => {
      if (!remembered() && !matchMedia("print").matches) draw(wished());
    });
  };
  return turn;
})();
