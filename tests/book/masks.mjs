// What the camera sees of a scene in the states of a file: masks as strings of 0 and 1.
import { given, loaded, made } from "./given.mjs";

const mujoco = await loaded();
const { makePhysics } = made("physics");
const { makeCamera } = made("camera");
const { model, data } = makePhysics(mujoco, given.scene);
const see = makeCamera(mujoco, model, given.scene.camera);
const masks = given.states.map((qpos) => {
  data.qpos.set(qpos);
  mujoco.mj_forward(model, data);
  return see(data).join("");
});
console.log(JSON.stringify(masks));
