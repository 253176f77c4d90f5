"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const root = document.documentElement;
  const wantsDark = window.matchMedia("(prefers-color-scheme: dark)");
  const narrow = () => window.innerWidth < 600;
  const printing = { now: false };
  // on a touch screen a finger on a plot moves the page, not the axes
  const touch = window.matchMedia("(pointer: coarse)").matches;
  const config = {
    responsive: true, displaylogo: false, displayModeBar: touch ? false : "hover",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "zoomIn2d", "zoomOut2d"],
  };

  // ---- theme: figures name roles of colours, which become colours here ----
  const dark = () => {
    if (printing.now) return false;
    return root.dataset.theme ? root.dataset.theme === "dark" : wantsDark.matches;
  };
  const coloured = (value) => {
    if (typeof value === "string") {
      const pair = value[0] === "@" && Object.hasOwn(data.roles, value) ? data.roles[value] : null;
      return pair ? pair[dark() ? 1 : 0] : value;
    }
    if (Array.isArray(value)) return value.map(coloured);
    if (value && typeof value === "object" && !ArrayBuffer.isView(value)) {
      const result = {};
      for (const key of Object.keys(value)) result[key] = coloured(value[key]);
      return result;
    }
    return value;
  };
  const unpacked = (bytes) => {
    const text = atob(bytes.bdata);
    const raw = Uint8Array.from(text, (c) => c.charCodeAt(0));
    return new Float32Array(raw.buffer);
  };

  // ---- plots ----
  const figures = new Map();
  const draw = (element, figure) => {
    figures.set(element, figure);
    const result = coloured(figure);
    result.layout = { ...result.layout, autosize: true, dragmode: touch ? false : "zoom" };
    result.layout.modebar = { bgcolor: "rgba(0,0,0,0)", color: coloured("@muted"), activecolor: coloured("@ink") };
    result.layout.hoverlabel = { bgcolor: coloured("@page"), bordercolor: coloured("@muted"), font: { color: coloured("@ink") } };
    if (narrow() && !printing.now) {
      result.layout.margin = { ...result.layout.margin, l: 54, r: 6 };
      result.layout.font = { ...result.layout.font, size: 11 };
    }
    result.layout.annotations = spread(result.layout, element.clientWidth);
    return Plotly.react(element, result.data, result.layout, config);
  };

  /** Annotations with the labels of events moved apart where they would overlap. */
  const PITCH = 13;
  const spread = (layout, width) => {
    const all = layout.annotations || [];
    const labels = all.filter((a) => a.name === "event");
    for (const name of new Set(labels.map((a) => a.xref))) {
      const axis = layout[name.replace("x", "xaxis")] || {};
      if (!axis.range || axis.type === "log") continue;
      const inner = width - layout.margin.l - layout.margin.r;
      const [begin, end] = axis.domain || [0, 1];
      const pixel = (x) => inner * (begin + (end - begin) * (x - axis.range[0]) / (axis.range[1] - axis.range[0]));
      const own = labels.filter((a) => a.xref === name).sort((a, b) => a.x - b.x);
      const place = own.map((a) => pixel(a.x));
      for (let k = 1; k < own.length; k++) place[k] = Math.max(place[k], place[k - 1] + PITCH);
      const last = own.length - 1;
      place[last] = Math.min(place[last], inner * end);
      for (let k = last - 1; k >= 0; k--) place[k] = Math.min(place[k], place[k + 1] - PITCH);
      own.forEach((a, k) => { a.xshift = place[k] - pixel(a.x); });
    }
    return all;
  };
  const redraw = () => { for (const [element, figure] of figures) draw(element, figure); };

  // ---- the plot that the map's cells fill ----
  const payload = data.residuals;
  const place = document.getElementById("plot-residuals");
  const chosen = { cell: payload ? payload.first : 0, window: "regime", unit: "unit" };
  const words = (name) => name.replaceAll("_", " ");

  /** The area within m sigmas, in pieces where nothing is compared between them. */
  const around = (x, sigma, m) => {
    const bx = [], by = [];
    for (let first = 0; first < x.length; first++) {
      if (Number.isNaN(sigma[first])) continue;
      let last = first;
      while (last + 1 < x.length && !Number.isNaN(sigma[last + 1])) last++;
      if (bx.length) { bx.push(null); by.push(null); }
      for (let k = first; k <= last; k++) { bx.push(x[k]); by.push(m * sigma[k]); }
      for (let k = last; k >= first; k--) { bx.push(x[k]); by.push(-m * sigma[k]); }
      first = last;
    }
    return {
      type: "scatter", mode: "lines", x: bx, y: by, fill: "toself", fillcolor: m === 1 ? "@blue-band" : "@blue-faint",
      line: { width: 0 }, name: `±${m} sigma`, hoverinfo: "skip",
    };
  };

  const inTime = (cell, channel) => {
    const sigmas = chosen.unit === "sigma";
    const x = unpacked(channel.x), sigma = unpacked(channel.sigma);
    const y = sigmas ? unpacked(channel.y).map((v, k) => v / sigma[k]) : unpacked(channel.y);
    const spread = sigmas ? sigma.map((v) => v / v) : sigma;  // NaN stays NaN
    const room = Math.max(0.06 * (cell.t1 - cell.t0), 0.5);
    const range = chosen.window === "flight" ? payload.span : [cell.t0 - room, cell.t1 + room];
    let least = sigmas ? -2.5 : 0, most = sigmas ? 2.5 : 0;
    const inside = (k) => x[k] >= range[0] && x[k] <= range[1] && !Number.isNaN(y[k]);
    const ordered = [...spread].filter((_, k) => inside(k)).sort((a, b) => a - b);
    const large = 10 * ordered[ordered.length >> 1];  // a sample with such a sigma says little: it sets no range
    for (let k = 0; k < x.length; k++) {
      if (!inside(k) || spread[k] > large) continue;
      least = Math.min(least, y[k], -2 * spread[k]);
      most = Math.max(most, y[k], 2 * spread[k]);
    }
    const bands = [2, 1].map((m) => around(x, spread, m));
    const unit = sigmas ? "sigma" : channel.unit;
    const curve = {
      type: "scatter", mode: "lines", name: "residual", x, y, line: { color: "@vermillion", width: 1.2 },
      hovertemplate: `%{x:.2f} s: %{y:.4~g} ${unit}<extra></extra>`,
    };
    const margin = 0.06 * (most - least) || 1;
    const shapes = [...payload.shapes, {
      type: "rect", xref: "x", yref: "paper", x0: cell.t0, x1: cell.t1, y0: 0, y1: 1, fillcolor: "@shade",
      line: { width: 1, color: "@orange" }, layer: "below",
    }];
    const onset = payload.onsets[cell.channel];
    if (onset !== undefined) {
      shapes.push({
        type: "line", xref: "x", yref: "paper", x0: onset, x1: onset, y0: 0, y1: 1,
        line: { color: "@ink", width: 1.5, dash: "dash" },
      });
    }
    const labels = payload.notes.filter((n) => n.x >= range[0] && n.x <= range[1]);
    const layout = {
      ...payload.layout, shapes, annotations: labels, margin: { ...payload.layout.margin, t: labels.length ? 74 : 16 },
      xaxis: { ...payload.layout.xaxis, range: [...range] },
      yaxis: { ...payload.layout.yaxis, range: [least - margin, most + margin],
        title: { ...payload.layout.yaxis.title, text: `${words(cell.channel)} (${unit})` } },
    };
    return { data: [...bands, curve], layout };
  };

  const fixed = (cell, uses) => {
    const colours = ["@blue", "@vermillion", "@green"];
    const x = uses.once ? uses.parts : unpacked(uses.time);
    const traces = uses.values.map((packed, k) => {
      const y = unpacked(packed);
      const point = { color: colours[k % 3], size: uses.once ? 11 : 5 };
      return {
        type: "scatter", mode: "markers", name: uses.parts[k], x: uses.once ? [uses.parts[k]] : x, y, marker: point,
        hovertemplate: "%{y:.2f} sigma<extra>%{fullData.name}</extra>", showlegend: !uses.once,
      };
    });
    let most = 3.3;
    for (const trace of traces) for (const y of trace.y) if (Math.abs(y) > most) most = 1.08 * Math.abs(y);
    const bands = [3, 1].map((m) => ({
      type: "rect", xref: "paper", yref: "y", x0: 0, x1: 1, y0: -m, y1: m, layer: "below",
      fillcolor: m === 1 ? "@blue-band" : "@blue-faint", line: { width: 0 },
    }));
    const time = uses.once ? { type: "category", title: { text: "" } } : { title: payload.layout.xaxis.title };
    const layout = {
      ...payload.layout, shapes: bands, annotations: [], margin: { ...payload.layout.margin, t: 16 }, xaxis: { ...payload.layout.xaxis, ...time },
      yaxis: { ...payload.layout.yaxis, range: [-most, most], title: { ...payload.layout.yaxis.title, text: "innovation (sigma)" } },
    };
    return { data: traces, layout };
  };

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
      draw(place, inTime(cell, channel));
    } else if (cell.regime === "constraints" && uses) {
      title.textContent += " Below: its innovations on the way forwards; bands of one and three sigmas.";
      place.hidden = false;
      draw(place, fixed(cell, uses));
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

  // ---- labels of events keep their distances when the width changes ----
  let width = window.innerWidth, waitingForSize = 0;
  window.addEventListener("resize", () => {
    if (window.innerWidth === width || printing.now) return;
    width = window.innerWidth;
    window.clearTimeout(waitingForSize);
    waitingForSize = window.setTimeout(redraw, 200);
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
