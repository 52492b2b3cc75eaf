// What a page says in words and numbers: errors with their powers, notes, and the run that is the cheapest.

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
  return [`${size} ∝ `, element("i", {}, data.letters[model.epsilon]), element("sup", {}, slope.toFixed(2).replace("-", "−"))];
}

const ENDINGS = {
  steps: "its steps were used up",
  "not finite": "the field is not finite there",
  "too small": "no step is small enough there",
  lost: "there the critical manifold has all but ceased to attract",
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
    found.push({ text: `The full run ends at t = ${time(fullEnd)}: ${ENDINGS[result.full.status]}.`, at: fullEnd });
  }
  if (!model.reducible) {
    found.push(`Only the full system is shown: ${model.reduction.reason}`);
    return found;
  }
  if (current.stepped) found.push(...told(s, current.stepped));
  const { order, label, coordinates } = model.seriesAt(s);
  if (model.reduction.slow.length === 1 && coordinates.length > 1) {
    found.push("The critical manifold is not drawn, for its equation is solved for none of its variables. A report draws it.");
  }
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
        ? "The run is not long enough near the slow manifold while that attracts, so there is nothing to compare. Take a smaller ε, a longer run or another start."
        : "The start is where the fast dynamics does not attract, and the run does not settle on a slow manifold. Nothing is compared.",
    );
    return found;
  }
  const first = result.pieces[0];
  for (const run of first.runs) {
    if (run.status !== "reached") {
      const where = run.ended === undefined ? run.begun : run.ended;
      found.push({ text: `The reduced run of order ${run.order} ends at t = ${time(where)}: ${ENDINGS[run.status] ?? run.status}.`, at: where });
    }
  }
  for (const drawn of current.curves.reduced) {
    if (drawn.piece > 0 || drawn.isWhole || Number.isNaN(drawn.within)) continue;
    found.push({ text: `The reduced run of order ${drawn.order} is drawn until t = ${time(drawn.within)}: after that the terms of its series fall no more.`, at: drawn.within });
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
        `At this ε the series is beyond its reach: its terms fall no more after order ${best}, where it is best cut. Order ${beyond.join(", ")} is worse.`,
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

// A note that tells of a moment leads to it.
function noteItem({ text, at }) {
  if (at === undefined) return element("li", {}, text);
  const button = element("button", { type: "button", title: "Show this moment in the pictures" }, text);
  button.addEventListener("click", () => {
    play(false);
    now = at;
    draw();
    Object.values(views).find((view) => !view.figure.hidden).figure.scrollIntoView({ block: "nearest" });
  });
  return element("li", {}, button);
}

function tell() {
  const lines = notes().map((note) => (typeof note === "string" ? { text: note } : note));
  const list = byId("notes");
  const told = lines.map(({ text }) => text).join("\n");
  if (told !== list.dataset.lines) {
    list.dataset.lines = told;
    list.replaceChildren(...lines.map(noteItem));
  }
  const steps = current.result.full.times.length - 1;
  readouts.full.textContent = `${steps} steps at ${current.rtol.toExponential()}`;
  if (readouts.fixed) readouts.fixed.textContent = current.stepped ? `${current.stepped.times.length - 1} steps` : "";
  tellChosen();
  for (let order = 0; order <= 3; order++) {
    const shown = state.orders.includes(order) && model.reducible;
    readouts[order].replaceChildren(...[shown ? readout((row) => row.orders[order]) : ""].flat());
  }
  model.claims.forEach((claim, k) => {
    readouts.claims[k].replaceChildren(...[state.rivals ? readout((row) => row.rivals[claim.name]) : ""].flat());
  });
}
