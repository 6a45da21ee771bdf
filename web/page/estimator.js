// Estimation of p by Gauss-Newton, a step for each control step: Python's `NewtonEstimator`. The graph `estimate` has the
// sums.
const UNKNOWN = "this step is so far from what the model was trained on that there is no loss";

// When a cloth is called unfamiliar: its p is so far from every trained one, in units of their spread, so many steps after
// its estimate began. As in Python's `LiveSession`, where it says what was measured.
const FAR = 0.5;
const SETTLED = 50;

// Whether p, estimated for so many steps, says that the cloth is unlike the trained ones; empty where it does not.
function warningOf(p, steps, { arm, biases, spread }) {
  const nearest = Math.min(...Object.values(biases).map((each) => distanceBetween(each, p)));
  if (arm === "muscle" || steps < SETTLED || nearest <= FAR * spread) return "";
  return "The material is unlike the trained ones: its p is far from all of theirs.";
}

// Follows p from a first one on.
function makeTracker(networks, { estimation }, first) {
  const { window, warmup, least } = estimation;
  let p = Float32Array.from(first);
  let seen = []; // states and commands, one more than the window: the last state is only predicted
  let fromRest = true;

  // The next step of p by what was seen; null before there is anything to judge.
  async function estimated(seen, p) {
    const left = fromRest && seen.length <= window ? 0 : warmup;
    const judged = seen.slice(1).map((_, t) => Number(t >= left));
    if (judged.length - left < least) return null;
    const [s, u] = ["s", "u"].map((name) => joined(...seen.map((each) => each[name])));
    return networks.estimate({ s, u, p, judged });
  }
  // Takes in the state before a command, and the command; `atRest`: the cloth hung still before the first of them.
  return async function update(s, u, { atRest, estimate = true }) {
    if (!seen.length) fromRest = atRest;
    const now = [...seen, { s, u }].slice(-window - 1);
    const found = estimate ? await estimated(now, p) : null;
    const next = p.map((x, k) => x + (found?.step[k] ?? 0));
    if (!next.every(Number.isFinite)) throw new Refusal(UNKNOWN);
    [p, seen] = [next, now];
    return p;
  };
}
