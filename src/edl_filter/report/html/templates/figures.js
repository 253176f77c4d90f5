"use strict";
// Figures of the report and of the workbench, which include this script: colours of roles, labels of events, and the
// residual of a cell of the residual map against time.

/** Numbers from their four-byte form. */
function unpacked(bytes) {
  const raw = Uint8Array.from(atob(bytes.bdata), (c) => c.charCodeAt(0));
  return new Float32Array(raw.buffer);
}

/** Annotations of a layout with the labels of events moved apart where they would overlap. */
function spreadEventLabels(layout, width) {
  const PITCH = 13; // pixels from label to label
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
}

/**
 * Functions that draw the figures of a page, remember them and draw them again.
 *
 * `roles`: "@role" → its colours on the light and on the dark page; `page.dark()`: whether the page is dark;
 * `page.printing()`: whether it is drawn for paper.
 */
function figureDrawing(roles, page) {
  // on a touch screen a finger on a plot moves the page, not the axes
  const touch = window.matchMedia("(pointer: coarse)").matches;
  const config = {
    responsive: true, displaylogo: false, displayModeBar: touch ? false : "hover",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "zoomIn2d", "zoomOut2d"],
  };
  const figures = new Map(); // element → figure
  const coloured = (value) => {
    if (typeof value === "string") {
      const pair = value[0] === "@" && Object.hasOwn(roles, value) ? roles[value] : null;
      return pair ? pair[page.dark() ? 1 : 0] : value;
    }
    if (Array.isArray(value)) return value.map(coloured);
    if (value && typeof value === "object" && !ArrayBuffer.isView(value)) {
      const result = {};
      for (const key of Object.keys(value)) result[key] = coloured(value[key]);
      return result;
    }
    return value;
  };
  const draw = (element, figure) => {
    figures.set(element, figure);
    const result = coloured(figure);
    result.layout = { ...result.layout, autosize: true, dragmode: touch ? false : "zoom" };
    result.layout.modebar = { bgcolor: "rgba(0,0,0,0)", color: coloured("@muted"), activecolor: coloured("@ink") };
    result.layout.hoverlabel = { bgcolor: coloured("@page"), bordercolor: coloured("@muted"), font: { color: coloured("@ink") } };
    if (window.innerWidth < 600 && !page.printing()) {
      result.layout.margin = { ...result.layout.margin, l: 54, r: 6 };
      result.layout.font = { ...result.layout.font, size: 11 };
    }
    result.layout.annotations = spreadEventLabels(result.layout, element.clientWidth);
    return Plotly.react(element, result.data, result.layout, config);
  };
  /** Draws the figures that are still on the page. */
  const redraw = () => {
    for (const [element, figure] of figures) {
      if (element.isConnected) draw(element, figure);
      else figures.delete(element);
    }
  };

  // labels of events keep their distances when the width changes
  let width = window.innerWidth, waitingForSize = 0;
  window.addEventListener("resize", () => {
    if (window.innerWidth === width || page.printing()) return;
    width = window.innerWidth;
    window.clearTimeout(waitingForSize);
    waitingForSize = window.setTimeout(redraw, 200);
  });
  return { draw, redraw, figures };
}

/** The area within m sigmas, in pieces where nothing is compared between them. */
function sigmaBand(x, sigma, m) {
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
}

/**
 * Residual of a cell's channel against time, with its bands of one and two sigmas.
 *
 * `flight`: span, layout, and shapes, notes and onsets that are drawn; `channel`: x, y, sigma and unit;
 * `choice.window`: "regime" or "flight"; `choice.unit`: "unit" or "sigma".
 */
function residualFigure(flight, cell, channel, choice) {
  const sigmas = choice.unit === "sigma";
  const x = unpacked(channel.x), sigma = unpacked(channel.sigma);
  const y = sigmas ? unpacked(channel.y).map((v, k) => v / sigma[k]) : unpacked(channel.y);
  const spread = sigmas ? sigma.map((v) => v / v) : sigma; // NaN stays NaN
  const room = Math.max(0.06 * (cell.t1_s - cell.t0_s), 0.5);
  const range = choice.window === "flight" ? flight.span : [cell.t0_s - room, cell.t1_s + room];
  let least = sigmas ? -2.5 : 0, most = sigmas ? 2.5 : 0;
  const inside = (k) => x[k] >= range[0] && x[k] <= range[1] && !Number.isNaN(y[k]);
  const ordered = [...spread].filter((_, k) => inside(k)).sort((a, b) => a - b);
  const large = 10 * ordered[ordered.length >> 1]; // a sample with such a sigma says little: it sets no range
  for (let k = 0; k < x.length; k++) {
    if (!inside(k) || spread[k] > large) continue;
    least = Math.min(least, y[k], -2 * spread[k]);
    most = Math.max(most, y[k], 2 * spread[k]);
  }
  const unit = sigmas ? "sigma" : channel.unit;
  const curve = {
    type: "scatter", mode: "lines", name: "residual", x, y, line: { color: "@vermillion", width: 1.2 },
    hovertemplate: `%{x:.2f} s: %{y:.4~g} ${unit}<extra></extra>`,
  };
  const margin = 0.06 * (most - least) || 1;
  const shapes = [...flight.shapes, {
    type: "rect", xref: "x", yref: "paper", x0: cell.t0_s, x1: cell.t1_s, y0: 0, y1: 1, fillcolor: "@shade",
    line: { width: 1, color: "@orange" }, layer: "below",
  }];
  const onset = flight.onsets[cell.channel];
  if (onset !== undefined) {
    shapes.push({
      type: "line", xref: "x", yref: "paper", x0: onset, x1: onset, y0: 0, y1: 1,
      line: { color: "@ink", width: 1.5, dash: "dash" },
    });
  }
  const labels = flight.notes.filter((n) => n.x >= range[0] && n.x <= range[1]);
  const layout = {
    ...flight.layout, shapes, annotations: labels, margin: { ...flight.layout.margin, t: labels.length ? 74 : 16 },
    xaxis: { ...flight.layout.xaxis, range: [...range] },
    yaxis: { ...flight.layout.yaxis, range: [least - margin, most + margin],
      title: { ...flight.layout.yaxis.title, text: `${cell.channel.replaceAll("_", " ")} (${unit})` } },
  };
  return { data: [...[2, 1].map((m) => sigmaBand(x, spread, m)), curve], layout };
}

/** Innovations of a constraint in sigmas, with bands of one and three: against time, or by component if it is used once. */
function constraintFigure(flight, uses) {
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
  const time = uses.once ? { type: "category", title: { text: "" } } : { title: flight.layout.xaxis.title };
  const layout = {
    ...flight.layout, shapes: bands, annotations: [], margin: { ...flight.layout.margin, t: 16 },
    xaxis: { ...flight.layout.xaxis, ...time },
    yaxis: { ...flight.layout.yaxis, range: [-most, most], title: { ...flight.layout.yaxis.title, text: "innovation (sigma)" } },
  };
  return { data: traces, layout };
}
