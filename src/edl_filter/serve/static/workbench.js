// The workbench: displays the missions and results of the served folder, starts jobs, and displays their progress.
// Its only state is which mission or result is open, which is the part of the address after '#'.
"use strict";

const $ = (id) => document.getElementById(id);
// openCount: number of views requested; startedJob: number of the last job that this page started or joined
const wantsDark = window.matchMedia("(prefers-color-scheme: dark)");
let figures; // functions that draw figures, with the colours that the server states
wantsDark.addEventListener("change", () => figures && figures.redraw());
const state = { library: null, job: null, busy: false, timer: 0, openCount: 0, effect: null, startedJob: 0 };

// ---- elements, requests and number formats ---------------------------------------------------------------------

/** Element with attributes and children; strings become text nodes, never HTML. */
function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === "onclick" || key === "onchange") element[key] = value;
    else if (value === true) element.setAttribute(key, "");
    else if (value !== false && value != null) element.setAttribute(key, value);
  }
  element.append(...children.filter((c) => c != null));
  return element;
}

/** JSON response of the server: to a GET request, or to a POST request with `body`. */
async function request(path, body) {
  const options = body === undefined ? {} : {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
  };
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new Error("The server does not respond: is “edl-filter serve” still running?");
  }
  const content = await response.json().catch(() => ({}));
  if (!response.ok) throw new Error(content.error || `The server failed (${response.status}); see its terminal.`);
  return content;
}

function showError(error) {
  $("error").textContent = error ? error.message : "";
  $("error").hidden = !error;
}

/** `action` as an event handler that displays its errors. */
const withErrors = (action) => async (...args) => {
  try {
    showError(null);
    await action(...args);
  } catch (error) {
    showError(error);
  }
};

/** An integer as superscript digits. */
const superscript = (power) => [...String(Number(power))].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("");

/** A number with three significant digits, with a power of ten where it is very large or small. */
function number(x, digits = 3) {
  if (x == null) return "–";
  const size = Math.abs(x);
  if (x === 0) return "0";
  if (size >= 1e5 || size < 1e-4) {
    const [mantissa, power] = x.toExponential(digits - 1).split("e");
    return `${mantissa.replace("-", "−")}·10${superscript(power)}`;
  }
  const places = Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return x.toFixed(places).replace("-", "−");
}

/** A number of nats, rounded to an integer from 100. */
const nats = (x) => (x == null ? "–" : Math.abs(x) < 1e-3 ? "0 nats" : `${Math.abs(x) < 100 ? number(x) : Math.round(x).toLocaleString("en").replaceAll(",", "\u202f").replace("-", "−")} nats`);

/** A value with its sigma, both rounded to the second digit of the sigma. */
function withSigma(value, sigma) {
  if (value == null) return "–";
  if (!(sigma > 0)) return number(value, 4);
  const place = 1 - Math.floor(Math.log10(sigma));
  if ((place > 6 && Math.abs(value) < 0.1) || Math.abs(value) >= 1e6) {
    const power = Math.floor(Math.log10(Math.max(Math.abs(value), sigma)));
    const scale = 10 ** power;
    const places = Math.min(8, Math.max(0, place + power));
    return `(${(value / scale).toFixed(places)} ± ${(sigma / scale).toFixed(places)})·10${superscript(power)}`.replace("(-", "(−");
  }
  const places = Math.max(0, place);
  return `${value.toFixed(places)} ± ${sigma.toFixed(places)}`.replace(/^-/, "−");
}

const percent = (p) => (p > 0.999 ? "> 99.9 %" : p < 0.001 ? "< 0.1 %" : `${(100 * p).toFixed(1)} %`);
const plain = (name) => name.replaceAll("_", " ").replaceAll("^2", "²").replaceAll("^3", "³");
const unitText = (unit) => (unit ? ` ${unit.replace("^2", "²").replace("^3", "³").replaceAll(" ", "\u00a0")}` : "");

/** Commands, one per line, each with a button that copies it. */
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

function table(columns, rows) {
  const cell = (tag) => (value, k) => make(tag, { class: columns[k].right ? "right" : null }, value);
  return make("div", { class: "scroll" }, make("table", { class: "numbers" },
    make("thead", {}, make("tr", {}, ...columns.map((c, k) => cell("th")(c.name, k)))),
    make("tbody", {}, ...rows.map((row) => make("tr", {}, ...row.map(cell("td")))))));
}

