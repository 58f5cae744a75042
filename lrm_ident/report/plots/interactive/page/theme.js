// Light or dark: as a person chose it last on this page, else as the browser wishes. A page in a file may have no memory.
"use strict";
const lrmTheme = (() => {
  const KEY = "lrm-theme", page = document.documentElement;
  const remembered = () => { try { return localStorage.getItem(KEY); } catch { return null; } };
  page.dataset.theme = remembered() || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  // The other one from now on; gives its name.
  return function turn() {
    const name = page.dataset.theme === "dark" ? "light" : "dark";
    try { localStorage.setItem(KEY, name); } catch { /* it is forgotten when the page is closed */ }
    return name;
  };
})();
