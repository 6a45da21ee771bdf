// Model predictive control, step after step of a run: Python's `Controller` with its `GradientSearch`.
// A plan holds the T commands of D_u numbers one after the other.

// Of the drivers that control, how a plan goes on when a step has passed, and whether a period may start from a recorded
// plan. The others are to compare "control" with.
const CONTROLS = {
  control: { repeats: false, recorded: true },
  "control: last": { repeats: false, recorded: false },
  "control: earlier": { repeats: true, recorded: false },
};
const joined = (...parts) => Float32Array.from(parts.flatMap((part) => [...part]));

// The paper's search: down the gradient, by the best of many step sizes.
function gradientSearch(networks, { plans, control }) {
  async function recorded({ plan, within, ...problem }) {
    const starts = joined(plan, within(plans));
    const { losses } = await networks.predict({ ...problem, u: starts });
    const best = losses.reduce((least, loss, k) => (loss < losses[least] ? k : least), 0);
    return starts.subarray(best * plan.length, (best + 1) * plan.length);
  }
  async function find(problem) {
    let { plan } = problem;
    if (!problem.solve) return { plan, trace: null, learned: null };
    if (problem.start.recorded && problem.t % control.period === 0) plan = await recorded(problem);
    const trace = [];
    for (let k = 0; k < control.iterations; k++) {
      const found = await networks.descend({ ...problem, u: plan });
      plan = found.plan;
      trace.splice(k, 2, ...found.losses);
    }
    return { plan, trace, learned: null };
  }
  return { begin: () => null, find };
}

// `constants`: the limits of the commands, the settings and recorded plans. A search of one's own has `begin`, `find`.
function makeController(networks, constants, search = gradientSearch(networks, constants)) {
  const { lower, upper, home, control } = constants;
  const { horizon, period } = control;
  const size = home.length;
  const first = joined(...Array(horizon).fill(home));
  let p = null;
  let target = null; // z of what is aimed at
  let start = CONTROLS.control;
  let now = null; // replaced as a whole, so that a step happens wholly or not at all

  function beginning(learned) {
    const empty = new Float32Array(constants.memory);
    return { plan: first, sent: [], h: empty, c: empty, learned: search.begin(learned), last: null, t: 0, solves: 0 };
  }
  const within = (plan) => plan.map((x, k) => Math.min(Math.max(x, lower[k % size]), upper[k % size]));
  const mask = (t) => Array.from({ length: horizon }, (_, k) => Number((t + 1 + k) % period === 0));

  // The progress when the next state is seen: a step has passed.
  async function movedOn(p) {
    if (!now.last) return now;
    const { next_h: h, next_c: c } = await networks.follow({ ...now.last, p, h: now.h, c: now.c });
    const sent = [...now.sent, now.plan.subarray(0, size)].slice(-period);
    const added = start.repeats && sent.length === period ? sent[0] : now.plan.subarray(-size);
    return { ...now, h, c, sent, plan: joined(now.plan.subarray(size), added) };
  }
  // The next command in state s; without a solve that of the plan, where there is one already.
  async function act(s, { solve = true } = {}) {
    const before = await movedOn(p);
    const { plan, t, h, c } = before;
    const around = { s, p, h, c, z_ref: target, mask: mask(t), lower, upper };
    const problem = { ...around, plan, t, solve: solve || !t, start, within };
    const found = await search.find(problem, before.learned);
    if (!found.plan.every(Number.isFinite)) throw new Refusal("the gradient of the loss is not finite");
    const u = found.plan.slice(0, size);
    const solves = before.solves + Number(found.trace !== null);
    now = { ...before, plan: found.plan, learned: found.learned, last: { s, u }, t: t + 1, solves };
    return u;
  }
  // Distance to the target at the end of the period that is expected of the plan; null before a step. A search that
  // learns says it itself.
  async function predictedDistance() {
    const { last, learned, plan, h, c, t } = now;
    if (learned) return search.expectedFor(learned, target);
    if (!last) return null;
    const around = { p, h, c, z_ref: target, mask: mask(t - 1) };
    const { distances } = await networks.predict({ s: last.s, u: plan, ...around });
    return distances[0];
  }

  now = beginning();
  return {
    act,
    predictedDistance,
    reset: () => (now = beginning()),
    resume: () => (now = beginning(now.learned)), // as after somebody moved the robot; what was learned stays
    setBias: (next) => (p = next),
    setTarget: (z) => (target = z),
    setStart: (driver) => (start = CONTROLS[driver]),
    solves: () => now.solves,
    learned: () => now.learned,
    periodEnded: () => now.last !== null && now.t % period === 0,
  };
}
