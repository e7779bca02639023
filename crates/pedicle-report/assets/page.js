"use strict";
// Theme, printing, and files saved from figures and tables.
const page = {
  themes: [],
  isDark: () => document.documentElement.dataset.theme === "dark",

  setTheme(theme) {
    document.documentElement.dataset.theme = theme;
    document.getElementById("theme").textContent = theme === "dark" ? "Light" : "Dark";
    for (const listener of page.themes) listener();
  },

  /** Offers bytes as a file. */
  save(name, blob) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  },

  /** The figure with its own style, so that it can stand alone. */
  standalone(svg) {
    const copy = svg.cloneNode(true);
    const style = document.createElementNS("http://www.w3.org/2000/svg", "style");
    style.textContent = document.getElementById("figure-style").textContent;
    copy.prepend(style);
    return new XMLSerializer().serializeToString(copy);
  },
};

{
  const wanted = window.matchMedia("(prefers-color-scheme: dark)");
  page.setTheme(wanted.matches ? "dark" : "light");
  wanted.addEventListener("change", () => page.setTheme(wanted.matches ? "dark" : "light"));
  document.getElementById("theme").addEventListener("click", () => page.setTheme(page.isDark() ? "light" : "dark"));
  document.getElementById("print").addEventListener("click", () => window.print());
  // Paper is white.
  let before = null;
  window.addEventListener("beforeprint", () => {
    before = document.documentElement.dataset.theme;
    page.setTheme("light");
  });
  window.addEventListener("afterprint", () => page.setTheme(before));
  document.addEventListener("click", (event) => {
    const button = event.target.closest("[data-save]");
    if (!button) return;
    const { save, name } = button.dataset;
    if (save === "svg") {
      const svg = button.closest("figure").querySelector("svg");
      page.save(`${name}.svg`, new Blob([page.standalone(svg)], { type: "image/svg+xml" }));
    } else {
      const text = button.parentElement.querySelector("script").textContent;
      page.save(`${name}.csv`, new Blob([text.replaceAll("\\u003c", "<")], { type: "text/csv" }));
    }
  });
}
