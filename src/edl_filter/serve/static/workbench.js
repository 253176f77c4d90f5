// The workbench: shows what the server's files say, asks for work, and shows it. It keeps no state of its own but
// which mission or result is open, and that stands in the address after '#'.
"use strict";

const $ = (id) => document.getElementById(id);
const state = { library: null, job: null, busy: false, timer: 0, opened: 0, effect: null, followed: 0 };

// ---- small tools -----------------------------------------------------------------------------------------------

/** Element with attributes and children; text is only ever text. */
function make(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === "onclick" || key === "onchange") made[key] = value;
    else if (value === true) made.setAttribute(key, "");
    else if (value !== false && value != null) made.setAttribute(key, value);
  }
  made.append(...children.filter((c) => c != null));
  return made;
}

async function ask(path, body) {
  const options = body === undefined ? {} : {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
  };
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Error("The workbench does not answer: is “edl-filter serve” still running?");
  }
  const told = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(told.error || `The workbench failed (${answer.status}); its terminal says more.`);
  return told;
}

function complain(error) {
  $("error").textContent = error ? error.message : "";
  $("error").hidden = !error;
}

const guarded = (action) => async (...given) => {
  try {
    complain(null);
    await action(...given);
  } catch (error) {
    complain(error);
  }
};

/** A number with three significant digits, as a person writes it. */
function number(x, digits = 3) {
  if (x == null) return "–";
  const size = Math.abs(x);
  if (x === 0) return "0";
  if (size >= 1e5 || size < 1e-4) {
    const [head, power] = x.toExponential(digits - 1).split("e");
    const raised = [...String(Number(power))].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("");
    return `${head.replace("-", "−")}·10${raised}`;
  }
  const places = Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return x.toFixed(places).replace("-", "−");
}

/** A normalised RMS as a cell of the map shows it. */
const short = (rms) => (rms == null ? "–" : rms.toFixed(rms < 10 ? 2 : rms < 100 ? 1 : 0));

/** Nats, whole where they are many. */
const nats = (x) => (x == null ? "–" : `${Math.abs(x) < 100 ? number(x) : Math.round(x).toLocaleString("en").replaceAll(",", "\u202f").replace("-", "−")} nats`);

