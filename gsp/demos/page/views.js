// The pictures: curves sampled from runs, and views that draw them on plain canvas.

// Points of a drawn run: more than a view is wide helps nobody.
const DRAWN = 600;
// Nodes of a run in fixed steps are shown where there are no more than this; where it grows, this part of it is in the picture.
const DOTTED = 200;
const ROOM = 1.5;
const FONT = "12px system-ui, sans-serif";
const SMALL_FONT = "9px system-ui, sans-serif";
const MARGIN = { left: 52, right: 12, top: 22, bottom: 30 };

// Quantities along a run as {t, q}: q[i] the values of quantity i. Every step is divided, so that long steps look smooth.
function sampleRun(model, run, p, at) {
  const steps = run.times.length - 1;
  const parts = Math.max(1, Math.min(12, Math.ceil(DRAWN / Math.max(1, steps))));
  const stride = Math.max(1, Math.floor(steps / (2 * DRAWN)));
  const times = [];
  for (let i = 0; i < steps; i += stride) {
    const end = run.times[Math.min(i + stride, steps)];
    for (let j = 0; j < parts; j++) times.push(run.times[i] + ((end - run.times[i]) * j) / parts);
  }
  times.push(run.times[steps]);
  return sampleAt(model, times, p, at);
}

function sampleAt(model, times, p, at) {
  const z = new Float64Array(model.n);
  const values = new Float64Array(model.quantities.length);
  const q = model.quantities.map(() => new Float64Array(times.length));
  times.forEach((t, i) => {
    if (at(t, z)) model.quantitiesAt(z, p, values);
    else values.fill(NaN);
    for (let j = 0; j < values.length; j++) q[j][i] = values[j];
  });
  return { t: Float64Array.from(times), q };
}

// Times of a picture with those of a run's steps that are far shorter: a run may turn within a step of the picture.
function withSteps(times, nodes) {
  const steps = Float64Array.from(nodes).sort();
  const longest = Math.abs(times[1] - times[0]);
  const between = Array.from(steps.subarray(1)).flatMap((end, i) =>
    8 * (end - steps[i]) < longest ? [steps[i], (steps[i] + end) / 2, end] : [],
  );
  return Array.from(new Set([...times, ...between])).sort((a, b) => a - b);
}

// All curves of a simulation: the full run, the reduced runs of every piece by order, and the rivals.
function sampleAll(model, result, s, stepped = null) {
  const p = model.constants(s);
  const full = sampleRun(model, result.full, p, (t, z) => stateAt(result.full, t, z) !== null);
  full.blows = result.full.status !== "reached";
  const reduced = [];
  for (const [piece, { runs }] of result.pieces.entries()) {
    for (const run of runs) {
      if (run.status === "no sheet") continue;
      const count = Math.ceil(DRAWN / 4 / result.pieces.length) + 10;
      const even = Array.from({ length: count + 1 }, (_, i) => run.first + ((run.ended - run.first) * i) / count);
      const times = withSteps(even, run.nodes);
      // The last time before the series no longer falls, from where on the run is not drawn.
      let within = NaN;
      const sampled = sampleAt(model, times, p, (t, z) => {
        const drawn = run.at(t, z) && run.isWithinReach();
        if (drawn) within = t;
        return drawn;
      });
      reduced.push({ order: run.order, piece, within, isWhole: within === times[times.length - 1], ...sampled });
    }
  }
  const rivals = result.rivals.map(({ name, places, run, at }) => {
    const ended = run.times[run.times.length - 1];
    const times = Float64Array.from({ length: 301 }, (_, i) => run.times[0] + ((ended - run.times[0]) * i) / 300);
    if (at) return { name, ...sampleAt(model, times, p, at) };
    const q = model.quantities.map(() => new Float64Array(times.length).fill(NaN));
    const state = new Float64Array(places.length);
    times.forEach((t, i) => {
      stateAt(run, t, state);
      places.forEach((place, j) => (q[place][i] = state[j]));
    });
    return { name, t: times, q };
  });
  const nodes = stepped && new Map(stepped.times.map((t, i) => [t, stepped.states[i]]));
  const fixed = stepped && sampleAt(model, stepped.times, p, (t, z) => z.set(nodes.get(t)) === undefined);
  return { full, reduced, rivals, fixed, layer: model.layer(result, s) };
}

