// The graphs that Python exported of its own functions, in onnxruntime, and the weights that they share. Each becomes a
// function that takes numbers by name and promises those that come out, by name. It is prepared when it is first asked,
// or by its own `prepare`.
function makeNetworks(ort, { weights, ...graphs }) {
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
  const externalData = [{ path: "weights", data: weights }];
  const options = { executionProviders: ["wasm"], graphOptimizationLevel: "basic", externalData, logSeverityLevel: 3 };
  function network(graph) {
    const prepare = once(() => ort.InferenceSession.create(graph, options));
    async function ask(inputs) {
      const prepared = await prepare();
      const feeds = prepared.inputMetadata.map((each) => [each.name, tensorOf(each, inputs[each.name])]);
      const found = await prepared.run(Object.fromEntries(feeds));
      return Object.fromEntries(Object.entries(found).map(([output, { data }]) => [output, data]));
    }
    return Object.assign(ask, { prepare });
  }
  return Object.fromEntries(Object.entries(graphs).map(([name, graph]) => [name, network(graph)]));
}
