// A live run that a person steers: robot, cloth, target and driver, step by step, as Python's `LiveSession`.
// Between two steps all can be changed; a refusal changes nothing.
class Refusal extends Error {} // what a person asked for and can't be; all other errors are faults

// C_damp [N s/m] or C_mass [kg] as labels have it.
const shortNumber = (x) => x.toFixed(Math.abs(x - Math.round(100 * x) / 100) < 1e-9 ? 2 : 3);

// One of the known cloths where these are its values, else a cloth of one's own.
function clothOf(damping, mass, known) {
  const name = `damp${damping.toFixed(3)}-mass${mass.toFixed(3)}`;
  const own = { name, label: `(${shortNumber(damping)}, ${shortNumber(mass)})`, damping, mass };
  return known.find((each) => each.damping === damping && each.mass === mass) ?? own;
}

// `method`: networks and what is made of them, and constants. `lab`: the scene and the cloths. `seed`: of all random
// numbers.
async function makeSession(mujoco, method, { scene, cloths }, seed) {
  const { networks, learning, makeTracker, aimAt, constants } = method;
  const seeds = makeRandom(seed);
  const see = makeCamera(scene.camera);
  const drivers = makeDrivers(method, constants);
  let physics = null;
  let look = null;
  let cloth = null;
  let observation = null;
  let still = null; // z of the cloth that hangs still
  let command = constants.home; // the last one that was sent
  let hand = constants.home; // that of the driver "manual"
  let step = 0; // number since the last reset
  let driver = "control";
  let estimating = false;
  let exploring = true; // whether who learns iteratively tries new plans; else it repeats the best known one
  let p = constants.biases[constants.cloth];
  let tracker = null;
  let aim = null;

  async function observe(world, lookAt) {
    const stage = lookAt(world.data);
    const mask = see(stage);
    const { z } = await networks.encode({ image: mask });
    const { image } = await networks.decode({ z });
    const joints = [...world.data.qpos.subarray(0, 2), ...world.data.qvel.subarray(0, 2)];
    const s = Float32Array.from([...z, ...joints]);
    return { stage, mask, z, joints, s, reconstruction: image };
  }
  // Go on from a cloth that was just made to hang still.
  function begin(seen) {
    observation = seen;
    still = seen.z;
    command = constants.home;
    step = 0;
    drivers.reset(seeds.integer(0, 2 ** 32));
    tracker = makeTracker(p);
  }
  async function hold(next) {
    const mjcf = scene.mjcf.replaceAll("{damping}", next.damping).replaceAll("{mass}", next.mass / scene.points);
    let world = null;
    try {
      world = makePhysics(mujoco, { ...scene, mjcf });
      const lookAt = makeStage(mujoco, world.model);
      begin(await observe(world, lookAt));
      physics?.free();
      [physics, look, cloth] = [world, lookAt, next];
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
    begin(await observe(physics, look));
  }
  async function advance(u) {
    const before = physics.kept();
    try {
      physics.advance(u);
      observation = await observe(physics, look);
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
    const choice = await drivers.choose(driver, before.s, { hand, solve, solveEvery });
    await advance(choice.command);
    if (estimating) {
      const estimate = step % estimateEvery === 0;
      use(await tracker.update(before.s, choice.command, { atRest: step === 1, estimate }));
    }
    const distance = distanceBetween(aim.z, observation.z);
    const period = drivers.closePeriod(driver, choice, distance);
    const seconds = (performance.now() - start) / 1000;
    return { ...choice, distance, period, seconds, theta: observation.joints.slice(0, 2), p: [...p] };
  }
  // How things stand now.
  function now() {
    const { stage, mask, reconstruction } = observation;
    const report = estimating ? tracker.report : null;
    const shownHand = driver === "manual" ? hand : command;
    const controls = { driver, exploring, estimating, hand: shownHand, p: [...p], cloth, report };
    return { ...controls, step, stillDistance: distanceBetween(aim.z, still), stage, mask, reconstruction };
  }
  async function setTarget(mask) {
    const next = await aimAt(mask);
    drivers.setTarget(next.z);
    aim = next;
    return aim;
  }

  // By the names that the panel has for them.
  const actions = {
    reset,
    step: makeStep,
    draw: ({ mask }) => setTarget(mask),
    pick: ({ name }) => setTarget(constants.gallery[name]),
    take: () => setTarget(observation.mask),
    "set cloth": ({ cloth: name }) => hold(cloths.find((each) => each.name === name)),
    "set material": ({ damping, mass }) => hold(clothOf(damping, mass, cloths)),
    "set driver"(next) {
      if (next.driver !== driver) drivers.resume(next.driver);
      driver = next.driver;
    },
    "set hand"({ u }) {
      hand = u.map((x, k) => Math.min(constants.upper[k], Math.max(constants.lower[k], x)));
      actions["set driver"]({ driver: "manual" });
    },
    "set p"(next) {
      tracker = makeTracker(next.p);
      use(next.p);
    },
    estimate: ({ on }) => (estimating = on),
    explore({ on }) {
      learning.explore(on);
      exploring = on;
    },
  };
  drivers.setBias(p);
  await setTarget(constants.gallery[constants.target]);
  await hold(cloths.find(({ name }) => name === constants.cloth));
  return { actions, now, aim: () => aim, world: () => physics };
}
