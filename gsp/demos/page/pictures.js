// The pictures of a page: plane, time, errors, path, and space.

// Lines of the net of a surface in each direction; a line is followed in steps as small as a mesh.
const NET = 22;
// Samples of a curve before those between; where a curve leaves everything behind, so many halvings lead to rounding.
const SAMPLES = 160;
const HALVINGS = 53;

// The largest relative error in the picture.
const LOST = 10;
// Rival runs are told apart by their dashes too.
const RIVAL_DASHES = [[3, 4], [10, 5]];

const bounded = (value, low, high) => Math.min(high, Math.max(low, value));

// The range that the scene's author asks for, of quantity `name` in the first view of these names; undefined where none is.
function asked(views, names, name) {
  return views.find((view) => view.names.join() === names.join() && name in view.ranges)?.ranges[name];
}

// Curves of a plane: quantity `i` across, quantity `j` up. `i` null is time.
function drawCurves(view, curves, i, j, colours) {
  const across = (curve) => (i === null ? curve.t : curve.q[i]);
  view.curve(across(curves.full), curves.full.q[j], colours.ink, 2.4);
  for (const run of curves.reduced) {
    view.curve(across(run), run.q[j], colours.orders[run.order], 1.9, [[], [9, 4], [5, 3], [2, 3]][run.order]);
  }
  curves.rivals.forEach((rival, k) => view.curve(across(rival), rival.q[j], colours.rivals[k % 2], 2.6, RIVAL_DASHES[k % 2]));
  if (curves.fixed) {
    const [x, y] = [across(curves.fixed), curves.fixed.q[j]];
    view.curve(x, y, colours.rivals[0], 1.4);
    if (x.length <= DOTTED) x.forEach((value, k) => view.dot(value, y[k], colours.rivals[0], 2.5));
  }
}

// Arrows of the slow motion in the plane, all of one length.
function drawFlow(view, flow, colours) {
  const c = view.context;
  const rate = new Float64Array(2);
  const step = 34;
  c.strokeStyle = colours.manifold;
  c.fillStyle = colours.manifold;
  c.lineWidth = 1.2;
  for (let px = MARGIN.left + step / 2; px < view.width - MARGIN.right; px += step) {
    for (let py = MARGIN.top + step / 2; py < view.height - MARGIN.bottom; py += step) {
      const at = [view.atX(px), view.atY(py)];
      if (!flow(at, rate)) continue;
      const [dx, dy] = [view.X(at[0] + rate[0]) - px, view.Y(at[1] + rate[1]) - py];
      const size = Math.hypot(dx, dy);
      if (!(size > 1e-6)) continue;
      const [ux, uy] = [dx / size, dy / size];
      c.beginPath();
      c.moveTo(px - 9 * ux, py - 9 * uy);
      c.lineTo(px + 6 * ux, py + 6 * uy);
      c.stroke();
      c.beginPath();
      c.moveTo(px + 10 * ux, py + 10 * uy);
      c.lineTo(px + 4 * ux - 3 * uy, py + 4 * uy + 3 * ux);
      c.lineTo(px + 4 * ux + 3 * uy, py + 4 * uy - 3 * ux);
      c.fill();
    }
  }
}

function drawPlane(view, model, s, curves, i, j, now, colours, orders, { frame, window: shown, views, folds }, { marks = [], flow = false }) {
  view.begin(colours);
  const names = [model.quantities[i], model.quantities[j]];
  const framed = (place, start) => rangeOf(curves, place, [start, ...(frame[model.quantities[place]] ?? [])]);
  // A story or a view may hold an axis still, where runs grow without bound.
  const ranged = (place, start) =>
    shown[model.quantities[place]] ?? asked(views, names, model.quantities[place]) ?? framed(place, start);
  view.setRanges(ranged(i, view.startAt[0]), ranged(j, view.startAt[1]));
  view.axes(...names.map(model.labelled));
  view.clipped(() => {
    const slow = flow ? model.flowIn([i, j], s) : null;
    if (slow) drawFlow(view, slow, colours);
    drawFibres(view, model, i, j, colours);
    const known = model.atDeclared(s) ? folds.map((fold) => [fold[i], fold[j]]).filter((fold) => !fold.includes(null)) : [];
    view.folds = [...known, ...drawManifold(view, model, s, i, j, colours, orders)];
    drawCurves(view, curves, i, j, colours);
    for (const fold of view.folds) {
      const c = view.context;
      c.strokeStyle = colours.rivals[0];
      c.lineWidth = 2;
      c.beginPath();
      c.arc(view.X(fold[0]), view.Y(fold[1]), 6, 0, 2 * Math.PI);
      c.stroke();
    }
    drawMarks(view, marks, names, colours);
    if (now !== null) view.dot(valueAt(curves.full, i, now), valueAt(curves.full, j, now), colours.ink);
  });
}