/** Verdicts of a diagnosis as badges. */
const VERDICTS = { clean: "clean", missing: "effect missing", unknown: "effect unknown", undecided: "undecided" };

function badge(verdict) {
  return make("span", { class: `badge ${verdict || "secondary"}` }, VERDICTS[verdict] || "not diagnosed");
}

/** Badges of a result: that it is not to be trusted, where it is not, and the verdict. */
const resultBadges = (headline, verdict) => (headline
  ? [make("span", { class: "badge unknown", title: headline }, "not to be trusted"), " ", badge(verdict)] : [badge(verdict)]);

const brokenBadge = (mission) => (mission.problems.length ? make("span", { class: "badge unknown" }, "cannot run") : null);

// ---- lists -----------------------------------------------------------------------------------------------------

async function loadLibrary() {
  state.library = await request("api/library");
  figures ||= figureDrawing(state.library.roles, { dark: () => wantsDark.matches, printing: () => false });
  const { root, missions, results } = state.library;
  $("root").textContent = root;
  const entry = (kind, name, title, extra) => {
    const current = location.hash === address(kind, name);
    return make("li", {}, make("button", {
      type: "button", "aria-current": current ? "page" : null, "data-name": name,
      onclick: () => { location.hash = address(kind, name); },
    }, name, ...[extra].flat().flatMap((child) => (child ? [" ", child] : [])), make("small", {}, title)));
  };
  const userMissions = missions.filter((m) => !m.shipped);
  $("missions").replaceChildren(...userMissions.map((m) => entry("mission", m.name, m.title, brokenBadge(m))));
  if (!userMissions.length) $("missions").append(make("li", { class: "secondary" }, "The folder contains no mission. Missions shipped with edl-filter are below."));
  $("shipped").replaceChildren(...missions.filter((m) => m.shipped).map((m) => entry("mission", m.name, m.title, brokenBadge(m))));
  if (!userMissions.length) $("shipped-box").open = true;
  $("results").replaceChildren(...results.map((r) => entry("result", r.path, r.title, resultBadges(r.headline, r.verdict))));
  if (!results.length) $("results").append(make("li", { class: "secondary" }, "The folder contains no result. Run a mission."));
}

const address = (kind, name) => `#${kind}=${encodeURIComponent(name)}`;

const open = withErrors(async () => {
  const count = ++state.openCount; // a slow response must not replace the view of a later request
  await loadLibrary();
  const [kind, name] = location.hash.slice(1).split("=").map(decodeURIComponent);
  let view;
  if (kind === "mission") view = missionView(name);
  else if (kind === "result") {
    const path = encodeURIComponent(name);
    view = resultView(...await Promise.all([request(`api/result?path=${path}`), request(`api/overview?path=${path}`)]));
  }
  else view = [make("h2", {}, "Choose a mission or a result"),
    make("p", {}, "A mission describes a flight and a model of it. Run it, see in which channel and regime the model fails, add the effect that explains the failure, and compare the errors until only noise remains.")];
  if (count !== state.openCount) return;
  $("main").replaceChildren(...view.filter((n) => n != null));
  makeTabStop(document.querySelector(".map button.fails") || document.querySelector(".map button"));
  setBusy();
});

// ---- a mission -------------------------------------------------------------------------------------------------

function missionView(name) {
  const mission = state.library.missions.find((m) => m.name === name);
  if (!mission) throw new Error(`${name}: found no such mission in the folder.`);
  const existing = state.library.results.find((r) => r.path === mission.result);
  const broken = mission.problems.length > 0;
  const reason = broken ? "The mission has problems, which are listed above." : "";
  const start = (id, path, label, body = {}, main = false) => workButton(
    { id, class: main ? "main" : "", onclick: withErrors(() => startJob(path, { mission: name, ...body })) }, label, reason);
  return [
    make("h2", {}, mission.title),
    make("p", {}, make("code", {}, mission.name)),
    broken ? make("div", { class: "error", id: "problems", role: "alert" }, make("strong", {}, `${mission.problems.length} problem${mission.problems.length > 1 ? "s" : ""}`),
      make("ul", {}, ...mission.problems.map((text) => make("li", {}, text)))) : null,
    make("div", { class: "actions" }, start("run", "api/run", "Run and diagnose", {}, true), start("run-only", "api/run", "Run only", { diagnose: false })),
    ...reasons(reason),
    existing ? make("p", { class: "secondary" }, `A run replaces the result of this mission in ${existing.path}.`) : null,
    commands(mission.commands),
    make("h2", {}, "All steps at once"),
    make("p", { class: "secondary" }, "Improve diagnoses the model and adds the missing effect until no effect is accepted. It takes minutes."),
    make("div", { class: "actions" }, start("improve", "api/improve", "Improve")), ...reasons(reason), commands(mission.further.improve || []),
    make("h2", {}, "Before looking at the data"),
    make("p", { class: "secondary" }, "Which size of each effect could be detected on this flight, and which effects would be confused."),
    make("div", { class: "actions" }, start("identifiability", "api/identifiability", "Compute detectable sizes")), ...reasons(reason), commands(mission.further.identifiability || []),
    state.job && state.job.study && state.job.title === `Detectable sizes of ${name}` ? studyView(state.job.study) : null,
  ];
}

