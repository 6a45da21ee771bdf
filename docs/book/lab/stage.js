// Where the parts of a scene are now, as plain data: the points of the cloth, and both ends of each rod.
function makeStage({ points, rods }) {
  function ends({ geom, half }, { geom_xpos, geom_xmat }) {
    const centre = three(geom_xpos, geom);
    const along = [2, 5, 8].map((k) => half * geom_xmat[9 * geom + k]); // its z axis
    return [-1, 1].map((side) => centre.map((x, i) => x + side * along[i]));
  }
  return (data) => ({
    points: points.map((body) => three(data.xpos, body)),
    ends: rods.map((rod) => ends(rod, data)),
  });
}
