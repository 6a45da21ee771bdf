// The robot in its worker: a function that asks it something, and promises what it answers.
async function startRobot() {
  const source = await unpackedFile("worker.js").text();
  const address = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
  const worker = new Worker(address, { type: "module" });
  const waiting = new Map(); // what to do with an answer, by the question's id
  let asked = 0;

  worker.addEventListener("message", ({ data: { id, answer, error } }) => {
    const { resolve, reject } = waiting.get(id);
    waiting.delete(id);
    if (error) reject(new Error(error));
    else resolve(answer);
  });
  worker.addEventListener("error", (event) => {
    for (const { reject } of waiting.values()) reject(new Error(event.message || "the worker could not start"));
  });
  const ask = (what, more = {}) =>
    new Promise((resolve, reject) => {
      asked += 1;
      waiting.set(asked, { resolve, reject });
      worker.postMessage({ id: asked, what, more });
    });

  await ask("load", { wasm: await unpackedFile("mujoco.wasm").arrayBuffer() });
  URL.revokeObjectURL(address);
  return ask;
}
