// The interactive figures of the workbench and the report: drawn with Plotly from the values of values.py.
// lrm.show(values) draws all that has a place (an element with the figure's id) on the page.
"use strict";
const lrm = (() => {
  const BINS = 12, AXES = ["x", "y", "z"], SYMBOLS = ["circle", "triangle-up", "square"];
  const state = { values: null, step: 0, beside: null, joint: 0, driver: "", candidate: null, brushed: null, pose: null };
  const place = (id) => document.getElementById("lrm-" + id);
  const emit = (name, value) => { if (window.lrmEmit) window.lrmEmit(name, value); };
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
  const words = (value, digits = 2) => value === null ? "–" : value.toFixed(digits);
  const norm = (v) => Math.hypot(v[0], v[1], v[2]);

  // ---- what the figures share

  function layout(extra) {
    const ink = colour("ink"), axis = { gridcolor: colour("grid"), zerolinecolor: colour("line"), automargin: true };
    const base = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink, size: 12, family: "system-ui, sans-serif" },
      margin: { l: 8, r: 8, t: 8, b: 8 }, showlegend: true, hovermode: "closest", dragmode: "select",
      legend: { orientation: "h", x: 0, y: 1, yanchor: "bottom", font: { size: 11 } }, uirevision: "kept",
    };
    const out = Object.assign(base, extra);
    for (const key of ["xaxis", "yaxis"]) if (out[key]) out[key] = Object.assign({}, axis, out[key]);
    return out;
  }

  const CONFIG = { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["toImage", "sendDataToCloud"] };

  function draw(id, traces, options, wire) {
    const element = place(id);
    if (!element || !window.Plotly) return;
    Plotly.react(element, traces, layout(options), CONFIG).then(() => {
      if (element.dataset.wired) return;
      element.dataset.wired = "yes";
      if (wire) wire(element);
    });
  }

  function discrete(count) { // steps of one hue from light to dark that keep their order without colour
    const scale = [], ends = [[253, 231, 37], [33, 145, 140], [68, 1, 84]].reverse();
    if (document.documentElement.dataset.theme !== "dark") ends.reverse();
    for (let i = 0; i < count; i++) {
      const t = 2 * i / (count - 1), k = Math.min(Math.floor(t), 1), f = t - k;
      const rgb = ends[k].map((c, j) => Math.round(c + f * (ends[k + 1][j] - c)));
      scale.push([i / count, `rgb(${rgb})`], [(i + 1) / count, `rgb(${rgb})`]);
    }
    return scale;
  }

  const selected = () => {
    if (!state.brushed) return null;
    const rows = [];
    state.values.pose.forEach((pose, row) => { if (state.brushed.has(pose)) rows.push(row); });
    return rows;
  };

  // Events of a scatter whose points carry their row in customdata.
  function wireScatter(element) {
    element.on("plotly_hover", (event) => hover(event.points[0].customdata));
    element.on("plotly_selected", (event) => {
      if (event) brush(new Set(event.points.map((p) => p.customdata).filter((row) => row !== undefined)
        .map((row) => state.values.pose[row])));
    });
    element.on("plotly_deselect", () => brush(null));
    element.on("plotly_click", (event) => toggle(event.points[0].customdata));
  }

  // ---- the error field

  function drawField() {
    const both = state.beside !== null;
    document.documentElement.classList.toggle("lrm-beside", both);
    drawStep("field", state.step);
    if (both) drawStep("field-b", state.beside);
    const scale = place("scale"), v = state.values;
    if (scale) scale.textContent = v.scale.words + (v.thinned ? "; " + v.thinned : "");
  }

  function drawStep(id, number) {
    const v = state.values, step = v.steps[number], element = place(id);
    if (!element || !step) return;
    const m = v.scale.magnification, arrows = [[], [], []], sizes = [], lengths = [];
    step.residual.forEach((r, row) => {
      const size = norm(r), head = arrowHead(r, size);
      sizes.push(size);
      AXES.forEach((_, k) => {
        const foot = v.tcp[row][k], tip = foot + m * r[k];
        arrows[k].push(foot, tip, tip + m * head[0][k], tip, tip + m * head[1][k], null);
      });
      lengths.push(size, size, size, size, size, size);
    });
    const chosen = selected(), is = new Set(chosen || []);
    const shown = (row) => !chosen || is.has(row);
    const traces = [
      { type: "scatter3d", mode: "lines", x: arrows[0], y: arrows[1], z: arrows[2], hoverinfo: "skip", showlegend: false,
        line: { width: 4, color: lengths, colorscale: discrete(v.scale.colours), cmin: 0, cmax: v.scale.largest,
          showscale: id === "field" && state.beside === null,
          colorbar: { title: { text: "mm", side: "top" }, thickness: 10, len: 0.55, y: 0.68, x: 1, xanchor: "right" } } },
      { type: "scatter3d", mode: "markers", name: "measured TCP", x: v.tcp.map((p) => p[0]), y: v.tcp.map((p) => p[1]),
        z: v.tcp.map((p) => p[2]), customdata: v.pose.map((_, row) => row), showlegend: false,
        hovertext: v.pose.map((pose, row) => `pose ${pose}: ${words(sizes[row])} mm`), hoverinfo: "text",
        marker: { size: v.pose.map((_, row) => is.has(row) ? 7 : 3), line: { width: 0 },
          symbol: v.pose.map((_, row) => is.has(row) ? "diamond" : "circle"),
          color: v.pose.map((_, row) => is.has(row) ? colour("accent") : shown(row) ? colour("ink") : colour("grid")) } },
      ...armTraces(),
    ];
    const scene = (title) => ({ title: { text: title }, color: colour("soft"), gridcolor: colour("grid"),
      backgroundcolor: "rgba(0,0,0,0)", zerolinecolor: colour("line"), nticks: 5, tickfont: { size: 10 } });
    const summary = `${number} ${step.name.split(",")[0]}: RMS ${step.rms} mm`;
    draw(id, traces, {
      margin: { l: 0, r: 0, t: 24, b: 0 }, dragmode: "orbit", title: { text: summary, font: { size: 12 }, x: 0.02, y: 0.98 },
      scene: { xaxis: scene("x mm"), yaxis: scene("y mm"), zaxis: scene("z mm"), aspectmode: "data",
        camera: { eye: { x: 1.2, y: -1.2, z: 0.7 }, center: { x: 0, y: 0, z: -0.18 } }, uirevision: "kept" },
      showlegend: false,
    }, (figure) => {
      figure.on("plotly_hover", (event) => hover(event.points[0].customdata));
      figure.on("plotly_click", (event) => toggle(event.points[0].customdata));
    });
  }

  // The two strokes of an arrow's head, from its tip: a third of its length back, to either side.
  function arrowHead(r, size) {
    if (!size) return [[0, 0, 0], [0, 0, 0]];
    const flat = Math.hypot(r[0], r[1]), side = flat > 0.1 * size ? [-r[1] / flat, r[0] / flat, 0] : [1, 0, 0];
    return [-1, 1].map((sign) => r.map((c, k) => -0.3 * c + sign * 0.15 * size * side[k]));
  }

  function armTraces() {
    const v = state.values, row = rowOfPose();
    const line = (points, name, dash, ink, width) => ({ type: "scatter3d", mode: "lines", name, hoverinfo: "skip",
      x: points.map((p) => p[0]), y: points.map((p) => p[1]), z: points.map((p) => p[2]), line: { dash, color: ink, width } });
    return [line(v.nominal[row], "nominal arm", "dash", colour("soft"), 5),
      line(v.bent[row], "bent arm (model)", "solid", colour("model"), 7)];
  }

  const rowOfPose = () => Math.max(state.values.pose.indexOf(state.pose), 0);

  function hover(row) {
    if (row === undefined || state.values.pose[row] === state.pose) return;
    state.pose = state.values.pose[row];
    tell();
    drawArm();
    clearTimeout(hover.timer);
    hover.timer = setTimeout(moveArms, 250); // the scene follows when the pointer rests
  }

  function moveArms() {
    const arms = armTraces();
    for (const id of state.beside === null ? ["field"] : ["field", "field-b"]) {
      const element = place(id);
      if (element && element.data) {
        Plotly.restyle(element, { x: arms.map((a) => a.x), y: arms.map((a) => a.y), z: arms.map((a) => a.z) }, [2, 3]);
      }
    }
  }

  function tell() {
    const v = state.values, row = rowOfPose(), note = place("pose-note"), input = place("pose");
    if (input && document.activeElement !== input) input.value = v.pose[row];
    if (!note) return;
    const r = v.steps[state.step].residual[row];
    note.textContent = `pose ${v.pose[row]}: q ${v.q[row].map((a) => a.toFixed(0)).join(" ")} deg, load ${v.load[row]} g, ` +
      `error ${words(norm(r))} mm (${r.map((c) => (c < 0 ? "" : "+") + c.toFixed(2)).join(" ")})`;
  }

  // Both arms of a pose, flat, so that the pointer need not wait for the scene: from the side, in the vertical plane
  // through its TCP, and from above.
  function drawArm() {
    const box = place("arm"), v = state.values, row = rowOfPose();
    if (box) box.replaceChildren(...armViews(v.nominal[row], v.bent[row], v.tcp[row]));
  }

  function armViews(nominal, bent, measured) {
    const base = nominal[0], tip = nominal[nominal.length - 1];
    const reach = Math.hypot(tip[0] - base[0], tip[1] - base[1]) || 1;
    const along = [(tip[0] - base[0]) / reach, (tip[1] - base[1]) / reach];
    const views = [["from the side", (p) => [(p[0] - base[0]) * along[0] + (p[1] - base[1]) * along[1], -p[2]]],
      ["from above", (p) => [p[0], -p[1]]]];
    const make = (tag, attributes) => {
      const out = document.createElementNS("http://www.w3.org/2000/svg", tag);
      for (const key in attributes) out.setAttribute(key, attributes[key]);
      return out;
    };
    return views.map(([name, flat]) => {
      const arms = [nominal.map(flat), bent.map(flat)], seen = measured ? [flat(measured)] : [];
      const all = [...arms[0], ...arms[1], ...seen], xs = all.map((p) => p[0]), ys = all.map((p) => p[1]);
      const size = Math.max(Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys), 1), pad = 0.12 * size;
      const middle = [(Math.max(...xs) + Math.min(...xs)) / 2, (Math.max(...ys) + Math.min(...ys)) / 2];
      const svg = make("svg", { role: "img", "aria-label": `nominal and bent arm ${name}`,
        viewBox: [middle[0] - size / 2 - pad, middle[1] - size / 2 - pad, size + 2 * pad, size + 2 * pad].join(" ") });
      const line = (points, ink, dash, width) => svg.append(make("polyline", { points: points.map((p) => p.join()).join(" "),
        fill: "none", stroke: ink, "stroke-width": width * size, "stroke-dasharray": dash * size, "stroke-linecap": "round" }));
      line(arms[0], colour("soft"), 0.03, 0.014);
      line(arms[1], colour("model"), 0, 0.02);
      for (const at of seen) {
        svg.append(make("circle", { cx: at[0], cy: at[1], r: 0.03 * size, fill: "none", stroke: colour("held"),
          "stroke-width": 0.015 * size }));
      }
      const figure = element("figure", "", "lrm-arm-view");
      figure.append(svg, element("figcaption", name));
      return figure;
    });
  }

  // A running daemon: both arms and words; null: no daemon any longer.
  function rover(told) {
    const panel = place("rover"), arms = place("rover-arms");
    if (!panel) return;
    panel.hidden = !told;
    if (!told) return;
    place("rover-words").textContent = told.words;
    arms.replaceChildren(...(told.bent ? armViews(told.nominal, told.bent, null) : []));
  }

  // A WebGL canvas prints blank: paper gets a picture of the scene as it stands.
  function print() {
    theme("light");
    resize();
    const picture = place("field-print"), figure = place("field");
    const scene = figure && figure._fullLayout && figure._fullLayout.scene && figure._fullLayout.scene._scene;
    if (picture && scene) picture.src = scene.toImage("png");
  }

  // ---- where it fails: the residual as a turn of one joint against a driver

  function binned(x, y) {
    const rows = x.map((_, i) => i).filter((i) => x[i] !== null && y[i] !== null).sort((a, b) => x[a] - x[b]);
    const levels = new Set(rows.map((i) => x[i])), groups = [];
    if (levels.size <= BINS) {
      for (const level of levels) groups.push(rows.filter((i) => x[i] === level));
    } else {
      for (let k = 0; k < BINS; k++) {
        groups.push(rows.slice(Math.floor(k * rows.length / BINS), Math.floor((k + 1) * rows.length / BINS)));
      }
    }
    const mean = (group, of) => group.reduce((sum, i) => sum + of[i], 0) / group.length;
    const kept = groups.filter((group) => group.length);
    return { x: kept.map((g) => mean(g, x)), y: kept.map((g) => mean(g, y)) };
  }

  // A range for most of some values, and how many of others are beyond; a joint that hardly moves the TCP makes a few
  // enormous turns.
  function range(values, most = values) {
    const sizes = (of) => of.filter((y) => y !== null).map(Math.abs).sort((a, b) => a - b), known = sizes(most);
    const limit = 1.4 * (known[Math.floor(0.98 * (known.length - 1))] || 1);
    return { limits: [-limit, limit], beyond: sizes(values).filter((y) => y > limit).length };
  }

  function drawTurn() {
    const v = state.values, driver = v.drivers.find((d) => d.name === state.driver), step = v.steps[state.step];
    if (!driver || !step) return;
    const y = step.turns[state.joint], means = binned(driver.values, y), one = candidate();
    const seen = range(y, v.steps[0].turns[state.joint]); // the same for all steps
    const traces = [
      { type: "scatter", mode: "markers", name: "residual, as a turn", x: driver.values, y, selectedpoints: selected(),
        customdata: v.pose.map((_, row) => row), text: v.pose.map((pose) => `pose ${pose}`),
        hovertemplate: "%{text}: %{y:.3f} deg<extra></extra>", marker: { size: 5, color: colour("model"), opacity: 0.55 } },
      { type: "scatter", mode: "lines+markers", name: "its mean", x: means.x, y: means.y, hoverinfo: "skip",
        line: { color: colour("ink"), width: 2 }, marker: { symbol: "square", size: 6 } },
    ];
    if (one && state.step === v.steps.length - 1) {
      const says = binned(driver.values, one.turns[state.joint]);
      traces.push({ type: "scatter", mode: "lines+markers", name: `what ${one.name} would explain`, x: says.x, y: says.y,
        hoverinfo: "skip", line: { color: colour("held"), width: 3, dash: "dash" }, marker: { symbol: "diamond", size: 7 } });
    }
    const beyond = seen.beyond ? ` (${seen.beyond} beyond)` : "";
    draw("turn", traces, {
      xaxis: { title: { text: driver.label, standoff: 4 } },
      yaxis: { title: { text: `acts like a turn of joint ${state.joint + 1}, deg${beyond}`, standoff: 4 }, range: seen.limits },
    }, wireScatter);
  }

  // ---- which effect

  const candidate = () => state.values.ranking.find((one) => one.name === state.candidate) || null;

  function drawCandidate() {
    const one = candidate(), detail = place("detail");
    for (const id of ["added", "form"]) if (place(id)) place(id).classList.toggle("lrm-empty", !one);
    if (detail) detail.replaceChildren(...(one ? details(one) : []));
    if (!one) return;
    const v = state.values, extent = Math.max(...one.added.flat().filter((c) => c !== null).map(Math.abs), 1e-6);
    const traces = AXES.map((axis, k) => ({ type: "scatter", mode: "markers", name: "along " + axis,
      x: one.added.map((a) => a[k]), y: v.steps[v.steps.length - 1].residual.map((r) => r[k]), selectedpoints: selected(),
      customdata: v.pose.map((_, row) => row), text: v.pose.map((pose) => `pose ${pose}`),
      hovertemplate: "%{text}<extra></extra>",
      marker: { size: 5, opacity: 0.6, symbol: SYMBOLS[k], color: colour(["model", "held", "good"][k]) } }));
    traces.push({ type: "scatter", mode: "lines", name: "as it says", x: [-extent, extent], y: [-extent, extent],
      hoverinfo: "skip", line: { color: colour("ink"), dash: "dash", width: 1.5 } });
    draw("added", traces, { xaxis: { title: { text: "it would add, mm", standoff: 4 } },
      yaxis: { title: { text: "the fit leaves, mm", standoff: 4 } } }, wireScatter);
    const driver = v.drivers.find((d) => d.name === one.driver);
    if (!driver) return;
    const order = driver.values.map((_, i) => i).filter((i) => one.form[i] !== null)
      .sort((a, b) => driver.values[a] - driver.values[b]);
    const seen = range(one.around);
    draw("form", [
      { type: "scatter", mode: "markers", name: "data", x: driver.values, y: one.around, selectedpoints: selected(),
        customdata: v.pose.map((_, row) => row), text: v.pose.map((pose) => `pose ${pose}`),
        hovertemplate: "%{text}: %{y:.3f} deg<extra></extra>", marker: { size: 5, color: colour("model"), opacity: 0.55 } },
      { type: "scatter", mode: "lines", name: "its form", x: order.map((i) => driver.values[i]),
        y: order.map((i) => one.form[i]), hoverinfo: "skip", line: { color: colour("held"), width: 3 } },
    ], { xaxis: { title: { text: driver.label, standoff: 4 } },
      yaxis: { title: { text: `turn of joint ${one.joint + 1}, deg`, standoff: 4 }, range: seen.limits } }, wireScatter);
  }

  function element(tag, text, name) {
    const out = document.createElement(tag);
    if (text) out.textContent = text;
    if (name) out.className = name;
    return out;
  }

  function details(one) {
    const lines = [element("p", one.why)];
    lines.push(element("p", `${one.estimates.join(", ")}; p ${one.p}; ` +
      (one.online ? "the rover can compensate it" : "explains a measurement session; never deployed silently"), "lrm-soft"));
    if (one.rivals.length) lines.push(element("p", "These data cannot tell it from " + one.rivals.join(", ") + ".", "lrm-soft"));
    return lines;
  }

  function drawRanking() {
    const list = place("ranking"), v = state.values;
    if (!list) return;
    const worst = Math.max(...v.ranking.map((one) => one.heldOut), 1e-9);
    list.setAttribute("role", "radiogroup");
    list.replaceChildren(...v.ranking.map((one, number) => {
      const button = element("button", "", "lrm-candidate lrm-" + one.verdict), is = one.name === state.candidate;
      button.type = "button";
      button.setAttribute("role", "radio");
      button.setAttribute("aria-checked", String(is));
      button.tabIndex = is || (!state.candidate && !number) ? 0 : -1;
      button.dataset.name = one.name;
      const bar = element("span", "", "lrm-bar");
      bar.style.width = 100 * one.heldOut / worst + "%";
      button.append(bar, element("span", one.mark.split(" ")[0], "lrm-mark"), element("span", one.name, "lrm-name"),
        element("span", one.held, "lrm-held"));
      button.title = one.mark;
      button.addEventListener("click", () => choose(one.name));
      return button;
    }));
    list.onkeydown = (event) => {
      const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      const at = v.ranking.findIndex((one) => one.name === state.candidate);
      const next = v.ranking[Math.min(Math.max(at + step, 0), v.ranking.length - 1)];
      choose(next.name);
      list.querySelector('[aria-checked="true"]').focus();
    };
  }

  function choose(name) {
    state.candidate = name;
    const one = candidate();
    if (one) {
      state.joint = one.joint;
      if (state.values.drivers.some((d) => d.name === one.driver)) state.driver = one.driver;
      fill();
    }
    drawRanking();
    drawCandidate();
    drawTurn();
    emit("lrm_choose", name);
  }

  // ---- the steps

  function drawHistory() {
    const v = state.values, h = v.history;
    if (!h.length) return;
    const x = h.map((_, i) => i), names = h.map((one, i) => `${i} ${one.name.split(",")[0]}`);
    const line = (name, y, dash, symbol, ink) => ({ type: "scatter", mode: "lines+markers", name, x, y,
      customdata: x, text: names, hovertemplate: "%{text}<br>%{y:.2f} mm<extra></extra>",
      line: { color: ink, dash, width: 2 }, marker: { symbol, size: x.map((i) => i === state.step ? 14 : 9) } });
    const traces = [line("fit", h.map((one) => one.fit), "solid", "circle", colour("model")),
      line("held out", h.map((one) => one.held), "dash", "diamond", colour("held"))];
    const shapes = [], notes = [], floor = v.floor !== null ? v.floor : v.bound;
    if (floor !== null) {
      shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, y0: floor, y1: floor, line: { dash: "dot", color: colour("ink") } });
      notes.push({ xref: "paper", x: 0.5, y: floor, xanchor: "center", yanchor: "top", showarrow: false,
        text: v.floor !== null ? `noise floor ${words(floor)} mm` : `noise at most ${words(floor)} mm` });
    }
    const most = Math.max(...h.map((one) => Math.max(one.fit, one.held || 0)));
    draw("history", traces, { shapes, annotations: notes, dragmode: false,
      xaxis: { tickvals: x, ticktext: names.map((name) => name.length > 22 ? name.slice(0, 21) + "…" : name),
        range: [-0.3, Math.max(h.length - 0.7, 1.3)], fixedrange: true },
      yaxis: { title: { text: "RMS error, mm", standoff: 4 }, range: [0, 1.15 * most], fixedrange: true } },
    (figure) => figure.on("plotly_click", (event) => showStep(event.points[0].customdata)));
  }

  function showStep(number) {
    if (!state.values.steps[number]) return;
    state.step = number;
    fill();
    drawField(); drawTurn(); drawHistory(); tell();
    emit("lrm_step", number);
  }

  // ---- brushing, controls, and drawing all

  function brush(poses) {
    state.brushed = poses && poses.size ? poses : null;
    drawField(); drawTurn(); drawCandidate();
    const note = place("brushed");
    if (note) note.textContent = state.brushed ? `${state.brushed.size} poses marked` : "";
  }

  function toggle(row) {
    if (row === undefined) return;
    const poses = new Set(state.brushed || []), pose = state.values.pose[row];
    if (!poses.delete(pose)) poses.add(pose);
    brush(poses);
  }

  function options(id, entries, value) {
    const select = place(id);
    if (!select) return;
    select.replaceChildren(...entries.map(([key, text]) => {
      const option = element("option", text);
      option.value = key;
      return option;
    }));
    select.value = value;
  }

  function fill() {
    const v = state.values, steps = v.steps.map((step, i) => [String(i), `${i} ${step.name.split(",")[0]}`]);
    options("joint", v.q[0].map((_, i) => [String(i), `joint ${i + 1}`]), String(state.joint));
    options("driver", v.drivers.map((d) => [d.name, d.name]), state.driver);
    options("step", steps, String(state.step));
    options("beside", [["", "alone"], ...steps.map(([key, text]) => [key, "beside " + text])],
      state.beside === null ? "" : String(state.beside));
    options("marked", [["", "mark poses"], ...Object.keys(v.marked).filter((why) => v.marked[why].length)
      .map((why) => [why, `mark the ${why}`])], "");
  }

  function wireControls() {
    const on = (id, action) => { if (place(id)) place(id).onchange = (event) => action(event.target.value); };
    on("joint", (value) => { state.joint = Number(value); drawTurn(); });
    on("driver", (value) => { state.driver = value; drawTurn(); });
    on("step", (value) => showStep(Number(value)));
    on("beside", (value) => { state.beside = value === "" ? null : Number(value); drawField(); resize(); });
    on("marked", (value) => brush(value ? new Set(state.values.marked[value]) : null));
    on("pose", (value) => { const row = state.values.pose.indexOf(Number(value)); if (row >= 0) hover(row); });
    if (place("clear")) place("clear").onclick = () => brush(null);
  }

  function resize() {
    for (const figure of document.querySelectorAll(".js-plotly-plot")) {
      if (figure.offsetParent) Plotly.Plots.resize(figure);
    }
  }

  function redraw() {
    if (!state.values) return;
    fill(); drawRanking(); drawHistory(); drawTurn(); drawCandidate(); drawArm(); tell();
    const v = state.values, marks = [...(state.brushed || [])];
    const now = JSON.stringify([v.data, v.poses, v.steps.map((step) => [step.name, step.rms]), state.step, state.beside,
      marks, document.documentElement.dataset.theme]);
    if (now === redraw.field) return; // a diagnosis changes nothing of the scene, which takes longest
    redraw.field = now;
    requestAnimationFrame(() => setTimeout(drawField)); // what is flat is on the screen before it
  }

  function show(values) {
    const before = state.values, known = new Set(values.drivers.map((d) => d.name));
    state.values = values;
    const last = values.steps.length - 1;
    if (!before || before.steps.length !== values.steps.length || state.step > last) state.step = last;
    if (state.beside !== null && state.beside > last) state.beside = null;
    if (!values.ranking.some((one) => one.name === state.candidate)) state.candidate = null;
    const other = !before || before.data !== values.data, looked = !other && !before.compared && values.steps.length === 1;
    if (other || looked || !known.has(state.driver)) {
      state.joint = values.where.joint;
      state.driver = values.where.driver;
    }
    if (other) state.brushed = null;
    if (!values.pose.includes(state.pose)) {
      const sizes = values.steps[last].residual.map(norm);
      state.pose = values.pose[sizes.indexOf(Math.max(...sizes))];
    }
    wireControls();
    const first = values.ranking[0];
    if (!state.candidate && first && first.verdict !== "no_evidence") {
      [state.candidate, state.joint, state.driver] = [first.name, first.joint, first.driver];
    }
    redraw();
    emit("lrm_choose", state.candidate);
  }

  function load(address) {
    return fetch(address).then((reply) => {
      if (!reply.ok) throw new Error(`the workbench answered ${reply.status}`);
      return reply.json();
    }).then(show);
  }

  function theme(name) {
    document.documentElement.dataset.theme = name;
    redraw();
  }

  return { show, load, theme, print, rover, redraw, resize, choose, showStep, brush, hover, state };
})();
window.lrm = lrm;