// Points of a curve c -> at(c) over an interval, `count` and as many between them as are needed for the steps between neighbours to be
// at most 1: `apart(a, b)`, 0 where neither is there and infinite where one is not. Where no step is found that small, as at a
// pole, the curve is in two pieces, and null stands between them. No more than `most` points are asked for between the first ones.
function tracedCurve(at, [low, high], count, apart, most) {
  const points = [];
  const finest = Number.EPSILON * Math.max(Math.abs(low), Math.abs(high));
  let left = most;
  // From a on, and before b.
  function fill(a, b) {
    if (apart(a.point, b.point) <= 1) {
      points.push(a.point);
    } else if (b.c - a.c <= finest || left <= 0) {
      points.push(a.point, null);
    } else {
      left -= 1;
      const middle = read((a.c + b.c) / 2);
      fill(a, middle);
      fill(middle, b);
    }
  }
  const read = (c) => ({ c, point: at(c) });
  let before = read(low);
  for (let i = 1; i <= count; i++) {
    const next = read(low + ((high - low) * i) / count);
    fill(before, next);
    before = next;
  }
  points.push(before.point);
  return points;
}

function extent(arrays) {
  let low = Infinity;
  let high = -Infinity;
  for (const values of arrays) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high && value < Infinity) high = value;
    }
  }
  if (!(low <= high) || !Number.isFinite(low)) return [-1, 1];
  // What varies by less than the error of a quick run is drawn as the constant that it may be.
  const size = Math.max(Math.abs(low), Math.abs(high));
  const room = high - low > PICTURE.rtol * size ? 0.08 * (high - low) : 0.5 * (size || 1);
  return [low - room, high + room];
}

// The range of quantity j in a picture: of all runs and of what else shall be seen. Of a run that blows up it is the
// beginning: within the last twentieth of its time it grows beyond all bounds.
function rangeOf(curves, j, others = []) {
  const { t, q, blows } = curves.full;
  const last = t[0] + 0.95 * (t[t.length - 1] - t[0]);
  const seen = extent([blows ? q[j].filter((_, k) => t[k] <= last) : q[j], others]);
  const room = ROOM * (seen[1] - seen[0]);
  const [low, high] = [seen[0] - room, seen[1] + room];
  const more = [...curves.reduced, ...curves.rivals, ...(curves.fixed ? [curves.fixed] : [])];
  const near = more.map(({ q }) => q[j].filter(Number.isFinite).map((value) => Math.min(high, Math.max(low, value))));
  return near.some((values) => values.length) ? union(seen, extent(near)) : seen;
}

function union(a, b) {
  return [Math.min(a[0], b[0]), Math.max(a[1], b[1])];
}

// An axis' range that does not tremble while a slider moves: it grows at once, and shrinks when much of it is empty.
function steadied(before, wanted) {
  if (!before) return wanted;
  const grown = [Math.min(before[0], wanted[0]), Math.max(before[1], wanted[1])];
  return wanted[1] - wanted[0] < 0.55 * (grown[1] - grown[0]) ? wanted : grown;
}

function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = Math.pow(10, Math.floor(Math.log10(rough)));
  const step = [1, 2, 5, 10].map((m) => m * power).find((m) => m >= rough) ?? rough;
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return { values: found, step };
}

// The values of an axis as texts that are told apart: plain ones where all of them fit, or no shorter form does.
function tickTexts({ values, step }, fits) {
  const size = (value) => Math.floor(Math.log10(value) + 1e-9);
  const plain = values.map((value) => (value === 0 ? "0" : value.toFixed(Math.max(0, -size(step)))));
  const digits = (value) => Math.max(0, size(Math.abs(value)) - size(step));
  const short = values.map((value) => (value === 0 ? "0" : value.toExponential(digits(value)).replace("e+", "e")));
  const longest = (texts) => Math.max(...texts.map((text) => text.length));
  const chosen = plain.every(fits) || longest(plain) <= longest(short) ? plain : short;
  return chosen.map((text) => text.replaceAll("-", "−"));
}

