// The reconstruction in a result: warnings, events, trajectory, constraints, and the link to the report.
"use strict";

/** Warnings in a box; those about trust come first, as the server lists them. */
function warningsView(result, overview) {
  if (!overview.warnings.length) return null;
  const [first, ...further] = overview.warnings;
  return make("section", { class: `verdict ${result.headline ? "unknown" : "missing"}`, id: "warnings" },
    make("strong", result.headline ? { id: "trust" } : {}, first), ...further.map((sentence) => make("p", {}, sentence)));
}

function reportLink(result, overview) {
  if (!overview.report) return make("p", { class: "secondary" }, "There is no report in this folder; a run writes one.");
  return make("p", {}, make("a", { id: "report", href: `report?path=${encodeURIComponent(result.path)}`, target: "_blank", rel: "noopener" },
    "Open the report"), " with all figures and tables of this result.");
}

/** A value with its sigma to a number of places, or to more where the sigma would be zero. */
function plusMinus(value, sigma, scale, places) {
  if (value == null) return "–";
  let digits = places;
  while (sigma > 0 && digits < 5 && Number((sigma / scale).toFixed(digits)) === 0) digits += 1;
  return (value / scale).toFixed(digits).replace("-", "−") + (sigma == null ? "" : ` ± ${(sigma / scale).toFixed(digits)}`);
}

/** Short labels of events, those of the report. */
const EVENT_LABELS = { parachute_deploy: "parachute", peak_deceleration: "peak", heat_shield_separation: "heat shield",
  backshell_separation: "backshell", retro_rocket_fire: "rockets" };

/** Events, trajectory and constraints. */
function reconstructionView(overview) {
  const events = Object.entries(overview.events).sort((a, b) => a[1].time_s - b[1].time_s);
  const rows = events.map(([name, e]) => [plain(name), plusMinus(e.time_s, null, 1, 2), plusMinus(e.altitude_m, e.altitude_sigma_m, 1000, 3),
    plusMinus(e.velocity_m_s, e.velocity_sigma_m_s, 1, 1), number(e.mach), number(e.dynamic_pressure_pa), number(e.alpha_total_deg)]);
  const columns = ["event", "time (s)", "altitude (km)", "velocity (m/s)", "Mach", "q (Pa)", "total angle (deg)"]
    .map((name, k) => ({ name, right: k > 0 }));
  const eventTable = table(columns, rows);
  eventTable.id = "events";
  const constraints = Object.entries(overview.constraints);
  const constraintTable = table(["constraint", "accepted", "NIS (dof)", "verdict"].map((name, k) => ({ name, right: k === 1 || k === 2 })),
    constraints.map(([name, c]) => [plain(name), `${c.accepted_uses}/${c.uses}`, `${number(c.nis)} (${c.dof})`, make("span", { class: c.tone }, c.verdict)]));
  constraintTable.id = "constraints";
  const lists = make("div", {}, rows.length ? eventTable : null, landingView(overview.landing));
  const columnsBox = make("div", { class: "reconstruction" }, lists);
  const section = make("section", {}, make("h2", {}, "Reconstruction"), columnsBox);
  if (overview.trajectory) {
    const plot = make("div", { class: "plot", id: "trajectory", role: "img", "aria-label": "Altitude and velocity against time" });
    columnsBox.append(plot);
    requestAnimationFrame(() => drawTrajectory(plot, overview.trajectory, events));
  }
  if (constraints.length) {
    const rejected = constraints.filter(([, c]) => c.tone === "bad").length;
    const outside = constraints.filter(([, c]) => c.tone === "doubt").length;
    const summary = `Constraints: ${constraints.length - rejected} of ${constraints.length} accepted${outside ? `, ${outside} outside ${outside > 1 ? "their" : "its"} interval` : ""}`;
    lists.append(make("details", { open: rejected > 0 }, make("summary", {}, summary), constraintTable,
      make("p", { class: "secondary" }, "NIS is the normalised innovation squared. Outside and below: of the interval that contains it with 99.9 %; below it, the constraint agrees better than its sigma lets expect.")));
  }
  if (overview.notes.length) {
    lists.append(make("details", { id: "notes" }, make("summary", {}, `Notes about the telemetry: ${overview.notes.length}`),
      ...overview.notes.map((note) => make("p", { class: "secondary" }, note))));
  }
  return section;
}