/** Button that starts a job; a reason for which it cannot is its title and its description. */
function workButton(attributes, label, reason = "") {
  const button = make("button", { type: "button", ...attributes, class: `work ${attributes.class || ""}`.trim(), "data-reason": reason }, label);
  button.disabled = Boolean(reason);
  return button;
}

/** Line that says why the buttons are greyed while a job runs. */
const busyReason = () => make("p", { class: "secondary why", "data-busy": "yes", hidden: true });

/** Lines that say why the button above them is greyed. */
const reasons = (reason) => [busyReason(), reason ? make("p", { class: "secondary why" }, reason) : null];

// ---- a result --------------------------------------------------------------------------------------------------

function resultView(result, overview) {
  const { diagnosis } = result;
  const again = (id, label, main) => [make("div", { class: "actions" }, workButton({ id, class: main ? "main" : "",
    onclick: withErrors(() => startJob("api/diagnose", { result: result.path })) }, label)), busyReason(), commands(result.diagnosing)];
  const heading = [make("h2", {}, result.title), make("p", {}, make("code", {}, result.path), " ", ...resultBadges(result.headline, diagnosis && diagnosis.verdict)),
    warningsView(result, overview), reportLink(result, overview)];
  if (!diagnosis) {
    return [...heading, make("p", {}, "This result has not been diagnosed."), ...again("diagnose", "Diagnose", true), reconstructionView(overview), effectsView(result)];
  }
  return [...heading, verdictView(result), ledgerView(result), reconstructionView(overview), effectsView(result), ...mapView(result),
    ...rankingView(result), make("h2", {}, "Diagnose again"),
    make("p", { class: "secondary" }, "This command computes the map and the hypotheses of this page."), ...again("diagnose", "Diagnose again", false)];
}

function verdictView(result) {
  const { diagnosis } = result;
  const floor = diagnosis.verdict !== "clean" || diagnosis.where.length || diagnosis.noise_floor == null ? []
    : [`Noise floor reached: over all residuals, the normalised RMS of a model that holds is below ${number(diagnosis.noise_floor)} with 97.5 %; a cell has fewer and may exceed it.`];
  // as the report and the terminal: how much fails comes first, with the verdict
  const headline = plain(diagnosis.state.slice(0, 2).join(" ") || diagnosis.sentence);
  const state = [...diagnosis.state.slice(2).map(plain), ...floor].map((sentence) => make("p", {}, sentence));
  const remainder = diagnosis.remainder ? make("p", {}, `What is left: ${plain(diagnosis.remainder.description)}`) : null;
  const failed = Object.values(diagnosis.failed || {}).map((reason) => make("p", { class: "secondary" }, `Excluded: ${reason}`));
  return make("div", { class: `verdict ${diagnosis.verdict}`, id: "verdict", "data-verdict": diagnosis.verdict },
    make("strong", {}, headline), ...state, remainder, ...failed, nextView(result));
}

/** The next step: a command to type, or a button that leads to the one that runs it. */
function nextView(result) {
  if (!result.next) return null;
  if (result.next_commands.length) return make("div", { id: "next" }, make("p", {}, `${result.next}:`), commands(result.next_commands));
  const show = make("button", { type: "button", onclick: () => {
    $("add").scrollIntoView({ block: "center" });
    $("add").focus({ preventScroll: true });
  } }, "Show the button");
  return make("div", { id: "next", class: "line" }, make("p", {}, `${plain(result.next)}.`), show);
}

