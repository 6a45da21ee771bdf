// A live run that a person steers: robot, cloth, target and driver, step by step, as Python's `LiveSession`.
// Between two steps all can be changed; a refusal changes nothing.
class Refusal extends Error {} // what a person asked for and can't be; all other errors are faults

// Networks that most sessions ask soon, but none before it is seen.
const SOON = ["predict", "descend", "follow", "estimate", "aim"];

// C_damp [N s/m] or C_mass [kg] as labels have it: with three decimals, if two are too few.
const shortNumber = (x) => x.toFixed(3).replace(/0$/, "");

// One of the known cloths where these are its values, else a cloth of one's own.
function clothOf(damping, mass, known) {
  const name = `damp${damping.toFixed(3)}-mass${mass.toFixed(3)}`;
  const own = { ...known[0], name, label: `(${shortNumber(damping)}, ${shortNumber(mass)})`, damping, mass };
  return known.find((each) => each.damping === damping && each.mass === mass) ?? own;
}

// Looks at a target, a number for each pixel, 0 or 1: Python's `aim_at`, which the graph `aim` is. What is aimed at is
// the mask, or a recorded image in its place. Without a cloth in its reconstruction, the distance to that is infinite.
async function aimAt(networks, { images }, mask) {
  if (!mask.includes(1)) throw new Refusal("no cloth in the image: the mask is empty");
  const { distance, overlap, ...aim } = await networks.aim({ image: mask, images });
  return { mask, ...aim, distance: distance[0], overlap: overlap[0] };
}

// An arm whose stiffness command, the last one, is fixed at so much [N]; null leaves it free.
function stiffened(arm, tension) {
  if (tension === null) return arm;
  const fixed = (u) => [...u.slice(0, -1), tension];
  return { ...arm, lower: fixed(arm.lower), upper: fixed(arm.upper), home: fixed(arm.home) };
}

