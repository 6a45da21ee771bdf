// The method in the page, with the graphs in a folder: what each question of a file is answered.
import { createRequire } from "node:module";
import { readFileSync, readdirSync } from "node:fs";
import { pathToFileURL } from "node:url";
import { given, made } from "./given.mjs";

const { runtime, folder, questions } = given;
const ort = createRequire(import.meta.url)(`${runtime}/ort.wasm.min.js`);
ort.env.wasm.wasmPaths = pathToFileURL(`${runtime}/`).href;
ort.env.wasm.numThreads = 1;
const { makeNetworks, readConstants, makeController, iterativeSearch, makeTracker, makeAim, makeEllipse } = made(
  ...["files", "networks", "session", "controller", "iterative", "estimator", "aim", "ellipse"],
);
const { constants: about, ...graphs } = Object.fromEntries(
  readdirSync(folder).map((name) => [name, readFileSync(`${folder}/${name}`)]),
);
const constants = readConstants(about);
const networks = await makeNetworks(ort, graphs);

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
  // Commands in states that were seen, whatever was sent there, and what is foreseen after each.
  async control({ start, p, target, states, skip }) {
    const controller = makeController(networks, constants);
    controller.setStart(start);
    controller.setBias(p);
    controller.setTarget(target);
    const steps = [];
    for (const [t, s] of states.entries()) {
      const u = [...(await controller.act(s, { solve: !skip.includes(t) }))];
      const [z, predicted] = [await controller.foreseen(), await controller.predictedDistance()];
      steps.push({ u, z: [...z], predicted, ended: controller.periodEnded(), solves: controller.solves() });
    }
    return steps;
  },
  // Commands of iterative learning in states that were seen, and what it expects and rests on.
  async iterate({ p, target, states, exploring }) {
    const search = iterativeSearch(networks, constants);
    const controller = makeController(networks, constants, search);
    controller.setBias(p);
    controller.setTarget(target);
    const steps = [];
    for (const [t, s] of states.entries()) {
      search.explore(exploring[t]);
      const u = [...(await controller.act(s))];
      const predicted = await controller.predictedDistance();
      steps.push({ u, predicted, basis: search.basis(controller.learned()), solves: controller.solves() });
    }
    return steps;
  },
  // p after each step, and the last report.
  async estimate({ p, states, commands }) {
    const tracker = makeTracker(networks, constants, p);
    const path = [];
    for (const [t, s] of states.entries()) path.push([...(await tracker.update(s, commands[t], { atRest: true }))]);
    return { path, report: tracker.report };
  },
  ellipse: ({ theta, tension }) => makeEllipse(constants.ellipse)(theta, tension),
  async aim({ mask }) {
    if (!mask.includes(1)) return refused(() => makeAim(networks, constants)(Uint8Array.from(mask)));
    const { known, z, distance, overlap } = await makeAim(networks, constants)(Uint8Array.from(mask));
    return { known: known.join(""), z: [...z], distance, overlap };
  },
};
const found = [];
for (const { what, ...more } of questions) found.push(await answers[what](more));
console.log(JSON.stringify(found));
