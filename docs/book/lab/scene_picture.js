// The onlooker's picture of a stage: floor and shadow, arm and cloth, from far to near. The page draws it, so that the
// robot has its worker for itself.
const ROD_PARTS = 8; // of one, which may stand before the cloth or behind it
const ROUND = [-1, -0.8, -0.4, 0, 0.4, 0.8, 1]; // across a rod, where its shading is computed

const rgb = (colour, bright) => `rgb(${colour.map((x) => Math.min(255, 255 * x * bright)).join(" ")})`;

const mixed = (shares, corners) => [0, 1, 2].map((i) => corners.reduce((sum, at, k) => sum + shares[k] * at[i], 0));

// `view`: from where it is seen. `shapes`: what there is to see; each triangle of the cloth is cut into facets.
function scenePicture(canvas, { lights, backdrop, ...view }, { sides, rods, facets: fineFacets }) {
  const ctx = canvas.getContext("2d");
  const { width, height } = canvas;
  const { focus, project } = makeProjection(view, [height, width]);
  const { eye } = view;

  function polygon(places) {
    ctx.beginPath();
    for (const [x, y] of places) ctx.lineTo(x, y);
    ctx.closePath();
  }
  // The floor reaches to the horizon, and fades.
  const background = ctx.createLinearGradient(0, 0, 0, height);
  for (const [at, colour] of backdrop) background.addColorStop(at, rgb(colour, 1));
  // All shadows are one shape, or they would be darker where two of them meet.
  function drawShadows({ points, ends }) {
    const [sun] = lights.beams.at(-1);
    const onFloor = (point) => project([0, 1, 2].map((i) => point[i] - (point[2] / sun[2]) * sun[i]));
    const shape = new Path2D();
    function add(places) {
      const [first, ...others] = areaOf(places) < 0 ? [...places].reverse() : places; // or two would cancel each other
      shape.moveTo(...first.slice(0, 2));
      for (const [x, y] of others) shape.lineTo(x, y);
      shape.closePath();
    }
    for (const corners of sides[0].triangles) add(corners.map((k) => onFloor(points[k])));
    for (const [k, { radius }] of rods.entries()) {
      const [from, to] = ends[k];
      const across = cross3(minus3(to, from), sun);
      const wide = across.map((x) => (radius * x) / (Math.hypot(...across) || 1));
      const edge = (point, side) => onFloor(point.map((x, i) => x + side * wide[i]));
      add([edge(from, 1), edge(to, 1), edge(to, -1), edge(from, -1)]);
    }
    ctx.fillStyle = "rgb(40 45 60 / 0.2)";
    ctx.fill(shape);
  }
  // Of a cloth's side, the facets that are seen of it: how far each is, and what draws it.
  function facets({ triangles, colour }, points) {
    const normals = pointNormals(points, triangles);
    const seen = triangles.filter((corners) => areaOf(corners.map((k) => project(points[k]))) < 0);
    return seen.flatMap((corners) => {
      const [places3, around] = [points, normals].map((of) => corners.map((k) => of[k]));
      return fineFacets.map((fine) => {
        const places = fine.map((shares) => project(mixed(shares, places3)));
        const normal = mixed(mixed([1 / 3, 1 / 3, 1 / 3], fine), around);
        const draw = () => {
          polygon(places);
          ctx.fillStyle = ctx.strokeStyle = rgb(colour, brightness(normal, lights));
          ctx.lineWidth = 1; // closes the seams between facets
          ctx.fill();
          ctx.stroke();
        };
        return { near: (places[0][2] + places[1][2] + places[2][2]) / 3, draw };
      });
    });
  }
  function parts({ round, radius, colour }, [from, to]) {
    const along = minus3(to, from);
    const across = cross3(along, minus3(eye, from));
    const length = Math.hypot(...across) || 1;
    const side = across.map((x) => x / length);
    const towards = cross3(side, along).map((x) => x / (Math.hypot(...along) || 1));
    const normal = (at) => side.map((x, i) => at * x + Math.sqrt(1 - at * at) * towards[i]);
    const shades = ROUND.map((at) => rgb(colour, brightness(normal(at), lights)));
    return Array.from({ length: ROD_PARTS }, (_, k) => {
      const [begin, end] = [k, k + 1].map((each) => project(between(from, to, each / ROD_PARTS)));
      const near = (begin[2] + end[2]) / 2;
      const middle = between(from, to, (k + 0.5) / ROD_PARTS);
      const edge = (sign) => project(middle.map((x, i) => x + sign * radius * side[i]));
      const draw = () => {
        const [left, right] = [edge(-1), edge(1)];
        const shading = ctx.createLinearGradient(left[0], left[1], right[0], right[1]);
        ROUND.forEach((at, i) => shading.addColorStop((at + 1) / 2, shades[i]));
        ctx.strokeStyle = shading;
        ctx.lineWidth = 2 * radius * focus * near;
        ctx.lineCap = round ? "round" : "butt";
        ctx.beginPath();
        ctx.moveTo(begin[0], begin[1]);
        ctx.lineTo(end[0], end[1]);
        ctx.stroke();
      };
      return { near: 1 / (1 / near - radius), draw };
    });
  }
  return function draw(stage) {
    ctx.fillStyle = background;
    ctx.fillRect(0, 0, width, height);
    drawShadows(stage);
    const things = sides.flatMap((side) => facets(side, stage.points));
    things.push(...rods.flatMap((rod, k) => parts(rod, stage.ends[k])));
    things.sort((a, b) => a.near - b.near);
    for (const thing of things) thing.draw();
  };
}
