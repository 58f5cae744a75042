// The workbench's own script: drag and drop, keyboard, the banner when the server is gone, the tour's marks.
"use strict";
(() => {
  const banner = (text) => {
    const box = document.getElementById("lrm-banner");
    if (!box) return;
    box.textContent = text;
    box.hidden = !text;
  };

  window.lrmOpen = (files) => {
    const form = new FormData();
    for (const file of files) form.append("files", file, file.name);
    fetch("/lrm/drop", { method: "POST", body: form }).catch(() => banner("the workbench does not answer"));
  };
  window.addEventListener("dragover", (event) => { event.preventDefault(); document.body.classList.add("lrm-over"); });
  window.addEventListener("dragleave", () => document.body.classList.remove("lrm-over"));
  window.addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("lrm-over");
    if (event.dataTransfer.files.length) window.lrmOpen(event.dataTransfer.files);
  });

  document.addEventListener("keydown", (event) => {
    const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "radio";
    if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.toLowerCase();
    if ("aurplcs".includes(key) && key.length === 1) window.lrmEmit("lrm_key", key);
    if (event.key === "Escape" && menu()?.open) menu().open = false;
    else if (event.key === "Escape") window.lrmEmit("lrm_key", "escape");
  });

  // A click is answered at once, before the server has heard of it; its answer takes the mark away.
  const SLOW = { add: "adding", undo: "undoing", redo: "redoing", auto: "auto", diagnose: "diagnosing", "propose a formula": "searching for a formula",
    "next poses": "choosing poses", "add a field (not a cause)": "adding a field" };
  const asked = (words) => {
    const box = document.getElementById("lrm-asked");
    if (!box) return;
    box.textContent = words ? words + "…" : "";
    box.hidden = !words;
  };
  document.addEventListener("click", (event) => {
    const button = event.target.closest && event.target.closest("[data-name]");
    if (button && !button.disabled && SLOW[button.dataset.name]) asked(SLOW[button.dataset.name]);
  }, true);
  window.lrmAnswered = () => asked("");

  window.lrmTurnDark = () => lrm.theme(lrmTheme());
  new MutationObserver(() => Quasar.Dark.set(document.documentElement.dataset.theme === "dark"))
    .observe(document.documentElement, { attributeFilter: ["data-theme"] });

  // The tour goes to a stop, or ends where there is none of that number: the stop's panel is framed and in view below the head,
  // and the card lies in the other half of the screen.
  window.lrmTour = (number) => {
    const card = document.querySelector(".lrm-tour"), stops = [...card.querySelectorAll("[data-panel]")], stop = stops[number];
    for (const one of stops) one.hidden = one !== stop;
    document.querySelector(".lrm-toured")?.classList.remove("lrm-toured");
    [lrmTour.stop, card.hidden] = [number, !stop];
    if (!stop) return;
    card.querySelector("button").disabled = !number;
    const panel = document.getElementById(stop.dataset.panel);
    panel.classList.add("lrm-toured");
    panel.scrollIntoView({ block: "start" });
    const box = panel.getBoundingClientRect();
    card.classList.toggle("lrm-on-the-left", box.left > innerWidth / 3 && box.width < innerWidth / 1.5);
  };

  // The menu is shut by a choice of it, a click beside it, and Escape.
  const menu = () => document.getElementById("lrm-menu");
  document.addEventListener("click", (event) => {
    if (menu()?.open && (!menu().contains(event.target) || event.target.closest("[data-name]"))) setTimeout(() => { menu().open = false; });
  });

  let away = 0;
  setInterval(() => {
    if (!window.socket) return;
    away = window.socket.connected ? 0 : away + 1;
    if (away === 2) banner(window.lrmGone || "The workbench does not answer.");
    if (!away && !document.getElementById("lrm-banner").hidden) banner("");
  }, 700);
})();
