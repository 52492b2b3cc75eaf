// Two integrators with dense output. Rodas5P (Steinebach 2023) for stiff fields: one Jacobian and one LU decomposition a
// step; its coefficients come with the page's data. Dormand and Prince's pair 5(4) (Hairer, Noersett, Wanner I, section
// II.5) for reduced flows, which are not stiff. A run is {times, states, dense, status}; status is "reached", or why it
// ended before: "steps" (the step limit), "not finite", "too small" (the step), "stopped" (by `stop`), "blew up" (a run in
// fixed steps). `attempts` are steps made or rejected, `operations` the arithmetic in them beside that of the field.

const SAFETY = 0.9;

function scaledNorm(error, y, yNew, rtol, atol) {
  let total = 0;
  for (let i = 0; i < error.length; i++) {
    const ratio = error[i] / (atol + rtol * Math.max(Math.abs(y[i]), Math.abs(yNew[i])));
    total += ratio * ratio;
  }
  return Math.sqrt(total / error.length);
}

function allFinite(values) {
  for (let i = 0; i < values.length; i++) if (!Number.isFinite(values[i])) return false;
  return true;
}

// A first step from the size of the rate; the control corrects it at once.
function firstStep(y, rate, length, rtol, atol) {
  const size = scaledNorm(y, y, y, rtol, atol);
  const speed = scaledNorm(rate, y, y, rtol, atol);
  const step = size < 1e-5 || speed < 1e-5 ? 1e-6 * length : (0.01 * size) / speed;
  return Math.min(step, length);
}

// LU decomposition in place with partial pivoting; false where the matrix is singular.
function factorise(matrix, n, pivots) {
  for (let k = 0; k < n; k++) {
    let best = k;
    for (let i = k + 1; i < n; i++) {
      if (Math.abs(matrix[i * n + k]) > Math.abs(matrix[best * n + k])) best = i;
    }
    pivots[k] = best;
    const pivot = matrix[best * n + k];
    if (!(Math.abs(pivot) > 0) || !Number.isFinite(pivot)) return false;
    if (best !== k) {
      for (let j = 0; j < n; j++) {
        const held = matrix[k * n + j];
        matrix[k * n + j] = matrix[best * n + j];
        matrix[best * n + j] = held;
      }
    }
    for (let i = k + 1; i < n; i++) {
      const factor = (matrix[i * n + k] /= pivot);
      if (factor !== 0) for (let j = k + 1; j < n; j++) matrix[i * n + j] -= factor * matrix[k * n + j];
    }
  }
  return true;
}

// The determinant of a matrix, which is factorised; 0 where it has no pivot.
function determinant(matrix, n, pivots) {
  if (!factorise(matrix, n, pivots)) return 0;
  let product = 1;
  for (let k = 0; k < n; k++) product *= pivots[k] === k ? matrix[k * n + k] : -matrix[k * n + k];
  return product;
}

function solveFactorised(matrix, n, pivots, vector) {
  for (let k = 0; k < n; k++) {
    const held = vector[pivots[k]];
    vector[pivots[k]] = vector[k];
    vector[k] = held;
  }
  for (let i = 1; i < n; i++) for (let j = 0; j < i; j++) vector[i] -= matrix[i * n + j] * vector[j];
  for (let i = n - 1; i >= 0; i--) {
    for (let j = i + 1; j < n; j++) vector[i] -= matrix[i * n + j] * vector[j];
    vector[i] /= matrix[i * n + i];
  }
}