/** Estimates with sigmas; without a column of units where no parameter has one. */
function parameters(values) {
  const estimated = Object.entries(values).filter(([, v]) => v.estimate != null);
  const units = estimated.some(([, v]) => v.unit);
  const columns = [{ name: "parameter" }, { name: "estimate ± 1 sigma", right: true }, ...(units ? [{ name: "unit" }] : [])];
  return table(columns, estimated.map(([name, v]) => [name, withSigma(v.estimate, v.sigma), ...(units ? [unitText(v.unit).trim() || "–"] : [])]));
}

function effectsView(result) {
  const names = Object.keys(result.effects);
  if (!names.length) return make("p", { class: "secondary" }, "The model contains no effects.");
  return make("section", {}, make("h2", {}, "Effects in the model"),
    ...names.map((name) => make("div", { class: "choice" }, make("h3", {}, plain(name)), parameters(result.effects[name]))));
}

/** Errors of every channel in this result and in the results of the preceding models. */
function ledgerView(result) {
  const steps = result.steps.filter((s) => s.errors);
  if (steps.length < 2) return null;
  const channels = Object.keys(steps[0].errors);
  const last = steps[steps.length - 1];
  const least = result.diagnosis.settings.cell_minimum_rms;
  const rows = channels.map((c) => {
    const values = steps.map((s) => s.errors[c]);
    const [a, b] = [values[0], last.errors[c]];
    const withinNoise = a == null || b == null || (a < least && b < least); // a change within the noise is not significant
    return { decrease: withinNoise ? -Infinity : 1 - b / a, row: [plain(c), ...values.map((v) => number(v)),
      withinNoise ? "–" : `${(100 * (1 - b / a)).toFixed(1).replace("-", "−")} %`] };
  }).sort((x, y) => y.decrease - x.decrease);
  const label = (s, k) => {
    const added = k ? Object.keys(s.effects).filter((e) => !(e in steps[k - 1].effects)) : [];
    return k ? `+ ${added.map(plain).join(", ")}` : "first model";
  };
  const columns = [{ name: "channel" }, ...steps.map((s, k) => ({ name: label(s, k), right: true })), { name: "decrease", right: true }];
  const ledger = table(columns, rows.map((r) => r.row));
  ledger.id = "ledger";
  return make("section", {}, make("h2", {}, "Decrease of the errors"),
    make("p", { class: "secondary" }, "Normalised RMS of the residuals, by channel: 1 where the model holds. A change within the noise is not listed; a negative decrease is an increase."),
    ledger,
    make("p", {}, "Steps: ", ...steps.flatMap((s, k) => [k ? " → " : null,
      s.path === result.path ? make("b", {}, s.path) : make("a", { href: address("result", s.path) }, s.path), " ", badge(s.verdict)])),
    commands(result.comparing));
}

// ---- the map ---------------------------------------------------------------------------------------------------

function mapView(result) {
  const cells = result.diagnosis.map;
  if (!cells.length) return [];
  const flight = cells.filter((c) => c.regime !== "constraints");
  const constraints = cells.filter((c) => c.regime === "constraints");
  const { channels, regimes, gradient, worst, drawn } = result.map;
  const panel = make("div", { id: "residual", "aria-live": "polite" },
    make("p", { class: "secondary" }, "Click a cell to display its residual against time."));
  const cell = (c) => {
    const { background, ink, text, sentence } = c ? drawn[cells.indexOf(c)] : {};
    if (!text) return make("td");
    const button = make("button", {
      type: "button", class: c.fails ? "fails" : null, title: sentence, "aria-pressed": "false", tabindex: "-1",
      "data-channel": c.channel, "data-regime": c.regime,
      "aria-label": `${plain(c.channel)}, ${c.regime}: ${number(c.normalised_rms)} sigmas${c.fails ? ", fails" : ""}`,
    }, text);
    button.style.background = background;
    button.style.color = ink;
    button.onkeydown = moveInMap;
    button.onfocus = () => makeTabStop(button);
    button.onclick = withErrors(async () => {
      for (const each of document.querySelectorAll(".map button")) each.setAttribute("aria-pressed", String(each === button));
      await residualView(panel, result, c, sentence);
    });
    return make("td", {}, button);
  };
  const grid = (corner, columns, names, gridCells) => make("div", { class: "scroll" }, make("table", { class: "map" },
    make("thead", {}, make("tr", {}, make("th", {}, corner), ...columns.map((r) => make("th", { scope: "col" }, r === "constraints" ? "sigmas" : r.replace(" flow", ""))))),
    make("tbody", {}, ...names.map((n) => make("tr", {}, make("th", { scope: "row" }, plain(n)),
      ...columns.map((r) => cell(gridCells.find((c) => c.channel === n && c.regime === r))))))));
  const bar = make("span", { class: "bar" });
  bar.style.background = gradient;
  const failing = cells.filter((c) => c.fails).length;
  return [
    make("h2", {}, "Where the model fails"),
    make("p", {}, failing ? `${failing} of ${cells.length} cells fail.` : `None of ${cells.length} cells fails.`),
    make("p", { class: "legend" }, "Normalised RMS: 0.5", bar, number(worst), make("span", {}, make("span", { class: "box" }), ` outlined: fails (above ${number(result.diagnosis.settings.cell_minimum_rms)} and statistically significant)`)),
    make("div", { class: "map-and-residual" }, make("div", {},
      flight.length ? grid("channel", regimes, channels, flight) : null,
      constraints.length ? make("details", { open: constraints.some((c) => c.fails) }, make("summary", {}, "Constraints"),
        grid("constraint", ["constraints"], constraints.map((c) => c.channel), constraints)) : null), panel),
  ];
}