// Lines with a name each, upright at values of the quantity across and level at values of the one up.
function drawMarks(view, marks, names, colours) {
  const [x0, x1, y0, y1] = view.box;
  for (const mark of marks) {
    if (mark.axis === names[0]) {
      view.curve([mark.at, mark.at], [y0, y1], colours.accent, 1.5, [6, 4]);
      view.word(mark.name, view.X(mark.at) - 8 - view.context.measureText(mark.name).width, MARGIN.top + 10, colours.accent);
    } else if (mark.axis === names[1]) {
      view.curve([x0, x1], [mark.at, mark.at], colours.accent, 1.5, [6, 4]);
      view.word(mark.name, MARGIN.left + 8, view.Y(mark.at) - 8, colours.accent);
    }
  }
}

// Fast fibres of a planar system, x = const.
function drawFibres(view, model, i, j, colours) {
  if (!model.reducible || model.nSlow !== 1) return;
  const slow = model.quantities.indexOf(model.reduction.slow[0]);
  const fast = model.reduction.fast.map((name) => model.quantities.indexOf(name));
  const c = view.context;
  const upright = i === slow && fast.includes(j);
  if (!upright && !(j === slow && fast.includes(i))) return;
  c.strokeStyle = colours.faint;
  c.globalAlpha = 0.35;
  c.lineWidth = 1;
  c.setLineDash([1, 5]);
  c.beginPath();
  const count = 12;
  for (let k = 1; k < count; k++) {
    const [x0, x1, y0, y1] = view.box;
    const at = upright ? view.X(x0 + ((x1 - x0) * k) / count) : view.Y(y0 + ((y1 - y0) * k) / count);
    if (upright) {
      c.moveTo(at, MARGIN.top);
      c.lineTo(at, view.height);
    } else {
      c.moveTo(MARGIN.left, at);
      c.lineTo(view.width, at);
    }
  }
  c.stroke();
  c.setLineDash([]);
  c.globalAlpha = 1;
}

// M0, solid where it attracts and dashed where it does not, and M_epsilon through the highest order shown. Returns the
// folds of M0 along a fast coordinate, as places on the axes.
function drawManifold(view, model, s, i, j, colours, orders) {
  const { coordinates } = model.reducible ? model.seriesAt(s) : {};
  if (!coordinates || coordinates.length !== 1) return [];
  const name = [...model.reduction.slow, ...model.reduction.fast][coordinates[0]];
  const place = model.quantities.indexOf(name);
  const [x0, x1, y0, y1] = view.box;
  const interval = place === i ? [x0, x1] : place === j ? [y0, y1] : null;
  if (!interval) return [];
  const p = model.constants(s);
  const values = new Float64Array(model.quantities.length);
  // Pixels between two points across the coordinate, of what lies in the picture.
  const pixel = ({ at }) => (place === i ? bounded(view.Y(at[1]), -1, view.height + 1) : bounded(view.X(at[0]), -1, view.width + 1));
  const apart = (a, b) => (a.there && b.there ? Math.abs(pixel(a) - pixel(b)) : a.there === b.there ? 0 : Infinity);
  const most = SAMPLES * (Math.max(view.width, view.height) + HALVINGS);
  const highest = Math.max(0, ...orders);
  const folds = [];
  for (const order of highest > 0 ? [0, highest] : [0]) {
    const pointAt = model.manifoldAt(s, order);
    if (!pointAt) return folds;
    const drawn = (c) => {
      const point = pointAt([c]);
      model.quantitiesAt(point.z, p, values);
      const at = [values[i], values[j]];
      return { ...point, at, there: point.valid && allFinite(at) };
    };
    const points = tracedCurve(drawn, interval, SAMPLES, apart, most);
    for (const attracts of [true, false]) {
      // One point more, so that the two kinds meet.
      const shown = points.map((point, k) => point && point.there && (point.attracts === attracts || (points[k + 1] ?? point).attracts === attracts));
      const along = (axis) => points.map((point, k) => (shown[k] ? point.at[axis] : NaN));
      const colour = order === 0 ? colours.manifold : colours.orders[order];
      view.curve(along(0), along(1), colour, order === 0 ? 3 : 1.2, attracts ? [] : [7, 6]);
    }
    if (order === 0 && coordinates[0] >= model.nSlow) {
      points.forEach((point, k) => {
        const next = points[k + 1];
        if (!(point && next && point.there && next.there && point.turn > 0 !== next.turn > 0)) return;
        let [low, high] = [point, next];
        for (let halving = 0; halving < HALVINGS; halving++) {
          const middle = drawn((low.c[0] + high.c[0]) / 2);
          if (middle.turn > 0 === low.turn > 0) low = middle;
          else high = middle;
        }
        folds.push(low.at);
      });
    }
  }
  return folds;
}

