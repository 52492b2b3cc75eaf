// The page: one state, controls that change it, and pictures that follow. Everything is computed again at every change;
// errors are measured in the pauses, one epsilon at a time.

const data = JSON.parse(document.getElementById("data").textContent);
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

// -- what is on the page ---------------------------------------------------------------------------

const sliders = [];

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === "class") made.className = value;
    else if (key in made) made[key] = value;
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

// A slider with its number beside it; the number may be typed, beyond the slider's ends and to all digits.
function addSlider(id, label, { low, high, log = false, read, write, moved = changed }) {
  const toSlider = (value) => (log ? Math.log10(value) : value);
  const range = element("input", { type: "range", id, min: toSlider(low), max: toSlider(high), step: "any" });
  range.setAttribute("aria-label", label);
  const number = element("input", { type: "number", id: `${id}-number`, step: "any" });
  number.setAttribute("aria-label", `${label}, as a number`);
  range.addEventListener("input", () => {
    const raw = log ? Math.pow(10, Number(range.value)) : Number(range.value);
    write(Number(raw.toPrecision(4)));
    moved();
  });
  number.addEventListener("change", () => {
    const value = readNumber(number.value, NaN);
    if (Number.isFinite(value) && (!log || value > 0)) write(value);
    moved();
  });
  byId("sliders").append(element("div", { class: `slider ${id}` }, element("label", { htmlFor: id }, label), range, number));
  sliders.push(() => {
    const value = read();
    if (document.activeElement !== range || Math.abs(Number(range.value) - toSlider(value)) > 1e-3) {
      range.value = String(toSlider(value));
    }
    if (document.activeElement !== number) number.value = String(value);
  });
}

function addControls() {
  addSlider("epsilon", `${model.epsilon}, the small parameter`, {
    low: Math.min(EPSILON_RANGE[0], data.epsilon), high: Math.max(EPSILON_RANGE[1], data.epsilon), log: true,
    read: () => state.epsilon, write: (value) => (state.epsilon = value),
  });
  model.parameters.forEach((name, i) => {
    const value = model.values[i];
    const [low, high] = data.ranges[name] ?? (value === 0 ? [-2, 2] : [Math.min(0, 2.5 * value), Math.max(0, 2.5 * value)]);
    addSlider(`parameter-${i}`, name, {
      low, high, read: () => state.parameters[i], write: (v) => (state.parameters[i] = v),
    });
  });
  const length = data.span[1] - data.span[0];
  addSlider("length", "length of the run", {
    low: length / SPAN_FACTOR, high: length * SPAN_FACTOR, log: true,
    read: () => state.end - data.span[0], write: (value) => (state.end = data.span[0] + value),
  });
  if (!data.work) return;
  addSlider("tolerance", "largest error allowed", {
    low: 1e-7, high: 1e-1, log: true, read: () => state.tolerance, write: (value) => (state.tolerance = value),
    moved: allowed,
  });
  addSlider("fixed", "step of an explicit run in fixed steps", {
    low: length / 2000, high: length / 10, log: true,
    read: () => state.fixed || length / 100, write: (value) => (state.fixed = value),
  });
}

// Another error is allowed: nothing is computed again.
function allowed() {
  for (const set of sliders) set();
  tellChosen();
  draw();
  remember();
}

const readouts = {};

function addOrders() {
  const box = byId("orders");
  const row = (key, kind, text, input) => {
    const output = element("output", {}, "");
    const label = element("label", { class: `order ${kind}` }, input ?? element("span"), element("span", {}, element("b"), text), output);
    readouts[key] = output;
    box.append(label);
  };
  row("full", "full", "full run");
  for (let order = 0; order <= 3; order++) {
    const input = element("input", { type: "checkbox", id: `order-${order}` });
    input.addEventListener("change", () => toggleOrder(order));
    row(order, `order${order}`, `order ${order}`, input);
    sliders.push(() => {
      input.checked = state.orders.includes(order);
      input.disabled = !model.reducible || order > model.seriesAt(state).order;
    });
  }
  model.claims.forEach((claim, k) => {
    const input = element("input", { type: "checkbox", id: `rival-${k}` });
    input.addEventListener("change", () => {
      state.rivals = input.checked;
      changed();
    });
    sliders.push(() => (input.checked = state.rivals));
    row(claim.name, "rival", claim.name, input);
    readouts[claim.name].parentElement.querySelector("b").dataset.rival = String(k);
  });
  if (data.work) {
    const input = element("input", { type: "checkbox", id: "fixed-shown" });
    input.addEventListener("change", () => {
      state.fixed = input.checked ? (data.span[1] - data.span[0]) / 100 : 0;
      changed();
    });
    sliders.push(() => (input.checked = state.fixed > 0));
    row("fixed", "fixed", "explicit, fixed steps", input);
  }
}

