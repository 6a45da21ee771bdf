// Who chooses the commands: controllers, a person, and those who look at nothing.

// Commands that Python's policies chose beforehand: from somewhere in them on, and then from their beginning.
function makePlayer(commands, size) {
  const count = commands.length / size;
  let k = Math.floor(count * Math.random());
  return function next() {
    k = (k + 1) % count;
    return commands.subarray(k * size, (k + 1) * size);
  };
}

// By the names of drivers. Two of them are only there to compare "control" with.
function makeControllers(networks, arm) {
  const gradients = gradientSearch(networks, arm.control);
  return {
    control: makeController(networks, arm, gradientSearch(networks, arm.control, arm.plans)),
    "control: last": makeController(networks, arm, gradients),
    "control: earlier": makeController(networks, arm, gradients, { repeats: true }),
    iterative: makeController(networks, arm, iterativeSearch(networks, arm)),
  };
}

// All of them, for an arm with these limits and this home, which may not be those of the networks.
function makeDrivers(networks, arm) {
  const controllers = makeControllers(networks, arm);
  const within = (u) => [...clamped(u, arm)];
  let others = null; // those who look at nothing, by name
  let count = 0; // steps since the controllers began
  let period = []; // predicted and seen distance of each step since its period began
  let aimed = null; // z of the target that these are about

  // Another driver's turn begins, or another run; what was learned may be kept.
  function begin({ keep = false } = {}) {
    const players = Object.entries(arm.commands).map(([name, each]) => [name, makePlayer(each, arm.home.length)]);
    others = Object.fromEntries(players);
    for (const each of Object.values(controllers)) each.begin({ keep });
    count = 0;
    period = [];
  }
  // What a driver can do before the step begins that it is asked in.
  const prepare = (driver, s, around) => controllers[driver]?.prepare(s, around);
  // A command, and what its driver says of it.
  async function choose(driver, s, { hand, solve, ...around }) {
    if (around.target !== aimed) period = [];
    aimed = around.target;
    if (!(driver in controllers)) {
      const command = within(driver === "manual" ? hand : others[driver]());
      return { command, predicted: null, periodEnded: false, basis: "" };
    }
    // A period that begins without a solve would go on with the plan of the last one.
    const begins = count % arm.control.period === 0;
    const choice = await controllers[driver].act(s, { ...around, solve: solve || begins });
    count += 1;
    return choice;
  }
  // The distance seen after a choice; at the end of a period, what was predicted when it began, and achieved then.
  function closePeriod({ predicted, periodEnded }, distance) {
    if (predicted !== null) period.push(predicted);
    if (!periodEnded || !period.length) return null;
    const ended = { predicted: period[0], achieved: distance };
    period = [];
    return ended;
  }
  begin();
  return { begin, within, prepare, choose, closePeriod };
}
