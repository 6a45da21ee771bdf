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