function drawTrace(view, model, s, curves, j, now, colours, { logarithmic, window: shown, views }) {
  const name = model.quantities[j];
  const yLog = logarithmic.includes(name);
  const names = ["t", name];
  view.begin(colours);
  const taken = yLog ? logarithms(curves, j) : curves;
  view.setRanges(
    asked(views, names, "t") ?? [s.span[0], s.span[1]],
    shown[name] ?? asked(views, names, name) ?? rangeOf(taken, j), { steady: false },
  );
  view.axes(model.labelled("t"), model.labelled(name), { yLog });
  view.layerEnd = curves.layer ? visibleEnd(curves.layer, j, (value) => view.Y(yLog ? Math.log10(value) : value)) : NaN;
  view.clipped(() => {
    if (view.layerEnd > s.span[0]) {
      view.context.fillStyle = colours.manifold;
      view.context.globalAlpha = 0.16;
      view.context.fillRect(view.X(s.span[0]), 0, view.X(view.layerEnd) - view.X(s.span[0]), view.height);
      view.context.globalAlpha = 1;
    }
    drawCurves(view, taken, null, j, colours);
    if (now !== null) {
      view.curve([now, now], [view.box[2], view.box[3]], colours.faint, 1);
      view.dot(now, valueAt(taken.full, j, now), colours.ink);
    }
  });
}

// Until when quantity j is seen to approach the slow manifold: from where on it is as near to it as where the run has
// reached it, to a pixel. NaN where it is so from the start.
function visibleEnd({ times, run, on }, j, pixel) {
  const away = run.map((values, k) => pixel(values[j]) - pixel(on[k][j]));
  const last = away.length - 1;
  for (let k = last; k > 0; k--) if (!(Math.abs(away[k - 1] - away[last]) <= 1)) return times[k];
  return NaN;
}

// The same curves with the decimal logarithm of quantity j; NaN where it is not positive.
function logarithms(curves, j) {
  const of = (curve) => {
    const q = curve.q.slice();
    q[j] = q[j].map((value) => (value > 0 ? Math.log10(value) : NaN));
    return { ...curve, q };
  };
  return { full: of(curves.full), reduced: curves.reduced.map(of), rivals: curves.rivals.map(of), fixed: curves.fixed && of(curves.fixed) };
}

// Errors against epsilon, both logarithmic, with the present epsilon marked.
function drawErrors(view, model, ladder, epsilon, colours, orders, rivals) {
  view.begin(colours);
  const lines = orders.length + rivals.length;
  const points = ladder.filter((row) => row !== null).sort((a, b) => a.epsilon - b.epsilon);
  const all = points.flatMap((row) => [...orders.map((order) => row.orders[order]), ...rivals.map((name) => row.rivals[name])]);
  // What is below the floor is noise, and an error far above 1 says nothing but that the run is lost.
  const isShown = (e) => e > FLOOR && Number.isFinite(e);
  const good = all.filter(isShown).map((e) => Math.log10(Math.min(e, LOST)));
  const x = Math.log10(epsilon);
  view.setRanges([x - 1.1, x + 0.7], good.length ? [Math.min(...good) - 0.4, Math.max(...good) + 0.4] : [-8, 0], {
    steady: false,
  });
  view.axes(model.labelled(model.epsilon), "error", { xLog: true, yLog: true });
  view.clipped(() => {
    view.curve([x, x], [view.box[2], view.box[3]], colours.faint, 1);
    const line = (read, colour, dash = []) => {
      const known = points.filter((row) => isShown(read(row)));
      const xs = known.map((row) => Math.log10(row.epsilon));
      const ys = known.map((row) => Math.log10(read(row)));
      view.curve(xs, ys, colour, 2, dash);
      xs.forEach((value, k) => view.dot(value, ys[k], colour, 3.2));
    };
    for (const order of orders) line((row) => row.orders[order], colours.orders[order]);
    rivals.forEach((name, k) => line((row) => row.rivals[name], colours.rivals[k % 2], RIVAL_DASHES[k % 2]));
  });
  const exact = points.length && orders.filter((order) => points.every((row) => row.orders[order] <= FLOOR));
  view.figure.classList.toggle("idle", lines === 0);
  const said = lines === 0
    ? "Switch an order on to measure its error."
    : exact.length ? `exact to rounding: order ${exact.join(", ")}` : "";
  view.word(said, (view.width - view.context.measureText(said).width) / 2, view.height / 2, colours.ink);
}

// The net of M0 in a box: {spans, lines}, a line the points along it in pieces of one kind, {attracts, along}. It changes
// with the setting and the run and not with the angles, so that it is kept while the picture is turned.
let net = { key: "" };

