// A scene in MuJoCo's WebAssembly. `scene`: its MJCF, where it starts, and the time steps of a control period.
function makePhysics(mujoco, { mjcf, start, substeps }) {
  const model = mujoco.MjModel.from_xml_string(mjcf);
  const data = new mujoco.MjData(model);

  function reset() {
    mujoco.mj_resetData(model, data);
    for (const name of ["qpos", "qvel", "act", "ctrl"]) if (start[name].length) data[name].set(start[name]);
    mujoco.mj_forward(model, data);
  }
  function advance(ctrl) {
    data.ctrl.set(ctrl);
    for (let k = 0; k < substeps; k++) mujoco.mj_step(model, data);
    mujoco.mj_forward(model, data); // positions of bodies, which the camera looks at, are those of now
  }
  // What lies in WebAssembly's memory is not collected by itself.
  function free() {
    data.delete();
    model.delete();
  }
  reset();
  return { model, data, reset, advance, free };
}
