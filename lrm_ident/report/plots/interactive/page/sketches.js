// Small sketches of what an effect is: play, a bent link, a leaning base. Lines on 96 × 64, in the ink of the page; what is
// wrong is drawn in the colour of errors.
"use strict";
const lrmSketch = (() => {
  const GROUND = "M8 58H40", LINK = "M24 56V34L70 20", JOINT = [24, 34];
  // Lines in ink, lines in the colour of errors, dashed lines, circles [x, y, radius], words under it.
  const KINDS = {
    play: [["M6 54H16V26H30V54H66V26H80V54H90", "M42 8V44H54V8"], ["M42 34H31M35 30L31 34L35 38", "M54 34H65M61 30L65 34L61 38"], [], [], "free play"],
    creep: [[GROUND, LINK], ["M70 26V42M66 38L70 42L74 38"], ["M24 34L70 28", "M24 34L68 38"], [JOINT.concat(4)], "sinks with time"],
    bend: [[GROUND, "M24 56V34"], ["M24 34Q56 20 76 38"], ["M24 34L76 18"], [JOINT.concat(4)], "link bends"],
    sideways: [["M4 14H24M4 50H24", "M14 14V50"], ["M14 32C44 30 66 38 86 56", "M70 34V44M66 40L70 44L74 40"], ["M14 32H88"], [[14, 32, 5]], "bends sideways"],
    lean: [["M6 58H50"], ["M28 58L38 30L78 26"], ["M28 58V28L70 18"], [[38, 30, 4]], "base leans"],
    gear: [["M26 32A22 22 0 1 0 70 32A22 22 0 1 0 26 32"], ["M48 26V38", "M42 32H54"], [], [[60, 26, 4]], "off-centre gear"],
    ripple: [["M8 40H90M12 58V8"], ["M12 40C18 22 24 22 30 40S42 58 48 40S60 22 66 40S78 58 84 40"], [], [], "repeats within a turn"],
    stairs: [["M8 58H90M12 60V8"], ["M12 54H28V40H46V26H64V12H84"], ["M20 56L84 6"], [], "moves in steps"],
    gain: [["M16 52A34 34 0 0 1 80 52", "M48 52L30 26"], ["M48 52L22 34"], [], [[48, 52, 3]], "turns too far or too little"],
    loop: [["M12 54H86M16 58V8"], ["M20 50C40 46 60 34 78 12C58 18 36 30 20 50", "M46 36H53L50 42", "M51 27H44L47 21"], [], [], "depends on the direction"],
    cable: [[GROUND, LINK], ["M24 50C44 52 60 44 70 22"], [], [JOINT.concat(4)], "cable pulls"],
    spring: [[GROUND, "M24 56V44", "M24 20L72 20", "M72 20V34"], ["M24 44L18 40L30 35L18 30L30 25L24 20"], [], [[72, 40, 6]], "gives under load"],
    mass: [[GROUND, LINK], ["M50 32V50M46 46L50 50L54 46"], [], [[50, 26, 7], JOINT.concat(4)], "weight differs"],
    step: [["M10 58H88"], ["M12 46H46V24H84"], ["M46 46H84"], [], "moved once"],
    frame: [["M14 50V14H50"], ["M14 50L66 61L50 14"], ["M14 50H50V14"], [], "the instrument is off"],
    length: [[GROUND, "M24 56V34"], ["M24 34L84 26"], ["M24 34L66 14"], [JOINT.concat(4)], "length or angle differs"],
  };

  // One of them as HTML; nothing of an effect that has none.
  return function sketch(kind) {
    if (!KINDS[kind]) return "";
    const [ink, wrong, dashed, circles, words] = KINDS[kind];
    const paths = (lines, name) => lines.map((d) => lrmHtml`<path d="${d}" class="${name}"/>`);
    return lrmHtml`<figure class="lrm-sketch"><svg viewBox="0 0 96 64" role="img" aria-label="${words}">${paths(dashed, "dashed")}${paths(ink, "")}${paths(wrong, "wrong")}
      ${circles.map(([cx, cy, r]) => lrmHtml`<circle cx="${cx}" cy="${cy}" r="${r}"/>`)}</svg><figcaption>${words}</figcaption></figure>`;
  };
})();
