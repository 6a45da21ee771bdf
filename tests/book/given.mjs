// What a script is given by a test: MuJoCo, the page's sources, and a file of JSON.
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [library, sources, file] = process.argv.slice(2);

export const given = JSON.parse(readFileSync(file, "utf8"));

export async function loaded() {
  const { default: loadMujoco } = await import(pathToFileURL(library));
  return loadMujoco();
}

// The functions of some of the page's sources, which are no modules.
export function made(...names) {
  const source = names.map((name) => readFileSync(`${sources}/${name}.js`, "utf8")).join("\n");
  const functions = [...source.matchAll(/^(?:async )?function (\w+)/gm)].map(([, each]) => each);
  return new Function(`${source}; return { ${functions.join(", ")} };`)();
}
