// From a to b, at a share of the way.
const between = (a, b, share) => a.map((x, i) => x + (b[i] - x) * share);

// How far a push of 1 N from all around moves the hand [m], as data of Python's own `pushed_hand` on an even grid.
// The shoulder turns the whole arm, and what moves its hand with it.
function makeEllipse({ elbows, softness, count, pushes }) {
  const size = pushes.length / count ** 2;
  const at = (i, j) => pushes.subarray((i * count + j) * size, (i * count + j + 1) * size);
  // The first of two places of the grid, and the share of the way from there to the other.
  function place(x, [low, high]) {
    const along = Math.min(Math.max((x - low) / (high - low), 0), 1) * (count - 1);
    const first = Math.min(Math.floor(along), count - 2);
    return [first, along - first];
  }
  // For a posture [rad] and the tension of the muscles [N], displacements of the hand, forward and up.
  return function pushedHand([shoulder, elbow], tension) {
    const [i, along] = place(elbow, elbows);
    const [j, across] = place(1 / tension, softness);
    const [nearer, farther] = [i, i + 1].map((row) => between(at(row, j), at(row, j + 1), across));
    const values = between(nearer, farther, along);
    const [cos, sin] = [Math.cos(shoulder), -Math.sin(shoulder)]; // an angle grows downwards
    return Array.from({ length: size / 2 }, (_, k) => {
      const [x, y] = [values[2 * k], values[2 * k + 1]];
      return [cos * x - sin * y, sin * x + cos * y];
    });
  };
}

const ENLARGED = 10; // times, or nobody would see the ellipse

// The arm, and ten times how far a push of 1 N moves its hand, on the axes of Python's `ellipse_at_hand`. `drawn` is called
// when these are there.
function ellipsePicture({ link_length: link, axes, ...grid }, canvas, drawn) {
  const ctx = canvas.getContext("2d");
  const { width, height } = canvas;
  const pushedHand = makeEllipse(grid);
  const [left, right, bottom, top] = axes.edges; // shares of the picture, at the ends of both axes
  const place = ([x, y]) => [
    width * (left + ((right - left) * (x - axes.x[0])) / (axes.x[1] - axes.x[0])),
    height * (bottom + ((top - bottom) * (y - axes.y[0])) / (axes.y[1] - axes.y[0])),
  ];
  const empty = make("img", { src: URL.createObjectURL(new Blob([axes.picture])), onload: drawn });

  // Of the angles that are sent, and the tension.
  return function draw(angles, tension) {
    const [shoulder, elbow] = clamped(angles, grid);
    const beyond = ([x, y], turned) => [x + link * Math.cos(turned), y - link * Math.sin(turned)];
    const middle = beyond([0, 0], shoulder);
    const hand = beyond(middle, shoulder + elbow);
    const around = pushedHand([shoulder, elbow], tension).map((pushed) => hand.map((x, i) => x + ENLARGED * pushed[i]));
    ctx.drawImage(empty, 0, 0, width, height);
    path(ctx, [[0, 0], middle, hand].map(place), "#999", 6 * SHARP);
    path(ctx, around.map(place), COLOURS[0], 2 * SHARP);
    return canvas;
  };
}
