// The method in the page, with the graphs in a folder: what each question of a file is answered.
import { given, made, method } from "./given.mjs";

const { makeControllers, makeTracker, aimAt, makeEllipse } = made(
  ...["geometry", "session", "drivers", "controller", "iterative", "estimator", "ellipse"],
);
const { constants, networks } = await method(given);

// What a person is told; of a fault, it is not there.
async function refused(act) {
  try {
    await act();
  } catch (error) {
    return { refused: error.constructor.name === "Refusal" ? error.message : null };
  }
}

const answers = {
  // A plan from the one that is given, and its losses on the way.
  async solve({ iterations, u, ...around }) {
    const losses = [];
    for (let k = 0; k < iterations; k++) {
      const found = await networks.descend({ ...around, u });
      u = found.plan;
      losses.splice(k, 2, ...found.losses);
    }
    return { plan: [...u], losses };
  },
  // Commands in states that were seen, whatever was sent there, and what is said of each; what was prepared for other ps
  // and targets in turn; and how often `predict` was asked in the step.
  async control({ driver, p, target, states, skip = [], prepared = [] }) {
    let asked = 0;
    function predict(given) {
      asked += 1;
      return networks.predict(given);
    }
    const controller = makeControllers({ ...networks, predict }, constants)[driver];
    const steps = [];
    for (const [t, s] of states.entries()) {
      for (const each of prepared) await controller.prepare(s, { p, target, ...each });
      asked = 0;
      const around = { p, target, solve: !skip.includes(t) };
      steps.push({ ...(await controller.act(s, around)), asked });
    }
    return steps;
  },
  // p after each step.
  async estimate({ p, states, commands }) {
    const update = makeTracker(networks, constants, p);
    const path = [];
    for (const [t, s] of states.entries()) path.push([...(await update(s, commands[t], { atRest: true }))]);
    return path;
  },
  ellipse: ({ theta, tension }) => makeEllipse(constants.ellipse)(theta, tension),
  async aim({ mask }) {
    const look = () => aimAt(networks, constants, Uint8Array.from(mask));
    if (!mask.includes(1)) return refused(look);
    const { known, z, distance, overlap } = await look();
    return { known: known.join(""), z: [...z], distance, overlap };
  },
};
const found = [];
for (const { what, ...more } of given.questions) found.push(await answers[what](more));
console.log(JSON.stringify(found));
