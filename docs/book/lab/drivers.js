// Who chooses the commands: random commands and the scripted operator, as in `policies.py`, a person, and controllers.
const uniform = (low, high) => low + (high - low) * Math.random();
const integer = (low, end) => Math.floor(uniform(low, end));

const LONGEST_HOLD = 4; // steps
const held = (u, count) => Array(count).fill(u);

// Uniform commands, each held for 1 to 4 steps, so that there are slow and fast motions.
function* randomCommands({ lower, upper }) {
  for (;;) {
    const u = lower.map((low, k) => uniform(low, upper[k]));
    yield* held(u, integer(1, LONGEST_HOLD + 1));
  }
}

// Angles that lift the cloth slowly and throw it down fast; each swing draws its own height, depth, speeds and pauses.
function* swings({ lower, upper, home }) {
  const within = (low, high) => lower.map((least, k) => least + uniform(low, high) * (upper[k] - least));
  const way = (from, to, count) => Array.from({ length: count }, (_, k) => between(from, to, (k + 1) / count));
  let u = home;
  for (;;) {
    const high = within(0, 0.35); // angles are smaller, the higher the arm is
    const low = within(0.65, 1);
    yield* way(u, high, integer(3, 7));
    yield* held(high, integer(0, 3));
    yield* way(high, low, integer(1, 3));
    yield* held(low, integer(1, 4));
    u = low;
  }
}
// Angles of the operator's swings; a stiffness command is random.
function* operatorCommands(arm) {
  const angles = JOINTS.length;
  const others = randomCommands(arm);
  for (const theta of swings(arm)) yield [...theta.slice(0, angles), ...others.next().value.slice(angles)];
}

// All of them, for an arm with these limits and this home, which may not be those of the networks.
function makeDrivers(networks, arm) {
  const learning = iterativeSearch(networks, arm);
  const controller = makeController(networks, arm);
  const learner = makeController(networks, arm, learning);
  const controllers = [controller, learner];
  const controllerOf = (driver) => (driver in CONTROLS ? controller : driver === "iterative" ? learner : null);
  let others = null; // their commands, one after the other
  let count = 0; // steps since the controller began
  let period = []; // predicted and seen distance of each step since its period began

  function reset() {
    others = { random: randomCommands(arm), operator: operatorCommands(arm) };
    for (const each of controllers) each.reset();
    count = 0;
    period = [];
  }
  // Another driver's turn begins; what was learned stays.
  function resume() {
    for (const each of controllers) each.resume();
    count = 0;
    period = [];
  }
  function setTarget(z) {
    for (const each of controllers) each.setTarget(z);
    period = []; // it was about another target
  }
  function setBias(p) {
    for (const each of controllers) each.setBias(p);
  }
  const within = (u) => u.map((x, k) => Math.min(arm.upper[k], Math.max(arm.lower[k], x)));
  // A command, and what its driver says of it.
  async function choose(driver, s, { hand, exploring, solve, solveEvery }) {
    const chosen = controllerOf(driver);
    if (!chosen) {
      const command = driver === "manual" ? within(hand) : others[driver].next().value;
      return { command, predicted: null, periodEnded: false, basis: "" };
    }
    if (driver in CONTROLS) controller.setStart(driver);
    learning.explore(exploring);
    // A period that begins without a solve would go on with the plan of the last one.
    const begins = count % arm.control.period === 0;
    const command = [...(await chosen.act(s, { solve: begins || (solve && count % solveEvery === 0) }))];
    count += 1;
    const predicted = await chosen.predictedDistance();
    const basis = chosen === learner ? learning.basis(learner.learned()) : "";
    return { command, predicted, periodEnded: chosen.periodEnded(), basis };
  }
  // The distance seen after a choice; at the end of a period, what was predicted when it began, and achieved: at its
  // last step, or by who learns at its best one.
  function closePeriod(driver, { predicted, periodEnded }, distance) {
    if (predicted !== null) period.push({ predicted, distance });
    if (!periodEnded || !period.length) return null;
    const best = Math.min(...period.map((each) => each.distance));
    const ended = { predicted: period[0].predicted, achieved: driver === "iterative" ? best : distance };
    period = [];
    return ended;
  }
  return { reset, resume, setTarget, setBias, within, choose, closePeriod };
}
