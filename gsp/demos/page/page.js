// The page: one state, controls that change it, and pictures that follow. Everything is computed again at every change;
// errors are measured in the pauses, one epsilon at a time.

// Maps of it have no prototype, so that a name of a model finds what the model says of it and nothing else.
const data = JSON.parse(document.getElementById("data").textContent, (_, value) =>
  value !== null && typeof value === "object" && !Array.isArray(value) ? Object.setPrototypeOf(value, null) : value,
);
const model = makeModel(data, program);
const byId = (id) => document.getElementById(id);
// Milliseconds of the last redraws, of the computation in them, and of the first picture since the page was opened.
const redraws = [];
const timings = { first: NaN };
// A measurement waits for so many milliseconds without a change.
const PAUSE = 180;
// Errors are measured at epsilon times these, the present one first.
const LADDER = [1, 0.5, 0.25, 2, 4, 0.125];
// Below this an error is rounding, or the tolerance of the runs.
const FLOOR = 3e-11;
// Seconds that a run takes when it is played.
const PLAYED = 9;

let state = initialState(data);
let current = null;
let ladder = [];
// Rows of error against work, and what makes them: a model that counts, and the runs that are repeated.
let work = [];
let worker = null;
let basis = null;
let pending = null;
let scheduled = false;
let now = null;
let playing = null;
// How the picture in space is turned: about the upright axis, and towards the eye.
let angles = [0.6, 0.45];

// -- computing and drawing -------------------------------------------------------------------------

function colours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  return {
    ink: of("ink"), paper: of("paper"), faint: of("faint"), line: of("line"), manifold: of("manifold"),
    orders: [0, 1, 2, 3].map((k) => of(`order${k}`)), rivals: [of("rival"), of("rival1")], accent: of("accent"),
  };
}

function changed() {
  ladder = [];
  work = [];
  clearTimeout(pending);
  if (!scheduled) {
    scheduled = true;
    requestAnimationFrame(update);
  }
}

function update() {
  scheduled = false;
  // A measurement of the page's first picture may be under way.
  clearTimeout(pending);
  ladder = [];
  work = [];
  const begun = performance.now();
  const s = settingOf(state, data);
  const result = model.simulate(s, state.orders, { ...PICTURE, rivals: state.rivals });
  show(s, result, PICTURE);
  for (const set of sliders) set();
  tell();
  draw();
  redraws.push(performance.now() - begun);
  if (redraws.length > 500) redraws.shift();
  pending = setTimeout(measure, PAUSE);
}

function show(s, result, { rtol }) {
  const stepped = s.fixed > 0 ? model.fixed(s) : null;
  current = { s, rtol, result, stepped, curves: sampleAll(model, result, s, stepped), scales: timeScalesOf(model, result.full, s, rtol) };
}

function draw() {
  const { s, result, curves } = current;
  const c = colours();
  const place = (name) => model.quantities.indexOf(name);
  views.plane.startAt = startOnAxes();
  const [i, j] = state.axes.map(place);
  const seen = (name) => views[name] && !views[name].figure.hidden;
  handle.hidden = dragging() === null || !seen("plane");
  if (seen("plane")) {
    drawPlane(views.plane, model, s, curves, i, j, now, c, state.orders, data, data.story[state.step] ?? {});
    handle.style.left = `${views.plane.X(views.plane.startAt[0])}px`;
    handle.style.top = `${views.plane.Y(views.plane.startAt[1])}px`;
  }
  if (seen("trace")) {
    drawTrace(views.trace, model, s, curves, place(state.trace), now, c, data);
    if (seen("scales")) drawScales(views.scales, current.scales, views.trace.box, now, c);
  }
  if (seen("path")) drawPath(views.path, model, s, curves, data, now, c, data.story[state.step]?.near);
  if (seen("space")) drawSpace(views.space, model, s, curves, data.space.map(place), angles, data, now, c);
  if (seen("work")) drawWork(views.work, work, state.tolerance, c, state.orders);
  if (seen("errors")) drawErrors(views.errors, model, ladder, state.epsilon, c, state.orders, state.rivals ? model.claims.map((r) => r.name) : []);
  document.querySelectorAll("[data-rival]").forEach((mark) => (mark.style.background = c.rivals[Number(mark.dataset.rival) % 2]));
}