/** The one cell of the map that the tab key reaches; arrow keys move from it to the others. */
function makeTabStop(cell) {
  for (const button of document.querySelectorAll(".map button")) button.tabIndex = button === cell ? 0 : -1;
}

const STEPS = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };

function moveInMap(event) {
  const step = STEPS[event.key];
  if (!step || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  const rows = [...document.querySelectorAll(".map tbody tr")].filter((row) => row.checkVisibility());
  const row = event.currentTarget.closest("tr");
  const column = event.currentTarget.closest("td").cellIndex;
  let [r, c] = [rows.indexOf(row) + step[0], column + step[1]];
  while (rows[r] && c >= 1 && c < Math.max(...rows.map((each) => each.cells.length))) {
    const cell = rows[r].cells[step[0] ? Math.min(c, rows[r].cells.length - 1) : c];
    const button = cell && cell.querySelector("button");
    if (button) {
      button.focus();
      return;
    }
    r += step[0];
    c += step[1];
  }
}

async function residualView(panel, result, cell, sentence) {
  const query = `path=${encodeURIComponent(result.path)}&channel=${encodeURIComponent(cell.channel)}`;
  const { axes, channel, uses } = await request(`api/residual?${query}`);
  const inFlight = cell.regime !== "constraints";
  const heading = make("h3", {}, inFlight ? `${plain(cell.channel)}: measured minus predicted` : plain(cell.channel));
  if (!(inFlight ? channel : uses)) {
    panel.replaceChildren(heading, make("p", {}, sentence), make("p", { class: "secondary" }, "There is no residual against time for it."));
    return;
  }
  const title = inFlight ? `Residual of ${plain(cell.channel)} against time` : `Innovations of ${plain(cell.channel)}`;
  const plot = make("div", { class: "plot", role: "img", "aria-label": title });
  if (inFlight) {
    const figure = residualFigure(axes, cell, channel, { window: "flight", unit: "unit" });
    const zoom = make("button", { type: "button", id: "zoom", "aria-pressed": "false" }, "Zoom to the sigma band");
    zoom.onclick = () => {
      const zoomed = zoom.getAttribute("aria-pressed") !== "true";
      zoom.setAttribute("aria-pressed", String(zoomed));
      zoom.textContent = zoomed ? "Show all" : "Zoom to the sigma band";
      const sigmas = unpacked(channel.sigma).filter((s) => !Number.isNaN(s)).sort(); // a typed array sorts numerically
      const limit = 5 * sigmas[Math.floor(0.9 * (sigmas.length - 1))]; // 90 % quantile
      const yaxis = { ...figure.layout.yaxis, range: zoomed ? [-limit, limit] : figure.layout.yaxis.range };
      figures.draw(plot, { ...figure, layout: { ...figure.layout, yaxis } });
    };
    panel.replaceChildren(make("div", { class: "line" }, heading, zoom), make("p", {}, sentence), plot,
      make("p", { class: "secondary" }, `Data: ${result.path}/residuals.nc, written by diagnose. Shaded: ${cell.regime}. Drag to zoom, double-click to show all.`));
    figures.draw(plot, figure);
  } else {
    panel.replaceChildren(heading, make("p", {}, sentence), plot,
      make("p", { class: "secondary" }, "Innovations of the filter on the way forwards, in sigmas; bands of one and three sigmas."));
    figures.draw(plot, constraintFigure(axes, uses));
  }
  panel.scrollIntoView({ block: "nearest", behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "auto" : "smooth" });
}

// ---- hypotheses ------------------------------------------------------------------------------------------------

function rankingView(result) {
  const { diagnosis } = result;
  const box = make("div", { id: "hypotheses", role: "radiogroup", "aria-label": "Hypotheses" });
  const plan = make("div", { id: "plan" });
  const nothingSelected = "Select a hypothesis first: none is selected, since no effect is named.";
  const add = workButton({ class: "main", id: "add",
    onclick: withErrors(() => startJob("api/add", { result: result.path, effect: state.effect })) }, "Add and run", nothingSelected);
  const why = make("p", { class: "secondary why", id: "add-why" }, nothingSelected);
  const choose = (effect) => {
    state.effect = effect;
    add.dataset.reason = result.adding[effect].length ? "" : "The effect cannot be added: its mission is not accessible.";
    why.textContent = add.dataset.reason;
    add.textContent = `Add ${plain(effect)} and run`;
    plan.replaceChildren(commands(result.adding[effect]));
    setBusy();
  };
  state.effect = null;
  const something = diagnosis.something_else || {};
  const unnamed = [["nothing is missing", diagnosis.none, "The present model."],
    ["something else", something.probability, `An unmodelled force and moment, or excess noise, outside the catalogue${something.gain == null ? "" : `: gain ${nats(something.gain)}`}.`]];
  const choices = diagnosis.ranking.map((entry) => [entry.probability, [hypothesis(entry, choose), ...alternatives(entry, choose)]]);
  for (const [name, p, description] of unnamed) {
    if (p != null) choices.push([p, [make("div", { class: "choice" }, probabilityHeading(make("h3", {}, name), p), make("p", { class: "secondary" }, description))]]);
  }
  choices.sort((a, b) => (b[0] || 0) - (a[0] || 0)); // as in the report: most probable first
  box.append(...choices.map(([, elements]) => make("div", { class: "group" }, ...elements)));
  if (["missing", "undecided"].includes(diagnosis.verdict) && diagnosis.ranking.length) { // the leader
    choose(diagnosis.ranking[0].label);
    box.querySelector(`input[value="${CSS.escape(diagnosis.ranking[0].label)}"]`).checked = true;
  }
  const advice = { missing: "The leader is selected; another may be selected instead.", clean: "No effect needs to be added.",
    undecided: "The most probable effect is selected; another may be selected instead.", unknown: "None of these effects is sufficient; adding one may still help to identify the remainder." }[diagnosis.verdict];
  const gain = `Gain is the logarithm of the evidence relative to the present model (an effect needs ${Number(diagnosis.required_gain.toPrecision(3))} nats); held-out gain is on data that were not fitted.`;
  const explanation = [advice, diagnosis.ranking.length ? gain : null].filter(Boolean).join(" ");
  return [make("h2", {}, "Hypotheses"), make("p", { class: "secondary" }, explanation), ...result.remarks.map((sentence) => make("p", { class: "secondary" }, plain(sentence))), box,
    ...(diagnosis.ranking.length ? [make("div", { class: "actions" }, add), why, busyReason(), plan] : [])];
}

function probabilityHeading(title, p, input) {
  const bar = make("i");
  bar.style.width = `${100 * p}%`;
  const heading = make("div", { class: "line" }, input, title, make("span", { class: "number" }, `probability ${percent(p)}`));
  return make("div", {}, heading, make("div", { class: "probability", "aria-hidden": "true" }, bar));
}

function hypothesis(entry, choose) {
  const input = make("input", { type: "radio", name: "effect", value: entry.label, onchange: () => choose(entry.label) });
  const indistinguishable = entry.same_as.length ? make("p", {}, make("b", {}, "Not distinguishable from: "), entry.same_as.map(plain).join(", "), ". Choose by what you know of the vehicle.") : null;
  return make("label", { class: "choice", "data-effect": entry.label }, probabilityHeading(make("h3", {}, plain(entry.label)), entry.probability, input),
    make("p", { class: "number secondary" }, `gain ${nats(entry.gain)} · held-out gain ${nats(entry.score_gain)}`),
    make("p", {}, `${plain(entry.channel)}: ${number(entry.error_before)} → ${number(entry.error_after)} sigmas expected`),
    parameters(entry.parameters), indistinguishable);
}

/** The alternative effects of a hypothesis, each with its own estimates. */
function alternatives(entry, choose) {
  return Object.entries(entry.alternatives || {}).map(([name, alternative]) => {
    const input = make("input", { type: "radio", name: "effect", value: name, onchange: () => choose(name) });
    const discriminator = (entry.discriminated_by || {})[name];
    return make("label", { class: "choice alternative", "data-effect": name },
      make("div", { class: "line" }, input, make("h3", {}, plain(name)), make("span", { class: "secondary" }, `instead of ${plain(entry.label)}`)),
      parameters(alternative.parameters), discriminator ? make("p", { class: "secondary" }, `${discriminator}.`) : null);
  });
}

// ---- jobs ------------------------------------------------------------------------------------------------------

async function startJob(path, body) {
  state.job = (await request(path, body)).job;
  state.startedJob = state.job.number;
  showJob();
  pollJob();
}

function pollJob() {
  clearTimeout(state.timer);
  state.timer = setTimeout(async () => {
    try {
      state.job = (await request("api/job")).job;
      showError(null);
    } catch (error) {
      showError(error);
      pollJob();
      return;
    }
    showJob();
    if (state.job && state.job.state === "running") return pollJob();
    await jobFinished();
  }, 400);
}

/** Open the result of a finished job that this page started; otherwise reload the current view. */
async function jobFinished() {
  const { job } = state;
  const startedHere = job && job.number === state.startedJob;
  const target = job && job.result && address("result", job.result);
  if (startedHere && job.state === "done") $("job").hidden = true;
  const undiagnosed = startedHere && job.state === "failed" && job.at > 0; // the run wrote a result, its diagnosis failed
  if (target && startedHere && (job.state === "done" || undiagnosed) && location.hash !== target) {
    await loadLibrary();
    if (job.state === "done" || state.library.results.some((r) => r.path === job.result)) {
      location.hash = target; // the event hashchange opens the result
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
  if (job.state === "failed" && $("job").dataset.state === "running") scrollTo({ top: 0 }); // to the error message
  $("job").dataset.state = job.state;
  const stateText = { running: `${job.seconds.toFixed(0)} s`, done: `done in ${job.seconds.toFixed(0)} s`, failed: "failed", cancelled: "cancelled; files of completed commands remain" }[job.state];
  $("job-title").textContent = job.title;
  $("job-state").textContent = stateText;
  $("cancel").hidden = !state.busy;
  $("job-close").hidden = state.busy;
  const content = JSON.stringify([job.number, job.state, job.at, job.said]);
  if ($("job-steps").dataset.content !== content) $("job-steps").replaceChildren(...job.commands.map((line, k) => {
    const commandState = job.state === "done" || k < job.at ? "done" : k > job.at ? "waiting" : job.state;
    return make("li", { "data-state": commandState }, make("code", {}, line), commandState === "running" && job.said ? make("div", { class: "secondary" }, job.said) : null);
  }));
  $("job-steps").dataset.content = content;
  $("job-error").textContent = job.error;
  $("job-error").hidden = !job.error;
}

function setBusy() {
  const busy = state.busy ? `A job is running: ${state.job.title}. Wait for it or cancel it.` : "";
  for (const button of document.querySelectorAll("button.work")) {
    button.title = button.dataset.reason || busy;
    button.disabled = Boolean(button.title);
  }
  for (const line of document.querySelectorAll(".why[data-busy]")) {
    line.textContent = busy;
    line.hidden = !busy;
  }
}

$("cancel").onclick = withErrors(async () => {
  $("cancel").disabled = true;
  try {
    state.job = (await request("api/cancel", {})).job;
  } finally {
    $("cancel").disabled = false;
  }
  showJob();
});
$("job-close").onclick = () => { $("job").hidden = true; };
addEventListener("hashchange", async () => {
  await open();
  if (matchMedia("(max-width: 760px)").matches) $("main").scrollIntoView(); // on a narrow page the lists are above it
  else scrollTo({ top: 0 });
  $("main").focus({ preventScroll: true });
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", open); // plots get their colours when they are drawn

(async () => {
  await open();
  await withErrors(async () => {
    state.job = (await request("api/job")).job;
    if (state.job && state.job.state === "running") {
      state.startedJob = state.job.number;
      showJob();
      pollJob();
    }
  })();
})();
