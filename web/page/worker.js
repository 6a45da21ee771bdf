// In a worker: MuJoCo, the networks, and a session with both. Each question has an answer with the same id, and waits
// for the one before it.
const arms = {}; // that were met, by name
let mujoco = null;
let session = null;
const read = (bytes) => unpacked(JSON.parse(new TextDecoder().decode(bytes)));

// onnxruntime in one thread. It loads a module of its own, which can only come from an address.
function loadRuntime({ "onnxruntime.mjs": module, "onnxruntime.wasm": wasm }) {
  const address = URL.createObjectURL(new Blob([module], { type: "text/javascript" }));
  Object.assign(ort.env.wasm, { numThreads: 1, wasmBinary: wasm, wasmPaths: { mjs: address } });
}

// What Python exported for an arm: what there is about it, and its method.
function makeMet(files, name) {
  const its = Object.entries(files).filter(([path]) => path.startsWith(`${name}/`));
  const exported = its.map(([path, bytes]) => [path.slice(name.length + 1), new Uint8Array(bytes)]);
  const { "lab.json": lab, constants, ...graphs } = Object.fromEntries(exported);
  return { lab: read(lab), method: { constants: read(constants), networks: makeNetworks(ort, graphs) } };
}

const answers = {
  // `files`: of an arm that was not met before; at first, also of MuJoCo and onnxruntime.
  async "set arm"({ name, files }) {
    if (!mujoco) loadRuntime(files);
    const loaded = mujoco ?? loadMujoco({ wasmBinary: files["mujoco.wasm"], locateFile: (path) => path });
    [mujoco, arms[name]] = await Promise.all([loaded, arms[name] ?? makeMet(files, name)]);
    const { lab, method } = arms[name];
    const next = await makeSession(mujoco, method, lab, session?.now().controls);
    session?.world().free();
    session = next;
    for (const file of ["mujoco.wasm", "onnxruntime.wasm"]) files[file]?.transfer?.(0); // compiled: the bytes go
    return { lab: { ...lab, pushes: method.constants.ellipse }, aim: session.aim() };
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
  turn = turn.then(async () => {
    postMessage({ id, ...(await answerTo(what, more)) });
    await session?.lookAhead()?.catch(() => {}); // the step that needs it says why it fails
  });
});