// One more epsilon of the ladder, and again until it is whole. Runs of all orders, so that switching one on shows it.
function measure() {
  if (ladder.length === 0) remember();
  if (ladder.length >= LADDER.length) {
    measureWork();
    return;
  }
  const epsilon = state.epsilon * LADDER[ladder.length];
  const s = { ...settingOf(state, data), epsilon };
  const first = ladder.length === 0;
  const accuracy = { ...MEASUREMENT, rivals: state.rivals, ...(first ? {} : { pieces: 1 }) };
  const result = first || epsilon <= EPSILON_RANGE[1] ? model.simulate(s, state.orders, accuracy) : null;
  // The finer run replaces the one that was quick to make: near a canard they differ.
  if (first && result.full.status === "reached") show(s, result, MEASUREMENT);
  if (!model.reducible) {
    tell();
    draw();
    return;
  }
  ladder.push(result === null || result.full.status !== "reached" ? null : { epsilon, ...model.errorsOf(result, s) });
  tell();
  draw();
  pending = setTimeout(measure, 0);
}

// One more tolerance of the picture of error against work.
function measureWork() {
  const done = work.length && work[work.length - 1].rtol === WORK_TOLERANCES[WORK_TOLERANCES.length - 1];
  if (!data.work || done) return;
  if (work.length === 0) basis = workBasis(worker, current.s, state.orders);
  if (basis === null) return;
  const last = work.length ? WORK_TOLERANCES.indexOf(work[work.length - 1].rtol) : -1;
  work.push(...workAt(worker, basis, WORK_TOLERANCES[last + 1]));
  tell();
  draw();
  pending = setTimeout(measure, 0);
}

function remember() {
  const fragment = encodeState(state, data);
  // Inside another page it has no address of its own.
  if (fragment !== location.hash && location.protocol !== "about:") history.replaceState(null, "", fragment);
}

// The address with the values and the step, to be copied; it is in the clipboard already where that is allowed.
function share() {
  remember();
  const link = byId("link");
  link.value = location.href;
  link.hidden = false;
  link.select();
  navigator.clipboard?.writeText(link.value).catch(() => {});
}

// -- playing, and the story ------------------------------------------------------------------------

function play(on) {
  playing = on ? { begun: performance.now(), from: now === null || now >= state.end ? data.span[0] : now } : null;
  byId("play").textContent = on ? "Pause" : "Play";
  byId("play").setAttribute("aria-pressed", String(on));
  if (on) requestAnimationFrame(advanceClock);
}

function advanceClock(moment) {
  if (!playing) return;
  const length = state.end - data.span[0];
  now = playing.from + (length * Math.max(0, moment - playing.begun)) / (1000 * PLAYED);
  if (now >= state.end) {
    now = state.end;
    play(false);
  }
  if (!scheduled) draw();
  if (playing) requestAnimationFrame(advanceClock);
}

// A step of the story sets what it names, and leaves what it does not as the page began.
function stateOfStep(step) {
  const told = data.story[step];
  const fresh = initialState(data);
  return {
    ...fresh, step,
    epsilon: told.epsilon ?? fresh.epsilon,
    end: told.end ?? fresh.end,
    orders: told.orders ?? fresh.orders,
    rivals: told.rivals ?? false,
    axes: told.axes ?? fresh.axes,
    trace: told.trace ?? fresh.trace,
    tolerance: told.tolerance ?? fresh.tolerance,
    fixed: told.fixed ?? 0,
    parameters: model.parameters.map((name, i) => told.parameters?.[name] ?? fresh.parameters[i]),
    start: [...model.states, ...model.driven].map((name, i) => told.start?.[name] ?? fresh.start[i]),
  };
}

function turnTo(step) {
  state = stateOfStep(step);
  for (const view of Object.values(views)) view.xRange = view.yRange = null;
  now = null;
  // Who wants nothing to move presses Play.
  play(Boolean(data.story[step].play) && !window.matchMedia("(prefers-reduced-motion: reduce)").matches);
  showStep();
  changed();
}

function showStep() {
  const count = data.story.length;
  byId("story").hidden = count === 0;
  if (!count) {
    showParts({});
    return;
  }
  byId("tale").innerHTML = data.story[state.step].text;
  byId("place").textContent = `${state.step + 1} of ${count}`;
  byId("previous").disabled = state.step === 0;
  byId("next").disabled = state.step === count - 1;
  showParts(data.story[state.step]);
}

