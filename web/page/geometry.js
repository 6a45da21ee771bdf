// What both the page and its worker need: distances, limits, and a camera in space with which a mask and a
// picture are made: vectors, a pinhole, and how bright a surface is.
const distanceBetween = (a, b) => Math.hypot(...a.map((x, k) => x - b[k]));
const dot3 = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const minus3 = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross3 = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const three = (values, k) => [values[3 * k], values[3 * k + 1], values[3 * k + 2]];
// Commands, one or several behind each other, between the limits of an arm.
const clamped = (u, { lower, upper }) =>
  u.map((x, k) => Math.min(Math.max(x, lower[k % lower.length]), upper[k % upper.length]));

// Where a point of the world is in a picture of this size: x, y [pixel], and how near that is [1 / m].
function makeProjection({ eye, axes, fovy }, [height, width]) {
  const focus = (0.5 * height) / Math.tan((fovy * Math.PI) / 360);
  const [right, up, backward] = axes;
  return function project(point) {
    const from = minus3(point, eye);
    const near = -1 / dot3(from, backward);
    return [width / 2 + focus * near * dot3(from, right), height / 2 - focus * near * dot3(from, up), near];
  };
}

// Of a surface with this normal, whatever its length.
function brightness(normal, { ambient, beams }) {
  const length = Math.hypot(...normal);
  return beams.reduce((sum, [beam, diffuse]) => sum + (diffuse * Math.max(0, dot3(normal, beam))) / length, ambient);
}

// Of three places in a picture, twice the area between them: negative where they go round as the clock does not.
const areaOf = ([a, b, c]) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);

// The normals of points that triangles join; a large triangle counts for more.
function pointNormals(points, triangles) {
  const normals = points.map(() => [0, 0, 0]);
  for (const [a, b, c] of triangles) {
    const normal = cross3(minus3(points[b], points[a]), minus3(points[c], points[a]));
    for (const k of [a, b, c]) normal.forEach((x, i) => (normals[k][i] += x));
  }
  return normals;
}
