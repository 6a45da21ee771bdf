// What the robot's camera sees of the cloth. MuJoCo's WebAssembly has no renderer, so surfaces are drawn here, with its
// lights, and how red they are; of that, the graph `see` makes a mask.

// Red beyond green, and beyond blue, of 255.
const excess = ([red, green, blue]) => [255 * (red - green), 255 * (red - blue)];

// Samples of a picture, at `places` of each pixel: how near they are, and how red beyond green and beyond blue.
function makeSamples([rows, columns], places) {
  const [nearness, green, blue] = [0, 1, 2].map(() => new Float32Array(rows * columns * places.length));
  function clear() {
    for (const each of [nearness, green, blue]) each.fill(0);
  }
  // Corners are [x, y, 1 / m, brightness], counterclockwise to those who see the front.
  function triangle([a, b, c], colour) {
    const area = areaOf([a, b, c]);
    if (area > -1e-9) return;
    const [left, top] = [0, 1].map((i) => Math.max(0, Math.floor(Math.min(a[i], b[i], c[i]))));
    const [right, bottom] = [columns, rows].map((size, i) => Math.min(size - 1, Math.max(a[i], b[i], c[i])));
    for (let row = top; row <= bottom; row++)
      for (let column = left; column <= right; column++)
        places.forEach(([dx, dy], sample) => {
          const [x, y] = [column + dx, row + dy];
          const u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area;
          const v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area;
          const w = 1 - u - v;
          if (u < 0 || v < 0 || w < 0) return;
          const near = u * a[2] + v * b[2] + w * c[2];
          const k = (row * columns + column) * places.length + sample;
          if (near <= nearness[k]) return;
          const bright = (u * a[2] * a[3] + v * b[2] * b[3] + w * c[2] * c[3]) / near;
          nearness[k] = near;
          green[k] = colour[0] * bright;
          blue[k] = colour[1] * bright;
        });
  }
  return { clear, triangle, seen: { green, blue } };
}

// Of a camera that sees surfaces: the samples of a stage.
function makeCamera({ size, places, lights, ...view }, { surfaces }) {
  const samples = makeSamples(size, places);
  const project = makeProjection(view, size);

  function drawSurface({ of, triangles, colour }, stage) {
    const normals = pointNormals(stage[of], triangles);
    const corners = stage[of].map((point, k) => [...project(point), brightness(normals[k], lights)]);
    for (const [a, b, c] of triangles) samples.triangle([corners[a], corners[b], corners[c]], excess(colour));
  }
  return function look(stage) {
    samples.clear();
    for (const surface of surfaces) drawSurface(surface, stage);
    return samples.seen;
  };
}
