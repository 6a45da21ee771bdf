// Iterative learning control: a search that learns from each period how the predictions err. Python: `IterativeController`.
// An attempt is a period that is over: the state and memory it began with, its plan u, the p in use, and the z seen.

// Stretches of recorded commands after which z was seen nearest to the target, best first.
function nearestPlans(runs, target, period, count, size) {
  const half = period >> 1;
  const fromEach = Math.ceil(count / runs.length);
  const found = runs.flatMap(({ z, u, material }) => {
    const seen = (k) => z.subarray(k * target.length, (k + 1) * target.length);
    const after = (_, k) => distanceBetween(target, seen(k + period));
    const distances = Array.from({ length: u.length / size - period }, after);
    return Array.from({ length: Math.min(fromEach, Math.floor(distances.length / period)) }, () => {
      const distance = Math.min(...distances);
      const start = distances.indexOf(distance);
      distances.fill(Infinity, Math.max(0, start - half + 1), start + half); // no other begins within half a plan
      return { u: u.subarray(start * size, (start + period) * size), distance, material };
    });
  });
  return found.sort((a, b) => a.distance - b.distance).slice(0, count);
}

function iterativeSearch(networks, { learning, control, biases, spread, runs, home, z: latent }) {
  const gap = (p, other) => (distanceBetween(p, other) / spread) ** 2;
  const recorded = ({ z_ref: target }) => nearestPlans(runs, target, control.period, learning.recorded, home.length);
  // Smaller as long as recent outcomes are poor.
  function caution(attempts, target) {
    const recent = attempts.slice(-learning.recent).flatMap(({ z }) => z.map((each) => distanceBetween(each, target)));
    const good = Math.min(1, (learning.aim / Math.max(Math.min(...recent), 1e-9)) ** 2);
    return Math.max(learning.least_caution, learning.caution * good);
  }
  // What attempts taught of predictions: a Gaussian process. It has room for as many as are remembered.
  function taught({ p }, attempts) {
    const [s, u, h, c] = ["s", "u", "h", "c"].map((name) => joined(...attempts.map((each) => each[name])));
    const z = joined(...attempts.flatMap((each) => each.z));
    return networks.teach({ s, u, h, c, z, p, tried: attempts.map(() => 1) });
  }
  // What the distances of plans are asked with.
  async function forecast(problem, attempts) {
    const around = { ...problem, caution: [caution(attempts, problem.z_ref)], ...(await taught(problem, attempts)) };
    return async function ask(plans, name = "distance") {
      const { losses, ...more } = await networks[name]({ ...around, u: joined(...plans) });
      return { ...more, losses: losses.subarray(0, plans.length) }; // a graph has room for more plans
    };
  }

  // The plan of the period that just ended, and what is expected of it from here.
  async function onceMore(problem, { attempts, underWay }) {
    const { u } = underWay ?? attempts.at(-1);
    const ask = await forecast(problem, attempts);
    const { losses } = await ask([u]);
    return { plan: u, expected: losses[0], trace: null };
  }
  // A recorded plan that is good by prediction, and was with a near material.
  async function recordedPlan(problem) {
    const found = recorded(problem);
    const plans = found.map(({ u }) => problem.within(u));
    const ask = await forecast(problem, []);
    const { losses } = await ask(plans);
    const scores = found.map(({ distance, material }, k) => {
      const difference = material in biases ? gap(biases[material], problem.p) : 1;
      return losses[k] ** 2 + learning.trust * (distance ** 2 + learning.difference * difference);
    });
    const best = scores.indexOf(Math.min(...scores));
    return { plan: plans[best], expected: losses[best], trace: [losses[best]] };
  }
  // The plan that is expected to lead nearest, by a descent from some starts.
  async function bestPlan(problem, { attempts }) {
    const { exploring } = problem;
    const ask = await forecast(problem, attempts);
    let plans = attempts.map(({ u }) => u);
    if (exploring || !plans.length) plans.push(...recorded(problem).map(({ u }) => problem.within(u)), problem.plan);
    let { losses } = await ask(plans);
    const order = [...losses.keys()].sort((a, b) => losses[a] - losses[b]).slice(0, exploring ? learning.starts : 1);
    [plans, losses] = [order.map((k) => plans[k]), order.map((k) => losses[k])];
    const trace = [losses[0]];
    for (let k = 0; k < (exploring ? learning.iterations : 0); k++) {
      const better = await ask(plans, "improve");
      plans = plans.map(({ length }, each) => better.plans.slice(each * length, (each + 1) * length));
      losses = [...better.losses];
      trace.push(Math.min(...losses));
    }
    return { plan: plans[losses.indexOf(trace.at(-1))], expected: trace.at(-1), trace };
  }
  function choose(problem, learned) {
    const { length } = learned.attempts;
    if (!length && problem.solve) return recordedPlan(problem);
    if (length < 2 || !problem.solve) return onceMore(problem, learned);
    return bestPlan(problem, learned);
  }

  // A plan for a new period, or at hand the rest of this period's.
  async function find(problem, before) {
    const { s, h, c, p, z_ref: target, t } = problem;
    let { underWay } = before;
    if (underWay) underWay = { ...underWay, z: [...underWay.z, s.slice(...latent)] };
    if (t % control.period) return { plan: problem.plan, trace: null, learned: { ...before, underWay } };

    // A period is over, and the next one begins. Another material in the hand: attempts are forgotten.
    const all = [...before.attempts, ...(underWay ? [underWay] : [])].slice(-learning.remembered);
    const attempts = all.filter((each) => gap(each.p, p) < learning.same_material);
    const { plan, expected, trace } = await choose(problem, { attempts, underWay });
    const begun = { s, h, c, u: plan, p, z: [] };
    return { plan, trace, learned: { attempts, expected, underWay: begun, target } };
  }
  return {
    begin: (learned) => ({ attempts: [], ...learned, underWay: null }),
    find,
    expectedFor: ({ underWay, target, expected }, other) => (underWay && target === other ? expected : null),
    basis: ({ attempts: { length } }) => (length < 2 ? "recordings" : `${length} attempts`),
  };
}
