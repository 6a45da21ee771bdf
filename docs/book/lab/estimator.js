// Estimation of p by Gauss-Newton, a step for each control step, and how sure it is: Python's `NewtonEstimator` and
// `BiasTracker`. The graph `estimate` has the sums.
const UNKNOWN = "this step is so far from what the model was trained on that there is no loss";

// Why an estimate is strange; empty where it is not.
function warningOf({ log_error_ratio: [ratio], out_of_distribution: [unlike], outside_hull: [outside] }) {
  const times = Math.exp(ratio).toFixed(1);
  if (unlike) return `The material is unlike the trained ones: squared prediction error ${times} times the usual.`;
  return outside ? "p lies outside the trained ones." : "";
}

// Follows p from a first one on, with a report now and then.
function makeTracker(networks, { estimation, calibration }, first) {
  const { window, warmup, least, report_every: every } = estimation;
  let p = Float32Array.from(first);
  let seen = []; // states and commands, one more than the window: the last state is only predicted
  let fromRest = true;
  let count = 0;
  let report = null;

  // The next step of p by what was seen, and how sure p is; null before there is anything to judge.
  async function estimated(seen, p) {
    const left = fromRest && seen.length <= window ? 0 : warmup;
    const judged = seen.slice(1).map((_, t) => Number(t >= left));
    if (judged.length - left < least) return null;
    const [s, u] = ["s", "u"].map((name) => joined(...seen.map((each) => each[name])));
    return networks.estimate({ s, u, p, judged, ...calibration });
  }
  // Takes in the state before a command, and the command; `atRest`: the cloth hung still before the first of them.
  async function update(s, u, { atRest, estimate = true }) {
    if (!count) fromRest = atRest;
    const now = [...seen, { s, u }].slice(-window - 1);
    const found = estimate ? await estimated(now, p) : null;
    const next = p.map((x, k) => x + (found?.step[k] ?? 0));
    if (!next.every(Number.isFinite)) throw new Refusal(UNKNOWN);
    [p, seen, count] = [next, now, count + 1];
    if (count % every === 0) {
      const sure = await estimated(seen, p);
      report = sure?.covariance.every(Number.isFinite) ? { ...sure, warning: warningOf(sure) } : null;
    }
    return p;
  }
  // Its region moves with p.
  function reported() {
    if (!report) return null;
    const around = Array.from({ length: report.region.length / 2 }, (_, k) => report.region.subarray(2 * k, 2 * k + 2));
    return { ...report, region: around.map(([x, y]) => [p[0] + x, p[1] + y]) };
  }
  return { update, report: reported };
}
