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
    const plot = make("div", { class: "plot", id: "trajectory", role: "img", "aria-label": "Altitude, velocity and their sigmas against time" });
    columnsBox.append(plot);
    requestAnimationFrame(() => figures.draw(plot, overview.trajectory));
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

/** Smallest detectable sizes, the output of `edl-filter identifiability`. */
function studyView(study) {
  const rows = study.effects.flatMap((e) => Object.entries(e.parameters).map(([name, p], k) => [k ? "" : plain(e.imu ? `${e.effect} in ${e.imu}` : e.effect), name,
    number(p.smallest), number(p.plausible), unitText(p.unit).trim() || "–", k ? "" : Object.keys(e.confused_with).map(plain).join(", ") || "–"]));
  const columns = ["effect", "parameter", "smallest detectable", "plausible", "unit", "confused with"].map((name, k) => ({ name, right: k === 2 || k === 3 }));
  const sizes = table(columns, rows);
  return make("section", { id: "study" }, make("h2", {}, "Detectable sizes"),
    make("p", { class: "secondary" }, `Size of each effect at which the expected gain is ${number(study.required_gain)} nats on this flight.`), sizes);
}
