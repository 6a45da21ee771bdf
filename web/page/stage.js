// Where what is seen of a scene is now, as plain data: of each body the points of its surface, the cloth first.
function makeStage({ cloth, rods }) {
  function placed({ geom, surface }, { geom_xpos, geom_xmat }) {
    const centre = three(geom_xpos, geom);
    const rows = [0, 1, 2].map((i) => three(geom_xmat, 3 * geom + i));
    return surface.map((point) => centre.map((x, i) => x + dot3(rows[i], point)));
  }
  return (data) => [cloth.map((body) => three(data.xpos, body)), ...rods.map((rod) => placed(rod, data))];
}
