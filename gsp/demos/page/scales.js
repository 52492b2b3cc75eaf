// The time scales of the full run, 1/|lambda| of every mode of the Jacobian, as a strip under the time axis.

// Places along a run, as many as so many products of a matrix allow.
const PLACES = [16, 160];
const PRODUCTS = 2e7;
// Neighbouring time scales that are further apart than this are separated: the same as in gsp scales.
const SEPARATION = 10;

// {t, modes, gaps}: modes[r] the decimal logarithms of the r-th fastest time scale at the places t, NaN for what stands
// still, and gaps the widest pair of neighbours at each, where all that are faster decay; null where none is wide enough. As the
// run is exact to `rtol`, a ratio that is nearer than that to the limit is at it: else a constant ratio of 10 would flicker.
function timeScalesOf(model, run, s, rtol) {
  const n = model.nRaw;
  const p = model.constants(s);
  const count = Math.round(Math.min(PLACES[1], Math.max(PLACES[0], PRODUCTS / (10 * n * n * n))));
  const { times } = run;
  const last = times.length - 1;
  // Half of them follow the steps, into layers, and half the clock.
  const places = Array.from({ length: count }, (_, k) => {
    const share = Math.floor(k / 2) / Math.max(1, Math.ceil(count / 2) - 1);
    return k % 2 ? times[Math.round(Math.min(1, share) * last)] : times[0] + Math.min(1, share) * (times[last] - times[0]);
  });
  const forward = times[last] >= times[0] ? 1 : -1;
  const t = [...new Set(places)].sort((a, b) => forward * (a - b));
  const modes = Array.from({ length: n }, () => new Float64Array(t.length).fill(NaN));
  const z = new Float64Array(model.n);
  const gaps = t.map((time, k) => {
    if (stateAt(run, time, z) === null) return null;
    const jacobian = model.jacobianAt(z, p);
    if (!allFinite(jacobian)) return null;
    const { re, im, size } = eigenvaluesOf(jacobian, n);
    const found = Array.from(re, (real, i) => ({ real, rate: Math.hypot(real, im[i]) }));
    const moving = found.filter(({ rate }) => rate > n * Number.EPSILON * size).sort((a, b) => b.rate - a.rate);
    moving.forEach(({ rate }, r) => (modes[r][k] = -Math.log10(rate)));
    let widest = null;
    for (let r = 0; r + 1 < moving.length && moving[r].real < 0; r++) {
      const ratio = moving[r].rate / moving[r + 1].rate;
      if (ratio >= Math.max(SEPARATION * (1 - rtol), widest ? widest.ratio : 0)) widest = { ratio, between: [modes[r][k], modes[r + 1][k]] };
    }
    return widest;
  });
  return { t: Float64Array.from(t), modes, gaps };
}

// Under the axis of `trace`, whose times run from trace[0] to trace[1].
function drawScales(view, { t, modes, gaps }, trace, now, colours) {
  view.begin(colours);
  const known = modes.filter((mode) => mode.some(Number.isFinite));
  // A mode that is a thousand times as slow as the run is long stands still, and how slow it is is rounding.
  const [low, high] = extent(known);
  const still = Math.log10(1000 * Math.abs(trace[1] - trace[0]));
  view.setRanges([trace[0], trace[1]], low < still ? [low, Math.min(high, still)] : [low, high], { steady: false });
  view.axes("", "time scales", { yLog: true });
  view.clipped(() => {
    const c = view.context;
    c.fillStyle = colours.orders[2];
    c.globalAlpha = 0.22;
    for (const [first, last] of stretches(gaps)) {
      c.beginPath();
      for (let k = first; k <= last; k++) c.lineTo(view.X(t[k]), view.Y(gaps[k].between[0]));
      for (let k = last; k >= first; k--) c.lineTo(view.X(t[k]), view.Y(gaps[k].between[1]));
      c.fill();
    }
    c.globalAlpha = 1;
    for (const mode of known) view.curve(t, mode, colours.ink, 1.4);
    if (now !== null) view.curve([now, now], [view.box[2], view.box[3]], colours.faint, 1);
  });
  view.say(
    stretches(gaps).length
      ? "time scales 1/|λ|; shaded: all faster ones decay, ten times as fast as the next or more"
      : "time scales 1/|λ|; none decays ten times as fast as the next",
  );
}

// First and last places of the stretches in which there is a gap, of two places or more.
function stretches(gaps) {
  const found = [];
  gaps.forEach((gap, k) => {
    if (gap === null) return;
    if (k > 0 && gaps[k - 1] !== null) found[found.length - 1][1] = k;
    else found.push([k, k]);
  });
  return found.filter(([first, last]) => last > first);
}
