// Moves the scene of a file as its commands say: the positions at the end of each control period.
import { given, loaded, made } from "./given.mjs";

const mujoco = await loaded();
const { makePhysics } = made("physics");
const physics = makePhysics(mujoco, given.scene);
const positions = given.commands.map((ctrl) => {
  physics.advance(ctrl);
  return [...physics.data.qpos];
});
physics.reset();
console.log(JSON.stringify({ positions, again: [...physics.data.qpos] }));
physics.free();
