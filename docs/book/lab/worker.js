// In a worker: MuJoCo, the networks, and a session with both. Each question has an answer with the same id, and waits
// for the one before it.
let session = null;
const read = (bytes) => JSON.parse(new TextDecoder().decode(bytes));

// onnxruntime in one thread. It loads a module of its own, which can only come from an address.
function loadRuntime({ "onnxruntime.mjs": module, "onnxruntime.wasm": wasm }) {
  const address = URL.createObjectURL(new Blob([module], { type: "text/javascript" }));
  Object.assign(ort.env.wasm, { numThreads: 1, wasmBinary: wasm, wasmPaths: { mjs: address } });
  return ort;
}

// What Python exported for an arm: constants, and networks with what is made of them.
async function makeMethod(files, arm) {
  const its = Object.entries(files).filter(([name]) => name.startsWith(`${arm}/`));
  const exported = its.map(([name, bytes]) => [name.slice(arm.length + 1), new Uint8Array(bytes)]);
  const { constants: about, ...graphs } = Object.fromEntries(exported);
  const constants = readConstants(about);
  const networks = await makeNetworks(loadRuntime(files), graphs);
  const learning = iterativeSearch(networks, constants);
  return {
    constants,
    networks,
    learning,
    controller: makeController(networks, constants),
    learner: makeController(networks, constants, learning),
    makeTracker: (p) => makeTracker(networks, constants, p),
    aimAt: makeAim(networks, constants),
  };
}

const answers = {
  async load({ files, seed }) {
    const lab = unpacked(read(files["lab.json"]));
    const [mujoco, method] = await Promise.all([
      loadMujoco({ wasmBinary: files["mujoco.wasm"], locateFile: (name) => name }),
      makeMethod(files, lab.about.arms[0]),
    ]);
    session = await makeSession(mujoco, method, lab, seed);
    const { biases, usual_distance } = method.constants;
    return { biases, usual_distance, aim: session.aim() };
  },
};

// An answer, or an error, with how the session stands then: what was asked may be done in part.
async function answerTo(what, more) {
  try {
    const answer = await (answers[what] ?? session.actions[what])(more);
    return { answer, now: session.now() };
  } catch (error) {
    return { error: { message: `${error.message ?? error}`, name: error.constructor?.name }, now: session?.now() };
  }
}
let turn = Promise.resolve();
addEventListener("message", ({ data: { id, what, more } }) => {
  turn = turn.then(async () => postMessage({ id, ...(await answerTo(what, more)) }));
});
