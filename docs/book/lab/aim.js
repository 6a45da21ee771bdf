// Looks at a target, a number for each pixel, 0 or 1: Python's `aim_at`, which the graph `aim` is. What is aimed at is
// the mask, or a recorded image in its place. Without a cloth in its reconstruction, the distance to that is infinite.
function makeAim(networks, { images }) {
  return async function aimAt(mask) {
    if (!mask.includes(1)) throw new Refusal("no cloth in the image: the mask is empty");
    const { distance, overlap, ...aim } = await networks.aim({ image: mask, images });
    return { mask, ...aim, distance: distance[0], overlap: overlap[0] };
  };
}
