// What the panel shows of a session, as plain data: Python's `Views` and `traces`.

// The plots of a history, one below the other, as Python laid them out. `place`: where in a moment a line has its value. A
// fine line, as that of what was predicted, is there if anything is.
function traces(plots, { stillDistance }, history) {
  const at = (place) => history.map((moment) => place.reduce((found, name) => found[name], moment));
  const [first, ...others] = plots.map(({ lines, ...plot }) => {
    const drawn = lines.map(({ place, ...line }) => ({ ...line, values: at(place) }));
    return { ...plot, lines: drawn.filter(({ fine, values }) => !fine || values.some((each) => each !== null)) };
  });
  const pairs = history.flatMap(({ period: ended }, k) => (ended ? [[k, ended.predicted, ended.achieved]] : []));
  return [{ ...first, limit: ["hanging still", stillDistance], pairs }, ...others];
}

// Whether the arm can show a target and the autoencoder knows its shape, and the numbers that this rests on.
function targetView({ mask, reconstruction, distance, overlap }, { usual_distance: usual, reachable }) {
  const known = distance <= usual;
  const shown = overlap >= reachable ? "Reachable" : "Not reachable";
  const reach = known ? "Known shape" : shown;
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
