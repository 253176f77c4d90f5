(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const root = document.documentElement;
  const wantsDark = window.matchMedia("(prefers-color-scheme: dark)");
  const printing = { now: false };

  // ---- theme ----
  const dark = () => {
    if (printing.now) return false;
    return root.dataset.theme ? root.dataset.theme === "dark" : wantsDark.matches;
  };
  const { draw, redraw, figures } = figureDrawing(data.roles, { dark, printing: () => printing.now });

  // ---- the plot that the map's cells fill ----
  const payload = data.residuals;
  const place = document.getElementById("plot-residuals");
  const chosen = { cell: payload ? payload.first : 0, window: "regime", unit: "unit" };

  const press = (selector, test) => {
    for (const b of document.querySelectorAll(selector)) b.setAttribute("aria-pressed", String(test(b)));
  };

  const show = () => {
    const cell = payload.cells[chosen.cell];
    const channel = payload.channels[cell.channel], uses = payload.constraints[cell.channel];
    const title = document.getElementById("residuals-title");
    press(".cell", (b) => Number(b.dataset.cell) === chosen.cell);
    press("[data-window]", (b) => b.dataset.window === chosen.window);
    press("[data-unit]", (b) => b.dataset.unit === chosen.unit);
    const inFlight = cell.regime !== "constraints" && channel;
    for (const b of document.querySelectorAll(".choices button")) b.disabled = !inFlight;
    document.getElementById("residuals-caption").hidden = !inFlight;
    title.textContent = cell.text;
    if (typeof Plotly === "undefined") return;
    if (inFlight) {
      place.hidden = false;
      draw(place, residualFigure(payload, cell, channel, chosen));
    } else if (cell.regime === "constraints" && uses) {
      title.textContent += " Below: its innovations on the way forwards; bands of one and three sigmas.";
      place.hidden = false;
      draw(place, constraintFigure(payload, uses));
    } else {
      figures.delete(place);
      place.hidden = true;
      title.textContent += " There is no residual against time for it.";
    }
  };

  // ---- what people press ----
  const toggle = document.getElementById("theme");
  const label = () => { toggle.textContent = dark() ? "light theme" : "dark theme"; };
  toggle.addEventListener("click", () => {
    root.dataset.theme = dark() ? "light" : "dark";
    label();
    redraw();
  });
  wantsDark.addEventListener("change", () => { if (!root.dataset.theme) { label(); redraw(); } });
  label();

  for (const button of document.querySelectorAll(".cell")) {
    button.addEventListener("click", () => {
      chosen.cell = Number(button.dataset.cell);
      chosen.window = "regime";
      show();
      const box = place.getBoundingClientRect();
      if (box.bottom > window.innerHeight || box.top < 0) {
        document.getElementById("residuals").scrollIntoView({ block: "nearest" });
      }
    });
  }
  for (const button of document.querySelectorAll(".choices button")) {
    button.addEventListener("click", () => {
      if (button.dataset.window) chosen.window = button.dataset.window;
      if (button.dataset.unit) chosen.unit = button.dataset.unit;
      show();
    });
  }
  const select = (element) => {
    const range = document.createRange();
    range.selectNodeContents(element);
    const selection = window.getSelection();
    selection.removeAllRanges();
    selection.addRange(range);
  };
  for (const button of document.querySelectorAll(".copy")) {
    button.addEventListener("click", async () => {
      const code = button.parentElement.querySelector("code");
      try {
        await navigator.clipboard.writeText(code.textContent);
        button.textContent = "copied";
      } catch {  // not every browser lets a file use the clipboard
        select(code);
        button.textContent = document.execCommand("copy") ? "copied" : "selected";
      }
      window.setTimeout(() => { button.textContent = "copy"; }, 1500);
    });
  }

  // ---- the map: one tab stop, arrow keys from cell to cell ----
  const lines = [...document.querySelectorAll(".map tbody tr")].map(
    (line) => [...line.querySelectorAll("td")].map((box) => box.querySelector(".cell")));
  const stop = (cell) => {
    for (const button of document.querySelectorAll(".cell")) button.tabIndex = button === cell ? 0 : -1;
  };
  const STEPS = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
  const move = (event) => {
    const step = STEPS[event.key];
    if (!step || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    let row = lines.findIndex((line) => line.includes(event.currentTarget));
    let column = lines[row].indexOf(event.currentTarget);
    for (;;) {
      row += step[0];
      column += step[1];
      if (!lines[row] || column < 0 || column >= Math.max(...lines.map((line) => line.length))) return;
      const cell = step[0] ? lines[row][Math.min(column, lines[row].length - 1)] : lines[row][column];
      if (cell) { stop(cell); cell.focus(); return; }
    }
  };
  for (const cell of document.querySelectorAll(".cell")) {
    cell.addEventListener("keydown", move);
    cell.addEventListener("focus", () => stop(cell));
  }
  stop(document.querySelector(`.cell[data-cell="${payload ? payload.first : 0}"]`) || document.querySelector(".cell"));

  // ---- first drawing, one plot after the other so that the page answers meanwhile ----
  const waiting = [...document.querySelectorAll("[data-figure]")];
  const next = () => {
    const element = waiting.shift();
    if (!element) { root.dataset.drawn = "true"; return; }
    draw(element, data.figures[element.dataset.figure]);
    window.setTimeout(next, 0);
  };

  /** The plotting library: in the page, in its folder, or in the folder above. */
  const load = (source) => new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = source;
    script.addEventListener("load", resolve);
    script.addEventListener("error", reject);
    document.head.append(script);
  });
  const library = async () => {
    if (typeof Plotly !== "undefined") return;
    await load("plotly.min.js").catch(() => load("../plotly.min.js"));
  };
  library().then(() => {
    if (payload) show();
    next();
  }).catch(() => {
    const note = document.createElement("p");
    note.className = "warning";
    note.textContent = "The plots need the file plotly.min.js in the folder of this page or the folder above.";
    document.querySelector("nav").after(note);
  });

  // ---- paper: light, and as wide as the page ----
  const resized = (width) => {
    for (const element of figures.keys()) {
      const half = element.closest(".grid") !== null;
      Plotly.relayout(element, width ? { width: half ? width / 2 - 8 : width, autosize: false } : { width: null, autosize: true });
    }
  };
  window.addEventListener("beforeprint", () => {
    while (waiting.length) { const e = waiting.shift(); draw(e, data.figures[e.dataset.figure]); }
    printing.now = true;
    root.dataset.screen = root.dataset.theme || "";
    root.dataset.theme = "light";
    redraw();
    resized(680);
  });
  window.addEventListener("afterprint", () => {
    printing.now = false;
    if (root.dataset.screen) root.dataset.theme = root.dataset.screen;
    else delete root.dataset.theme;
    redraw();
    resized(null);
  });
})();
