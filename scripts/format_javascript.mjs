// Files as Prettier writes them: of each path, its text.
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [folder, ...files] = process.argv.slice(2);
const load = (name) => import(pathToFileURL(`${folder}/${name}.mjs`));
const prettier = await load("standalone");
const plugins = [await load("plugins/babel"), await load("plugins/estree")];
const written = {};
for (const file of files)
  written[file] = await prettier.format(readFileSync(file, "utf8"), { parser: "babel", printWidth: 120, plugins });
console.log(JSON.stringify(written));
