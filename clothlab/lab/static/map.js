// The plane of p: trained materials as dots, the p in use as a cross with its trail and the region
// that holds it in nine cases of ten. A click or the arrow keys choose.
function placeLabel(width, [x, y], taken, size) {
  // Beside, above or below its dot, as near as it is inside and covers nothing yet.
  const around = (r) => [[r, 5], [-r - width, 5], [-width / 2, -r - 1], [-width / 2, r + 11], [r, -r], [r, r + 10], [-r - width, -r], [-r - width, r + 10]];
  const places = [10, 16, 22, 30].flatMap(around);
  const boxes = places.map(([dx, dy]) => [x + dx, y + dy - 12, x + dx + width, y + dy + 3]);
  const inside = (box) => box[0] > 2 && box[1] > 2 && box[2] < size - 2 && box[3] < size - 2;
  const free = (box) => !taken.some((other) => box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3]);
  const box = boxes.find((each) => inside(each) && free(each)) ?? boxes.find(inside) ?? boxes[0];
  taken.push(box);
  return [box[0], box[3] - 3];
}

function pbMap(choose, SIZE = 310) {
  const PAD = 26, SHARP = 2; // [CSS pixel], and canvas pixels to each
  const canvas = document.createElement("canvas"), ctx = canvas.getContext("2d");
  canvas.width = canvas.height = SIZE * SHARP;
  canvas.style.cssText = `width:${SIZE}px;height:${SIZE}px;cursor:crosshair;touch-action:none`;
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "application");
  canvas.setAttribute("aria-label", "map of the parametric bias p: click, or use the arrow keys, to set p");
  ctx.scale(SHARP, SHARP);
  let shown = { dots: [], reach: 1, axes: ["", ""], at: [0, 0], trail: [], region: [], held: "" };
  const half = SIZE / 2 - PAD;
  const toScreen = ([x, y]) => [SIZE / 2 + (x / shown.reach) * half, SIZE / 2 - (y / shown.reach) * half];

  function draw(news) {
    shown = { ...shown, ...news };
    ctx.fillStyle = "#fff";
    ctx.fillRect(0, 0, SIZE, SIZE);
    ctx.strokeStyle = "#ccc";
    ctx.strokeRect(PAD, PAD / 4, SIZE - 1.25 * PAD, SIZE - 1.25 * PAD);
    ctx.font = "14px sans-serif";
    ctx.fillStyle = "#222";
    ctx.textAlign = "center";
    ctx.fillText(shown.axes[0], SIZE / 2, SIZE - 6);
    ctx.save();
    ctx.translate(17, SIZE / 2);
    ctx.rotate(-Math.PI / 2);
    ctx.fillText(shown.axes[1], 0, 0);
    ctx.restore();
    ctx.textAlign = "left";
    const places = shown.dots.map(({ at }) => toScreen(at)), taken = places.map(([x, y]) => [x - 6, y - 6, x + 6, y + 6]);
    taken.push([0, 0, 24, SIZE], [0, SIZE - 22, SIZE, SIZE]); // the names of the axes
    ctx.font = "13px sans-serif";
    ctx.strokeStyle = "#0072B2";
    ctx.lineWidth = 2;
    ctx.beginPath();
    for (const point of [...shown.trail, shown.at]) ctx.lineTo(...toScreen(point));
    ctx.stroke();
    ctx.lineWidth = 1;
    shown.dots.forEach(({ name, label }, i) => {
      ctx.fillStyle = name === shown.held ? "#000" : "#ccc";
      ctx.strokeStyle = "#333";
      ctx.beginPath();
      ctx.arc(...places[i], 5.5, 0, 7);
      ctx.fill();
      ctx.stroke();
      ctx.fillStyle = "#222";
      const width = ctx.measureText(label).width, at = placeLabel(width, places[i], taken, SIZE), [x, y] = places[i];
      const near = [Math.min(Math.max(x, at[0]), at[0] + width), Math.min(Math.max(y, at[1] - 10), at[1])];
      if (Math.hypot(near[0] - x, near[1] - y) > 13) {
        ctx.strokeStyle = "#555"; // so far away that a line has to say whose label it is
        ctx.beginPath();
        ctx.moveTo(x, y);
        ctx.lineTo(...near);
        ctx.stroke();
      }
      ctx.strokeStyle = "#fff"; // a rim, because the trail may run below
      ctx.lineWidth = 3;
      ctx.strokeText(label, ...at);
      ctx.lineWidth = 1;
      ctx.fillText(label, ...at);
    });
    if (shown.region.length) {
      ctx.strokeStyle = "#D55E00";
      ctx.lineWidth = 1.5;
      ctx.setLineDash([5, 3]);
      ctx.beginPath();
      for (const point of shown.region) ctx.lineTo(...toScreen(point));
      ctx.stroke();
      ctx.setLineDash([]);
    }
    const [x, y] = toScreen(shown.at);
    ctx.strokeStyle = "#D55E00";
    ctx.lineWidth = 3.5;
    ctx.beginPath();
    for (const [dx, dy] of [[1, 0], [0, 1]]) {
      ctx.moveTo(x - 9 * dx, y - 9 * dy);
      ctx.lineTo(x + 9 * dx, y + 9 * dy);
    }
    ctx.stroke();
    ctx.lineWidth = 1;
  }
  canvas.addEventListener("click", (event) => {
    const box = canvas.getBoundingClientRect(), scale = SIZE / box.width;
    const x = (event.clientX - box.left) * scale - SIZE / 2, y = SIZE / 2 - (event.clientY - box.top) * scale;
    choose([(x / half) * shown.reach, (y / half) * shown.reach]);
  });
  canvas.addEventListener("keydown", (event) => {
    const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!move) return;
    event.preventDefault();
    event.stopPropagation(); // the notebook would move to another cell
    const at = shown.at.map((x, k) => x + (move[k] * shown.reach) / 20);
    draw({ at }); // so that the next press starts from here
    choose(at);
  });
  return { canvas, draw };
}