class View {
  constructor(container, caption) {
    this.figure = document.createElement("figure");
    this.caption = document.createElement("figcaption");
    this.words = document.createElement("span");
    this.caption.append(this.words);
    this.frame = document.createElement("div");
    this.frame.className = "frame";
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", caption);
    this.frame.append(this.canvas);
    this.figure.append(this.caption, this.frame);
    container.append(this.figure);
    this.context = this.canvas.getContext("2d");
    this.xRange = null;
    this.yRange = null;
  }

  say(...parts) {
    this.words.replaceChildren(...parts);
  }

  begin(colours) {
    const scale = window.devicePixelRatio || 1;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    if (this.canvas.width !== Math.round(this.width * scale)) this.canvas.width = Math.round(this.width * scale);
    if (this.canvas.height !== Math.round(this.height * scale)) this.canvas.height = Math.round(this.height * scale);
    this.context.setTransform(scale, 0, 0, scale, 0, 0);
    this.context.clearRect(0, 0, this.width, this.height);
    this.colours = colours;
    this.context.lineJoin = "round";
    this.context.font = FONT;
  }

  // Linear axes; `equal` gives both the same scale.
  setRanges(x, y, { equal = false, steady = true } = {}) {
    this.xRange = steady ? steadied(this.xRange, x) : x;
    this.yRange = steady ? steadied(this.yRange, y) : y;
    const w = this.width - MARGIN.left - MARGIN.right;
    const h = this.height - MARGIN.top - MARGIN.bottom;
    let [x0, x1] = this.xRange;
    let [y0, y1] = this.yRange;
    if (equal) {
      const unit = Math.max((x1 - x0) / w, (y1 - y0) / h);
      const [cx, cy] = [(x0 + x1) / 2, (y0 + y1) / 2];
      [x0, x1, y0, y1] = [cx - (unit * w) / 2, cx + (unit * w) / 2, cy - (unit * h) / 2, cy + (unit * h) / 2];
    }
    this.box = [x0, x1, y0, y1];
    this.X = (v) => MARGIN.left + ((v - x0) / (x1 - x0)) * w;
    this.Y = (v) => MARGIN.top + ((y1 - v) / (y1 - y0)) * h;
    this.atX = (px) => x0 + ((px - MARGIN.left) / w) * (x1 - x0);
    this.atY = (py) => y1 - ((py - MARGIN.top) / h) * (y1 - y0);
  }

  axes(xName, yName, { xLog = false, yLog = false } = {}) {
    const c = this.context;
    const [x0, x1, y0, y1] = this.box;
    c.lineWidth = 1;
    c.strokeStyle = this.colours.line;
    c.fillStyle = this.colours.faint;
    const bottom = this.height - MARGIN.bottom;
    const right = this.width - MARGIN.right;
    const width = (text) => c.measureText(text).width;
    const xs = xLog ? decades(x0, x1) : ticks(x0, x1, Math.max(3, this.width / 90));
    const apart = this.X(x0 + xs.step) - this.X(x0) - width("0");
    const xTexts = xs.texts ?? tickTexts(xs, (text) => width(text) <= apart);
    c.textAlign = "center";
    c.textBaseline = "top";
    c.beginPath();
    xs.values.forEach((value, k) => {
      c.moveTo(this.X(value), MARGIN.top);
      c.lineTo(this.X(value), bottom);
      // The last one ends within the picture.
      c.fillText(xTexts[k], Math.min(this.X(value), this.width - width(xTexts[k]) / 2 - 1), bottom + 3);
    });
    const room = MARGIN.left - 6;
    // Half a line apart.
    const ys = yLog ? decades(y0, y1, (bottom - MARGIN.top) / (1.5 * parseFloat(FONT))) : ticks(y0, y1, 5);
    const yTexts = ys.texts ?? tickTexts(ys, (text) => width(text) <= room);
    c.textAlign = "right";
    c.textBaseline = "middle";
    ys.values.forEach((value, k) => {
      c.moveTo(MARGIN.left, this.Y(value));
      c.lineTo(right, this.Y(value));
      c.fillText(yTexts[k], MARGIN.left - 5, this.Y(value), room);
    });
    c.stroke();
    this.name(xName, right - 2, this.height - 5, 1);
    this.name(yName, 4, 13, 0);
  }