// `method`: networks, and constants beside them. `lab`: the scene, the cloths and the images to aim at. What
// another session was asked to do before may go on: who drives, and whether it learns.
async function makeSession(mujoco, { networks, constants }, { scene, cloths, about }, before = {}) {
  const arm = makeArm(scene.arm);
  const look = makeStage(scene.shapes);
  const picture = makeCamera(scene.camera, scene.shapes);
  let drivers = makeDrivers(networks, constants);
  let physics = null;
  let cloth = null;
  let observation = null;
  let still = null; // z of the cloth that hangs still
  let command = constants.home; // the last one that was sent
  let hand = constants.home; // that of the driver "manual"
  let tension = null; // [N], at which the stiffness is fixed
  let step = 0; // number since the last reset
  let { driver = "control", estimating = false } = before;
  let { exploring = true } = before; // whether who learns tries new plans; else it repeats the best known one
  let p = constants.biases[constants.cloth];
  let tracker = null;
  let estimated = 0; // steps since it began
  let { aim } = constants; // at first

  async function observe({ data }) {
    const stage = look(data);
    const { mask, z, reconstruction } = await networks.see(picture(stage));
    const s = Float32Array.from([...z, ...arm.sense(data)]);
    return { stage, mask, z, s, reconstruction, theta: arm.theta(data) };
  }
  // Does something; where a simulation fails, `undo` it, and refuse.
  async function simulated(act, undo, why) {
    try {
      return await act();
    } catch (error) {
      undo();
      throw error instanceof SimulationError ? new Refusal(why) : error;
    }
  }
  function beginEstimate() {
    tracker = makeTracker(networks, constants, p);
    estimated = 0;
  }
  // Go on from a cloth that was just made to hang still.
  function begin(seen) {
    observation = seen;
    still = seen.z;
    command = constants.home;
    step = 0;
    drivers.begin();
    beginEstimate();
  }
  async function hold(next) {
    const numbers = Object.entries({ ...next, mass: next.mass / scene.points });
    const mjcf = numbers.reduce((text, [name, value]) => text.replaceAll(`{${name}}`, value), scene.mjcf);
    let world = null;
    async function replace() {
      world = makePhysics(mujoco, { ...scene, ...scene.still[next.name], mjcf });
      world.hang();
      begin(await observe(world));
    }
    const why = `the cloth ${next.label} is too light or too stiff to be simulated: ${cloth?.label} stays in the hand`;
    await simulated(replace, () => world?.free(), why);
    physics?.free();
    [physics, cloth] = [world, next];
  }
  async function reset() {
    physics.reset();
    begin(await observe(physics));
  }
  async function advance(u) {
    const kept = physics.kept();
    async function move() {
      physics.advance(arm.sent(u));
      observation = await observe(physics);
    }
    const smaller = `use a smaller time_step than ${scene.timeStep} s, a heavier cloth or a softer one`;
    await simulated(move, () => physics.put(kept), `the simulation of cloth ${cloth.label} diverged; ${smaller}`);
    step += 1;
    command = u;
  }
  // Choose a command, send it, and look. Without a solve a controller goes on with its last plan, and p stays.
  async function makeStep({ solve }) {
    const start = performance.now();
    const before = observation;
    const choice = await drivers.choose(driver, before.s, { hand, p, target: aim.z, exploring, solve });
    await advance(choice.command);
    if (estimating) {
      p = await tracker(before.s, choice.command, { atRest: step === 1, estimate: solve });
      estimated += 1;
    } else {
      beginEstimate(); // a window with a gap would say nothing
    }
    const distance = distanceBetween(aim.z, observation.z);
    const period = drivers.closePeriod(choice, distance);
    const milliseconds = performance.now() - start;
    return { ...choice, distance, period, milliseconds, theta: observation.theta, p: [...p] };
  }
  // In the idle time after a step or a change: the next step takes less time then.
  const lookAhead = () => drivers.prepare(driver, observation.s, { p, target: aim.z });
  // How things stand now.
  function now() {
    const { stage, mask, reconstruction } = observation;
    const stillDistance = distanceBetween(aim.z, still);
    const warning = estimating ? warningOf(p, estimated, constants) : "";
    const shownHand = drivers.within(driver === "manual" ? hand : command);
    const { name, label, damping, mass } = cloth;
    const shownCloth = { name, label, material: [damping, mass] };
    const controls = { driver, exploring, estimating, hand: shownHand, cloth: shownCloth };
    return { controls, tension, p: [...p], warning, step, stillDistance, stage, mask, reconstruction };
  }
  const setTarget = async (mask) => (aim = await aimAt(networks, constants, mask));

  // By the names that the panel has for them.
  const actions = {
    reset,
    step: makeStep,
    draw: ({ mask }) => setTarget(mask),
    pick: ({ name }) => setTarget(about.gallery.find((each) => each.name === name).image),
    take: () => setTarget(observation.mask),
    "set cloth": ({ cloth: name }) => hold(cloths.find((each) => each.name === name)),
    "set material": ({ damping, mass }) => hold(clothOf(damping, mass, cloths)),
    "set driver"(next) {
      if (next.driver !== driver) drivers.begin({ keep: true });
      driver = next.driver;
    },
    "set hand"({ u }) {
      hand = u;
      actions["set driver"]({ driver: "manual" });
    },
    // For every driver; learning restarts.
    "set tension"({ f_const: next }) {
      drivers = makeDrivers(networks, stiffened(constants, next));
      tension = next;
    },
    "set p"(next) {
      p = next.p;
      beginEstimate();
    },
    estimate: ({ on }) => (estimating = on),
    explore: ({ on }) => (exploring = on),
    async prepare() {
      for (const name of SOON) await networks[name].prepare();
    },
  };
  await hold(cloths.find(({ name }) => name === constants.cloth));
  return { actions, lookAhead, now, aim: () => aim, world: () => physics };
}
