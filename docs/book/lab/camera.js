// What the robot's camera sees of the cloth. MuJoCo's WebAssembly has no renderer, so its skins and capsules are drawn
// here, with its lights, and how red they are; then colour extraction, closing and opening as in `vision.py`.
// Of a pixel, where OpenGL has its four: sixteen in a grid close gaps behind the arm that a real picture leaves open.
const SAMPLES = [
  [0.375, 0.875],
  [0.875, 0.625],
  [0.125, 0.375],
  [0.625, 0.125],
];

// Red beyond green, and beyond blue, of 255.
const excess = ([red, green, blue]) => [255 * (red - green), 255 * (red - blue)];

// Samples of a picture: how near they are, and how red beyond green and beyond blue.
function makeSamples(rows, columns) {
  const [nearness, green, blue] = [0, 1, 2].map(() => new Float32Array(rows * columns * SAMPLES.length));
  function clear() {
    for (const each of [nearness, green, blue]) each.fill(0);
  }
  let bright = 1; // what inside(x, y) found last
  // Calls inside(x, y) in a box; it gives how near that is, 1 / m, or 0 outside.
  function fill([left, right, top, bottom], colour, inside) {
    for (let y = Math.max(0, Math.floor(top)); y <= Math.min(rows - 1, bottom); y++)
      for (let x = Math.max(0, Math.floor(left)); x <= Math.min(columns - 1, right); x++)
        SAMPLES.forEach(([dx, dy], sample) => {
          const near = inside(x + dx, y + dy);
          const k = (y * columns + x) * SAMPLES.length + sample;
          if (near <= nearness[k]) return;
          nearness[k] = near;
          green[k] = colour[0] * bright;
          blue[k] = colour[1] * bright;
        });
  }
  // Of a triangle, corners are [x, y, 1 / m, brightness], counterclockwise to those who see its front.
  function triangle([a, b, c], colour) {
    const area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if (area > -1e-9) return; // y points down
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
  // Of a pixel, red beyond green and blue, of 255.
  function mean(values, pixel) {
    let sum = 0;
    for (let sample = 0; sample < SAMPLES.length; sample++) sum += values[pixel * SAMPLES.length + sample];
    return sum / SAMPLES.length;
  }
  const redness = (pixel) => Math.min(mean(green, pixel), mean(blue, pixel));
  return { clear, triangle, ball, redness };
}

// Of a camera: the size of a mask, the redness of cloth, and the kernel of closing and opening.
function makeCamera({ size, redness, kernel }) {
  const [height, width] = size;
  const samples = makeSamples(height, width);
  const away = (j, i) => [j - (kernel.length >> 1), i - (kernel[0].length >> 1)]; // from its middle
  const around = kernel.flatMap((row, j) => row.flatMap((on, i) => (on ? [away(j, i)] : [])));

  function drawSkin({ triangles, points, colour }, { project }, lights) {
    const normals = pointNormals(points, triangles);
    const places = points.map((point, k) => [...project(point), brightness(normals[k], lights)]);
    for (const [a, b, c] of triangles) samples.triangle([places[a], places[b], places[c]], excess(colour));
  }
  function drawCapsule({ from, to, radius, colour }, { project, focus }) {
    const count = Math.ceil((2 * Math.hypot(...minus3(to, from))) / radius);
    for (let ball = 0; ball <= count; ball++)
      samples.ball(project(between(from, to, ball / count)), radius, focus, excess(colour));
  }
  const extract = () => new Uint8Array(height * width).map((_, pixel) => (samples.redness(pixel) > redness ? 1 : 0));
  // Dilation, or erosion, by the kernel, which is symmetric; outside of the picture is neither cloth nor none.
  function spread(mask, grows) {
    const next = mask.slice();
    for (let k = 0; k < mask.length; k++) {
      if (!mask[k]) continue;
      for (const [j, i] of around) {
        const y = Math.floor(k / width) + j;
        const x = (k % width) + i;
        if (y < 0 || y >= height || x < 0 || x >= width) continue;
        if (grows) next[y * width + x] = 1;
        else if (!mask[y * width + x]) next[k] = 0;
      }
    }
    return next;
  }
  // The mask of the cloth on a stage, row by row, of 0 and 1.
  return function see({ camera, lights, skins, rods }) {
    const projection = makeProjection(camera, [width, height]);
    samples.clear();
    for (const skin of skins) drawSkin(skin, projection, lights);
    for (const rod of rods) if (rod.round) drawCapsule(rod, projection);
    return [true, false, false, true].reduce(spread, extract()); // closing, then opening
  };
}
