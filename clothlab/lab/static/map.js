// The plane of p: trained materials as dots, the p in use as a cross with its trail and the region
// that holds it in nine cases of ten. A click or the arrow keys choose.
function placeLabel(width, [x, y], taken, side, size) {
  // Beside, above or below its dot, as near as it is inside and covers nothing yet.
  const around = (r) => [[r, 0.35], [-r - width, 0.35], [-width / 2, -r / size], [-width / 2, r / size + 0.7], [r, -r / size], [r, r / size + 0.7], [-r - width, -r / size], [-r - width, r / size + 0.7]];
  const places = [0.75, 1.2, 1.7, 2.3, 3, 4, 5].flatMap((far) => around(far * size));
  const boxes = places.map(([dx, dy]) => [x + dx, y + (dy - 0.9) * size, x + dx + width, y + (dy + 0.25) * size]);
  const inside = (box) => box[0] > 2 && box[1] > 2 && box[2] < side - 2 && box[3] < side - 2;
  const free = (box) => !taken.some((other) => box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3]);
  const box = boxes.find((each) => inside(each) && free(each)) ?? boxes.find(inside) ?? boxes[0];
  taken.push(box);
  return [box[0], box[3] - 0.25 * size];
}

function pbMap(choose) {
  const SIDE = 310; // [CSS pixel]
  const SHARP = 2; // canvas pixels to each CSS pixel
  const canvas = document.createElement("canvas"), ctx = canvas.getContext("2d");
  canvas.className = "map";
  canvas.style.cssText = "max-width:100%;aspect-ratio:1;cursor:crosshair;touch-action:none";
  canvas.style.setProperty("width", `var(--map, ${SIDE}px)`);
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "application");
  canvas.setAttribute("aria-label", "map of the parametric bias p: click, or use the arrow keys, to set p");
  let shown = { dots: [], reach: 1, axes: ["", ""], at: [0, 0], trail: [], region: [], held: "" };
  let side = SIDE, pad = 26; // [CSS pixel]
  const half = () => side / 2 - pad;
  const toScreen = ([x, y]) => [side / 2 + (x / shown.reach) * half(), side / 2 - (y / shown.reach) * half()];

  function draw(news) {
    shown = { ...shown, ...news };
    const symbol = shown.axes[0].split(" ").pop();
    if (symbol && symbol !== "p") canvas.setAttribute("aria-label", `map of ${symbol}: click, or use the arrow keys, to set ${symbol}`);
    side = canvas.clientWidth || SIDE;
    if (canvas.width !== side * SHARP) canvas.width = canvas.height = side * SHARP;
    ctx.setTransform(SHARP, 0, 0, SHARP, 0, 0);
    ctx.fillStyle = "#fff";
    ctx.fillRect(0, 0, side, side);
    const { size, thick, width, write, upwards } = writer(canvas, ctx), edge = 1.4 * size, dot = 0.4 * size, arm = 0.65 * size;
    pad = 1.9 * size;
    ctx.strokeStyle = "#ccc";
    ctx.strokeRect(pad, pad / 4, side - 1.25 * pad, side - 1.25 * pad);
    write(shown.axes[0], side / 2, side - 0.4 * size, { align: 0.5 });
    upwards(shown.axes[1], 1.1 * size, side / 2);
    const places = shown.dots.map(({ at }) => toScreen(at)), taken = places.map(([x, y]) => [x - dot, y - dot, x + dot, y + dot]);
    taken.push([0, 0, edge + 2, side], [0, side - edge, side, side]); // the names of the axes
    ctx.strokeStyle = "#0072B2";
    ctx.lineWidth = thick;
    ctx.beginPath();
    for (const point of [...shown.trail, shown.at]) ctx.lineTo(...toScreen(point));
    ctx.stroke();
    ctx.lineWidth = 1;
    const labels = shown.dots.map(({ name, label }, i) => {
      ctx.fillStyle = name === shown.held ? "#000" : "#ccc";
      ctx.strokeStyle = "#333";
      ctx.beginPath();
      ctx.arc(...places[i], dot, 0, 7);
      ctx.fill();
      ctx.stroke();
      const wide = width(label), at = placeLabel(wide, places[i], taken, side, size), [x, y] = places[i];
      const near = [Math.min(Math.max(x, at[0]), at[0] + wide), Math.min(Math.max(y, at[1] - 0.75 * size), at[1])];
      if (Math.hypot(near[0] - x, near[1] - y) > size) {
        ctx.strokeStyle = "#555"; // so far away that a line has to say whose label it is
        ctx.beginPath();
        ctx.moveTo(x, y);
        ctx.lineTo(...near);
        ctx.stroke();
      }
      return () => write(label, ...at, { rimmed: true });
    });
    labels.forEach((put) => put()); // over all lines
    if (shown.region.length) {
      ctx.strokeStyle = "#D55E00";
      ctx.lineWidth = 0.75 * thick;
      ctx.setLineDash([5, 3]);
      ctx.beginPath();
      for (const point of shown.region) ctx.lineTo(...toScreen(point));
      ctx.stroke();
      ctx.setLineDash([]);
    }
    const [x, y] = toScreen(shown.at);
    ctx.strokeStyle = "#D55E00";
    ctx.lineWidth = 1.75 * thick;
    ctx.beginPath();
    for (const [dx, dy] of [[1, 0], [0, 1]]) {
      ctx.moveTo(x - arm * dx, y - arm * dy);
      ctx.lineTo(x + arm * dx, y + arm * dy);
    }
    ctx.stroke();
    ctx.lineWidth = 1;
  }
  new ResizeObserver(() => draw({})).observe(canvas); // lets go of it with the canvas
  canvas.addEventListener("click", (event) => {
    const box = canvas.getBoundingClientRect(), scale = side / box.width;
    const x = (event.clientX - box.left) * scale - side / 2, y = side / 2 - (event.clientY - box.top) * scale;
    choose([(x / half()) * shown.reach, (y / half()) * shown.reach]);
  });
  canvas.dataset.lmSuppressShortcuts = "true"; // a notebook has its own use for arrows
  canvas.addEventListener("keydown", (event) => {
    const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!move) return;
    event.preventDefault();
    const at = shown.at.map((x, k) => x + (move[k] * shown.reach) / 20);
    draw({ at }); // so that the next press starts from here
    choose(at);
  });
  return { canvas, draw };
}
