// The page "Throw a cloth": the panel with a robot that runs in a worker.
const ARM = "torque"; // the first
const PARTS = [ARM, "worker", "mujoco", "onnxruntime"]; // scripts, with the files of a robot
const place = document.getElementById("clothlab-lab");
const folder = document.currentScript.src.replace(/[^/]*$/, "");
const note = make("span", { role: "status" });
const again = make("button", { type: "button", textContent: "Try again", onclick: begin });
const el = make("div");

// Why no robot can run in this browser; empty where one can.
function lacking() {
  if (typeof WebAssembly === "undefined") return "this browser has no WebAssembly";
  if (navigator.deviceMemory < 1) return "this machine has less than 1 GB of memory";
  return "";
}
// The files of a part of the page, by name.
async function filesOf(part) {
  await loadScript(`${folder}${part}.js`);
  const files = {};
  const names = Object.keys(globalThis.clothlabFiles).filter((name) => name.startsWith(part));
  for (const name of names) files[name] = await unpackedFile(name).arrayBuffer();
  return files;
}
async function live() {
  if (lacking()) throw new Error(lacking());
  const parts = await Promise.allSettled(PARTS.map(filesOf)); // none is under way when another try begins
  const failed = parts.find(({ reason }) => reason);
  if (failed) throw failed.reason;
  const { "worker.js": worker, ...files } = Object.assign({}, ...parts.map(({ value }) => value));
  const { ask, first } = await startRobot(new TextDecoder().decode(worker), { name: ARM, files });
  return liveLab(ask, first, filesOf);
}
async function begin() {
  again.hidden = true;
  note.textContent = "The robot is being loaded …";
  try {
    place.model = await live(); // also for tests, and for those who look behind the page
    render({ model: place.model, el });
    note.textContent = "";
  } catch (error) {
    note.textContent = `The robot can't run here: ${error.message || "it fails, and does not say why"}. `;
    again.hidden = lacking() !== "";
  }
}

place.replaceChildren(make("p", {}, note, again), el);
document.addEventListener("visibilitychange", () => document.hidden && place.model?.rest());
begin();
