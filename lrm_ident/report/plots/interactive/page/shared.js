// What the parts of the page share: what is chosen, and how places and words are found. `page` of every other script is this,
// with what the scripts loaded before have added to it.
"use strict";
function lrmShared() {
  const state = { values: null, step: 0, beside: null, joint: 0, driver: "", candidate: null, brushed: null, pose: null, size: 0,
    worst: false };
  const place = (id) => document.getElementById("lrm-" + id);
  const emit = (name, value) => { if (window.lrmEmit) window.lrmEmit(name, value); };
  const words = (value, digits = 2) => value === null ? "–" : value.toFixed(digits);
  const norm = (v) => Math.hypot(v[0], v[1], v[2]);
  const rowOfPose = () => Math.max(state.values.pose.indexOf(state.pose), 0);

  function element(tag, text, name) {
    const out = document.createElement(tag);
    if (text) out.textContent = text;
    if (name) out.className = name;
    return out;
  }

  return { state, scenes: {}, place, emit, words, norm, rowOfPose, element };
}
