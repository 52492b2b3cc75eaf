// Eigenvalues of a real matrix: balanced, brought to Hessenberg form by elimination, then by QR steps with Wilkinson's shift.

// A matrix has given up its eigenvalues before so many steps for each; a tenth one without progress takes another shift.
const QR_STEPS = 60;

// {re, im, size}: the eigenvalues of A (n x n, by rows), and the norm of the balanced matrix, whose rounding they carry.
function eigenvaluesOf(A, n) {
  const re = Float64Array.from(A);
  const im = new Float64Array(n * n);
  balance(re, n);
  const size = Math.hypot(...re);
  toHessenberg(re, n);
  let low = 0;
  let steps = 0;
  for (let high = n - 1; high > 0; ) {
    for (low = high; low > 0; low--) {
      const at = low * n + low;
      const beside = Math.hypot(re[at], im[at]) + Math.hypot(re[at - n - 1], im[at - n - 1]);
      if (Math.hypot(re[at - 1], im[at - 1]) <= Number.EPSILON * (beside || size)) break;
    }
    if (low > 0) re[low * n + low - 1] = im[low * n + low - 1] = 0;
    if (low === high || steps === QR_STEPS) {
      high -= 1;
      steps = 0;
    } else {
      stepQR(re, im, n, low, high, ++steps % 10 === 0);
    }
  }
  const diagonal = (part) => Float64Array.from({ length: n }, (_, i) => part[i * n + i]);
  return { re: diagonal(re), im: diagonal(im), size };
}

// Rows and columns of like size, by powers of two (Parlett and Reinsch 1969).
function balance(a, n) {
  for (let moved = true; moved; ) {
    moved = false;
    for (let i = 0; i < n; i++) {
      let [row, column] = [0, 0];
      for (let j = 0; j < n; j++) {
        if (j === i) continue;
        row += Math.abs(a[i * n + j]);
        column += Math.abs(a[j * n + i]);
      }
      if (!(row > 0 && column > 0)) continue;
      const factor = Math.pow(2, Math.round(Math.log2(row / column) / 2));
      if (!((row / factor + column * factor) < 0.95 * (row + column))) continue;
      moved = true;
      for (let j = 0; j < n; j++) a[i * n + j] /= factor;
      for (let j = 0; j < n; j++) a[j * n + i] *= factor;
    }
  }
}

function toHessenberg(a, n) {
  for (let m = 1; m < n - 1; m++) {
    let pivot = m;
    for (let i = m + 1; i < n; i++) if (Math.abs(a[i * n + m - 1]) > Math.abs(a[pivot * n + m - 1])) pivot = i;
    if (a[pivot * n + m - 1] === 0) continue;
    for (let j = 0; j < n; j++) [a[m * n + j], a[pivot * n + j]] = [a[pivot * n + j], a[m * n + j]];
    for (let i = 0; i < n; i++) [a[i * n + m], a[i * n + pivot]] = [a[i * n + pivot], a[i * n + m]];
    for (let i = m + 1; i < n; i++) {
      const factor = a[i * n + m - 1] / a[m * n + m - 1];
      for (let j = 0; j < n; j++) a[i * n + j] -= factor * a[m * n + j];
      for (let k = 0; k < n; k++) a[k * n + m] += factor * a[k * n + i];
    }
    for (let i = m + 1; i < n; i++) a[i * n + m - 1] = 0;
  }
}

// H - shift = QR and H = RQ + shift on the rows and columns from `low` to `high`, by Givens' rotations.
function stepQR(re, im, n, low, high, another) {
  const corner = high * n + high;
  let [sr, si] = wilkinson(re, im, n, corner);
  if (another) sr += Math.hypot(re[corner - 1], im[corner - 1]);
  for (let i = low; i <= high; i++) {
    re[i * n + i] -= sr;
    im[i * n + i] -= si;
  }
  const rotations = [];
  for (let k = low; k < high; k++) {
    const [top, below] = [k * n + k, (k + 1) * n + k];
    const length = Math.hypot(re[top], im[top], re[below], im[below]);
    const turn = length === 0 ? [1, 0, 0, 0] : [re[top], im[top], re[below], im[below]].map((part) => part / length);
    rotations.push(turn);
    const [cr, ci, tr, ti] = turn;
    for (let j = k; j <= high; j++) {
      const [u, v] = [k * n + j, (k + 1) * n + j];
      const [ur, ui, vr, vi] = [re[u], im[u], re[v], im[v]];
      [re[u], im[u]] = [cr * ur + ci * ui + tr * vr + ti * vi, cr * ui - ci * ur + tr * vi - ti * vr];
      [re[v], im[v]] = [cr * vr - ci * vi - tr * ur + ti * ui, cr * vi + ci * vr - tr * ui - ti * ur];
    }
  }
  rotations.forEach(([cr, ci, tr, ti], place) => {
    const k = low + place;
    for (let i = low; i <= Math.min(k + 1, high); i++) {
      const u = i * n + k;
      const [ur, ui, vr, vi] = [re[u], im[u], re[u + 1], im[u + 1]];
      [re[u], im[u]] = [cr * ur - ci * ui + tr * vr - ti * vi, cr * ui + ci * ur + tr * vi + ti * vr];
      [re[u + 1], im[u + 1]] = [cr * vr + ci * vi - tr * ur - ti * ui, cr * vi - ci * vr - tr * ui + ti * ur];
    }
  });
  for (let i = low; i <= high; i++) {
    re[i * n + i] += sr;
    im[i * n + i] += si;
  }
}

// The eigenvalue of the last two rows and columns that is nearer to the last entry.
function wilkinson(re, im, n, corner) {
  const [a, b, c] = [corner - n - 1, corner - n, corner - 1];
  const [hr, hi] = [(re[a] - re[corner]) / 2, (im[a] - im[corner]) / 2];
  const squareR = hr * hr - hi * hi + re[b] * re[c] - im[b] * im[c];
  const squareI = 2 * hr * hi + re[b] * im[c] + im[b] * re[c];
  const modulus = Math.hypot(squareR, squareI);
  const root = [Math.sqrt((modulus + squareR) / 2), Math.sign(squareI || 1) * Math.sqrt(Math.max(0, (modulus - squareR) / 2))];
  const sign = hr * root[0] + hi * root[1] > 0 ? -1 : 1;
  return [re[corner] + hr + sign * root[0], im[corner] + hi + sign * root[1]];
}
