// A live run that a person steers: robot, cloth, target and driver, step by step, as Python's `LiveSession`.
// Between two steps all can be changed; a refusal changes nothing.
class Refusal extends Error {} // what a person asked for and can't be; all other errors are faults

// C_damp [N s/m] or C_mass [kg] as labels have it.
const shortNumber = (x) => x.toFixed(Math.abs(x - Math.round(100 * x) / 100) < 1e-9 ? 2 : 3);

// One of the known cloths where these are its values, else a cloth of one's own.
function clothOf(damping, mass, known) {
  const name = `damp${damping.toFixed(3)}-mass${mass.toFixed(3)}`;
  const own = { ...known[0], name, label: `(${shortNumber(damping)}, ${shortNumber(mass)})`, damping, mass };
  return known.find((each) => each.damping === damping && each.mass === mass) ?? own;
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
  const aimAt = makeAim(networks, constants);
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
  let aim = null;

  async function observe({ data }) {
    const stage = look(data);
    const { mask, z, reconstruction } = await networks.see(picture(stage));
    const s = Float32Array.from([...z, ...arm.sense(data)]);
    return { stage, mask, z, s, reconstruction, theta: arm.theta(data) };
  }
  // Go on from a cloth that was just made to hang still.
  function begin(seen) {
    observation = seen;
    still = seen.z;
    command = constants.home;
    step = 0;
    drivers.reset();
    tracker = makeTracker(networks, constants, p);
  }
  async function hold(next) {
    const numbers = Object.entries({ ...next, mass: next.mass / scene.points });
    const mjcf = numbers.reduce((text, [name, value]) => text.replaceAll(`{${name}}`, value), scene.mjcf);
    let world = null;
    try {
      world = makePhysics(mujoco, { ...scene, mjcf });
      begin(await observe(world));
      physics?.free();
      [physics, cloth] = [world, next];
    } catch (error) {
      if (world) world.free();
      if (!(error instanceof SimulationError)) throw error;
      throw new Refusal(
        `the cloth ${next.label} is too light or too stiff to be simulated: ${cloth.label} stays in the hand`,
      );
    }
  }
  async function reset() {
    physics.reset();
    begin(await observe(physics));
  }
  async function advance(u) {
    const before = physics.kept();
    try {
      physics.advance(arm.sent(u));
      observation = await observe(physics);
    } catch (error) {
      physics.put(before);
      if (!(error instanceof SimulationError)) throw error;
      throw new Refusal(
        `the simulation of cloth ${cloth.label} diverged; use a smaller time_step than ${scene.timeStep} s, a heavier ` +
          "cloth or a softer one",
      );
    }
    step += 1;
    command = u;
  }
  function use(bias) {
    drivers.setBias(bias);
    p = bias;
  }
  // Choose a command, send it, and look. Between solves a controller goes on with its last plan.
  async function makeStep({ solve, solveEvery, estimateEvery }) {
    const start = performance.now();
    const before = observation;
    const choice = await drivers.choose(driver, before.s, { hand, exploring, solve, solveEvery });
    await advance(choice.command);
    if (estimating) {
      const estimate = step % estimateEvery === 0;
      use(await tracker.update(before.s, choice.command, { atRest: step === 1, estimate }));
    }
    const distance = distanceBetween(aim.z, observation.z);
    const period = drivers.closePeriod(driver, choice, distance);
    const seconds = (performance.now() - start) / 1000;
    return { ...choice, distance, period, seconds, theta: observation.theta, p: [...p] };
  }
  // How things stand now.
  function now() {
    const { stage, mask, reconstruction } = observation;
    const report = estimating ? tracker.report() : null;
    const shownHand = drivers.within(driver === "manual" ? hand : command);
    const controls = { driver, exploring, estimating, tension, hand: shownHand, p: [...p], cloth, report };
    return { ...controls, step, stillDistance: distanceBetween(aim.z, still), stage, mask, reconstruction };
  }
  async function setTarget(mask) {
    const next = await aimAt(mask);
    drivers.setTarget(next.z);
    aim = next;
    return aim;
  }
  const pick = ({ name }) => setTarget(about.gallery.find((each) => each.name === name).image);

  // By the names that the panel has for them.
  const actions = {
    reset,
    step: makeStep,
    draw: ({ mask }) => setTarget(mask),
    pick,
    take: () => setTarget(observation.mask),
    "set cloth": ({ cloth: name }) => hold(cloths.find((each) => each.name === name)),
    "set material": ({ damping, mass }) => hold(clothOf(damping, mass, cloths)),
    "set driver"(next) {
      if (next.driver !== driver) drivers.resume();
      driver = next.driver;
    },
    "set hand"({ u }) {
      hand = u;
      actions["set driver"]({ driver: "manual" });
    },
    // For every driver; learning restarts.
    "set tension"({ f_const: next }) {
      drivers = makeDrivers(networks, stiffened(constants, next));
      drivers.reset();
      drivers.setTarget(aim.z);
      drivers.setBias(p);
      tension = next;
    },
    "set p"(next) {
      tracker = makeTracker(networks, constants, next.p);
      use(next.p);
    },
    estimate: ({ on }) => (estimating = on),
    explore: ({ on }) => (exploring = on),
  };
  drivers.setBias(p);
  await pick({ name: constants.target });
  await hold(cloths.find(({ name }) => name === constants.cloth));
  return { actions, now, aim: () => aim, world: () => physics };
}