function toggleOrder(order) {
  state.orders = state.orders.includes(order)
    ? state.orders.filter((k) => k !== order)
    : [...state.orders, order].sort();
  changed();
}

function choice(id, label, names, read, write) {
  const select = element("select", { id });
  select.setAttribute("aria-label", label);
  for (const name of names) select.append(element("option", { value: name }, name));
  select.addEventListener("change", () => {
    write(select.value);
    for (const view of Object.values(views)) view.xRange = view.yRange = null;
    changed();
  });
  sliders.push(() => (select.value = read()));
  return select;
}

const views = {};
const handle = element("button", { class: "handle", type: "button", id: "start" });
handle.setAttribute("aria-label", "The start: drag it, or use the arrow keys");

function addViews() {
  const container = byId("views");
  if (data.path) {
    views.path = new View(container, "The path in the plane");
    views.path.say(data.body ? `path of ${data.body.name}` : "path");
  }
  views.plane = new View(container, "Phase plane");
  const other = (value, place) => {
    const axes = state.axes.slice();
    if (axes[1 - place] === value) axes[1 - place] = axes[place];
    axes[place] = value;
    state.axes = axes;
  };
  views.plane.say(
    choice("axis-y", "upright axis", model.quantities, () => state.axes[1], (value) => other(value, 1)), " against ",
    choice("axis-x", "axis across", model.quantities, () => state.axes[0], (value) => other(value, 0)),
  );
  views.plane.frame.append(handle);
  if (data.space) {
    views.space = new View(container, "The critical manifold in space");
    views.space.say(`${data.space.join(", ")} in space: drag to turn`);
    views.space.frame.classList.add("turned");
    addTurning(views.space.canvas);
  }
  views.trace = new View(container, "A quantity against time");
  views.trace.say(
    choice("trace", "quantity against time", model.quantities, () => state.trace, (value) => (state.trace = value)), " against time",
  );
  if (data.work) {
    views.work = new View(container, "Error against work");
    views.work.say("error against the operations of a run: ", element("output", { id: "chosen" }));
  }
  if (model.reducible && data.compared) {
    views.errors = new View(container, "Error against epsilon");
    views.errors.say("largest relative error of the slow variables against epsilon");
  }
}

function addTurning(canvas) {
  let from = null;
  canvas.addEventListener("pointerdown", (event) => {
    from = [event.clientX, event.clientY, ...angles];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!from) return;
    angles = [from[2] + (event.clientX - from[0]) / 120, Math.min(1.5, Math.max(-0.3, from[3] + (event.clientY - from[1]) / 160))];
    draw();
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => (from = null));
}

// -- the start, dragged ----------------------------------------------------------------------------

// The places of the axes in the start, and how to move it: in the declared states where both axes are among them, else in
// slow and fast variables; null where the start cannot be dragged in this plane.
function dragging() {
  const names = [...model.states, ...model.driven];
  const raw = state.axes.map((name) => names.indexOf(name));
  if (!raw.includes(-1)) {
    return (values) => {
      const start = state.start.slice();
      raw.forEach((place, k) => (start[place] = values[k]));
      return start;
    };
  }
  if (!model.reducible) return null;
  const u = state.axes.map((name) => [...model.reduction.slow, ...model.reduction.fast].indexOf(name));
  if (u.includes(-1)) return null;
  return (values) => {
    const p = model.constants(state);
    const point = model.toNew(Float64Array.from(state.start), p);
    u.forEach((place, k) => (point[place] = values[k]));
    const z = new Float64Array(model.n);
    program.toRaw(point, p, z);
    return allFinite(z) ? [...z.subarray(0, model.nRaw), ...state.start.slice(model.nRaw)] : state.start;
  };
}