  // A text, or a name in pieces [text, raised by], of which the share `left` stands left of x.
  name(text, x, y, left) {
    const c = this.context;
    const pieces = typeof text === "string" ? [[text, 0]] : text;
    const fonts = pieces.map(([, raised]) => (raised ? SMALL_FONT : FONT));
    const widths = pieces.map(([part], k) => {
      c.font = fonts[k];
      return c.measureText(part).width;
    });
    const width = widths.reduce((a, b) => a + b, 0);
    c.fillStyle = this.colours.ink;
    c.textAlign = "left";
    c.textBaseline = "alphabetic";
    let at = x - left * width;
    pieces.forEach(([part, raised], k) => {
      c.font = fonts[k];
      c.fillText(part, at, y - 4 * raised + (raised < 0 ? -1 : 0));
      at += widths[k];
    });
    c.font = FONT;
  }

  clipped(draw) {
    const c = this.context;
    c.save();
    c.beginPath();
    c.rect(MARGIN.left, MARGIN.top, this.width - MARGIN.left - MARGIN.right, this.height - MARGIN.top - MARGIN.bottom);
    c.clip();
    draw();
    c.restore();
  }

  curve(x, y, colour, width = 1.6, dash = []) {
    const c = this.context;
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.setLineDash(dash);
    c.beginPath();
    let down = false;
    for (let i = 0; i < x.length; i++) {
      const px = this.X(x[i]);
      const py = this.Y(y[i]);
      if (!(Math.abs(px) < 1e5 && Math.abs(py) < 1e5)) {
        down = false;
        continue;
      }
      if (down) c.lineTo(px, py);
      else c.moveTo(px, py);
      down = true;
    }
    c.stroke();
    c.setLineDash([]);
  }

  // A word beside a curve, on a rim of the paper's colour, so that lines under it do not strike it out.
  word(text, x, y, colour) {
    const c = this.context;
    c.textAlign = "left";
    c.textBaseline = "middle";
    c.strokeStyle = this.colours.paper;
    c.lineWidth = 4;
    const left = Math.min(x, this.width - MARGIN.right - c.measureText(text).width - 2);
    c.strokeText(text, left, y);
    c.fillStyle = colour;
    c.fillText(text, left, y);
  }

  dot(x, y, colour, radius = 5) {
    const c = this.context;
    c.fillStyle = colour;
    c.beginPath();
    c.arc(this.X(x), this.Y(y), radius, 0, 2 * Math.PI);
    c.fill();
  }
}

// Powers of ten between two exponents; where there are not two of them, values between them.
function decades(low, high, most = Infinity) {
  const values = [];
  const every = Math.max(1, Math.ceil((high - low) / Math.min(7, most)));
  for (let k = Math.ceil(low); k <= high; k++) if (k % every === 0) values.push(k);
  if (values.length > 1) return { values, texts: values.map(power) };
  const between = ticks(Math.pow(10, low), Math.pow(10, high), 3);
  between.values = between.values.filter((value) => value > 0);
  return { values: between.values.map(Math.log10), texts: tickTexts(between, () => false) };
}

function power(exponent) {
  const raised = [...String(exponent)].map((d) => (d === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(d)])).join("");
  return `10${raised}`;
}

// The value of a sampled curve at time t, linear between samples; NaN outside.
function valueAt(curve, place, t) {
  const { t: times, q } = curve;
  const sign = times[times.length - 1] >= times[0] ? 1 : -1;
  let low = 0;
  let high = times.length - 1;
  if (sign * t < sign * times[0] || sign * t > sign * times[high]) return NaN;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (sign * times[middle] <= sign * t) low = middle;
    else high = middle;
  }
  const share = high === low ? 0 : (t - times[low]) / (times[high] - times[low]);
  return q[place][low] + share * (q[place][high] - q[place][low]);
}