// A step shows the pictures that it names, all where it names none, and rings what it speaks of.
function showParts({ views: named = [], highlight = [] }) {
  const isNamed = (name) => named.length === 0 || named.includes(name);
  for (const [name, view] of Object.entries(views)) view.figure.hidden = !isNamed(name) && !(name === "trace" && named.includes("scales"));
  const parts = { start: handle, orders: byId("orders"), notes: byId("notes") };
  for (const name of ["epsilon", "length"]) parts[name] = byId(name)?.parentElement;
  for (const [name, view] of Object.entries(views)) parts[name] = view.figure;
  model.parameters.forEach((name, i) => (parts[name] = byId(`parameter-${i}`).parentElement));
  document.querySelectorAll(".lit").forEach((part) => part.classList.remove("lit"));
  for (const name of highlight) {
    parts[name]?.classList.add("lit");
    if (parts[name]?.parentElement?.id === "more") byId("more").open = true;
  }
  placeSliders();
  const shown = [...byId("views").children].filter((figure) => !figure.hidden);
  shown.forEach((figure, k) => {
    figure.classList.toggle("wide", k === 0 && shown.length % 2 === 1);
    figure.classList.toggle("alone", shown.length === 1);
  });
}

function turn(by) {
  const step = state.step + by;
  if (step >= 0 && step < data.story.length) turnTo(step);
}

function reset() {
  if (data.story.length) turnTo(state.step);
  else {
    state = initialState(data);
    now = null;
    play(false);
    changed();
  }
}

// -- light and dark, full screen, keys -------------------------------------------------------------

const darkness = window.matchMedia("(prefers-color-scheme: dark)");
let theme = darkness.matches ? "dark" : "light";

function setTheme(wanted) {
  theme = wanted;
  document.documentElement.dataset.theme = theme;
  if (current) draw();
}

function toggleFullscreen() {
  const done = document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen();
  done.catch(() => {});
}

const KEYS = {
  " ": () => play(!playing),
  ArrowLeft: () => turn(-1),
  ArrowRight: () => turn(1),
  "+": () => multiplyEpsilon(1.25),
  "-": () => multiplyEpsilon(0.8),
  f: toggleFullscreen,
  d: () => setTheme(theme === "dark" ? "light" : "dark"),
  r: reset,
};

function multiplyEpsilon(factor) {
  if (model.epsilon === null) return;
  const wanted = Number((state.epsilon * factor).toPrecision(4));
  state.epsilon = Math.min(EPSILON_RANGE[1], Math.max(EPSILON_RANGE[0], wanted));
  changed();
}

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const inControl = event.target.closest("input, select, button, summary");
  if (inControl && (event.key === " " || event.key.startsWith("Arrow") || event.target.type === "number")) return;
  const order = /^[0-3]$/.test(event.key) ? Number(event.key) : null;
  if (order !== null && model.reducible && order <= model.seriesAt(state).order) toggleOrder(order);
  else if (KEYS[event.key]) {
    event.preventDefault();
    KEYS[event.key]();
  }
}

// Inside another page: it is told how high this one is, so that nothing has to be scrolled within.
function tellHeight() {
  window.parent.postMessage({ demoHeight: document.body.getBoundingClientRect().height }, "*");
}

function begin() {
  if (data.work) worker = makeWorker(data, program);
  byId("description").textContent = data.description;
  byId("source").textContent = data.source;
  addControls();
  addOrders();
  addViews();
  addDragging();
  byId("play").addEventListener("click", () => play(!playing));
  byId("reset").addEventListener("click", reset);
  byId("theme").addEventListener("click", () => setTheme(theme === "dark" ? "light" : "dark"));
  byId("fullscreen").addEventListener("click", toggleFullscreen);
  byId("share").hidden = location.protocol === "about:";
  byId("share").addEventListener("click", share);
  byId("previous").addEventListener("click", () => turn(-1));
  byId("next").addEventListener("click", () => turn(1));
  document.addEventListener("keydown", onKey);
  window.addEventListener("resize", () => current && draw());
  window.addEventListener("hashchange", () => {
    const given = stepIn(location.hash, data);
    state = decodeState(location.hash, given === null ? state : stateOfStep(given), data);
    showStep();
    changed();
  });
  darkness.addEventListener("change", (event) => setTheme(event.matches ? "dark" : "light"));
  setTheme(theme);
  const given = stepIn(location.hash, data);
  if (data.story.length) turnTo(given ?? 0);
  if (given !== null && location.hash.includes("&")) play(false);
  state = decodeState(location.hash, state, data);
  showStep();
  update();
  timings.first = performance.now();
  sortParameters();
  narrow.addEventListener("change", () => {
    placeSliders();
    draw();
  });
  if (window.parent !== window) {
    tellHeight();
    window.addEventListener("message", (event) => {
      if (event.source === window.parent && event.data && event.data.askHeight) tellHeight();
    });
    // No change is observed while the frame is out of sight.
    new ResizeObserver(tellHeight).observe(document.body);
  }
}

begin();