function startOnAxes() {
  const values = model.quantitiesAt(Float64Array.from(state.start), model.constants(state), new Float64Array(model.quantities.length));
  return state.axes.map((name) => values[model.quantities.indexOf(name)]);
}

function moveStart(px, py) {
  const move = dragging();
  const view = views.plane;
  if (!move || !view.atX) return;
  const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
  const x = view.atX(clamp(px, MARGIN.left, view.width - MARGIN.right));
  const y = view.atY(clamp(py, MARGIN.top, view.height - MARGIN.bottom));
  state.start = move([x, y]).map((value) => Number(value.toPrecision(5)));
  changed();
}

function addDragging() {
  const at = (event) => {
    const box = views.plane.canvas.getBoundingClientRect();
    moveStart(event.clientX - box.left, event.clientY - box.top);
  };
  let held = false;
  handle.addEventListener("pointerdown", (event) => {
    held = true;
    handle.setPointerCapture(event.pointerId);
  });
  handle.addEventListener("pointermove", (event) => held && at(event));
  for (const name of ["pointerup", "pointercancel"]) handle.addEventListener(name, () => (held = false));
  views.plane.canvas.addEventListener("click", at);
  handle.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    const [x, y] = startOnAxes();
    moveStart(views.plane.X(x) + 4 * step[0], views.plane.Y(y) + 4 * step[1]);
  });
}

// -- computing and drawing -------------------------------------------------------------------------

function colours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  return {
    ink: of("ink"), paper: of("paper"), faint: of("faint"), line: of("line"), manifold: of("manifold"),
    orders: [0, 1, 2, 3].map((k) => of(`order${k}`)), rivals: [of("rival"), of("accent")],
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
  const result = model.simulate(s, state.orders);
  show(s, result, PICTURE);
  for (const set of sliders) set();
  tell();
  draw();
  redraws.push(performance.now() - begun);
  if (redraws.length > 500) redraws.shift();
  pending = setTimeout(measure, PAUSE);
}

function show(s, result, { rtol }) {
  const shown = state.rivals ? result : { ...result, rivals: [] };
  const stepped = s.fixed > 0 ? model.fixed(s) : null;
  current = { s, rtol, result: shown, stepped, curves: sampleAll(model, shown, s, stepped) };
}

function draw() {
  const { s, result, curves } = current;
  const c = colours();
  const place = (name) => model.quantities.indexOf(name);
  views.plane.startAt = startOnAxes();
  const [i, j] = state.axes.map(place);
  const folds = model.atDeclared(s) ? data.folds.filter((fold) => fold[i] !== null && fold[j] !== null) : [];
  const marks = data.story[state.step]?.marks ?? [];
  drawPlane(views.plane, model, s, curves, i, j, now, c, state.orders, folds, data, marks);
  handle.hidden = dragging() === null;
  handle.style.left = `${views.plane.X(views.plane.startAt[0])}px`;
  handle.style.top = `${views.plane.Y(views.plane.startAt[1])}px`;
  drawTrace(views.trace, model, s, curves, place(state.trace), now, c, result.layerEnd, data);
  if (views.path) drawPath(views.path, model, curves, data.path.map(place), data.body, now, c);
  if (views.space) drawSpace(views.space, model, s, curves, data.space.map(place), angles, data.box, now, c);
  if (views.work) drawWork(views.work, work, state.tolerance, c, state.orders);
  if (views.errors) drawErrors(views.errors, ladder, state.epsilon, c, state.orders, state.rivals ? model.claims.map((r) => r.name) : []);
  document.querySelectorAll("[data-rival]").forEach((mark) => (mark.style.background = c.rivals[Number(mark.dataset.rival)]));
}

