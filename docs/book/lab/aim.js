// Images to aim at, and how well the network understands them: Python's `aim_at`, `known_target` and `chamfer_distance`.
// A mask has a number for each pixel, 0 or 1.
function iou(a, b) {
  let [common, union] = [0, 0];
  a.forEach((on, k) => {
    common += on & b[k];
    union += on | b[k];
  });
  return union ? common / union : 1;
}
// Mean distance from the pixels of one mask to the nearest of the other, both ways [pixel].
function chamferDistance(a, b, [, width]) {
  const places = (mask) => [...mask.keys()].filter((k) => mask[k]).map((k) => [k % width, Math.floor(k / width)]);
  function oneWay(from, to) {
    const nearest = ([x, y]) =>
      to.reduce((least, at) => Math.min(least, (at[0] - x) ** 2 + (at[1] - y) ** 2), Infinity);
    return from.reduce((sum, place) => sum + Math.sqrt(nearest(place)), 0) / from.length;
  }
  const [these, those] = [places(a), places(b)];
  return (oneWay(these, those) + oneWay(those, these)) / 2;
}

// Looks at a target: what is aimed at is the mask, or a recorded image in its place, if that is more like it than what
// the autoencoder makes of it. Without a cloth in its reconstruction, the distance to that is infinite.
function makeAim(networks, { images, cannot_draw: cannotDraw, size }) {
  const encode = async (image) => (await networks.encode({ image })).z;

  return async function aimAt(mask) {
    if (!mask.includes(1)) throw new Error("no cloth in the image: the mask is empty");
    const own = await encode(mask);
    const { image: reconstruction } = await networks.decode({ z: own });
    const shape = Uint8Array.from(reconstruction, (x) => x > 0.5);
    const overlaps = images.map((image) => iou(image, mask));
    const overlap = Math.max(...overlaps);
    const drawn = iou(shape, mask);
    const replaced = drawn < cannotDraw && overlap > drawn;
    const known = replaced ? images[overlaps.indexOf(overlap)] : mask;
    const distance = shape.includes(1) ? chamferDistance(mask, shape, size) : Infinity;
    const z = replaced ? await encode(known) : own;
    return { mask, known, z, reconstruction, distance, overlap };
  };
}