/** A value with its sigma, both to the place of the sigma's second digit. */
function withSigma(value, sigma) {
  if (value == null) return "–";
  if (!(sigma > 0)) return number(value, 4);
  const place = 1 - Math.floor(Math.log10(sigma));
  if (place > 6 || Math.abs(value) >= 1e6) {
    const power = Math.floor(Math.log10(Math.max(Math.abs(value), sigma)));
    const scale = 10 ** power;
    const places = Math.min(8, Math.max(0, place + power));
    const raised = [...String(power)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("");
    return `(${(value / scale).toFixed(places)} ± ${(sigma / scale).toFixed(places)})·10${raised}`.replace("(-", "(−");
  }
  const places = Math.max(0, place);
  return `${value.toFixed(places)} ± ${sigma.toFixed(places)}`.replace(/^-/, "−");
}

const chance = (p) => (p > 0.999 ? "> 99.9 %" : p < 0.001 ? "< 0.1 %" : `${(100 * p).toFixed(1)} %`);
const plain = (name) => name.replaceAll("_", " ").replaceAll("^2", "²").replaceAll("^3", "³");
const unitText = (unit) => (unit ? ` ${unit.replace("^2", "²").replace("^3", "³")}` : "");

/** Commands to copy, a line each. */
function commands(lines) {
  const box = make("div");
  for (const line of lines) {
    const copy = make("button", { type: "button", "aria-label": `Copy: ${line}` }, "Copy");
    copy.onclick = async () => {
      try {
        await navigator.clipboard.writeText(line);
        copy.textContent = "Copied";
      } catch {
        getSelection().selectAllChildren(copy.previousSibling);
        copy.textContent = "Press Ctrl-C";
      }
      setTimeout(() => { copy.textContent = "Copy"; }, 1500);
    };
    box.append(make("div", { class: "command" }, make("code", {}, line), copy));
  }
  return box;
}

function table(heads, rows) {
  const cell = (tag) => (value, k) => make(tag, { class: heads[k].right ? "right" : null }, value);
  return make("div", { class: "scroll" }, make("table", { class: "numbers" },
    make("thead", {}, make("tr", {}, ...heads.map((h, k) => cell("th")(h.name, k)))),
    make("tbody", {}, ...rows.map((row) => make("tr", {}, ...row.map(cell("td")))))));
}

function badge(verdict) {
  return make("span", { class: `badge ${verdict || "quiet"}` }, verdict || "not diagnosed");
}

// ---- lists -----------------------------------------------------------------------------------------------------

async function loadLibrary() {
  state.library = await ask("api/library");
  const { root, missions, results } = state.library;
  $("root").textContent = root;
  const entry = (kind, name, title, extra) => {
    const current = location.hash === address(kind, name);
    return make("li", {}, make("button", {
      type: "button", "aria-current": current ? "page" : null, "data-name": name,
      onclick: () => { location.hash = address(kind, name); },
    }, name, extra ? " " : null, extra, make("small", {}, title)));
  };
  const own = missions.filter((m) => !m.shipped);
  $("missions").replaceChildren(...own.map((m) => entry("mission", m.name, m.title)));
  if (!own.length) $("missions").append(make("li", { class: "quiet" }, "None in the folder yet. Shipped ones are below."));
  $("shipped").replaceChildren(...missions.filter((m) => m.shipped).map((m) => entry("mission", m.name, m.title)));
  if (!own.length) $("shipped-box").open = true;
  $("results").replaceChildren(...results.map((r) => entry("result", r.path, r.title, badge(r.verdict))));
  if (!results.length) $("results").append(make("li", { class: "quiet" }, "None yet. Run a mission."));
}

const address = (kind, name) => `#${kind}=${encodeURIComponent(name)}`;

const open = guarded(async () => {
  const turn = ++state.opened; // a slow answer must not replace a later one
  await loadLibrary();
  const [kind, name] = location.hash.slice(1).split("=").map(decodeURIComponent);
  let shown;
  if (kind === "mission") shown = missionView(name);
  else if (kind === "result") shown = resultView(await ask(`api/result?path=${encodeURIComponent(name)}`));
  else shown = [make("h2", {}, "Choose a mission or a result"),
    make("p", {}, "A mission is a flight and a model of it. Run it, see in which channel and regime the model fails, add the effect that explains it, and watch the error fall to the noise.")];
  if (turn !== state.opened) return;
  $("main").replaceChildren(...shown.filter((n) => n != null));
  setBusy();
});

// ---- a mission -------------------------------------------------------------------------------------------------

function missionView(name) {
  const mission = state.library.missions.find((m) => m.name === name);
  if (!mission) throw new Error(`${name}: found no such mission in the folder.`);
  const there = state.library.results.find((r) => r.path === mission.result);
  return [
    make("h2", {}, mission.title),
    make("p", {}, make("code", {}, mission.name)),
    mission.error ? make("p", { class: "error" }, mission.error) : null,
    make("div", { class: "actions" },
      make("button", { type: "button", class: "main work", id: "run", disabled: Boolean(mission.error),
        onclick: guarded(() => begin("api/run", { mission: name })) }, "Run and diagnose"),
      make("button", { type: "button", class: "work", id: "run-only", disabled: Boolean(mission.error),
        onclick: guarded(() => begin("api/run", { mission: name, diagnose: false })) }, "Run only")),
    there ? make("p", { class: "quiet" }, `Replaces the result in ${there.path}, which is of this mission.`) : null,
    commands(mission.commands),
  ];
}

// ---- a result --------------------------------------------------------------------------------------------------

function resultView(result) {
  const told = result.diagnosis;
  const heading = [make("h2", {}, result.title), make("p", {}, make("code", {}, result.path), " ", badge(told && told.verdict))];
  if (!told) {
    return [...heading, effectsView(result), make("p", {}, "Not diagnosed yet."),
      make("div", { class: "actions" }, make("button", { type: "button", class: "main work", id: "diagnose",
        onclick: guarded(() => begin("api/diagnose", { result: result.path })) }, "Diagnose")),
      commands(result.diagnosing)];
  }
  return [...heading, verdictView(told), ledgerView(result), effectsView(result), ...mapView(result), ...rankingView(result),
    make("h2", {}, "Diagnose again"), make("p", { class: "quiet" }, "The command that made this page’s map and hypotheses."),
    commands(result.diagnosing), make("div", { class: "actions" }, make("button", { type: "button", class: "work", id: "diagnose",
      onclick: guarded(() => begin("api/diagnose", { result: result.path })) }, "Diagnose again"))];
}

function verdictView(told) {
  const floor = told.noise_floor == null ? "" : ` Over all channels it leaves a normalised RMS of ${number(told.noise_floor)}; 1 is the stated noise.`;
  const words = {
    clean: ["Noise floor reached.", `The model explains this flight: what is left is noise, and no effect earns its place.${floor}`],
    missing: [told.sentence, "It is first among the hypotheses below, with its evidence."],
    unknown: ["Something is missing that no known effect explains.", told.sentence],
  }[told.verdict] || ["", told.sentence];
  const more = told.remainder ? make("p", {}, `What is left: ${plain(told.remainder.description)}`) : null;
  const failed = Object.values(told.failed || {}).map((reason) => make("p", { class: "quiet" }, `Left out: ${reason}`));
  return make("div", { class: `verdict ${told.verdict}`, id: "verdict", "data-verdict": told.verdict },
    make("strong", {}, words[0]), make("p", {}, words[1]), more, ...failed);
}

function parameters(values) {
  return table([{ name: "parameter" }, { name: "estimate ± 1 sigma", right: true }, { name: "unit" }],
    Object.entries(values).map(([name, v]) => [name, withSigma(v.estimate, v.sigma), unitText(v.unit).trim() || "–"]));
}

function effectsView(result) {
  const names = Object.keys(result.effects);
  if (!names.length) return make("p", { class: "quiet" }, "No effects are in the model.");
  return make("section", {}, make("h2", {}, "In the model"),
    ...names.map((name) => make("div", { class: "choice" }, make("h3", {}, plain(name)), parameters(result.effects[name]))));
}

/** Errors of every channel across the steps that led here. */
function ledgerView(result) {
  const steps = result.steps.filter((s) => s.errors);
  if (steps.length < 2) return null;
  const channels = Object.keys(steps[0].errors);
  const last = steps[steps.length - 1];
  const rows = channels.map((c) => {
    const values = steps.map((s) => s.errors[c]);
    const [a, b] = [values[0], last.errors[c]];
    const quiet = a == null || b == null || (a < 1.1 && b < 1.1); // a change within the noise says nothing
    return { fall: quiet ? -Infinity : 1 - b / a, row: [plain(c), ...values.map((v) => number(v)),
      quiet ? "–" : `${(100 * (1 - b / a)).toFixed(1).replace("-", "−")} %`] };
  }).sort((x, y) => y.fall - x.fall);
  const label = (s, k) => {
    const added = k ? Object.keys(s.effects).filter((e) => !(e in steps[k - 1].effects)) : [];
    return k ? `+ ${added.map(plain).join(", ")}` : "first look";
  };
  const heads = [{ name: "channel" }, ...steps.map((s, k) => ({ name: label(s, k), right: true })), { name: "fall", right: true }];
  const shown = table(heads, rows.map((r) => r.row));
  shown.id = "ledger";
  return make("section", {}, make("h2", {}, "How the error fell"),
    make("p", { class: "quiet" }, "Normalised RMS by channel: 1 where the model holds. No fall is given within the noise; a fall below zero is a rise."),
    shown,
    make("p", {}, "Steps: ", ...steps.flatMap((s, k) => [k ? " → " : null,
      s.path === result.path ? make("b", {}, s.path) : make("a", { href: address("result", s.path) }, s.path), " ", badge(s.verdict)])),
    commands(result.comparing));
}

// ---- the map ---------------------------------------------------------------------------------------------------

// cividis (Nuñez, Anderton and Renslow 2018) at equal distances
const CIVIDIS = [[0, 34, 78], [18, 53, 112], [59, 73, 108], [87, 93, 109], [112, 113, 115], [138, 134, 120], [165, 156, 116], [195, 179, 105], [225, 204, 85], [254, 232, 56]];

function colour(share) {
  const x = Math.min(1, Math.max(0, share)) * (CIVIDIS.length - 1);
  const k = Math.min(CIVIDIS.length - 2, Math.floor(x));
  return CIVIDIS[k].map((a, i) => Math.round(a + (CIVIDIS[k + 1][i] - a) * (x - k)));
}

function mapView(result) {
  const cells = result.diagnosis.map;
  if (!cells.length) return [];
  const flight = cells.filter((c) => c.regime !== "constraints");
  const fixed = cells.filter((c) => c.regime === "constraints");
  const regimes = [...new Set([...flight].sort((a, b) => a.t0_s - b.t0_s).map((c) => c.regime))];
  const low = Math.log(0.5);
  const worst = Math.max(10, ...cells.map((c) => c.normalised_rms || 0));
  const share = (rms) => (Math.log(Math.max(rms, 0.5)) - low) / (Math.log(worst) - low);
  const panel = make("div", { id: "residual", "aria-live": "polite" },
    make("p", { class: "quiet" }, "Click a cell to see that residual against time."));
  const cell = (c) => {
    if (!c) return make("td");
    const rgb = colour(share(c.normalised_rms ?? 1));
    const [red, green, blue] = rgb.map((c) => (c < 10.3 ? c / 3294.6 : ((c / 255 + 0.055) / 1.055) ** 2.4));
    const bright = 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.18;  // black has the better contrast then (WCAG 2)
    const button = make("button", {
      type: "button", class: c.fails ? "fails" : null, title: plain(c.sentence), "aria-pressed": "false",
      "data-channel": c.channel, "data-regime": c.regime,
      "aria-label": `${plain(c.channel)}, ${c.regime}: ${number(c.normalised_rms)} sigmas${c.fails ? ", fails" : ""}`,
    }, short(c.normalised_rms));
    button.style.background = `rgb(${rgb})`;
    button.style.color = bright ? "#000" : "#fff";
    button.onclick = guarded(async () => {
      for (const other of document.querySelectorAll(".map button")) other.setAttribute("aria-pressed", String(other === button));
      await residualView(panel, result, c);
    });
    return make("td", {}, button);
  };
  const grid = (corner, columns, names, found) => make("div", { class: "scroll" }, make("table", { class: "map" },
    make("thead", {}, make("tr", {}, make("th", {}, corner), ...columns.map((r) => make("th", { scope: "col" }, r === "constraints" ? "sigmas" : r.replace(" flow", ""))))),
    make("tbody", {}, ...names.map((n) => make("tr", {}, make("th", { scope: "row" }, plain(n)),
      ...columns.map((r) => cell(found.find((c) => c.channel === n && c.regime === r))))))));
  const bar = make("span", { class: "bar" });
  bar.style.background = `linear-gradient(to right, ${CIVIDIS.map((c) => `rgb(${c})`).join(",")})`;
  const names = [...new Set(flight.map((c) => c.channel))];
  const failing = cells.filter((c) => c.fails).length;
  return [
    make("h2", {}, "Where the model fails"),
    make("p", {}, failing ? `${failing} of ${cells.length} cells fail.` : `No cell of ${cells.length} fails.`),
    make("p", { class: "legend" }, "Normalised RMS: 0.5", bar, number(worst), make("span", { class: "box" }), "outlined: fails (above 1.1 and beyond chance)"),
    flight.length ? grid("channel", regimes, names, flight) : null,
    fixed.length ? make("details", { open: fixed.some((c) => c.fails) }, make("summary", {}, "Constraints"),
      grid("constraint", ["constraints"], fixed.map((c) => c.channel), fixed)) : null,
    panel,
  ].filter(Boolean);
}

async function residualView(panel, result, cell) {
  const words = make("p", {}, plain(cell.sentence));
  if (cell.regime === "constraints") {
    panel.replaceChildren(make("h3", {}, plain(cell.channel)), words,
      make("p", { class: "quiet" }, "A constraint is met at its own times; it has no residual against time."));
    return;
  }
  const told = await ask(`api/residual?path=${encodeURIComponent(result.path)}&channel=${encodeURIComponent(cell.channel)}`);
  const plot = make("div", { class: "plot", role: "img", "aria-label": `Residual of ${plain(cell.channel)} against time` });
  const near = make("button", { type: "button", id: "near", "aria-pressed": "false" }, "Zoom to the band");
  near.onclick = () => {
    const zoomed = near.getAttribute("aria-pressed") !== "true";
    near.setAttribute("aria-pressed", String(zoomed));
    near.textContent = zoomed ? "Show all" : "Zoom to the band";
    const usual = [...told.sigma].sort((a, b) => a - b)[Math.floor(0.9 * (told.sigma.length - 1))];
    Plotly.relayout(plot, zoomed ? { "yaxis.range": [-5 * usual, 5 * usual] } : { "yaxis.autorange": true });
  };
  panel.replaceChildren(make("div", { class: "line" }, make("h3", {}, `${plain(cell.channel)}: measured less predicted`), near), words, plot,
    make("p", { class: "quiet" }, `From ${result.path}/residuals.nc, which diagnose writes. Shaded: ${cell.regime}. Drag to zoom, double-click to see all.`));
  drawResidual(plot, told, cell);
  panel.scrollIntoView({ block: "nearest", behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "auto" : "smooth" });
}

function drawResidual(plot, told, cell) {
  const style = getComputedStyle(document.documentElement);
  const [text, line, ground] = ["--text", "--line", "--ground"].map((n) => style.getPropertyValue(n).trim());
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const shade = dark ? "230,159,0" : "0,114,178";
  const band = (n, alpha) => [-1, 1].map((side) => ({
    x: told.time, y: told.sigma.map((s) => side * n * s), mode: "lines", line: { width: 0 }, hoverinfo: "skip",
    name: `±${n} sigma`, showlegend: side > 0, fill: side > 0 ? "tonexty" : "none", fillcolor: `rgba(${shade},${alpha})`,
  }));
  const found = {
    x: told.time, y: told.residual, customdata: told.normalised, mode: "markers", name: "residual",
    marker: { size: 3.5, color: dark ? "#56B4E9" : "#000000" },
    hovertemplate: `%{x:.2f} s: %{y:.3g}${unitText(told.unit)} (%{customdata:.2f} sigma)<extra></extra>`,
  };
  const axis = { gridcolor: line, zerolinecolor: line, linecolor: line, automargin: true };
  Plotly.newPlot(plot, [...band(2, 0.16), ...band(1, 0.28), found], {
    margin: { l: 10, r: 10, t: 8, b: 10 }, paper_bgcolor: ground, plot_bgcolor: ground, font: { color: text, size: 12, family: "system-ui, sans-serif" },
    xaxis: { ...axis, title: { text: "time (s)" } },
    yaxis: { ...axis, title: { text: `residual (${unitText(told.unit).trim() || "1"})` }, exponentformat: "power" },
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" }, hovermode: "closest",
    shapes: [{ type: "rect", xref: "x", yref: "paper", x0: cell.t0_s, x1: cell.t1_s, y0: 0, y1: 1, layer: "below", line: { width: 0 }, fillcolor: dark ? "rgba(255,255,255,.07)" : "rgba(0,0,0,.06)" }],
  }, { responsive: true, displaylogo: false, displayModeBar: false });
}

// ---- hypotheses ------------------------------------------------------------------------------------------------

function rankingView(result) {
  const told = result.diagnosis;
  const box = make("div", { id: "hypotheses", role: "radiogroup", "aria-label": "Hypotheses" });
  const shown = make("div", { id: "plan" });
  const go = make("button", { type: "button", class: "main work", id: "add", "data-off": "yes",
    onclick: guarded(() => begin("api/add", { result: result.path, effect: state.effect })) }, "Add and run");
  const choose = (effect) => {
    state.effect = effect;
    go.dataset.off = "";
    go.textContent = `Add ${plain(effect)} and run`;
    shown.replaceChildren(commands(result.adding[effect]));
    setBusy();
  };
  state.effect = null;
  for (const entry of told.ranking) box.append(hypothesis(entry, choose), ...alternatives(entry, choose));
  const rest = [["nothing is missing", told.none, "The model as it is."],
    ["something else", told.something_else && told.something_else.probability, "A force and moment that nobody named."]];
  for (const [name, p, words] of rest) {
    if (p != null) box.append(make("div", { class: "choice" }, chanceHead(make("h3", {}, name), p), make("p", { class: "quiet" }, words)));
  }
  const advice = { missing: "Select one to add it to the mission.", clean: "Nothing needs to be added.",
    unknown: "None of them is enough; adding one may still show what is left." }[told.verdict];
  return [make("h2", {}, "Hypotheses"), make("p", { class: "quiet" }, `${advice || ""} Held out: on data that were not fitted.`), box,
    ...(told.ranking.length ? [make("div", { class: "actions" }, go), shown] : [])];
}

function chanceHead(title, p, input) {
  const bar = make("i");
  bar.style.width = `${100 * p}%`;
  const head = make("div", { class: "line" }, input, title, make("span", { class: "number" }, `probability ${chance(p)}`));
  return make("div", {}, head, make("div", { class: "chance", "aria-hidden": "true" }, bar));
}

function hypothesis(entry, choose) {
  const input = make("input", { type: "radio", name: "effect", value: entry.effect, onchange: () => choose(entry.effect) });
  const alike = entry.same_as.length ? make("p", {}, make("b", {}, "Cannot be told from: "), entry.same_as.map(plain).join(", "), ". Choose by what you know of the vehicle.") : null;
  return make("label", { class: "choice", "data-effect": entry.effect }, chanceHead(make("h3", {}, plain(entry.effect)), entry.probability, input),
    make("p", { class: "number quiet" }, `gain ${nats(entry.gain)} · held out ${nats(entry.score_gain)}`),
    make("p", {}, `${plain(entry.channel)}: ${number(entry.error_before)} → ${number(entry.error_after)} sigmas expected`),
    parameters(entry.parameters), alike);
}

/** The other names of a hypothesis, each to be chosen with its own estimates. */
function alternatives(entry, choose) {
  return Object.entries(entry.alternatives || {}).map(([name, other]) => {
    const input = make("input", { type: "radio", name: "effect", value: name, onchange: () => choose(name) });
    const parted = (entry.parted_by || {})[name];
    return make("label", { class: "choice also", "data-effect": name },
      make("div", { class: "line" }, input, make("h3", {}, plain(name)), make("span", { class: "quiet" }, `instead of ${plain(entry.effect)}`)),
      parameters(other.parameters), parted ? make("p", { class: "quiet" }, `${parted}.`) : null);
  });
}

// ---- work ------------------------------------------------------------------------------------------------------

async function begin(path, body) {
  state.job = (await ask(path, body)).job;
  state.followed = state.job.number;
  showJob();
  follow();
}

function follow() {
  clearTimeout(state.timer);
  state.timer = setTimeout(async () => {
    try {
      state.job = (await ask("api/job")).job;
      complain(null);
    } catch (error) {
      complain(error);
      follow();
      return;
    }
    showJob();
    if (state.job && state.job.state === "running") return follow();
    await finished();
  }, 400);
}

/** Open the new result where a job of this page is done; otherwise show what is there now. */
async function finished() {
  const { job } = state;
  const mine = job && job.number === state.followed;
  const target = job && address("result", job.result);
  if (mine && job.state === "done") $("job").hidden = true;
  const half = mine && job.state === "failed" && job.at > 0; // a run that was not diagnosed is a result still
  if (mine && (job.state === "done" || half) && location.hash !== target) {
    await loadLibrary();
    if (job.state === "done" || state.library.results.some((r) => r.path === job.result)) {
      location.hash = target; // opens it
      return;
    }
  }
  await open();
}

function showJob() {
  const { job } = state;
  state.busy = Boolean(job && job.state === "running");
  setBusy();
  $("job").hidden = !job || (job.state === "done" && $("job").hidden);
  if (!job) return;
  if (job.state === "failed" && $("job").dataset.state === "running") scrollTo({ top: 0 }); // where the sentence stands
  $("job").dataset.state = job.state;
  const now = { running: `${job.seconds.toFixed(0)} s`, done: `done in ${job.seconds.toFixed(0)} s`, failed: "failed", cancelled: "cancelled; what was finished before stays" }[job.state];
  $("job-title").textContent = job.title;
  $("job-state").textContent = now;
  $("cancel").hidden = !state.busy;
  $("job-close").hidden = state.busy;
  const shown = JSON.stringify([job.number, job.state, job.at, job.said]);
  if ($("job-steps").dataset.shown !== shown) $("job-steps").replaceChildren(...job.commands.map((line, k) => {
    const at = job.state === "done" || k < job.at ? "done" : k > job.at ? "waiting" : job.state;
    return make("li", { "data-state": at }, make("code", {}, line), at === "running" && job.said ? make("div", { class: "quiet" }, job.said) : null);
  }));
  $("job-steps").dataset.shown = shown;
  $("job-error").textContent = job.error;
  $("job-error").hidden = !job.error;
}

function setBusy() {
  for (const button of document.querySelectorAll("button.work")) {
    button.disabled = state.busy || button.dataset.off === "yes";
    button.title = state.busy ? "Another piece of work is being done." : "";
  }
}

$("cancel").onclick = guarded(async () => {
  $("cancel").disabled = true;
  try {
    state.job = (await ask("api/cancel", {})).job;
  } finally {
    $("cancel").disabled = false;
  }
  showJob();
});
$("job-close").onclick = () => { $("job").hidden = true; };
addEventListener("hashchange", async () => {
  await open();
  if (matchMedia("(max-width: 760px)").matches) $("main").scrollIntoView(); // the lists stand above it there
  else scrollTo({ top: 0 });
  $("main").focus({ preventScroll: true });
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", open); // plots take their colours when drawn

(async () => {
  await open();
  await guarded(async () => {
    state.job = (await ask("api/job")).job;
    if (state.job && state.job.state === "running") {
      state.followed = state.job.number;
      showJob();
      follow();
    }
  })();
})();
