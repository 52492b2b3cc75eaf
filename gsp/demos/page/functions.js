// Functions that JavaScript does not have.

// The error function: x e^(-x^2) sum_n 2^n x^(2n)/(2n+1)!! 2/sqrt(pi), whose terms are all positive, so that none cancel.
function erf(x) {
  if (!(Math.abs(x) < 6)) return Number.isNaN(x) ? NaN : Math.sign(x);
  let term = 1;
  let sum = 1;
  for (let n = 1; term > 1e-17 * sum; n++) {
    term *= (2 * x * x) / (2 * n + 1);
    sum += term;
  }
  return (2 / Math.sqrt(Math.PI)) * x * Math.exp(-x * x) * sum;
}

// Real zeros of a polynomial of degree 1 or 2, the highest coefficient first; of others none are given.
function zerosOfPolynomial([a, b, c, ...more]) {
  if (c === undefined) return [-b / a];
  const root = Math.sqrt(b * b - 4 * a * c);
  return more.length ? [] : [(-b - root) / (2 * a), (-b + root) / (2 * a)];
}

// Zeros of a sin(k t + b) + c cos(k t + b) + d from `low` to `high`; none where they are more than `most`.
function zerosOfWave([k, b, a, c, d], low, high, most) {
  const period = Math.abs((2 * Math.PI) / k);
  const beside = Math.acos(-d / Math.hypot(a, c));
  if (!Number.isFinite(beside) || !(high - low <= most * period)) return [];
  return [Math.atan2(a, c) - beside, Math.atan2(a, c) + beside].flatMap((angle) => {
    const place = (angle - b) / k;
    const [begin, end] = [Math.ceil((low - place) / period), Math.floor((high - place) / period)];
    return Array.from({ length: Math.max(end - begin + 1, 0) }, (_, i) => place + (begin + i) * period);
  });
}
