// Model predictive control, step after step of a run: Python's `Controller`.
// A plan holds the T commands of D_u numbers one after the other.
const joined = (...parts) => Float32Array.from(parts.flatMap((part) => [...part]));

// The paper's search: down the gradient, by the best of many step sizes. With recorded `plans`, each period starts from the
// best of them, or from the plan at hand.
function gradientSearch(networks, { iterations }, plans = null) {
  async function start({ plan, within, ...problem }) {
    if (!plans) return plan;
    const starts = joined(plan, within(plans));
    const { losses } = await networks.predict({ ...problem, u: starts });
    const best = losses.reduce((least, loss, k) => (loss < losses[least] ? k : least), 0);
    return starts.subarray(best * plan.length, (best + 1) * plan.length);
  }
  async function find(problem) {
    if (!problem.solve) return { plan: problem.plan, trace: null, learned: null };
    let plan = problem.start;
    const trace = [];
    for (let k = 0; k < iterations; k++) {
      const found = await networks.descend({ ...problem, u: plan });
      plan = found.plan;
      trace.splice(k, 2, ...found.losses);
    }
    return { plan, trace, learned: null };
  }
  return { begin: () => null, start, find, basis: () => "" };
}

// `constants`: the limits of the commands, and the settings. `search`: one of one's own has `begin`, `find` and `basis`; if
// a period has a start of its own `start`, and if it learns `expectedFor`. `repeats`: whether a plan goes on, when a step
// has passed, as a period ago.
function makeController(networks, constants, search, { repeats = false } = {}) {
  const { home, control, lower, upper } = constants;
  const { horizon, period } = control;
  const size = home.length;
  const first = joined(...Array(horizon).fill(home));
  const within = (plan) => clamped(plan, constants);
  const mask = (t) => Array.from({ length: horizon }, (_, k) => Number((t + 1 + k) % period === 0));
  let now = null; // replaced as a whole, so that a step happens wholly or not at all
  let ahead = null; // what was prepared last, and of what

  // What was learned may be kept, as after somebody moved the robot.
  function begin({ keep = false } = {}) {
    const empty = new Float32Array(constants.memory);
    const learned = search.begin(keep ? now.learned : null);
    now = { plan: first, sent: [], h: empty, c: empty, learned, last: null, t: 0, solves: 0 };
  }
  // The progress when the next state is seen: a step has passed.
  async function movedOn(p) {
    if (!now.last) return now;
    const { next_h: h, next_c: c } = await networks.follow({ ...now.last, p, h: now.h, c: now.c });
    const sent = [...now.sent, now.plan.subarray(0, size)].slice(-period);
    const added = repeats && sent.length === period ? sent[0] : now.plan.subarray(-size);
    return { ...now, h, c, sent, plan: joined(now.plan.subarray(size), added) };
  }
  // The problem in state s, but for what is decided only in the step itself.
  async function posed(s, { p, target }) {
    const before = await movedOn(p);
    const { plan, t, h, c } = before;
    const problem = { s, p, h, c, z_ref: target, mask: mask(t), lower, upper, plan, t, within };
    const start = t % period || !search.start ? plan : await search.start(problem);
    return { before, problem: { ...problem, start } };
  }
  // It may be asked for in the idle time before the step, which then takes what is there. Something else in the place of
  // any of these, and it is posed anew.
  function prepare(s, { p, target }) {
    const of = [s, p, target, now];
    if (!ahead || of.some((each, k) => each !== ahead.of[k])) ahead = { of, posed: posed(s, { p, target }) };
    return ahead.posed;
  }
  // Distance to the target at the end of the period that is expected of what was found. A search that learns says it
  // itself.
  async function expected({ plan, learned }, { z_ref: target, ...problem }) {
    if (learned) return search.expectedFor(learned, target);
    const { distances } = await networks.predict({ ...problem, z_ref: target, u: plan });
    return distances[0];
  }
  // The next command in state s, and what is said of it; without a solve that of the plan, where there is one already.
  async function act(s, { p, target, exploring = true, solve = true }) {
    const { before, problem } = await prepare(s, { p, target });
    const { t } = before;
    const found = await search.find({ ...problem, solve: solve || !t, exploring }, before.learned);
    if (!found.plan.every(Number.isFinite)) throw new Refusal("the gradient of the loss is not finite");
    const predicted = await expected(found, problem);
    const u = found.plan.slice(0, size);
    const solves = before.solves + Number(found.trace !== null);
    now = { ...before, plan: found.plan, learned: found.learned, last: { s, u }, t: t + 1, solves };
    const periodEnded = now.t % period === 0;
    return { command: [...u], predicted, periodEnded, basis: search.basis(found.learned), solves };
  }

  begin();
  return { prepare, act, begin };
}
