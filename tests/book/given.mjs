// What a script is given by a test: MuJoCo, the page's sources, and a file of JSON.
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [library, sources, file] = process.argv.slice(2);

export async function loaded() {
  const { default: loadMujoco } = await import(pathToFileURL(library));
  return { mujoco: await loadMujoco(), given: JSON.parse(readFileSync(file, "utf8")) };
}

// The functions of one of the page's sources, which are no modules.
export function made(name) {
  const source = readFileSync(`${sources}/${name}.js`, "utf8");
  const names = [...source.matchAll(/^function (\w+)/gm)].map(([, each]) => each);
  return new Function(`${source}; return { ${names.join(", ")} };`)();
}
