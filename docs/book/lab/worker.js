// In a worker: MuJoCo, the networks, and a session with both. Each question has an answer with the same id, and waits
// for the one before it.
let session = null;
const read = (bytes) => JSON.parse(new TextDecoder().decode(bytes));

const answers = {
  async load({ files, seed }) {
    const mujoco = await loadMujoco({ wasmBinary: files["mujoco.wasm"], locateFile: (name) => name });
    session = await makeSession(mujoco, await makeMethod(files), unpacked(read(files["lab.json"])), seed);
  },
};

let turn = Promise.resolve();
addEventListener("message", ({ data: { id, what, more } }) => {
  turn = turn.then(async () => {
    try {
      const answer = await (answers[what] ?? session.actions[what])(more);
      postMessage({ id, answer: { answer, now: session.now(), aim: session.aim() } });
    } catch (error) {
      postMessage({ id, error: `${error.message ?? error}`, name: error.constructor?.name });
    }
  });
});
