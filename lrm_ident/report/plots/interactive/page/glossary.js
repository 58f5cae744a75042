// Words that a newcomer does not know are explained where they stand: pointing at one, or reading it out, tells.
"use strict";
const lrmGlossary = (() => {
  const ANY = new RegExp(`(${Object.keys(lrmTerms).sort((a, b) => b.length - a.length).join("|")})`);

  // Marks the first occurrence of every word in each block of an element.
  return function glossary(root) {
    for (const block of root.querySelectorAll("p, li, th, td:first-child, dt, dd, h2, caption, span")) {
      if (block.querySelector("abbr") || block.closest("abbr, button")) continue;
      for (const node of [...block.childNodes].filter((one) => one.nodeType === Node.TEXT_NODE)) mark(node);
    }
  };

  function mark(node) {
    const known = new Set();
    node.replaceWith(...node.textContent.split(ANY).map((part) => {
      if (!lrmTerms[part] || known.has(part)) return part;
      known.add(part);
      return Object.assign(document.createElement("abbr"), { textContent: part, title: lrmTerms[part] });
    }));
  }
})();
