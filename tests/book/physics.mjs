// Moves the scene of a file as its commands say; prints the positions at the end of each control period.
import { readFileSync } from "node:fs";

const [library, source, file] = process.argv.slice(2);
const { default: loadMujoco } = await import(library);
const makePhysics = new Function(`${readFileSync(source, "utf8")}; return makePhysics;`)();
const { scene, commands } = JSON.parse(readFileSync(file, "utf8"));
const physics = makePhysics(await loadMujoco(), scene);
const positions = commands.map((ctrl) => {
  physics.advance(ctrl);
  return [...physics.data.qpos];
});
physics.reset();
console.log(JSON.stringify({ positions, again: [...physics.data.qpos] }));
physics.free();