// One more epsilon of the ladder, and again until it is whole. Runs of all orders, so that switching one on shows it.
function measure() {
  if (ladder.length === 0) remember();
  if (!model.reducible) return;
  if (ladder.length >= LADDER.length) {
    measureWork();
    return;
  }
  const epsilon = state.epsilon * LADDER[ladder.length];
  const s = { ...settingOf(state, data), epsilon };
  const first = ladder.length === 0;
  const accuracy = first ? MEASUREMENT : { ...MEASUREMENT, pieces: 1 };
  const result = first || epsilon <= EPSILON_RANGE[1] ? model.simulate(s, state.orders, accuracy) : null;
  // The finer run replaces the one that was quick to make: near a canard they differ.
  if (first && result.full.status === "reached") show(s, result, MEASUREMENT);
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

// The power of epsilon between the present epsilon and the smaller ones, NaN where too few errors stand clear of rounding.
// Where the layer takes more than half of the run, errors of different epsilons are taken over different stretches.
function measuredPower(read) {
  const [begun] = settingOf(state, data).span;
  const clear = ladder.filter(
    (row) =>
      row && row.epsilon <= state.epsilon && read(row) > FLOOR && Number.isFinite(read(row)) &&
      2 * (row.from - begun) <= row.to - begun,
  );
  if (clear.length < 2) return NaN;
  const x = clear.map((row) => Math.log(row.epsilon));
  const y = clear.map((row) => Math.log(read(row)));
  const mean = (values) => values.reduce((a, b) => a + b, 0) / values.length;
  const [mx, my] = [mean(x), mean(y)];
  const top = x.reduce((total, value, k) => total + (value - mx) * (y[k] - my), 0);
  return top / x.reduce((total, value) => total + (value - mx) * (value - mx), 0);
}

function readout(read) {
  const here = ladder[0];
  if (ladder.length === 0) return "…";
  if (!here || read(here) === undefined) return "not compared";
  const error = read(here);
  if (!Number.isFinite(error)) return "ended";
  if (error <= FLOOR) return "exact, to rounding";
  const slope = ladder.length >= 3 ? measuredPower(read) : NaN;
  const size = error.toExponential(1).replace("-", "−");
  if (!Number.isFinite(slope)) return size;
  return [`${size} ∝ `, element("i", {}, model.epsilon), element("sup", {}, slope.toFixed(2).replace("-", "−"))];
}

const ENDINGS = {
  steps: "its steps were used up",
  "not finite": "the field is not finite there",
  "too small": "no step is small enough there",
  lost: "there the critical manifold ceases to attract",
  "no sheet": "no point of the critical manifold was found there",
  "blew up": "it has blown up",
};

function notes() {
  const { s, result } = current;
  const found = [];
  // A quick run knows its times to two digits; the finer one that follows in the pause, to more.
  const quick = current.rtol > MEASUREMENT.rtol;
  const time = (t) => (quick ? `about ${Number(t.toPrecision(2))}` : Number(t.toPrecision(4)));
  const fullEnd = result.full.times[result.full.times.length - 1];
  if (result.full.status !== "reached") {
    found.push(`The full run ends at t = ${time(fullEnd)}: ${ENDINGS[result.full.status]}.`);
  }
  if (!model.reducible) {
    found.push(`Only the full system is shown: ${model.reduction.reason}`);
    return found;
  }
  if (current.stepped) found.push(...told(s, current.stepped));
  const { order, label } = model.seriesAt(s);
  if (order < 3) {
    const where = model.reduction.declared > order ? ` away from the declared parameters; there through order ${model.reduction.declared}` : "";
    found.push(`The reduction is known through order ${order}${where}: ${model.reduction[`ended${label}`]}.`);
  }
  const p = model.constants(s);
  if (!result.pieces.length) {
    if (!state.orders.length) return found;
    const gap = model.gapAt(model.toNew(Float64Array.from(state.start), p), p);
    found.push(
      gap > 0
        ? "The run is not long enough near the slow manifold while that attracts, so there is nothing to compare. Take a smaller epsilon, a longer run or another start."
        : "The start is where the fast dynamics does not attract, and the run does not settle on a slow manifold. Nothing is compared.",
    );
    return found;
  }
  const first = result.pieces[0];
  for (const run of first.runs) {
    if (run.status !== "reached") {
      const where = run.ended === undefined ? run.begun : run.ended;
      found.push(`The reduced run of order ${run.order} ends at t = ${time(where)}: ${ENDINGS[run.status] ?? run.status}.`);
    }
  }
  if (result.cut && result.pieces.length > 1) {
    found.push(`Reduced runs are drawn on the first ${result.pieces.length} slow pieces of this run only: their steps were used up.`);
  }
  const u = model.toNew(result.full.states[first.at], p);
  const y0 = u.slice(model.nSlow);
  const x = u.slice(0, model.nSlow);
  if (model.onSheet(x, y0, p)) {
    const { best, reached } = model.bestOrder(model.coordinatesOf(x, y0, s), s);
    const beyond = state.orders.filter((k) => k <= order && !reached[k]);
    if (beyond.length) {
      found.push(
        `At this epsilon the series is beyond its reach: its terms fall no more after order ${best}, where it is best cut. Order ${beyond.join(", ")} is worse.`,
      );
    }
  }
  return found;
}

// What became of the run in fixed steps, and why, where one fast variable alone sets the limit.
function told(s, run) {
  const ended = run.times[run.times.length - 1];
  const lines = run.status === "reached" ? [] : [`The explicit run in steps of ${s.fixed} ends at t = ${Number(ended.toPrecision(4))}: ${ENDINGS[run.status]}.`];
  if (model.nFast !== 1) return lines;
  const p = model.constants(s);
  const rates = current.result.full.states.map((z) => model.gapAt(model.toNew(z, p), p) / s.epsilon);
  const product = s.fixed * Math.max(...rates.filter(Number.isFinite));
  const side = product > CLASSICAL_LIMIT ? "beyond" : "within";
  lines.push(`Its step times the fastest rate of this run is ${product.toFixed(2)}, ${side} the limit of ${CLASSICAL_LIMIT.toFixed(2)} of the classical Runge-Kutta method.`);
  return lines;
}

function tellChosen() {
  if (!data.work) return;
  const chosen = cheapest(work, state.tolerance);
  const last = work.length && work[work.length - 1].rtol === WORK_TOLERANCES[WORK_TOLERANCES.length - 1];
  const text = chosen
    ? `cheapest is ${methodName(chosen.method)}, ${chosen.operations.toLocaleString("en")} operations`
    : last ? "no run is as exact" : "counting …";
  byId("chosen").textContent = text;
}

function tell() {
  const lines = notes();
  const list = byId("notes");
  if (lines.join("\n") !== list.dataset.lines) {
    list.dataset.lines = lines.join("\n");
    list.replaceChildren(...lines.map((line) => element("li", {}, line)));
  }
  const steps = current.result.full.times.length - 1;
  readouts.full.textContent = `${steps} steps at ${current.rtol.toExponential()}`;
  if (readouts.fixed) readouts.fixed.textContent = current.stepped ? `${current.stepped.times.length - 1} steps` : "";
  tellChosen();
  for (let order = 0; order <= 3; order++) {
    const shown = state.orders.includes(order) && model.reducible;
    readouts[order].replaceChildren(...[shown ? readout((row) => row.orders[order]) : ""].flat());
  }
  for (const claim of model.claims) {
    readouts[claim.name].replaceChildren(...[state.rivals ? readout((row) => row.rivals[claim.name]) : ""].flat());
  }
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
function turnTo(step) {
  const told = data.story[step];
  const fresh = initialState(data);
  state = {
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
  for (const view of Object.values(views)) view.xRange = view.yRange = null;
  now = null;
  play(Boolean(told.play));
  showStep();
  changed();
}

function showStep() {
  const count = data.story.length;
  byId("story").hidden = count === 0;
  if (!count) return;
  byId("tale").textContent = data.story[state.step].text;
  byId("place").textContent = `${state.step + 1} of ${count}`;
  byId("previous").disabled = state.step === 0;
  byId("next").disabled = state.step === count - 1;
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
  byId("previous").addEventListener("click", () => turn(-1));
  byId("next").addEventListener("click", () => turn(1));
  document.addEventListener("keydown", onKey);
  window.addEventListener("resize", () => current && draw());
  window.addEventListener("hashchange", () => {
    state = decodeState(location.hash, state, data);
    showStep();
    changed();
  });
  darkness.addEventListener("change", (event) => setTheme(event.matches ? "dark" : "light"));
  if (window.parent !== window) new ResizeObserver(tellHeight).observe(document.body);
  setTheme(theme);
  if (data.story.length) turnTo(0);
  state = decodeState(location.hash, state, data);
  showStep();
  update();
  timings.first = performance.now();
}

begin();