// One attempted step of Rodas5P: fills `yNew`, `error` and `rows`; false where it cannot be made.
function rodasStepper(tableau, field, jacobian, n) {
  const { gamma, A, C, dense } = tableau;
  const stages = C.length;
  const k = Array.from({ length: stages }, () => new Float64Array(n));
  const matrix = new Float64Array(n * n);
  const pivots = new Int32Array(n);
  const argument = new Float64Array(n);
  const value = new Float64Array(n);
  const J = new Float64Array(n * n);
  let linearisedAt = null;
  // The matrix and its decomposition; for each stage its argument, its right-hand side and a solution; the dense output.
  const operations =
    n * n + 2 * n + (2 * n * n * n) / 3 + stages * (2 * n * n + 3 * n) + 2 * n * stages * (stages - 1) + 6 * n * stages;
  return {
    order: 5,
    operations: Math.round(operations),
    attempt(y, rate, h, yNew, error, rows) {
      if (linearisedAt !== y) {
        jacobian(y, J);
        linearisedAt = y;
      }
      if (!allFinite(J)) return false;
      for (let i = 0; i < n * n; i++) matrix[i] = -J[i];
      for (let i = 0; i < n; i++) matrix[i * n + i] += 1 / (h * gamma);
      if (!factorise(matrix, n, pivots)) return false;
      for (let s = 0; s < stages; s++) {
        if (s === 0) {
          value.set(rate);
        } else {
          for (let i = 0; i < n; i++) {
            let total = s < A.length ? y[i] : argument[i] + k[s - 1][i];
            if (s < A.length) for (let q = 0; q < s; q++) total += A[s][q] * k[q][i];
            argument[i] = total;
          }
          field(argument, value);
          for (let i = 0; i < n; i++) {
            let total = 0;
            for (let q = 0; q < s; q++) total += C[s][q] * k[q][i];
            value[i] += total / h;
          }
        }
        solveFactorised(matrix, n, pivots, value);
        k[s].set(value);
      }
      for (let i = 0; i < n; i++) {
        yNew[i] = argument[i] + value[i];
        error[i] = value[i];
      }
      for (let m = 0; m < dense.length; m++) {
        for (let i = 0; i < n; i++) {
          let total = 0;
          for (let s = 0; s < stages; s++) total += dense[m][s] * k[s][i];
          rows[m * n + i] = total;
        }
      }
      return allFinite(yNew);
    },
    // The first term left out of the dense output, of a series that falls like a geometric one: the embedded error
    // says nothing of a fast variable that is slaved.
    denseError(y, yNew, rows, rtol, atol) {
      let largest = 0;
      for (let i = 0; i < n; i++) {
        let last = Math.abs(rows[2 * n + i]) / 16;
        const before = (4 / 27) * Math.abs(rows[n + i]);
        if (last < before) last *= last / before;
        largest = Math.max(largest, last / (atol + rtol * Math.max(Math.abs(y[i]), Math.abs(yNew[i]))));
      }
      return 0.3 * largest;
    },
  };
}

