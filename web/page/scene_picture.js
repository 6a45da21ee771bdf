// The onlooker's picture of a stage: floor and shadow, arm and cloth, from far to near. The page draws it, so that the
// robot has its worker for itself.
const rgb = (colour, bright) => `rgb(${colour.map((x) => Math.min(255, 255 * x * bright)).join(" ")})`;

const mixed = (shares, corners) => [0, 1, 2].map((i) => corners.reduce((sum, at, k) => sum + shares[k] * at[i], 0));

// `view`: from where it is seen. `surfaces`: what there is to see; each triangle is cut into facets.
function scenePicture(canvas, { lights, backdrop, ...view }, { surfaces }) {
  const ctx = canvas.getContext("2d");
  const { width, height } = canvas;
  const project = makeProjection(view, [height, width]);

  // On the canvas, or in a path.
  function outline(places, shape = ctx) {
    shape.moveTo(...places[0].slice(0, 2));
    for (const [x, y] of places.slice(1)) shape.lineTo(x, y);
    shape.closePath();
  }
  // The floor reaches to the horizon, and fades.
  const background = ctx.createLinearGradient(0, 0, 0, height);
  for (const [at, colour] of backdrop) background.addColorStop(at, rgb(colour, 1));
  // All shadows are one shape, or they would be darker where two of them meet: of triangles that face the sun.
  function drawShadows(stage) {
    const [sun] = lights.beams.at(-1);
    const onFloor = (point) => project(point.map((x, i) => x - (point[2] / sun[2]) * sun[i]));
    const shape = new Path2D();
    for (const { of, triangles } of surfaces) {
      const shadow = stage[of].map(onFloor);
      const outlines = triangles.map((corners) => corners.map((k) => shadow[k]));
      for (const places of outlines) if (areaOf(places) < 0) outline(places, shape);
    }
    ctx.fillStyle = "rgb(40 45 60 / 0.2)";
    ctx.fill(shape);
  }
  // The facets that are seen of a surface: how near each is, and what draws it.
  function seenFacets({ of, triangles, colour, facets }, stage) {
    const points = stage[of];
    const normals = pointNormals(points, triangles);
    const projected = points.map(project);
    const seen = triangles.filter((corners) => areaOf(corners.map((k) => projected[k])) < 0);
    return seen.flatMap((corners) => {
      const [places3, around] = [points, normals].map((each) => corners.map((k) => each[k]));
      return facets.map((fine) => {
        const places = fine.map((shares) => project(mixed(shares, places3)));
        const normal = mixed(mixed([1 / 3, 1 / 3, 1 / 3], fine), around);
        const draw = () => {
          ctx.beginPath();
          outline(places);
          ctx.fillStyle = ctx.strokeStyle = rgb(colour, brightness(normal, lights));
          ctx.lineWidth = 1; // closes the seams between facets
          ctx.fill();
          ctx.stroke();
        };
        return { near: (places[0][2] + places[1][2] + places[2][2]) / 3, draw };
      });
    });
  }
  return function draw(stage) {
    ctx.fillStyle = background;
    ctx.fillRect(0, 0, width, height);
    drawShadows(stage);
    const things = surfaces.flatMap((surface) => seenFacets(surface, stage));
    things.sort((a, b) => a.near - b.near);
    for (const thing of things) thing.draw();
  };
}
