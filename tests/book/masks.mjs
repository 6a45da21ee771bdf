// What the camera sees of a scene in the states of a file: masks as strings of 0 and 1.
import { given, loaded, made } from "./given.mjs";

const mujoco = await loaded();
const { makePhysics, makeStage, makeCamera } = made("physics", "geometry", "stage", "camera");
const { model, data } = makePhysics(mujoco, given.scene);
const look = makeStage(mujoco, model);
const see = makeCamera(given.scene.camera);
const masks = given.states.map((qpos) => {
  data.qpos.set(qpos);
  mujoco.mj_forward(model, data);
  return see(look(data)).join("");
});
console.log(JSON.stringify(masks));
