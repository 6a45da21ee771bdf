// Images to aim at, and how well the network knows them: Python's `aim_at`, `known_target` and `chamfer_distance`.
// A mask has a number for each pixel, 0 or 1.
function iou(a, b) {
  let [common, union] = [0, 0];
  a.forEach((on, k) => {
    common += on & b[k];
    union += on | b[k];
  });
  return union ? common / union : 1;
}
// Of each pixel, the distance to the nearest one of a mask that is in its column [pixel].
function distancesInColumns(mask, width) {
  const found = Float32Array.from(mask, (on) => (on ? 0 : Infinity));
  for (let k = width; k < found.length; k++) found[k] = Math.min(found[k], found[k - width] + 1);
  for (let k = found.length - width - 1; k >= 0; k--) found[k] = Math.min(found[k], found[k + width] + 1);
  return found;
}
// Mean distance from the pixels of one mask to the nearest of the other, both ways [pixel].
function chamferDistance(a, b, [, width]) {
  function oneWay(from, to) {
    const inColumns = distancesInColumns(to, width);
    function nearest(k) {
      const [column, row] = [k % width, k - (k % width)];
      let least = Infinity;
      for (let x = 0; x < width; x++) least = Math.min(least, (x - column) ** 2 + inColumns[row + x] ** 2);
      return Math.sqrt(least);
    }
    const places = [...from.keys()].filter((k) => from[k]);
    return places.reduce((sum, k) => sum + nearest(k), 0) / places.length;
  }
  return (oneWay(a, b) + oneWay(b, a)) / 2;
}

// Looks at a target: what is aimed at is the mask, or a recorded image in its place, if that is more like it than what
// the autoencoder makes of it. Without a cloth in its reconstruction, the distance to that is infinite.
function makeAim(networks, { images, cannot_draw: cannotDraw, size }) {
  const encode = async (image) => (await networks.encode({ image })).z;

  return async function aimAt(mask) {
    if (!mask.includes(1)) throw new Refusal("no cloth in the image: the mask is empty");
    const understood = await encode(mask);
    const { image: reconstruction } = await networks.decode({ z: understood });
    const drawn = Uint8Array.from(reconstruction, (x) => x > 0.5);
    const own = iou(drawn, mask);
    const overlaps = images.map((image) => iou(image, mask));
    const overlap = Math.max(...overlaps);
    const replaced = own < cannotDraw && overlap > own;
    const known = replaced ? images[overlaps.indexOf(overlap)] : mask;
    const distance = drawn.includes(1) ? chamferDistance(mask, drawn, size) : Infinity;
    const z = replaced ? await encode(known) : understood;
    return { mask, known, z, reconstruction, distance, overlap };
  };
}
