// The page "Throw a cloth": the panel with a live robot, or with the recorded run where the address asks for that, and
// where a robot can't run.
const RECORDED = "#recorded-run";
const ARM = "torque"; // the first
const PARTS = [ARM, "worker", "mujoco", "onnxruntime"]; // scripts, with the files of a robot
const place = document.getElementById("clothlab-lab");
const folder = document.currentScript.src.replace(/[^/]*$/, "");
const note = make("span", { role: "status" });
const other = make("a"); // leads to the other of the two
const el = make("div");
let failed = ""; // why there is no robot
let leave = () => {}; // takes a panel away

const load = (name) => loadScript(`${folder}${name}.js`);
const wantsRun = () => location.hash === RECORDED || failed !== "";
const recorded = once(async () => {
  await load("run");
  const { shots } = await unpackedFile("run.json").json();
  return recordedRun(shots);
});
// Why no robot can run in this browser; empty where one can.
function lacking() {
  if (typeof WebAssembly === "undefined") return "this browser has no WebAssembly";
  if (navigator.deviceMemory < 1) return "this machine has less than 1 GB of memory";
  return "";
}
// The files of a part of the page, by name.
async function filesOf(part) {
  await load(part);
  const files = {};
  const names = Object.keys(globalThis.clothlabFiles).filter((name) => name.startsWith(part));
  for (const name of names) files[name] = await unpackedFile(name).arrayBuffer();
  return files;
}
const live = once(async () => {
  if (lacking()) throw new Error(lacking());
  const parts = await Promise.allSettled(PARTS.map(filesOf)); // none is under way when another try begins
  const failed = parts.find(({ reason }) => reason);
  if (failed) throw failed.reason;
  const { "worker.js": worker, ...files } = Object.assign({}, ...parts.map(({ value }) => value));
  const { ask, first } = await startRobot(new TextDecoder().decode(worker), { name: ARM, files });
  return liveLab(ask, first, filesOf);
});

function show(model) {
  note.textContent = failed && `A live robot can't run here: ${failed}. This is a recorded run. `;
  if (place.model === model) return; // the address has changed, but not what is shown
  place.model?.rest();
  leave();
  place.model = model; // for tests, and for those who look behind the page
  leave = render({ model, el });
}
// There is a way to the other of the two, also while one is being loaded.
async function choose() {
  const chosen = wantsRun();
  other.textContent = failed ? "Try again." : chosen ? "Steer the robot yourself." : "Watch the recorded run.";
  other.href = chosen ? "#" : RECORDED;
  other.hidden = lacking() !== "";
  if (!chosen) note.textContent = "The robot is being loaded …";
  try {
    const model = await (chosen ? recorded() : live());
    if (chosen === wantsRun()) show(model);
  } catch (error) {
    const why = error.message || "it fails, and does not say why";
    if (chosen) note.textContent = `This browser can't play the recorded run: ${why}.`;
    else failed = why;
    if (!chosen) await choose();
  }
}
function tryAgain(event) {
  if (!failed) return;
  event.preventDefault(); // the link leads to the recorded run from now on
  failed = "";
  choose();
}

place.replaceChildren(make("p", {}, note, other), el);
other.addEventListener("click", tryAgain);
addEventListener("hashchange", choose);
document.addEventListener("visibilitychange", () => document.hidden && place.model?.rest());
choose();
