// What the robot's camera sees of the cloth. MuJoCo's WebAssembly has no renderer, so its skins and capsules are drawn
// here, with its lights, and how red they are; of that, the graph `see` makes a mask.

// Red beyond green, and beyond blue, of 255.
const excess = ([red, green, blue]) => [255 * (red - green), 255 * (red - blue)];

// Samples of a picture, at `places` of each pixel: how near they are, and how red beyond green and beyond blue.
function makeSamples([rows, columns], places) {
  const [nearness, green, blue] = [0, 1, 2].map(() => new Float32Array(rows * columns * places.length));
  function clear() {
    for (const each of [nearness, green, blue]) each.fill(0);
  }
  let bright = 1; // what inside(x, y) found last
  // Calls inside(x, y) in a box; it gives how near that is, 1 / m, or 0 outside.
  function fill([left, right, top, bottom], colour, inside) {
    for (let y = Math.max(0, Math.floor(top)); y <= Math.min(rows - 1, bottom); y++)
      for (let x = Math.max(0, Math.floor(left)); x <= Math.min(columns - 1, right); x++)
        places.forEach(([dx, dy], sample) => {
          const near = inside(x + dx, y + dy);
          const k = (y * columns + x) * places.length + sample;
          if (near <= nearness[k]) return;
          nearness[k] = near;
          green[k] = colour[0] * bright;
          blue[k] = colour[1] * bright;
        });
  }
  // Of a triangle, corners are [x, y, 1 / m, brightness], counterclockwise to those who see its front.
  function triangle([a, b, c], colour) {
    const area = areaOf([a, b, c]);
    if (area > -1e-9) return;
    const xs = [a[0], b[0], c[0]];
    const ys = [a[1], b[1], c[1]];
    fill([Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)], colour, (x, y) => {
      const u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area;
      const v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area;
      const w = 1 - u - v;
      if (u < 0 || v < 0 || w < 0) return 0;
      const near = u * a[2] + v * b[2] + w * c[2];
      bright = (u * a[2] * a[3] + v * b[2] * b[3] + w * c[2] * c[3]) / near;
      return near;
    });
  }
  // Of a ball, as it looks from afar.
  function ball([x, y, near], radius, focus, colour) {
    const r = radius * focus * near;
    bright = 1; // a grey is hardly more or less red in another light
    fill([x - r, x + r, y - r, y + r], colour, (atX, atY) => {
      const off = ((atX - x) ** 2 + (atY - y) ** 2) / (r * r);
      return off < 1 ? 1 / (1 / near - radius * Math.sqrt(1 - off)) : 0;
    });
  }
  return { clear, triangle, ball, seen: { green, blue } };
}

// Of a camera that sees shapes: the samples of a stage.
function makeCamera({ size, places, lights, ...view }, { sides, rods }) {
  const samples = makeSamples(size, places);
  const { focus, project } = makeProjection(view, size);

  function drawSide({ triangles, colour }, points) {
    const normals = pointNormals(points, triangles);
    const corners = points.map((point, k) => [...project(point), brightness(normals[k], lights)]);
    for (const [a, b, c] of triangles) samples.triangle([corners[a], corners[b], corners[c]], excess(colour));
  }
  function drawCapsule({ radius, colour }, [from, to]) {
    const count = Math.ceil((2 * Math.hypot(...minus3(to, from))) / radius);
    for (let ball = 0; ball <= count; ball++)
      samples.ball(project(between(from, to, ball / count)), radius, focus, excess(colour));
  }
  return function look({ points, ends }) {
    samples.clear();
    for (const side of sides) drawSide(side, points);
    rods.forEach((rod, k) => rod.round && drawCapsule(rod, ends[k]));
    return samples.seen;
  };
}
