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
