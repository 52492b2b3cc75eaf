// What a page shows: everything that a reader can change, and its form in the address, so that a situation can be shared.

const EPSILON_RANGE = [1e-5, 1];
// The span may be made so many times shorter or longer.
const SPAN_FACTOR = 20;
const MAX_SHARED = 4000;

function initialState(data) {
  const { model } = data;
  return {
    epsilon: data.epsilon,
    parameters: model.values.slice(),
    start: data.start.slice(),
    end: data.span[1],
    orders: [0, 1],
    rivals: data.model.claims.length > 0,
    axes: data.axes.slice(),
    trace: data.trace,
    // Where speed is told against accuracy: the error allowed, and the step of a run in fixed steps, 0 for none.
    tolerance: 1e-3,
    fixed: 0,
    step: 0,
  };
}

function settingOf(state, data) {
  return {
    epsilon: state.epsilon, parameters: state.parameters.slice(), start: Float64Array.from(state.start),
    span: [data.span[0], state.end], fixed: state.fixed,
  };
}

// A number that a slider's value or a shared address gives; `otherwise` where it is none, or out of all reason.
function readNumber(text, otherwise) {
  const value = typeof text === "string" && text.trim() === "" ? NaN : Number(text);
  return Number.isFinite(value) && Math.abs(value) < 1e12 ? value : otherwise;
}

function encodeState(state, data) {
  const parts = new URLSearchParams();
  parts.set("epsilon", String(state.epsilon));
  data.model.parameters.forEach((name, i) => parts.set(`p.${name}`, String(state.parameters[i])));
  [...data.model.states, ...data.model.driven].forEach((name, i) => parts.set(`s.${name}`, String(state.start[i])));
  parts.set("end", String(state.end));
  parts.set("orders", state.orders.join("."));
  parts.set("rivals", state.rivals ? "1" : "0");
  parts.set("x", state.axes[0]);
  parts.set("y", state.axes[1]);
  parts.set("trace", state.trace);
  if (data.work) {
    parts.set("tolerance", String(state.tolerance));
    parts.set("fixed", String(state.fixed));
  }
  parts.set("step", String(state.step));
  return `#${parts}`;
}

// The step of the story that a fragment names; null where it names none.
function stepIn(fragment, data) {
  const given = new URLSearchParams(fragment.slice(1, MAX_SHARED)).get("step");
  const step = given === null ? NaN : Math.round(readNumber(given, NaN));
  return step >= 0 && step < data.story.length ? step : null;
}

// The state that a fragment describes. What it does not say, or says wrongly, stays as `state` has it.
function decodeState(fragment, state, data) {
  const given = new URLSearchParams(fragment.slice(1, MAX_SHARED));
  const number = (key, otherwise) => (given.has(key) ? readNumber(given.get(key), otherwise) : otherwise);
  const epsilon = number("epsilon", state.epsilon);
  const end = number("end", state.end);
  const tolerance = number("tolerance", state.tolerance);
  const fixed = number("fixed", state.fixed);
  const name = (key, otherwise) => (data.model.quantities.includes(given.get(key)) ? given.get(key) : otherwise);
  const orders = given.has("orders")
    ? [...new Set(given.get("orders").split(".").filter((part) => /^[0-3]$/.test(part)).map(Number))].sort()
    : state.orders;
  const axes = [name("x", state.axes[0]), name("y", state.axes[1])];
  return {
    ...state,
    epsilon: epsilon > 0 ? epsilon : state.epsilon,
    parameters: data.model.parameters.map((p, i) => number(`p.${p}`, state.parameters[i])),
    start: [...data.model.states, ...data.model.driven].map((s, i) => number(`s.${s}`, state.start[i])),
    end: end > data.span[0] ? end : state.end,
    orders,
    rivals: given.has("rivals") ? given.get("rivals") === "1" : state.rivals,
    axes: axes[0] === axes[1] ? state.axes : axes,
    trace: name("trace", state.trace),
    tolerance: tolerance > 0 ? tolerance : state.tolerance,
    fixed: fixed >= 0 ? fixed : state.fixed,
    step: stepIn(fragment, data) ?? state.step,
  };
}
