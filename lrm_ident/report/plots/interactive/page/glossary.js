// Words that a newcomer does not know are explained where they stand: pointing at one, or reading it out, tells.
"use strict";
const lrmGlossary = (() => {
  const WORDS = {
    "held-out": "of poses that the fit has not seen: ten parts of the data, each predicted by a fit to the other nine",
    "held out": "of poses that the fit has not seen: ten parts of the data, each predicted by a fit to the other nine",
    "as deployed": "of the model that the arm gets: without the effects of the measurement session and of the tracker, whose last state stays in the offsets",
    "RMS": "root mean square: the typical size of the error, in which large errors count more",
    "measurement noise": "the error that the measurement itself makes; no model can be better",
    "Moran's I": "spatial autocorrelation of the residuals: 0 if the errors of neighbouring poses have nothing in common, 1 if they are the same",
    "black-box model": "a Gaussian process that predicts the residuals from the pose without a physical cause: what it explains is systematic",
    "empirical term": "it improves the prediction; these poses do not identify its cause",
    "identified cause": "its own parameters are significant, it predicts unseen poses better, and little else stays unexplained",
    "candidate cause": "it predicts unseen poses better, but so much stays unexplained that another cause may stand behind it",
    "turn of joint": "the error as the angle by which this joint alone would have to turn to make it",
  };
  const ANY = new RegExp(`(${Object.keys(WORDS).sort((a, b) => b.length - a.length).join("|")})`);

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
      if (!WORDS[part] || known.has(part)) return part;
      known.add(part);
      return Object.assign(document.createElement("abbr"), { textContent: part, title: WORDS[part] });
    }));
  }
})();
