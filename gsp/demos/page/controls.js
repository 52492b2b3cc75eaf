// What is on the page beside its pictures: sliders, switches, and the start, which is dragged.

const sliders = [];
// More parameters than this are not all open.
const SLIDERS = 6;

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

// A name as it was set when the page was made.
function typeset(name) {
  return element("span", { class: "name", innerHTML: data.typeset[name] });
}

// A slider with its number beside it; the number may be typed, beyond the slider's ends and to all digits. `shown` is the label
// as it is set, `label` as it is read aloud.
function addSlider(id, label, { shown = [label], low, high, log = false, read, write, moved = changed }) {
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
  byId("sliders").append(element("div", { class: `slider ${id}` }, element("label", { htmlFor: id }, ...shown), range, number));
  sliders.push(() => {
    const value = read();
    if (document.activeElement !== range || Math.abs(Number(range.value) - toSlider(value)) > 1e-3) {
      range.value = String(toSlider(value));
    }
    if (document.activeElement !== number) number.value = String(value);
  });
}

// a - b to the digits that it has: 2027 - 2026.4 is 0.6, and 0.599999999999909 by doubles.
function difference(a, b) {
  const digits = Math.floor(Math.log10(Math.abs(a - b) / (Math.max(Math.abs(a), Math.abs(b)) * Number.EPSILON)));
  return Number((a - b).toPrecision(Math.min(Math.max(digits, 1), 15)));
}

function unitOf(name) {
  return name in data.units ? [` (${data.units[name]})`] : [];
}

function addControls() {
  if (model.epsilon !== null) {
    addSlider("epsilon", `${data.letters[model.epsilon]}, the small parameter`, {
      shown: [typeset(model.epsilon), ", the small parameter"],
      low: Math.min(EPSILON_RANGE[0], data.epsilon), high: Math.max(EPSILON_RANGE[1], data.epsilon), log: true,
      read: () => state.epsilon, write: (value) => (state.epsilon = value),
    });
  }
  model.parameters.forEach((name, i) => {
    const value = model.values[i];
    // A parameter keeps its sign: many a model has no meaning where it is zero.
    const [low, high] = data.ranges[name] ?? (value === 0 ? [-2, 2] : [value / 2.5, 2.5 * value].sort((a, b) => a - b));
    addSlider(`parameter-${i}`, data.letters[name], {
      shown: [typeset(name), ...unitOf(name)], low, high, read: () => state.parameters[i], write: (v) => (state.parameters[i] = v),
    });
  });
  const length = data.span[1] - data.span[0];
  addSlider("length", "length of the run", {
    shown: ["length of the run", ...unitOf("t")],
    low: length / SPAN_FACTOR, high: length * SPAN_FACTOR, log: true,
    read: () => difference(state.end, data.span[0]), write: (value) => (state.end = data.span[0] + value),
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

// Those of claims are told by their places: a claim may have any name.
const readouts = { claims: [] };

// How far each parameter moves the run: the largest change of a quantity, relative to its largest value, for one percent.
function sensitivities() {
  const s = settingOf(state, data);
  const places = model.quantities.map((_, j) => j);
  const along = (setting) => {
    const run = model.full(setting, { ...PICTURE, rtol: 1e-8 });
    const times = Array.from({ length: 41 }, (_, k) => s.span[0] + (k * (s.span[1] - s.span[0])) / 40);
    return sampleAt(model, times, model.constants(setting), (t, z) => stateAt(run, t, z) !== null).q;
  };
  const base = along(s);
  const largest = base.map((values) => Math.max(...values.filter(Number.isFinite).map(Math.abs)) || 1);
  return s.parameters.map((value, i) => {
    const parameters = s.parameters.slice();
    parameters[i] = 1.01 * value || 0.01;
    const moved = along({ ...s, parameters });
    const changes = places.flatMap((j) => Array.from(moved[j], (v, k) => Math.abs(v - base[j][k]) / largest[j]));
    return Math.max(0, ...changes.filter(Number.isFinite));
  });
}

// The parameters that move the run most come first; of many the others are folded away.
function sortParameters() {
  if (model.parameters.length < 2) return;
  const moved = sensitivities();
  const order = moved.map((_, i) => i).sort((a, b) => moved[b] - moved[a]);
  const rows = order.map((i) => byId(`parameter-${i}`).parentElement);
  order.forEach((i, k) => (rows[k].title = `1 % more moves the run by ${Number((100 * moved[i]).toPrecision(2))} %`));
  const before = byId("length").parentElement;
  const open = rows.length > SLIDERS ? SLIDERS - 1 : rows.length;
  rows.slice(0, open).forEach((row) => before.before(row));
  if (open === rows.length) return;
  const folded = element("details", { id: "more" }, element("summary", {}, `${rows.length - open} more parameters, which move the run less`), ...rows.slice(open));
  before.after(folded);
}

function addOrders() {
  const box = byId("orders");
  const row = (kind, text, input) => {
    const output = element("output", {}, "");
    const label = element("label", { class: `order ${kind}` }, input ?? element("span"), element("span", {}, element("b"), text), output);
    box.append(label);
    return output;
  };
  readouts.full = row("full", "full run");
  for (let order = 0; order <= 3; order++) {
    const input = element("input", { type: "checkbox", id: `order-${order}` });
    input.addEventListener("change", () => toggleOrder(order));
    readouts[order] = row(`order${order}`, `order ${order}`, input);
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
    readouts.claims[k] = row("rival", claim.name, input);
    readouts.claims[k].parentElement.querySelector("b").dataset.rival = String(k);
  });
  if (data.work) {
    const input = element("input", { type: "checkbox", id: "fixed-shown" });
    input.addEventListener("change", () => {
      state.fixed = input.checked ? (data.span[1] - data.span[0]) / 100 : 0;
      changed();
    });
    sliders.push(() => (input.checked = state.fixed > 0));
    readouts.fixed = row("fixed", "explicit, fixed steps", input);
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
  for (const name of names) select.append(element("option", { value: name }, data.letters[name]));
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
  if (data.path || data.body) {
    views.path = new View(container, "The path in the plane");
    // What stands still has no path.
    const moves = data.body?.at.some((value) => typeof value === "string");
    views.path.say(data.body ? `${moves ? "path of " : ""}${data.body.name}` : "path");
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
    views.space.say(...data.space.flatMap((name, k) => (k ? [", ", typeset(name)] : [typeset(name)])), " in space: drag to turn");
    views.space.frame.classList.add("turned");
    addTurning(views.space.canvas);
  }
  views.trace = new View(container, "A quantity against time");
  views.trace.say(
    choice("trace", "quantity against time", model.quantities, () => state.trace, (value) => (state.trace = value)), " against time",
  );
  views.scales = new View(views.trace.figure, "Time scales against time");
  views.scales.canvas.classList.add("strip");
  if (data.work) {
    views.work = new View(container, "Error against work");
    views.work.say("error against the operations of a run: ", element("output", { id: "chosen" }));
  }
  if (model.reducible && data.compared) {
    views.errors = new View(container, `Error against ${data.letters[model.epsilon]}`);
    views.errors.say("largest relative error of the slow variables against ", typeset(model.epsilon));
  }
  for (const name of Object.keys(views)) addSaving(name);
}

// On a narrow page the sliders stand under the picture that they move, which stays in sight while they are scrolled.
const narrow = window.matchMedia("(max-width: 900px)");

function placeSliders() {
  const picture = Object.values(views).find((view) => !view.figure.hidden) ?? views.plane;
  if (narrow.matches) picture.figure.append(byId("sliders"));
  else byId("controls").prepend(byId("sliders"));
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