function netOf(model, s, curves, places, { box, views }) {
  const names = places.map((place) => model.quantities[place]);
  const spans = places.map((place, k) => asked(views, names, names[k]) ?? extent([curves.full.q[place], box[names[k]] ?? []]));
  const p = model.constants(s);
  const key = [...p, ...places, ...spans.flat()].join();
  if (net.key === key) return net;
  net = { key, spans, lines: [] };
  const { coordinates } = model.reducible ? model.seriesAt(s) : {};
  const own = coordinates?.map((c) => names.indexOf([...model.reduction.slow, ...model.reduction.fast][c])) ?? [];
  if (own.length !== 2 || own.includes(-1)) return net;
  const [across] = [0, 1, 2].filter((axis) => !own.includes(axis));
  const pointAt = model.manifoldAt(s, 0);
  const values = new Float64Array(model.quantities.length);
  const drawn = (c) => {
    const point = pointAt(c);
    model.quantitiesAt(point.z, p, values);
    const at = places.map((place) => values[place]);
    return { at, attracts: point.attracts, there: allFinite(at) };
  };
  const [low, high] = spans[across];
  // Meshes between two points, of what lies in the box.
  const mesh = ({ at }) => (NET * (bounded(at[across], low, high) - low)) / (high - low);
  const apart = (a, b) => (a.there && b.there ? Math.abs(mesh(a) - mesh(b)) : a.there === b.there ? 0 : Infinity);
  const inside = (point) => point && point.there && low <= point.at[across] && point.at[across] <= high;
  for (const moving of [0, 1]) {
    const [from, to] = spans[own[1 - moving]];
    for (let line = 0; line <= NET; line++) {
      const still = from + ((to - from) * line) / NET;
      const points = tracedCurve((c) => drawn(moving ? [still, c] : [c, still]), spans[own[moving]], NET, apart, NET * (NET + HALVINGS));
      for (const attracts of [true, false]) {
        const along = [0, 1, 2].map((axis) =>
          points.map((point, k) => {
            const next = points[k + 1] ?? point;
            return inside(point) && (point.attracts === attracts || next.attracts === attracts) ? point.at[axis] : NaN;
          }),
        );
        net.lines.push({ attracts, along });
      }
    }
  }
  return net;
}

// Three quantities in space, turned by two angles: M0 as a net, the runs, and the start.
function drawSpace(view, model, s, curves, places, angles, data, now, colours) {
  view.begin(colours);
  const { spans, lines } = netOf(model, s, curves, places, data);
  const [turn, tilt] = angles;
  const [ct, st, ci, si] = [Math.cos(turn), Math.sin(turn), Math.cos(tilt), Math.sin(tilt)];
  const unit = 0.56 * Math.min(view.width, view.height * 1.15);
  const scaled = (value, k) => (value - spans[k][0]) / (spans[k][1] - spans[k][0]) - 0.5;
  const project = (q) => {
    const [x, y, z] = [scaled(q[0], 0), scaled(q[1], 1), scaled(q[2], 2)];
    return [view.width / 2 + unit * (x * ct - y * st), view.height / 2 - unit * (z * ci + (x * st + y * ct) * si)];
  };
  view.X = (value) => value;
  view.Y = (value) => value;
  const polyline = ([a, b, c], colour, width, dash = []) => {
    const x = new Float64Array(a.length);
    const y = new Float64Array(a.length);
    for (let i = 0; i < a.length; i++) [x[i], y[i]] = project([a[i], b[i], c[i]]);
    view.curve(x, y, colour, width, dash);
  };
  const c = view.context;
  for (const { attracts, along } of lines) {
    c.globalAlpha = attracts ? 0.75 : 0.3;
    polyline(along, colours.manifold, 1);
  }
  c.globalAlpha = 1;
  const corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]].map((corner) => corner.map((k, i) => spans[i][k]));
  corners.slice(1).forEach((corner, k) => {
    polyline(corner.map((value, i) => [corners[0][i], value]), colours.faint, 1);
    const [px, py] = project(corner);
    view.name(model.labelled(model.quantities[places[k]]), Math.min(view.width - 14, Math.max(14, px)), Math.min(view.height - 6, Math.max(14, py - 5)), 0.5);
  });
  const inSpace = (curve) => places.map((place) => curve.q[place]);
  polyline(inSpace(curves.full), colours.ink, 2.4);
  for (const run of curves.reduced) polyline(inSpace(run), colours.orders[run.order], 1.9, [[], [9, 4], [5, 3], [2, 3]][run.order]);
  const at = now === null ? curves.full.t[0] : now;
  const [px, py] = project(places.map((place) => valueAt(curves.full, place, at)));
  view.dot(px, py, now === null ? colours.accent : colours.ink);
}
