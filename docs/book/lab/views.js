// What the panel shows of a session, as plain data: Python's `Views` and `traces`.
const plot = (title, unit, lines, limit, pairs = []) => ({ title, unit, lines, limit, pairs });

// The plots of a history, one below the other. A line is named, and `of` gives its value at a moment.
function traces({ stillDistance }, history, { period, tension }) {
  const line = (name, of, colour = 0, { dash = 0, fine = false } = {}) => {
    return { name, values: history.map(of), colour, dash, fine };
  };
  const distances = [line("distance", (moment) => moment.distance)];
  const predicted = line("predicted at each step", (moment) => moment.predicted, 1, { dash: 1, fine: true });
  if (predicted.values.some((each) => each !== null)) distances.push(predicted);
  const pairs = history.flatMap(({ period: ended }, k) => (ended ? [[k, ended.predicted, ended.achieved]] : []));
  const angles = JOINTS.map((joint, j) => line(joint, (moment) => moment.theta[j], j));
  const sent = JOINTS.map((joint, j) => line(`${joint} ref`, (moment) => moment.command[j], j, { dash: 1 }));
  const stiffness = line("f_const", (moment) => moment.command.at(-1));
  const times = line("step", (moment) => 1e3 * moment.seconds);
  return [
    plot("distance to the target", "s.d. of z", distances, ["hanging still", stillDistance], pairs),
    plot("joint angles", "rad", [...angles, ...sent], null),
    ...(tension ? [plot("stiffness command", "N", [stiffness], null)] : []),
    plot("time a step took", "ms", [times], ["control period", 1e3 * period]),
  ];
}

// Whether the arm can show a target and the autoencoder knows its shape, and the numbers that this rests on.
function targetView({ mask, reconstruction, distance, overlap }, { usual_distance: usual, reachable }) {
  const known = distance <= usual;
  const reach = known ? "Known shape" : overlap >= reachable ? "Reachable" : "Not reachable";
  const away = Number.isFinite(distance) ? `${distance.toFixed(1)} pixel from the target` : "no cloth at all";
  return {
    image: mask,
    reconstruction,
    known,
    verdict: `${reach}. The autoencoder ${known ? "reproduces" : "does not reproduce"} it.`,
    reason:
      `Its reconstruction is ${away} (chamfer distance; 99 % of recorded images are below ` +
      `${usual.toFixed(1)}). The recorded image most like it has an IoU of ${overlap.toFixed(2)} with it.`,
  };
}

// The plane of the map: p of a place, and the place of p.
function makePlane({ mean, axes }) {
  const at = (p) => axes.map((axis) => axis.reduce((sum, x, k) => sum + x * (p[k] - mean[k]), 0));
  const p = (place) => mean.map((x, k) => x + axes.reduce((sum, axis, j) => sum + axis[k] * place[j], 0));
  return { at, p };
}

// What lies nearest to a place of the map.
function nearestDot(place, dots) {
  const gap = ({ at }) => distanceBetween(at, place);
  return dots.reduce((best, dot) => (gap(dot) < gap(best) ? dot : best));
}
