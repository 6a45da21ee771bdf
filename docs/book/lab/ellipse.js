// How far a push of 1 N from all around moves the hand [m], as data of Python's own `pushed_hand` on a grid.
// The shoulder turns the whole arm, and what moves its hand with it.
function makeEllipse({ elbows, softness, pushes }) {
  const size = pushes.length / (elbows.length * softness.length);
  const at = (i, j) => pushes.subarray((i * softness.length + j) * size, (i * softness.length + j + 1) * size);

  // Between which two of the grid, and at which share of the way.
  function place(x, grid) {
    const k = Math.max(
      1,
      grid.findIndex((each, k) => x <= each || k === grid.length - 1),
    );
    return [k - 1, Math.min(1, Math.max(0, (x - grid[k - 1]) / (grid[k] - grid[k - 1])))];
  }
  const mixed = (a, b, share) => a.map((x, k) => x + share * (b[k] - x));

  // For a posture [rad] and the tension of the muscles [N], displacements of the hand, forward and up.
  return function pushedHand([shoulder, elbow], tension) {
    const [i, along] = place(elbow, elbows);
    const [j, across] = place(1 / tension, softness);
    const nearer = mixed(at(i, j), at(i, j + 1), across);
    const values = mixed(nearer, mixed(at(i + 1, j), at(i + 1, j + 1), across), along);
    const [cos, sin] = [Math.cos(shoulder), -Math.sin(shoulder)]; // an angle grows downwards
    return Array.from({ length: size / 2 }, (_, k) => {
      const [x, y] = [values[2 * k], values[2 * k + 1]];
      return [cos * x - sin * y, sin * x + cos * y];
    });
  };
}

const ENLARGED = 10; // times, or nobody would see the ellipse
const SIGHT = { x: [-0.35, 1], y: [-0.75, 0.75] }; // [m], the same for every posture

// The arm, and ten times how far a push of 1 N moves its hand, as Python's `ellipse_at_hand` draws it.
function ellipsePicture({ link_length: link, lower, upper, ...grid }, canvas) {
  const ctx = canvas.getContext("2d");
  ctx.scale(SHARP, SHARP);
  const [width, height] = [canvas.width / SHARP, canvas.height / SHARP];
  const pushedHand = makeEllipse(grid);
  const edge = { left: 50, right: width - 5, top: 5, bottom: height - 45 }; // a metre is as long up as forward
  const along = (x, [low, high], from, to) => from + ((x - low) / (high - low)) * (to - from);
  const place = ([x, y]) => [along(x, SIGHT.x, edge.left, edge.right), along(y, SIGHT.y, edge.bottom, edge.top)];

  function drawAxes() {
    const { size, write, upwards } = writer(canvas, ctx);
    ctx.fillStyle = "#fff";
    ctx.fillRect(0, 0, width, height);
    ctx.strokeStyle = "#222";
    ctx.lineWidth = 1;
    ctx.strokeRect(edge.left, edge.top, edge.right - edge.left, edge.bottom - edge.top);
    for (const x of [0, 0.5, 1]) write(x, place([x, 0])[0], edge.bottom + 1.2 * size, { align: 0.5 });
    for (const y of [-0.5, 0, 0.5])
      write(`${y}`.replace("-", "−"), edge.left - 5, place([0, y])[1] + 0.35 * size, { align: 1 });
    write("forward [m]", (edge.left + edge.right) / 2, height - 0.5 * size, { align: 0.5 });
    upwards("up [m]", 1.1 * size, (edge.top + edge.bottom) / 2);
  }
  // Of the angles that are sent, and the tension.
  return function draw(angles, tension) {
    const [shoulder, elbow] = angles.map((x, k) => Math.min(upper[k], Math.max(lower[k], x)));
    const beyond = ([x, y], turned) => [x + link * Math.cos(turned), y - link * Math.sin(turned)];
    const middle = beyond([0, 0], shoulder);
    const hand = beyond(middle, shoulder + elbow);
    const around = pushedHand([shoulder, elbow], tension).map((pushed) => hand.map((x, i) => x + ENLARGED * pushed[i]));
    drawAxes();
    path(ctx, [[0, 0], middle, hand].map(place), "#999", 6);
    path(ctx, around.map(place), COLOURS[0], 2);
    return canvas;
  };
}
