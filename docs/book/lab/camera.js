// What the robot's camera sees of the cloth. MuJoCo's WebAssembly has no renderer, so its skins and capsules are drawn
// here, with its lights, and how red they are; then colour extraction, closing and opening as in `vision.py`.
// Of a pixel, where OpenGL has its four: sixteen in a grid close gaps behind the arm that a real picture leaves open.
const SAMPLES = [
  [0.375, 0.875],
  [0.875, 0.625],
  [0.125, 0.375],
  [0.625, 0.125],
];

const dot3 = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const minus3 = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross3 = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const three = (values, k) => [values[3 * k], values[3 * k + 1], values[3 * k + 2]];
// Red beyond green, and beyond blue, of 255.
const excess = (rgba, k) => [255 * (rgba[4 * k] - rgba[4 * k + 1]), 255 * (rgba[4 * k] - rgba[4 * k + 2])];

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

// `camera`: the size of a mask, the redness of cloth, and the kernel of closing and opening.
function makeCamera(mujoco, model, { size, redness, kernel }) {
  const [height, width] = size;
  const samples = makeSamples(height, width);
  const id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA.value, "camera");
  const focus = (0.5 * height) / Math.tan((model.cam_fovy[id] * Math.PI) / 360);
  const CAPSULE = mujoco.mjtGeom.mjGEOM_CAPSULE.value;
  const capsules = [...model.geom_type.keys()].filter((k) => model.geom_type[k] === CAPSULE);
  const part = (values, first, count) => [...values.subarray(first, first + count)];
  const skins = [...model.skin_facenum.keys()].map((k) => ({
    faces: part(model.skin_face, 3 * model.skin_faceadr[k], 3 * model.skin_facenum[k]),
    bodies: part(model.skin_bonebodyid, model.skin_boneadr[k], model.skin_bonenum[k]), // one for each vertex
    colour: excess(model.skin_rgba, k),
  }));
  const around = kernel.flatMap((row, j) =>
    row.flatMap((on, i) => (on ? [[j - (kernel.length >> 1), i - (row.length >> 1)]] : [])),
  );

  let eye = [0, 0, 0];
  let axes = []; // what is right, up and backward
  let ambient = 0;
  let beams = []; // of each light, where it comes from and how bright it is
  function look(data) {
    const turned = data.cam_xmat.subarray(9 * id, 9 * id + 9);
    const { headlight } = model.vis;
    eye = three(data.cam_xpos, id);
    axes = [0, 1, 2].map((k) => [turned[k], turned[3 + k], turned[6 + k]]);
    ambient = headlight.ambient[0];
    beams = [[axes[2], headlight.diffuse[0]]];
    for (const k of model.light_type.keys())
      beams.push([three(data.light_xdir, k).map((x) => -x), model.light_diffuse[3 * k]]);
  }
  // Of a surface with this normal, whatever its length.
  function brightness(normal) {
    const length = Math.hypot(...normal);
    return beams.reduce((sum, [beam, diffuse]) => sum + (diffuse * Math.max(0, dot3(normal, beam))) / length, ambient);
  }
  function project(point) {
    const from = minus3(point, eye);
    const near = -1 / dot3(from, axes[2]);
    return [width / 2 + focus * near * dot3(from, axes[0]), height / 2 - focus * near * dot3(from, axes[1]), near];
  }
  function drawSkin({ faces, bodies, colour }, { xpos }) {
    const points = bodies.map((body) => three(xpos, body));
    const normals = points.map(() => [0, 0, 0]);
    const places = points.map(project);
    const triangles = Array.from({ length: faces.length / 3 }, (_, k) => three(faces, k));
    for (const [a, b, c] of triangles) {
      const normal = cross3(minus3(points[b], points[a]), minus3(points[c], points[a]));
      for (const k of [a, b, c]) normal.forEach((x, i) => (normals[k][i] += x));
    }
    const bright = normals.map(brightness);
    for (const corners of triangles)
      samples.triangle(
        corners.map((k) => [...places[k], bright[k]]),
        colour,
      );
  }
  function drawCapsule(k, { geom_xpos, geom_xmat }) {
    const [radius, half] = three(model.geom_size, k);
    const centre = three(geom_xpos, k);
    const count = Math.ceil((4 * half) / radius);
    for (let ball = 0; ball <= count; ball++) {
      const along = half * ((2 * ball) / count - 1);
      const at = centre.map((x, i) => x + along * geom_xmat[9 * k + 3 * i + 2]); // along its z axis
      samples.ball(project(at), radius, focus, excess(model.geom_rgba, k));
    }
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
  // The mask of the cloth, row by row, of 0 and 1.
  return function see(data) {
    look(data);
    samples.clear();
    for (const skin of skins) drawSkin(skin, data);
    for (const k of capsules) drawCapsule(k, data);
    return [true, false, false, true].reduce(spread, extract()); // closing, then opening
  };
}
