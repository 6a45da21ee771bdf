// Estimation of p by Gauss-Newton, a step for each control step, and how sure it is: Python's `Linearisation`,
// `NewtonEstimator`, `Calibration` and `BiasTracker`. p has two numbers, and matrices are [[a, b], [c, d]].
const UNKNOWN = "this step is so far from what the model was trained on that there is no loss";

const dot2 = (a, b) => a[0] * b[0] + a[1] * b[1];
const outer2 = (a, b) => a.map((x) => b.map((y) => x * y));
const plus2 = (a, b, factor = 1) => a.map((row, i) => row.map((x, j) => x + factor * b[i][j]));
const transposed2 = ([a, b]) => [0, 1].map((i) => [a[i], b[i]]);
const product2 = (a, b) => a.map((row) => transposed2(b).map((column) => dot2(row, column)));
const combined2 = (parts, axes) => [0, 1].map((i) => parts[0] * axes[0][i] + parts[1] * axes[1][i]);

// Lengths of a symmetric matrix and its axes, the longest first.
function eigen2([[a, b], [, d]]) {
  const [middle, half] = [(a + d) / 2, Math.hypot((a - d) / 2, b)];
  const angle = Math.atan2(2 * b, a - d) / 2;
  const axes = [angle, angle + Math.PI / 2].map((each) => [Math.cos(each), Math.sin(each)]);
  return { lengths: [middle + half, middle - half], axes };
}
function inverse2(matrix) {
  const { lengths, axes } = eigen2(matrix);
  const [first, second] = axes.map((axis) => outer2(axis, axis));
  const nothing = outer2([0, 0], [0, 0]);
  return plus2(plus2(nothing, first, 1 / lengths[0]), second, 1 / lengths[1]);
}

// How one p predicts a window, and what a small change of p would do: errors and their jacobian, as the graph has them.
function makeLinearisation({ errors, jacobian }, sensors, { freedom, longest, lag }) {
  const count = errors.length / sensors;
  const loss = errors.reduce((sum, x) => sum + x * x, 0) / errors.length;
  const sizes = errors.map((x) => (x * x) / Math.max(loss, 1e-12));
  const weights = sizes.map((size) => (freedom + 1) / (freedom + size)); // of Student's t: outliers count little
  const row = (k) => [jacobian[2 * k], jacobian[2 * k + 1]];

  const curvature = (weights) =>
    weights.reduce((sum, weight, k) => plus2(sum, outer2(row(k), row(k)), weight), outer2([0, 0], [0, 0]));
  // Of the loss of each step of the window.
  function gradients() {
    const found = Array.from({ length: count }, () => [0, 0]);
    errors.forEach((error, k) => {
      const sum = found[Math.floor(k / sensors)];
      row(k).forEach((x, i) => (sum[i] += weights[k] * error * x));
    });
    return found;
  }
  // To the lowest loss, at most so long, and not along an axis that the predictions don't depend on.
  function step() {
    const { lengths, axes } = eigen2(curvature(weights));
    const downhill = gradients().reduce((sum, [x, y]) => [sum[0] + x, sum[1] + y]);
    const parts = lengths.map((length, k) => (length > 1e-6 * lengths[0] ? dot2(axes[k], downhill) / length : 0));
    const shorter = Math.min(1, longest / Math.max(Math.hypot(...parts), 1e-12));
    return combined2(parts, axes).map((x) => shorter * x);
  }
  // Between two curvatures stands by how much gradients really scatter, with those of up to `lag` steps later.
  function covariance() {
    const slope = weights.map((weight, k) => (weight * (freedom - sizes[k])) / (freedom + sizes[k]));
    const inverse = inverse2(curvature(slope));
    const each = gradients();
    const together = (later) =>
      each.slice(later).reduce((sum, late, t) => plus2(sum, outer2(late, each[t])), outer2([0, 0], [0, 0]));
    let scatter = together(0);
    for (let k = 1; k <= Math.min(lag, count - 1); k++) {
      const both = together(k);
      scatter = plus2(scatter, plus2(both, transposed2(both)), 1 - k / (lag + 1));
    }
    return product2(product2(inverse, scatter), inverse);
  }
  // Of each sensor, the log of its mean squared error.
  function logSquares() {
    const squares = Array(sensors).fill(0);
    errors.forEach((error, k) => (squares[k % sensors] += error * error));
    return squares.map((sum) => Math.log(Math.max(sum / count, 1e-20)));
  }
  return { loss, count, step, covariance, logSquares };
}

