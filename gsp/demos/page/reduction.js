// The model of a page: full runs, the point where they have reached the slow manifold, reduced runs of every order from
// there, and how far apart the two are. A setting is {epsilon, parameters, start, span}, start in the states as declared
// and what is reconstructed.

// Steps of a run, for a picture while something moves and for a measurement; the tolerances of both.
const PICTURE = { rtol: 1e-4, maxSteps: 3000, reducedSteps: 200 };
const MEASUREMENT = { rtol: 1e-11, maxSteps: 20000, reducedSteps: 4000 };
// A run in fixed steps has blown up when it is so many times as large as its start.
const BLOWN = 1e4;
// Errors are measured at so many times.
const GRID = 60;
// Pieces of slow motion between jumps that are reduced, each from where the full run has reached the manifold again.
const PIECES = 6;
// A step of Newton's method below this, relative to the point, is the last: what it leaves is of the size of its square.
const NEWTON = 1e-8;
// An order is past the best one when its error is larger by this factor; estimates are thrice the first term left out.
const GROWN = 2;
const ESTIMATE = 3;
// The sheet counts as lost where the rate of attraction has fallen to this share: what is left is a fold, where the
// reduced field grows beyond bounds.
const FADED = 0.03;
// At so many times at least a reduced run is looked at for that.
const WATCHED = 64;

// The largest real part of the eigenvalues of a matrix.
function spectralAbscissa(A, n) {
  if (n === 1) return A[0];
  if (n > 2) return Math.max(...eigenvaluesOf(A, n).re);
  const half = (A[0] + A[3]) / 2;
  const square = half * half - A[0] * A[3] + A[1] * A[2];
  return square > 0 ? half + Math.sqrt(square) : half;
}

