// What there is to see of a scene now, as plain data: the camera, its lights, the two sides of the cloth, and rods.
function makeStage(mujoco, model) {
  const id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA.value, "camera");
  const { mjGEOM_CAPSULE, mjGEOM_CYLINDER } = mujoco.mjtGeom;
  const kinds = [mjGEOM_CAPSULE.value, mjGEOM_CYLINDER.value];
  const rods = [...model.geom_type.keys()].filter((k) => kinds.includes(model.geom_type[k]));
  const part = (values, first, count) => [...values.subarray(first, first + count)];
  const colour = (rgba, k) => part(rgba, 4 * k, 3);
  const skins = [...model.skin_facenum.keys()].map((k) => {
    const faces = part(model.skin_face, 3 * model.skin_faceadr[k], 3 * model.skin_facenum[k]);
    return {
      triangles: Array.from({ length: model.skin_facenum[k] }, (_, face) => three(faces, face)),
      bodies: part(model.skin_bonebodyid, model.skin_boneadr[k], model.skin_bonenum[k]), // one for each vertex
      colour: colour(model.skin_rgba, k),
    };
  });

  function seenFrom(data) {
    const turned = data.cam_xmat.subarray(9 * id, 9 * id + 9);
    const axes = [0, 1, 2].map((k) => [turned[k], turned[3 + k], turned[6 + k]]); // right, up and backward
    return { eye: three(data.cam_xpos, id), axes, fovy: model.cam_fovy[id] };
  }
  // Of each light, where it comes from and how bright it is.
  function lit(data, backward) {
    const { headlight } = model.vis;
    const towards = (k) => three(data.light_xdir, k).map((x) => -x);
    const others = [...model.light_type.keys()].map((k) => [towards(k), model.light_diffuse[3 * k]]);
    return { ambient: headlight.ambient[0], beams: [[backward, headlight.diffuse[0]], ...others] };
  }
  function rod(k, { geom_xpos, geom_xmat }) {
    const [radius, half] = three(model.geom_size, k);
    const centre = three(geom_xpos, k);
    const along = [0, 1, 2].map((i) => half * geom_xmat[9 * k + 3 * i + 2]); // its z axis
    const [from, to] = [-1, 1].map((side) => centre.map((x, i) => x + side * along[i]));
    return { round: model.geom_type[k] === kinds[0], from, to, radius, colour: colour(model.geom_rgba, k) };
  }
  return function look(data) {
    const { xpos } = data;
    const camera = seenFrom(data);
    return {
      camera,
      lights: lit(data, camera.axes[2]),
      skins: skins.map(({ bodies, ...each }) => ({ ...each, points: bodies.map((body) => three(xpos, body)) })),
      rods: rods.map((k) => rod(k, data)),
    };
  };
}