// Between known values, and the first or the last beyond them.
function interpolated(x, xs, ys) {
  const k = xs.findIndex((each) => x <= each);
  if (k < 1) return ys.at(k);
  const share = (x - xs[k - 1]) / (xs[k] - xs[k - 1]);
  return ys[k - 1] + share * (ys[k] - ys[k - 1]);
}

// How sure an estimate is: its 90 % region, and whether its material is unlike those that were trained on.
function reportOf(fit, p, { floor, lengths, scale, limit, biases, usual, reach, sides, radius }) {
  const grows = interpolated(fit.count, lengths, scale);
  const covariance = plus2(fit.covariance(), floor).map((row) => row.map((x) => grows * x));
  if (!covariance.flat().every(Number.isFinite)) return null;

  // The error over what is usual for materials near p, which passes smoothly from one to the next.
  const gaps = biases.map((bias) => (p[0] - bias[0]) ** 2 + (p[1] - bias[1]) ** 2);
  const near = gaps.map((gap) => Math.exp((-0.5 * (gap - Math.min(...gaps))) / reach ** 2));
  const total = near.reduce((sum, x) => sum + x);
  const expected = (sensor) => near.reduce((sum, x, k) => sum + x * usual[k][sensor], 0) / total;
  const excess = fit.logSquares().map((log, sensor) => log - expected(sensor));
  const logErrorRatio = excess.reduce((sum, x) => sum + x) / excess.length;

  // Warnings: predicted worse than any that was trained on, or beyond a side of them.
  const early = fit.count < lengths[0] - 1;
  const outOfDistribution = !early && logErrorRatio > interpolated(fit.count, lengths, limit);
  const scattered = (normal) => covariance.map((row) => dot2(row, normal));
  const reaches = (normal) => radius * Math.sqrt(dot2(normal, scattered(normal)));
  const outsideHull = sides.some(([x, y, offset]) => dot2([x, y], p) + offset > reaches([x, y]));
  let warning = "";
  if (outOfDistribution) {
    const times = Math.exp(logErrorRatio).toFixed(1);
    warning = `The material is unlike the trained ones: squared prediction error ${times} times the usual.`;
  } else if (outsideHull) warning = "p lies outside the trained ones.";
  return { covariance, logErrorRatio, outOfDistribution, outsideHull, warning };
}
// The edge of such a region, its last point the first.
function outline(centre, covariance, radius, points = 48) {
  const { lengths, axes } = eigen2(covariance);
  const [long, short] = lengths.map((length) => radius * Math.sqrt(Math.max(length, 0)));
  return Array.from({ length: points }, (_, k) => {
    const angle = (2 * Math.PI * k) / (points - 1);
    const away = combined2([long * Math.cos(angle), short * Math.sin(angle)], axes);
    return centre.map((x, i) => x + away[i]);
  });
}

// Follows p from a first one on, with a report now and then.
function makeTracker(networks, { estimation, calibration }, first) {
  const { window, warmup, least, report_every: every } = estimation;
  let p = Float32Array.from(first);
  let seen = []; // states and commands, one more than the window: the last state is only predicted
  let fromRest = true;
  let count = 0;
  let report = null;

  // How p predicts what was seen; null before there is anything to judge.
  async function linearised(seen, p) {
    const sensors = seen[0].s.length;
    const left = fromRest && seen.length <= window ? 0 : warmup * sensors;
    if (seen.length - 1 - left / sensors < least) return null;
    const [s, u] = ["s", "u"].map((name) => joined(...seen.map((each) => each[name])));
    const { errors, jacobian } = await networks.linearise({ s, u, p });
    const judged = { errors: errors.subarray(left), jacobian: jacobian.subarray(2 * left) };
    return makeLinearisation(judged, sensors, estimation);
  }
  // Takes in the state before a command, and the command; `atRest`: the cloth hung still before the first of them.
  async function update(s, u, { atRest, estimate = true }) {
    if (!count) fromRest = atRest;
    const now = [...seen, { s, u }].slice(-window - 1);
    const step = estimate ? ((await linearised(now, p))?.step() ?? [0, 0]) : [0, 0];
    const next = p.map((x, k) => x + step[k]);
    if (!next.every(Number.isFinite)) throw new Refusal(UNKNOWN);
    [p, seen, count] = [next, now, count + 1];
    if (count % every === 0) {
      const fit = await linearised(seen, p);
      report = fit && reportOf(fit, [...p], calibration);
    }
    return p;
  }
  return {
    update,
    // Its region moves with p.
    get report() {
      return report && { ...report, region: outline([...p], report.covariance, calibration.radius) };
    },
  };
}