function makeModel(data, program) {
  const { model, rodas5p } = data;
  const reduction = model.reduction;
  const reducible = reduction.reason === "";
  const nRaw = model.states.length;
  const nDriven = model.driven.length;
  const n = nRaw + nDriven;
  const nSlow = reducible ? reduction.slow.length : 0;
  const nFast = reducible ? reduction.fast.length : 0;

  const constants = (s) => [s.epsilon, ...s.parameters];
  // A name in pieces [text, raised by], with its unit, as it is drawn on a canvas.
  const labelled = (name) => {
    const [base, below, above] = data.lettered[name];
    const pieces = [[base, 0], [below, -1], [above, 1], [name in data.units ? ` (${data.units[name]})` : "", 0]];
    return pieces.filter(([text]) => text !== "");
  };

  function atDeclared(s) {
    return s.parameters.every((value, i) => value === model.values[i]);
  }

  // The functions of the series that hold at a setting, and through which order.
  function seriesAt(s) {
    const label = reduction.declared > reduction.anywhere && atDeclared(s) ? "Declared" : "";
    return {
      label,
      order: label ? reduction.declared : reduction.anywhere,
      coordinates: reduction[`coordinates${label}`],
    };
  }

  // In steps of s.fixed by an explicit method, until it is out of all reason.
  function fixed(s) {
    const p = constants(s);
    const size = Math.max(1, ...Array.from(s.start, Math.abs));
    return integrateFixed((z, out) => program.field(z, p, out), s.start, s.span[0], s.span[1], s.fixed, {
      beyond: BLOWN * size, maxSteps: PICTURE.maxSteps,
    });
  }

  // Where steps end: before and after the jumps that a clock makes, and on the pulses that it makes.
  function pulsesOf(s, most) {
    const [first, last] = s.span;
    const values = new Float64Array(model.pulses.reduce((sum, { zeros }) => zeros.reduce((m, z) => m + z.numbers, sum + 1), 0));
    program.pulses(s.start, constants(s), values);
    let next = 0;
    return model.pulses.flatMap(({ state, zeros }) => {
      const rate = values[next++];
      const now = s.start[state];
      return zeros.flatMap(({ jumps, wave, numbers }) => {
        const given = Array.from(values.subarray(next, (next += numbers)));
        const ends = [now, now + rate * (last - first)].sort((a, b) => a - b);
        const places = wave ? zerosOfWave(given, ...ends, most) : zerosOfPolynomial(given);
        return places.flatMap((place) => {
          const time = first + (place - now) / rate;
          const beside = 16 * Number.EPSILON * Math.max(...[first, last, place / rate, now / rate].map(Math.abs));
          return jumps ? [time - beside, time + beside] : [time];
        });
      });
    });
  }

  // The absolute tolerance follows the smallest state.
  const passing = (s, accuracy) => ({ ...accuracy, atol: accuracy.rtol * data.absolute, ends: pulsesOf(s, accuracy.maxSteps) });

  function explicit(s, accuracy, end) {
    const p = constants(s);
    return integrateExplicit((z, out) => program.field(z, p, out), s.start, s.span[0], end, passing(s, accuracy));
  }

  function full(s, accuracy, end = s.span[1]) {
    const p = constants(s);
    return integrateStiff(
      rodas5p, (z, out) => program.field(z, p, out), (z, out) => program.jacobian(z, p, out),
      s.start, s.span[0], end, passing(s, accuracy),
    );
  }

  function quantitiesAt(z, p, out) {
    program.quantities(z, p, out);
    return out;
  }

  // Of the rates of the states by the states (nRaw x nRaw, by rows): what is reconstructed has no part in it.
  function jacobianAt(z, p) {
    const whole = new Float64Array(n * n);
    program.jacobian(z, p, whole);
    return Float64Array.from({ length: nRaw * nRaw }, (_, k) => whole[Math.floor(k / nRaw) * n + (k % nRaw)]);
  }

  // y on M0 over x, nearest to `y` in Newton's sense; false where there is none.
  const newton = {
    u: new Float64Array(nSlow + nFast), residual: new Float64Array(nFast), J: new Float64Array(nFast * nFast),
    pivots: new Int32Array(nFast),
  };

  function onSheet(x, y, p) {
    if (reduction.explicit) {
      program.graph(x, p, y);
      return allFinite(y);
    }
    const { u, residual, J, pivots } = newton;
    u.set(x);
    for (let step = 0; step < 30; step++) {
      u.set(y, nSlow);
      program.sheet(u, p, residual);
      program.sheetJacobian(u, p, J);
      if (nFast === 1) {
        residual[0] /= J[0];
      } else {
        if (!factorise(J, nFast, pivots)) return false;
        solveFactorised(J, nFast, pivots, residual);
      }
      let size = 0;
      for (let i = 0; i < nFast; i++) {
        y[i] -= residual[i];
        size = Math.max(size, Math.abs(residual[i]) / (reduction.sizes[i] + Math.abs(y[i])));
      }
      if (!Number.isFinite(size)) return false;
      if (size < NEWTON) return true;
    }
    return false;
  }

  // The slowest rate of attraction, in fast time, at (x, y); negative where a direction repels.
  const fastBlock = new Float64Array(nFast * nFast);

  function gapAt(u, p) {
    program.fastJacobian(u, p, fastBlock);
    return allFinite(fastBlock) ? -spectralAbscissa(fastBlock, nFast) : NaN;
  }

  function toNew(z, p) {
    const u = new Float64Array(nSlow + nFast);
    program.toNew(z, p, u);
    return u;
  }

  // Where, from node `from` on, the full run has spent `wanted` e-folds over the attracting part, past its layer, {at, left}: and
  // whether it has left another piece of it before, on which it had settled to order epsilon. at is -1 where it never does.
  function arrival(run, s, from, wanted) {
    const p = constants(s);
    const settled = Math.log(1 / s.epsilon);
    let [folds, left] = [0, false];
    let before = NaN;
    const u = new Float64Array(nSlow + nFast);
    for (let i = from; i < run.times.length; i++) {
      program.toNew(run.states[i], p, u);
      const gap = gapAt(u, p);
      if (i > from) {
        const rate = (0.5 * (gap + before)) / s.epsilon;
        left ||= !(rate > 0) && folds > settled;
        folds = rate > 0 ? folds + rate * (run.times[i] - run.times[i - 1]) : 0;
        if (folds >= wanted && gap > 0) return { at: i, left };
      }
      before = gap;
    }
    return { at: -1, left };
  }

  // e-folds after which what is left of the layer is below the smallest error that is looked at.
  function layerFolds(s) {
    return Math.min(30, Math.max(6, 6 * Math.log(1 / s.epsilon)));
  }

  // Fills `out` with h ("h") or x' ("f") through `order` at coordinates c on M0.
  function sum(kind, order, c, s, p, out) {
    addTerms(termsOf(kind, order, seriesAt(s).label), c, s.epsilon, p, out, new Float64Array(out.length));
  }

  function termsOf(kind, order, label) {
    return Array.from({ length: order + 1 }, (_, k) => program[`${kind}${k}${label}`]);
  }

  function addTerms(terms, c, epsilon, p, out, term) {
    terms[0](c, p, out);
    for (let k = 1, power = epsilon; k < terms.length; k++, power *= epsilon) {
      terms[k](c, p, term);
      for (let i = 0; i < out.length; i++) out[i] += power * term[i];
    }
  }

  function coordinatesOf(x, y0, s) {
    return fillCoordinates(seriesAt(s).coordinates, x, y0, []);
  }

  function fillCoordinates(places, x, y0, c) {
    for (let i = 0; i < places.length; i++) c[i] = places[i] < nSlow ? x[places[i]] : y0[places[i] - nSlow];
    return c;
  }

  // The order at which the series is best cut at (x, y0), and the sizes of its terms: the envelope of the next two terms
  // tells the error, and where none is known the last term does.
  function bestOrder(c, s) {
    const { order, label } = seriesAt(s);
    const p = constants(s);
    const term = new Float64Array(nFast);
    const sizes = [];
    for (let k = 0; k <= order; k++) {
      program[`h${k}${label}`](c, p, term);
      sizes.push(Math.pow(s.epsilon, k) * Math.hypot(...term));
    }
    const errors = sizes.map((own, k) => ESTIMATE * Math.max(sizes[k + 1] ?? (sizes.length > 1 ? own : 0), sizes[k + 2] ?? 0));
    let best = 0;
    errors.forEach((e, k) => {
      if (e <= errors[best]) best = k;
    });
    const reached = errors.map((e, k) => k <= best || e <= GROWN * errors[best]);
    return { best, sizes, reached };
  }

  // A reduced run of `order` through the slow state of the full run at node `at`, to `end` and, with `back`, back to the
  // beginning of the span. The states are x and what is reconstructed; `points` makes z of them.
  function reduced(run, s, at, order, end, back, accuracy) {
    const p = constants(s);
    const u = toNew(run.states[at], p);
    const y0 = u.slice(nSlow);
    const begun = run.times[at];
    const x = u.slice(0, nSlow);
    if (!onSheet(x, y0, p)) return { order, status: "no sheet", begun, parts: [] };
    const seen = new Float64Array(nFast);
    const y = new Float64Array(nFast);
    const point = new Float64Array(n);
    const rate = new Float64Array(n);
    const uPoint = new Float64Array(nSlow + nFast);
    const slow = new Float64Array(nSlow);
    const near = Float64Array.from(y0);
    const { label, coordinates } = seriesAt(s);
    const [hTerms, fTerms] = [termsOf("h", order, label), termsOf("f", order, label)];
    const [yTerm, xTerm] = [new Float64Array(nFast), new Float64Array(nSlow)];
    const c = new Float64Array(coordinates.length);

    // The coordinates c of a state on M0; false where the sheet has ended.
    function locate(state) {
      const xNow = state.subarray(0, nSlow);
      seen.set(near);
      if (!onSheet(xNow, seen, p)) return false;
      fillCoordinates(coordinates, xNow, seen, c);
      return true;
    }

    // z over (x, driven), with y through `order`; false where the sheet has ended.
    function lift(state, out) {
      if (!locate(state)) return false;
      const xNow = state.subarray(0, nSlow);
      addTerms(hTerms, c, s.epsilon, p, y, yTerm);
      uPoint.set(xNow);
      uPoint.set(y, nSlow);
      program.toRaw(uPoint, p, out);
      for (let i = 0; i < nDriven; i++) out[nRaw + i] = state[nSlow + i];
      return true;
    }

    function field(state, out) {
      // Where nothing is driven, the slow rates are all that is asked for.
      if (!(nDriven ? lift(state, point) : locate(state))) {
        out.fill(NaN);
        return;
      }
      addTerms(fTerms, c, s.epsilon, p, slow, xTerm);
      out.set(slow);
      if (nDriven) {
        program.field(point, p, rate);
        for (let i = 0; i < nDriven; i++) out[nSlow + i] = rate[nRaw + i];
      }
    }

    // After each step: the sheet is followed, and the run ends where it no longer attracts.
    let sheets = null;
    const held = near.slice();
    function attracts(state) {
      const xNow = state.subarray(0, nSlow);
      seen.set(near);
      if (!onSheet(xNow, seen, p)) return false;
      near.set(seen);
      uPoint.set(xNow);
      uPoint.set(near, nSlow);
      return gapAt(uPoint, p) > FADED * firstGap;
    }

    // Within a step too: those of a slow motion that is simple are long.
    let [between, length] = [[], 0];
    function stop(part) {
      const [from, to] = part.times.slice(-2);
      const count = Math.ceil(WATCHED * Math.abs((to - from) / length));
      for (let k = 1; k <= count; k++) {
        const looked = k === count ? to : from + ((to - from) * k) / count;
        between = [between[1] ?? from, looked];
        if (!attracts(stateAt(part, looked, state))) return true;
        held.set(near);
      }
      if (sheets) sheets.push(near.slice());
      return false;
    }

    // Where a run that was stopped attracts no more, to a share of 2^-40.
    function stopped(part) {
      let [good, bad] = between;
      for (let halving = 0; halving < 40; halving++) {
        const middle = (good + bad) / 2;
        near.set(held);
        stateAt(part, middle, state);
        if (attracts(state)) {
          good = middle;
          held.set(near);
        } else bad = middle;
      }
      near.set(held);
      return good;
    }

    const firstGap = gapAt(Float64Array.of(...x, ...y0), p);
    const start = new Float64Array(nSlow + nDriven);
    start.set(x);
    for (let i = 0; i < nDriven; i++) start[nSlow + i] = run.states[at][nRaw + i];
    const state = new Float64Array(nSlow + nDriven);
    const limits = { ...passing(s, accuracy), maxSteps: accuracy.reducedSteps, stop };
    // A run and its sheet at every node, for the values between them.
    function along(to) {
      near.set(y0);
      held.set(y0);
      [between, length] = [[], to - begun];
      sheets = reduction.explicit ? null : [y0];
      const part = integrateExplicit(field, start, begun, to, limits);
      part.sheets = sheets;
      return part;
    }
    const forward = along(end);
    const isLost = forward.status === "stopped";
    const ended = isLost ? stopped(forward) : forward.times[forward.times.length - 1];
    const last = near.slice();
    const parts = [forward];
    if (back && begun > s.span[0]) parts.unshift(along(s.span[0]));
    sheets = null;
    // Towards a fold the rate of attraction falls to nothing, whatever stops the run first.
    uPoint.set(forward.states[forward.states.length - 1].subarray(0, nSlow));
    uPoint.set(last, nSlow);
    const faded = !(gapAt(uPoint, p) > 3 * FADED * firstGap);
    const status = isLost || (faded && forward.status !== "reached") ? "lost" : forward.status;
    const reachedBack = parts.length > 1 ? parts[0].times[parts[0].times.length - 1] : begun;
    return {
      order, status, begun, ended, steps: forward.times.length, first: reachedBack, last,
      nodes: parts.flatMap((part) => part.times.filter((t) => t <= ended)),
      // The same flow from this run's own beginning to `to`, at another accuracy; its states are x and what is reconstructed.
      again(to, wanted) {
        const begins = parts[0].states[parts.length > 1 ? parts[0].states.length - 1 : 0];
        near.set(nearest(parts[0], reachedBack));
        return integrateExplicit(field, begins, reachedBack, to, passing(s, wanted));
      },
      // z at time t, on the sheet near y0.
      at(t, out) {
        const part = parts.length > 1 && t < begun ? parts[0] : forward;
        stateAt(part, t, state);
        // The sheet is found from the one nearest in time that is known.
        near.set(nearest(part, t));
        return lift(state, out);
      },
      // Whether the series through the run's order is within its reach at the time last asked for.
      isWithinReach: () => order === 0 || bestOrder(c, s).reached[order],
    };

    function nearest(part, t) {
      if (!part.sheets || part.sheets.length === 1) return y0;
      let low = 0;
      let high = part.times.length - 1;
      const sign = part.times[high] >= part.times[0] ? 1 : -1;
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (sign * part.times[middle] <= sign * t) low = middle;
        else high = middle;
      }
      return part.sheets[Math.min(low, part.sheets.length - 1)];
    }
  }

  // Everything a picture shows: the full run, and reduced runs of `orders` on every slow piece of it.
  function simulate(s, orders, accuracy = PICTURE) {
    const result = { full: full(s, accuracy), pieces: [], rivals: [], layerEnd: NaN, cut: false };
    if (!reducible) return result;
    const { order } = seriesAt(s);
    const possible = orders.filter((k) => k <= order);
    let from = 0;
    let spent = 0;
    const pieces = accuracy.pieces ?? PIECES;
    for (let piece = 0; piece < pieces && from < result.full.times.length - 1; piece++) {
      const { at, left } = arrival(result.full, s, from, layerFolds(s));
      if (at < 0) break;
      if (piece === 0) result.layerEnd = result.full.times[at];
      const end = s.span[1];
      // Back to the start's base point, over the initial layer alone.
      const runs = possible.map((k) => reduced(result.full, s, at, k, end, piece === 0 && !left, accuracy));
      result.pieces.push({ at, left, runs });
      spent += runs.reduce((total, run) => total + (run.steps ?? 0), 0);
      if (spent > 2 * accuracy.reducedSteps) {
        result.cut = s.span[1] > result.full.times[at];
        break;
      }
      if (!runs.length) break;
      // The lowest order decides where the piece ends: higher ones break down before, or run astray there.
      const ended = runs[0].ended ?? runs[0].begun;
      if (runs[0].status === "reached") break;
      from = result.full.times.findIndex((t) => t > ended);
      if (from < 0) break;
    }
    if (accuracy.rivals !== false) result.rivals = rivals(result, s, accuracy);
    return result;
  }

  // Fills what is not among the `given` states of z from the slow manifold through `order`, where those are slaved to the
  // given ones; z begins near. False where the sheet has ended, or no such point was found.
  function complete(z, given, order, s, p) {
    const y = new Float64Array(nFast);
    const out = new Float64Array(n);
    for (let step = 0; step < 40; step++) {
      const u = toNew(z, p);
      const x = u.slice(0, nSlow);
      const y0 = u.slice(nSlow);
      if (!onSheet(x, y0, p)) return false;
      sum("h", order, coordinatesOf(x, y0, s), s, p, y);
      u.set(y, nSlow);
      program.toRaw(u, p, out);
      let moved = 0;
      for (let i = 0; i < nRaw; i++) {
        if (given.includes(i)) continue;
        moved = Math.max(moved, Math.abs(out[i] - z[i]) / (data.sizes[i] + Math.abs(out[i])));
        z[i] = out[i];
      }
      if (!Number.isFinite(moved)) return false;
      if (moved < NEWTON) return true;
    }
    return false;
  }

  // The reduced flow of order 0 in the plane of two states: a function that fills `rate` at their values; null where the slow
  // motion is not one in that plane.
  function flowIn(places, s) {
    if (!reducible || nSlow !== 2 || places.some((place) => place >= nRaw)) return null;
    const p = constants(s);
    const z = new Float64Array(n);
    const rate = new Float64Array(n);
    return (values, out) => {
      z.set(Float64Array.from(s.start));
      places.forEach((place, k) => (z[place] = values[k]));
      if (!complete(z, places, 0, s, p)) return false;
      const u = toNew(z, p);
      const y0 = u.slice(nSlow);
      const x = u.slice(0, nSlow);
      const slow = new Float64Array(nSlow);
      sum("f", 0, coordinatesOf(x, y0, s), s, p, slow);
      // Along the manifold: the states at a slow point a little further on.
      const ahead = (sign) => {
        const size = 1e-5 / (1 + Math.hypot(...slow));
        const next = x.map((value, i) => value + sign * size * slow[i]);
        const yNext = y0.slice();
        onSheet(next, yNext, p);
        program.toRaw(Float64Array.of(...next, ...yNext), p, rate);
        return { size, at: places.map((place) => rate[place]) };
      };
      const [before, after] = [ahead(-1), ahead(1)];
      after.at.forEach((value, k) => (out[k] = (value - before.at[k]) / (2 * after.size)));
      return allFinite(out);
    };
  }

  // Rival fields of the scene, from the full run's own values where it has reached the manifold. What a field says nothing of is
  // taken from the slow manifold through first order where its states are the model's, and the path follows.
  function rivals(result, s, accuracy) {
    if (!result.pieces.length || !model.claims.length) return [];
    const p = constants(s);
    const values = quantitiesAt(result.full.states[result.pieces[0].at], p, new Float64Array(model.quantities.length));
    return model.claims.map((claim, i) => {
      const places = claim.states.map((name) => model.quantities.indexOf(name));
      const start = Float64Array.from(places, (place) => values[place]);
      const rate = program[`claim${i}`];
      const given = claim.states.map((name) => model.states.indexOf(name));
      const whole = !given.includes(-1);
      const order = Math.min(1, seriesAt(s).order);
      const z = Float64Array.from(result.full.states[result.pieces[0].at]);
      const at = (state, out) => {
        out.set(z);
        given.forEach((place, j) => (out[place] = state[j]));
        const found = complete(out, given, order, s, p);
        for (let j = 0; j < nDriven; j++) out[nRaw + j] = state[given.length + j];
        if (found) z.set(out);
        return found;
      };
      const [point, moving] = [new Float64Array(n), new Float64Array(n)];
      const field = (state, out) => {
        rate(state.subarray(0, given.length), p, out);
        if (!whole || nDriven === 0) return;
        if (at(state, point)) program.field(point, p, moving);
        else moving.fill(NaN);
        for (let j = 0; j < nDriven; j++) out[given.length + j] = moving[nRaw + j];
      };
      const begun = whole ? Float64Array.of(...start, ...z.subarray(nRaw)) : start;
      const run = integrateExplicit(field, begun, result.layerEnd, s.span[1],
        { ...passing(s, accuracy), maxSteps: accuracy.reducedSteps });
      const state = new Float64Array(begun.length);
      return { name: claim.name, places, run, at: whole ? (t, out) => stateAt(run, t, state) !== null && at(state, out) : null };
    });
  }

  // Where runs are compared: times over the first slow piece, the slow variables of the full run there, and their largest
  // values; null where nothing can be compared.
  function comparison(result, s) {
    if (!result.pieces.length) return null;
    const p = constants(s);
    const { at, runs } = result.pieces[0];
    const begun = result.full.times[at];
    const fullEnd = result.full.times[result.full.times.length - 1];
    const ended = Math.min(fullEnd, ...runs.map((run) => run.ended ?? begun));
    if (!(ended > begun)) return null;
    const z = new Float64Array(n);
    const times = Array.from({ length: GRID }, (_, i) => begun + ((ended - begun) * (i + 1)) / GRID);
    const exact = times.map((t) => toNew(stateAt(result.full, t, z), p));
    const scale = Array.from({ length: nSlow }, (_, j) => Math.max(...exact.map((u) => Math.abs(u[j]))) || 1);
    return { times, exact, scale, ended };
  }

  // Largest error of each order's run over the first slow piece, each slow variable relative to its largest value.
  function errorsOf(result, s) {
    const found = { orders: {}, rivals: Object.create(null), from: result.layerEnd, to: NaN };
    const compared = comparison(result, s);
    if (!compared) return found;
    const { times, exact, scale } = compared;
    found.to = compared.ended;
    const p = constants(s);
    const { runs } = result.pieces[0];
    const z = new Float64Array(n);
    const point = new Float64Array(n);
    for (const run of runs) {
      let worst = 0;
      times.forEach((t, i) => {
        const u = run.at(t, point) ? toNew(point, p) : null;
        for (let j = 0; j < nSlow; j++) {
          worst = Math.max(worst, u === null ? Infinity : Math.abs(u[j] - exact[i][j]) / scale[j]);
        }
      });
      found.orders[run.order] = worst;
    }
    const shown = new Float64Array(model.quantities.length);
    for (const rival of result.rivals) {
      const last = rival.run.times[rival.run.times.length - 1];
      const top = new Float64Array(rival.places.length);
      const gap = new Float64Array(rival.places.length);
      const own = new Float64Array(rival.run.states[0].length);
      for (const t of times) {
        if (t > last) break;
        quantitiesAt(stateAt(result.full, t, z), p, shown);
        stateAt(rival.run, t, own);
        rival.places.forEach((place, j) => {
          top[j] = Math.max(top[j], Math.abs(shown[place]));
          gap[j] = Math.max(gap[j], Math.abs(shown[place] - own[j]));
        });
      }
      found.rivals[rival.name] = Math.max(...Array.from(gap, (g, j) => g / (top[j] || 1)));
    }
    return found;
  }

  // The point of M_epsilon through `order` over c, where the manifold is a curve or a surface: {c, z, attracts, turn, valid}. Folds
  // are where `turn`, the determinant of the fast block, changes its sign along a fast coordinate. Null where nothing is known.
  function manifoldAt(s, order) {
    const series = reducible ? seriesAt(s) : null;
    if (!series || order > series.order) return null;
    const p = constants(s);
    const u = new Float64Array(nSlow + nFast);
    const y = new Float64Array(nFast);
    const pivots = new Int32Array(nFast);
    return (c) => {
      program[`base${series.label}`](c, p, u);
      const attracts = gapAt(u, p) > 0;
      const turn = determinant(fastBlock, nFast, pivots);
      const valid = order === 0 || bestOrder(c, s).reached[order];
      if (order > 0) {
        sum("h", order, c, s, p, y);
        u.set(y, nSlow);
      }
      const z = new Float64Array(n);
      program.toRaw(u, p, z);
      return { c, z, attracts, turn, valid: valid && allFinite(z) };
    };
  }

  // The full run from its start until it has reached the manifold, {times, run, on}: its quantities at every node, and those
  // of the slow manifold, cut where it is best, over the same slow variables. The sheet is followed back from where the run
  // has reached it, and NaN stands where it does not go so far. Null where the run was on another piece before.
  function layer(result, s) {
    if (!result.pieces.length || result.pieces[0].left) return null;
    const { at } = result.pieces[0];
    const p = constants(s);
    const { full } = result;
    const near = toNew(full.states[at], p).slice(nSlow);
    const y = new Float64Array(nFast);
    const z = new Float64Array(n);
    let known = true;
    const rows = Array.from({ length: at + 1 }, (_, back) => {
      const state = full.states[at - back];
      const u = toNew(state, p);
      const x = u.slice(0, nSlow);
      const on = new Float64Array(model.quantities.length).fill(NaN);
      known = known && onSheet(x, near, p);
      if (known) {
        const c = coordinatesOf(x, near, s);
        sum("h", bestOrder(c, s).best, c, s, p, y);
        u.set(y, nSlow);
        program.toRaw(u, p, z);
        for (let i = nRaw; i < n; i++) z[i] = state[i];
        quantitiesAt(z, p, on);
      }
      return { on, run: quantitiesAt(state, p, new Float64Array(model.quantities.length)) };
    }).reverse();
    return { times: full.times.slice(0, at + 1), run: rows.map((row) => row.run), on: rows.map((row) => row.on) };
  }

  return {
    ...model, labelled, reducible, nRaw, nDriven, n, nSlow, nFast, constants, seriesAt, full, fixed, explicit, simulate,
    comparison, errorsOf, bestOrder, flowIn,
    quantitiesAt, jacobianAt, toNew, gapAt, onSheet, coordinatesOf, manifoldAt, layer, layerFolds, arrival, reduced, atDeclared, sum,
  };
}