function landingView(landing) {
  if (!landing || landing.miss_m == null) return null;
  return make("p", { class: "secondary" }, `Landing ${plusMinus(landing.miss_m, landing.sigma_m, 1, 0)} m from the stated site.`);
}

function drawTrajectory(plot, trajectory, events) {
  const style = getComputedStyle(document.documentElement);
  const [text, line, background] = ["--text", "--line", "--background"].map((n) => style.getPropertyValue(n).trim());
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const colours = dark ? ["#56B4E9", "#E69F00"] : ["#0072B2", "#B35900"];
  const axis = { gridcolor: line, zerolinecolor: line, linecolor: line, automargin: true };
  const kilo = (values) => values.map((v) => (v == null ? null : v / 1000));
  const marks = events.filter(([name]) => name !== "entry_interface");
  const [begin, end] = [trajectory.time[0], trajectory.time.at(-1)];
  const width = Math.max(plot.clientWidth - 120, 100); // without the axes
  const [top, bottom] = [marks.length ? 78 : 8, 72]; // labels of events; tick labels, title and legend
  let previous = -Infinity; // label before, pixels
  const annotations = marks.map(([name, e]) => {
    const at = (width * (e.time_s - begin)) / (end - begin);
    previous = Math.max(at, previous + 14);
    return { x: e.time_s, xshift: previous - at, y: 1, yref: "paper", yanchor: "bottom", showarrow: false, textangle: -90,
      text: EVENT_LABELS[name] || plain(name), font: { size: 12 } };
  });
  Plotly.newPlot(plot, [
    { x: trajectory.time, y: kilo(trajectory.altitude), name: "altitude", mode: "lines", line: { color: colours[0], width: 2 },
      hovertemplate: "%{x:.1f} s: %{y:.3f} km<extra></extra>" },
    { x: trajectory.time, y: kilo(trajectory.speed), name: "velocity", mode: "lines", yaxis: "y2", line: { color: colours[1], width: 2, dash: "dash" },
      hovertemplate: "%{x:.1f} s: %{y:.3f} km/s<extra></extra>" },
  ], {
    margin: { l: 10, r: 10, t: top, b: bottom }, paper_bgcolor: background, plot_bgcolor: background, font: { color: text, size: 12, family: "system-ui, sans-serif" },
    xaxis: { ...axis, title: { text: "time (s)", standoff: 4 }, range: [begin, end] }, yaxis: { ...axis, title: { text: "altitude (km)" } },
    yaxis2: { ...axis, title: { text: "velocity (km/s)" }, overlaying: "y", side: "right", showgrid: false, zeroline: false, tickmode: "auto" },
    legend: { orientation: "h", x: 0, y: -46 / Math.max(plot.clientHeight - top - bottom, 50), yanchor: "top" }, hovermode: "closest",
    shapes: marks.map(([, e]) => ({ type: "line", x0: e.time_s, x1: e.time_s, yref: "paper", y0: 0, y1: 1, line: { color: text, width: 1, dash: "dot" } })),
    annotations,
  }, { responsive: true, displaylogo: false, displayModeBar: false });
}

/** Smallest detectable sizes, the output of `edl-filter identifiability`. */
function studyView(study) {
  const rows = study.effects.flatMap((e) => Object.entries(e.parameters).map(([name, p], k) => [k ? "" : plain(e.imu ? `${e.effect} in ${e.imu}` : e.effect), name,
    number(p.smallest), number(p.plausible), unitText(p.unit).trim() || "–", k ? "" : Object.keys(e.confused_with).map(plain).join(", ") || "–"]));
  const columns = ["effect", "parameter", "smallest detectable", "plausible", "unit", "confused with"].map((name, k) => ({ name, right: k === 2 || k === 3 }));
  const sizes = table(columns, rows);
  return make("section", { id: "study" }, make("h2", {}, "Detectable sizes"),
    make("p", { class: "secondary" }, `Size of each effect at which the expected gain is ${number(study.required_gain)} nats on this flight.`), sizes);
}
