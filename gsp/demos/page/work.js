// Speed against accuracy: runs at a ladder of tolerances, their errors, and the arithmetic that they took. Operations are
// counted, not timed: those of the printed functions, every time one is called, and those of the integrator's steps.

const WORK_TOLERANCES = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9];
// A run with more steps than this is given up.
const WORK_STEPS = 5000;
// The classical method of Runge and Kutta is stable while step times rate is below this, the real root of
// 1 - z + z^2/2 - z^3/6 + z^4/24 = 1.
const CLASSICAL_LIMIT = 2.785293563405282;

// A model of the same page that counts: `tally.operations` grows by what each function's text holds.
function makeWorker(data, program) {
  const tally = { operations: 0 };
  const counting = {};
  for (const [name, compute] of Object.entries(program)) {
    const operations = data.model.operations[name];
    counting[name] = (...given) => {
      tally.operations += operations;
      return compute(...given);
    };
  }
  return { model: makeModel(data, counting), tally };
}

// The runs that are repeated at every tolerance; null where there is nothing to compare.
function workBasis(worker, s, orders) {
  const result = worker.model.simulate(s, orders, { ...MEASUREMENT, pieces: 1 });
  const compared = result.full.status === "reached" ? worker.model.comparison(result, s) : null;
  return compared && { s, result, compared };
}

// One tolerance: {method, rtol, error, operations, status} of the full system by both integrators and of every order. A
// reduced run starts on its base point, which is not counted: it is found once for all tolerances.
function workAt(worker, basis, rtol) {
  const { s, result, compared } = basis;
  const { model, tally } = worker;
  const accuracy = { rtol, maxSteps: WORK_STEPS };
  const p = model.constants(s);
  const z = new Float64Array(model.n);
  const row = (method, run, slowAt) => {
    const spent = tally.operations + run.operations;
    let error = run.status === "reached" ? 0 : NaN;
    compared.times.forEach((t, i) => {
      if (run.status !== "reached") return;
      const x = slowAt(run, t);
      for (let j = 0; j < model.nSlow; j++) {
        error = Math.max(error, Math.abs(x[j] - compared.exact[i][j]) / compared.scale[j]);
      }
    });
    return { method, rtol, error, operations: spent, status: run.status };
  };
  const begin = (make) => {
    tally.operations = 0;
    return make();
  };
  const fullAt = (run, t) => model.toNew(stateAt(run, t, z), p);
  const rows = [
    row("implicit", begin(() => model.full(s, accuracy, compared.ended)), fullAt),
    row("explicit", begin(() => model.explicit(s, accuracy, compared.ended)), fullAt),
  ];
  const state = new Float64Array(model.nSlow + model.nDriven);
  for (const run of result.pieces[0].runs) {
    if (!run.again) continue;
    rows.push(row(run.order, begin(() => run.again(compared.ended, accuracy)), (found, t) => stateAt(found, t, state)));
  }
  return rows;
}

// The run with the fewest operations among those whose error is at most `tolerance`; null where none is.
function cheapest(rows, tolerance) {
  const good = rows.filter((row) => row.error <= tolerance);
  return good.length ? good.reduce((best, row) => (row.operations < best.operations ? row : best)) : null;
}

function methodName(method) {
  if (method === "implicit") return "the full system, implicit";
  if (method === "explicit") return "the full system, explicit";
  return `the reduced run of order ${method}`;
}

// Error up, operations across; the tolerance as a line, and the cheapest run that keeps to it in a ring.
function drawWork(view, rows, tolerance, colours, orders) {
  view.begin(colours);
  const known = rows.filter((row) => row.error > FLOOR && row.error < LOST);
  const x = known.map((row) => Math.log10(row.operations));
  const y = known.map((row) => Math.log10(row.error));
  const level = Math.log10(tolerance);
  view.setRanges(
    known.length ? [Math.min(...x) - 0.2, Math.max(...x) + 0.5] : [2, 6],
    [Math.min(level, ...y) - 0.5, Math.max(level, ...y) + 0.5], { steady: false },
  );
  view.axes("operations", "error", { xLog: true, yLog: true });
  view.clipped(() => {
    view.curve([view.box[0], view.box[1]], [level, level], colours.faint, 1.5, [6, 5]);
    const names = [];
    const one = (method, colour, name) => {
      const points = known.filter((row) => row.method === method);
      if (!points.length) return;
      const xs = points.map((row) => Math.log10(row.operations));
      const ys = points.map((row) => Math.log10(row.error));
      view.curve(xs, ys, colour, 2);
      xs.forEach((value, k) => view.dot(value, ys[k], colour, 3.2));
      names.push([name, view.X(xs[xs.length - 1]) + 7, view.Y(ys[ys.length - 1]), colour]);
    };
    one("implicit", colours.ink, "implicit");
    one("explicit", colours.rivals[0], "explicit");
    for (const order of orders) one(order, colours.orders[order], `order ${order}`);
    for (const name of names) view.word(...name);
    const chosen = cheapest(rows, tolerance);
    if (known.includes(chosen)) {
      const c = view.context;
      c.strokeStyle = colours.accent;
      c.lineWidth = 3;
      c.beginPath();
      c.arc(view.X(Math.log10(chosen.operations)), view.Y(Math.log10(chosen.error)), 9, 0, 2 * Math.PI);
      c.stroke();
    }
  });
}
