// The robot in its worker: a function that asks it something, and promises what it answers.
async function startRobot() {
  const source = await unpackedFile("worker.js").text();
  const address = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
  const worker = new Worker(address);
  const waiting = new Map(); // what to do with an answer, by the question's id
  let asked = 0;
  let failure = null; // of the worker itself, also before it was asked anything

  worker.addEventListener("message", ({ data: { id, answer, error } }) => {
    const { resolve, reject } = waiting.get(id);
    waiting.delete(id);
    if (error) reject(new Error(error));
    else resolve(answer);
  });
  worker.addEventListener("error", (event) => {
    failure = new Error(event.message || "the worker could not start");
    for (const { reject } of waiting.values()) reject(failure);
  });
  const ask = (what, more = {}) =>
    new Promise((resolve, reject) => {
      if (failure) throw failure;
      asked += 1;
      waiting.set(asked, { resolve, reject });
      worker.postMessage({ id: asked, what, more });
    });

  await ask("load", { wasm: await unpackedFile("mujoco.wasm").arrayBuffer() });
  URL.revokeObjectURL(address);
  return ask;
}
