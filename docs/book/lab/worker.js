// In a worker: MuJoCo, a cloth in the robot's hand, and the camera. Each question has an answer with the same id.
let mujoco = null;
let physics = null;
let see = null;

const seen = () => ({ qpos: Float64Array.from(physics.data.qpos), mask: see(physics.data) });
const answers = {
  async load({ wasm }) {
    mujoco = await loadMujoco({ wasmBinary: wasm, locateFile: (name) => name });
  },
  hold({ scene }) {
    const next = makePhysics(mujoco, scene); // if that fails, the robot keeps the cloth that it has
    physics?.free();
    physics = next;
    see = makeCamera(mujoco, physics.model, scene.camera);
    return seen();
  },
  reset() {
    physics.reset();
    return seen();
  },
  advance({ ctrl }) {
    physics.advance(ctrl);
    return seen();
  },
};

addEventListener("message", async ({ data: { id, what, more } }) => {
  try {
    postMessage({ id, answer: await answers[what](more) });
  } catch (error) {
    postMessage({ id, error: `${error.message ?? error}` });
  }
});
