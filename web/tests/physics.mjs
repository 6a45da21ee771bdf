// Moves the scene of a file as its commands say: positions at the end of each control period, and what the arm senses.
import { given, loaded, made } from "./given.mjs";

const mujoco = await loaded();
const { makePhysics, makeArm } = made("physics", "arm");
const physics = makePhysics(mujoco, given.scene);
const arm = makeArm(given.scene.arm);
const found = given.commands.map((u) => {
  physics.advance(arm.sent(u));
  return { positions: [...physics.data.qpos], sensed: arm.sense(physics.data) };
});
physics.reset();
console.log(JSON.stringify({ found, again: [...physics.data.qpos] }));
physics.free();