const DORMAND_PRINCE = {
  a: [
    [],
    [1 / 5],
    [3 / 40, 9 / 40],
    [44 / 45, -56 / 15, 32 / 9],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
    [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
  ],
  error: [71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40],
  dense: [
    -12715105075 / 11282082432, 0, 87487479700 / 32700410799, -10690763975 / 1880347072,
    701980252875 / 199316789632, -1453857185 / 822651844, 69997945 / 29380423,
  ],
};

function explicitStepper(field, n) {
  const { a, error: weights, dense } = DORMAND_PRINCE;
  const k = Array.from({ length: 7 }, () => new Float64Array(n));
  const argument = new Float64Array(n);
  return {
    order: 5,
    // Six stages' arguments, the error, the dense output.
    operations: 100 * n,
    attempt(y, rate, h, yNew, error, rows) {
      k[0].set(rate);
      for (let s = 1; s < 7; s++) {
        for (let i = 0; i < n; i++) {
          let total = 0;
          for (let q = 0; q < s; q++) total += a[s][q] * k[q][i];
          argument[i] = y[i] + h * total;
        }
        field(argument, k[s]);
      }
      for (let i = 0; i < n; i++) {
        yNew[i] = argument[i];
        let e = 0;
        let d = 0;
        for (let s = 0; s < 7; s++) {
          e += weights[s] * k[s][i];
          d += dense[s] * k[s][i];
        }
        error[i] = h * e;
        // In the nesting that `stateAt` evaluates, the same as Rodas5P's.
        const rise = yNew[i] - y[i];
        const first = h * k[0][i] - rise;
        rows[i] = first;
        rows[n + i] = rise - h * k[6][i] - first;
        rows[2 * n + i] = h * d;
      }
      return allFinite(yNew) && allFinite(error);
    },
    denseError: () => 0,
    // The last stage is taken at the new state.
    rateAtEnd: (rate) => rate.set(k[6]),
  };
}

// Advance from t0 to t1, which may lie before it. `stop(run)` is asked after every step; steps end on the `ends` between.
function advance(stepper, field, start, t0, t1, { rtol, atol, maxSteps, stop, ends = [] }) {
  const n = start.length;
  const sign = t1 >= t0 ? 1 : -1;
  let t = t0;
  let y = Float64Array.from(start);
  let rate = new Float64Array(n);
  const run = { times: [t0], states: [y], dense: [], status: "reached", attempts: 0, operations: 0 };
  field(y, rate);
  if (!allFinite(y) || !allFinite(rate)) return { ...run, status: "not finite" };
  if (t0 === t1) return run;
  const ahead = [...new Set(ends.filter((end) => (end - t0) * (end - t1) < 0)), t1].sort((a, b) => sign * (a - b));
  let h = firstStep(y, rate, Math.abs(t1 - t0), rtol, atol);
  let rejected = false;
  let finite = true;
  const error = new Float64Array(n);
  for (let steps = 0; ; steps++) {
    if (steps >= maxSteps) return { ...run, status: "steps" };
    if (h < 8 * Number.EPSILON * Math.max(Math.abs(t), Math.abs(t1 - t0) * 1e-6)) {
      return { ...run, status: finite ? "too small" : "not finite" };
    }
    const left = Math.abs(ahead[0] - t);
    const lands = h >= left * (1 - 1e-12);
    const step = sign * (lands ? left : h);
    const yNew = new Float64Array(n);
    const rows = new Float64Array(3 * n);
    run.attempts++;
    run.operations += stepper.operations;
    finite = stepper.attempt(y, rate, step, yNew, error, rows);
    const size = finite
      ? Math.max(scaledNorm(error, y, yNew, rtol, atol), stepper.denseError(y, yNew, rows, rtol, atol))
      : Infinity;
    const rateNew = new Float64Array(n);
    if (size <= 1) {
      if (stepper.rateAtEnd) stepper.rateAtEnd(rateNew);
      else field(yNew, rateNew);
      finite = allFinite(rateNew);
    }
    if (!(size <= 1) || !finite) {
      h = Math.abs(step) * (finite ? Math.max(0.2, SAFETY * Math.pow(size, -1 / stepper.order)) : 0.1);
      rejected = true;
      continue;
    }
    t = lands ? ahead.shift() : t + step;
    y = yNew;
    rate = rateNew;
    run.times.push(t);
    run.states.push(y);
    run.dense.push(rows);
    if (stop && stop(run)) return { ...run, status: "stopped" };
    if (!ahead.length) return run;
    const growth = Math.min(6, Math.max(0.2, SAFETY * Math.pow(Math.max(size, 1e-10), -1 / stepper.order)));
    // A step that was cut says nothing against the one that was meant.
    h = Math.max(lands ? h : 0, Math.abs(step) * (rejected ? Math.min(1, growth) : growth));
    rejected = false;
  }
}

function integrateStiff(tableau, field, jacobian, start, t0, t1, options) {
  return advance(rodasStepper(tableau, field, jacobian, start.length), field, start, t0, t1, options);
}

function integrateExplicit(field, start, t0, t1, options) {
  return advance(explicitStepper(field, start.length), field, start, t0, t1, options);
}

// The classical method of Runge and Kutta in steps of h, without any control: its nodes only, for it has no dense output.
// It ends where a state has grown beyond `beyond`.
function integrateFixed(field, start, t0, t1, h, { beyond, maxSteps }) {
  const n = start.length;
  const k = Array.from({ length: 4 }, () => new Float64Array(n));
  const argument = new Float64Array(n);
  const run = { times: [t0], states: [Float64Array.from(start)], status: "reached" };
  for (let steps = 0, t = t0; t < t1 - 1e-9 * h; steps++) {
    if (steps >= maxSteps) return { ...run, status: "steps" };
    const y = run.states[steps];
    const step = Math.min(h, t1 - t);
    const yNew = Float64Array.from(y);
    for (let s = 0; s < 4; s++) {
      const reach = s === 0 ? 0 : s === 3 ? step : step / 2;
      for (let i = 0; i < n; i++) argument[i] = y[i] + (s ? reach * k[s - 1][i] : 0);
      field(argument, k[s]);
      const weight = s === 1 || s === 2 ? step / 3 : step / 6;
      for (let i = 0; i < n; i++) yNew[i] += weight * k[s][i];
    }
    t += step;
    run.times.push(t);
    run.states.push(yNew);
    if (!yNew.every((value) => Math.abs(value) < beyond)) return { ...run, status: "blew up" };
  }
  return run;
}

// The state at time t inside the run: y = r y0 + s y1 + s r (c1 + s (c2 + r c3)), s the share of the step, r = 1 - s.
function stateAt(run, t, out) {
  const { times, states, dense } = run;
  const sign = times[times.length - 1] >= times[0] ? 1 : -1;
  let low = 0;
  let high = times.length - 1;
  if (high === 0) {
    out.set(states[0]);
    return out;
  }
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (sign * times[middle] <= sign * t) low = middle;
    else high = middle;
  }
  const s = (t - times[low]) / (times[low + 1] - times[low]);
  const r = 1 - s;
  const n = out.length;
  const rows = dense[low];
  for (let i = 0; i < n; i++) {
    const inner = rows[i] + s * (rows[n + i] + r * rows[2 * n + i]);
    out[i] = r * states[low][i] + s * states[low + 1][i] + s * r * inner;
  }
  return out;
}
