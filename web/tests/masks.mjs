// What the camera sees of a scene in the states of a file: masks as strings of 0 and 1.
import { given, loaded, made, method } from "./given.mjs";

const mujoco = await loaded();
const { networks } = await method(given);
const { makePhysics, makeStage, makeCamera } = made("physics", "geometry", "stage", "camera");
const { scene } = given;
const { model, data } = makePhysics(mujoco, scene);
const look = makeStage(scene.shapes);
const picture = makeCamera(scene.camera, scene.shapes);
const masks = [];
for (const qpos of given.states) {
  data.qpos.set(qpos);
  mujoco.mj_forward(model, data);
  const { mask } = await networks.see(picture(look(data)));
  masks.push(mask.join(""));
}
console.log(JSON.stringify(masks));
