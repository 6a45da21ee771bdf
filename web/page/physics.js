// A scene in MuJoCo's WebAssembly. `scene`: its MJCF, where it starts, the time steps of a control period, and those
// after which a cloth that was just put into the hand hangs still.
class SimulationError extends Error {}

function makePhysics(mujoco, { mjcf, start, substeps, settle = 0 }) {
  const model = mujoco.MjModel.from_xml_string(mjcf);
  const data = new mujoco.MjData(model);
  const STATE = ["qpos", "qvel", "act", "ctrl", "qacc_warmstart"];

  const kept = () => Object.fromEntries(STATE.map((name) => [name, Float64Array.from(data[name])]));
  function put(state) {
    mujoco.mj_resetData(model, data);
    for (const name of STATE) if (state[name]?.length) data[name].set(state[name]);
    mujoco.mj_forward(model, data);
  }
  function simulate(steps) {
    data.time = 1;
    for (let k = 0; k < steps; k++) mujoco.mj_step(model, data);
    // MuJoCo begins anew when a coordinate became infinite, NaN or absurdly large, and its time then does from 0
    if (data.time < 1 + (steps - 0.5) * model.opt.timestep) throw new SimulationError();
    mujoco.mj_forward(model, data); // positions of bodies, which the camera looks at, are those of now
  }
  // Holds a command for a control period. After an error, `put` what was `kept` before.
  function advance(ctrl) {
    data.ctrl.set(ctrl);
    simulate(substeps);
  }
  // What lies in WebAssembly's memory is not collected by itself.
  function free() {
    data.delete();
    model.delete();
  }
  let still = start;
  // Until a cloth that was just put into the hand hangs still; a reset leads there from then on.
  function hang() {
    simulate(settle);
    still = kept();
  }

  put(start);
  return { model, data, hang, reset: () => put(still), kept, put, advance, free };
}
