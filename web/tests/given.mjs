// What a script is given by a test: MuJoCo, the page's sources, and a file of JSON.
import { createRequire } from "node:module";
import { readFileSync, readdirSync } from "node:fs";
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

// The networks of an arm, and the constants beside them, from a folder.
export async function method({ runtime, folder }) {
  const ort = createRequire(import.meta.url)(`${runtime}/ort.wasm.min.js`);
  ort.env.wasm.wasmPaths = pathToFileURL(`${runtime}/`).href;
  ort.env.wasm.numThreads = 1;
  const { makeNetworks, unpacked } = made("files", "networks");
  const { constants, ...graphs } = Object.fromEntries(
    readdirSync(folder).map((name) => [name, readFileSync(`${folder}/${name}`)]),
  );
  return { constants: unpacked(JSON.parse(constants)), networks: await makeNetworks(ort, graphs) };
}
