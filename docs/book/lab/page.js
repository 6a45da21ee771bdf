// The page "Throw a cloth": the panel with a live robot, or with the recorded run where the address asks for that, and
// where a robot can't run.
const RECORDED = "#recorded-run";
const PARTS = ["lab-data", "torque", "worker", "mujoco", "onnxruntime"]; // scripts with the files that a robot is made of
const place = document.getElementById("clothlab-lab");
const folder = document.currentScript.src.replace(/[^/]*$/, "");
const note = make("span", { role: "status" });
const other = make("a"); // leads to the other of the two
const el = make("div");
let impossible = ""; // why there is no robot here
let lab = null; // the model of the live lab
let leave = () => {}; // takes a panel away

const load = (name) => loadScript(`${folder}${name}.js`);
const wantsRun = () => location.hash === RECORDED || impossible !== "";
const once = (start) => {
  let started = null;
  return () => (started ??= start());
};
const text = (bytes) => new TextDecoder().decode(bytes);
function pageSeed() {
  return Number(new URLSearchParams(location.search).get("seed") ?? crypto.getRandomValues(new Uint32Array(1))[0]);
}

const recorded = once(async () => {
  await load("run");
  const { shots } = await (await unpackedFile("run.json")).json();
  return recordedRun(shots);
});
const live = once(async () => {
  if (typeof WebAssembly === "undefined") throw new Error("this browser has no WebAssembly");
  if (navigator.deviceMemory < 1) throw new Error("this machine has less than 1 GB of memory");
  const files = {};
  for (const [k, part] of PARTS.entries()) {
    note.textContent = `The robot is being loaded, part ${k + 1} of ${PARTS.length} …`;
    await load(part);
    for (const name of Object.keys(globalThis.clothlabFiles))
      files[name] = await (await unpackedFile(name)).arrayBuffer();
  }
  note.textContent = "The robot is being put together …";
  const { "worker.js": worker, ...others } = files;
  const about = unpacked(JSON.parse(text(files["lab.json"])));
  const { ask, first } = await startRobot(text(worker), others, pageSeed());
  return (lab = await liveLab(ask, first, { ...about, ...first.answer }));
});

function show(model, chosen) {
  leave();
  place.model = model; // for tests, and for those who look behind the page
  note.textContent = impossible && `A live robot can't run here: ${impossible}. This is a recorded run. `;
  other.textContent = chosen ? "Steer the robot yourself." : "Watch the recorded run.";
  other.href = chosen ? "#" : RECORDED;
  other.hidden = impossible !== "";
  leave = render({ model, el });
}
async function choose() {
  const chosen = wantsRun();
  lab?.pause();
  try {
    const model = await (chosen ? recorded() : live());
    if (chosen === wantsRun()) show(model, chosen);
  } catch (error) {
    if (chosen) note.textContent = `This browser can't play the recorded run: ${error.message}.`;
    else impossible = error.message;
    if (!chosen) await choose();
  }
}

place.replaceChildren(make("p", {}, note, other), el);
addEventListener("hashchange", choose);
choose();
