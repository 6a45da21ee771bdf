// The graphs that Python exported of its own functions, in onnxruntime, and the weights that they share. Each becomes a
// function that takes numbers by name and promises those that come out, by name.

// Large graphs that not every session needs are prepared when they are first asked.
const LATER = ["teach", "distance", "improve"];

async function makeNetworks(ort, { weights, ...graphs }) {
  const externalData = [{ path: "weights", data: weights }];
  const kinds = { float32: Float32Array, float64: Float64Array };

  // Where a graph takes a fixed count, there may be fewer numbers; those that are not given are zeros.
  function tensorOf({ name, type, shape }, values) {
    const known = shape.reduce((product, length) => product * (Number(length) || 1), 1);
    const dims = shape.map((length) => (typeof length === "number" ? length : values.length / known));
    const numbers = new kinds[type](Math.max(known, values.length));
    numbers.set(values);
    return new ort.Tensor(type, numbers, dims);
  }
  // Python has looked for what can be simplified; more of it takes longer than it saves. Only errors are spoken of.
  const options = {
    ...{ executionProviders: ["wasm"], graphOptimizationLevel: "basic" },
    ...{ externalData, logSeverityLevel: 3 },
  };
  async function network(name) {
    const prepare = () => ort.InferenceSession.create(graphs[name], options);
    let session = LATER.includes(name) ? null : await prepare();
    return async (inputs) => {
      session ??= await prepare();
      const feeds = session.inputMetadata.map((each) => [each.name, tensorOf(each, inputs[each.name])]);
      const found = await session.run(Object.fromEntries(feeds));
      return Object.fromEntries(Object.entries(found).map(([output, { data }]) => [output, data]));
    };
  }
  const made = Object.keys(graphs).map(async (name) => [name, await network(name)]);
  return Object.fromEntries(await Promise.all(made));
}
