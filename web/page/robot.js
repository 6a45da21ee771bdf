// The robot in its worker: a function that asks it something, and promises what it answers.
// `source`: what its worker does. `more`: with which it is asked to meet its first arm.
async function startRobot(source, more) {
  const address = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
  const worker = new Worker(address);
  const waiting = new Map(); // what to do with an answer, by the question's id
  let asked = 0;
  let failure = null; // of the worker itself, also before it was asked anything

  worker.addEventListener("message", ({ data: { id, error, ...answer } }) => {
    const { resolve, reject } = waiting.get(id);
    waiting.delete(id);
    if (error) reject(Object.assign(new Error(error.message), { name: error.name, now: answer.now }));
    else resolve(answer);
  });
  worker.addEventListener("error", (event) => {
    failure = new Error(event.message || "the worker could not start");
    for (const { reject } of waiting.values()) reject(failure);
  });
  const ask = (what, more = {}, handed = []) =>
    new Promise((resolve, reject) => {
      if (failure) throw failure;
      asked += 1;
      waiting.set(asked, { resolve, reject });
      worker.postMessage({ id: asked, what, more }, handed);
    });

  try {
    return { ask, first: await ask("set arm", more, Object.values(more.files)) };
  } catch (error) {
    worker.terminate();
    throw error;
  } finally {
    URL.revokeObjectURL(address);
  }
}
