// The plane of p: trained materials as dots, the p in use as a cross with its trail. A click or the arrow keys set p.
const SIZE = 320, PAD = 34, SHARP = 2;

// Beside, above or below its dot, wherever it covers nothing yet.
function placeLabel(width, [x, y], taken) {
  const places = [[9, 4], [-9 - width, 4], [-width / 2, -9], [-width / 2, 17], [7, -8], [7, 16]];
  const boxes = places.map(([dx, dy]) => [x + dx, y + dy - 10, x + dx + width, y + dy + 2]);
  const free = (box) => !taken.some((other) => box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3]);
  const box = boxes.find(free) ?? boxes[0];
  taken.push(box);
  return [box[0], box[3] - 2];
}

function render({ model, el }) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = SIZE * SHARP;
  canvas.style.width = canvas.style.height = `${SIZE}px`;
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "application");
  canvas.setAttribute("aria-label", "map of the parametric bias p: click, or use the arrow keys, to set p");
  canvas.className = "clothlab-map";
  canvas.style.cursor = "crosshair";
  el.appendChild(canvas);
  const ctx = canvas.getContext("2d");
  ctx.scale(SHARP, SHARP);

  const reach = () => model.get("reach");
  const toScreen = ([x, y]) => [SIZE / 2 + (x / reach()) * (SIZE / 2 - PAD), SIZE / 2 - (y / reach()) * (SIZE / 2 - PAD)];
  const toPlane = (x, y) => [((x - SIZE / 2) / (SIZE / 2 - PAD)) * reach(), ((SIZE / 2 - y) / (SIZE / 2 - PAD)) * reach()];

  function draw() {
    ctx.clearRect(0, 0, SIZE, SIZE);
    ctx.fillStyle = "#fff";
    ctx.fillRect(0, 0, SIZE, SIZE);
    ctx.strokeStyle = "#ccc";
    ctx.strokeRect(PAD / 2, PAD / 2, SIZE - PAD, SIZE - PAD);
    ctx.font = "12px sans-serif";
    ctx.fillStyle = "#222";
    ctx.fillText(model.get("labels")[0], SIZE / 2 - 30, SIZE - 4);
    ctx.fillText(`${model.get("held") && "● in the hand   "}+ p in use`, PAD / 2 + 6, PAD / 2 + 15);
    ctx.save();
    ctx.translate(12, SIZE / 2 + 30);
    ctx.rotate(-Math.PI / 2);
    ctx.fillText(model.get("labels")[1], 0, 0);
    ctx.restore();
    const materials = model.get("materials"), dots = materials.map(({ at }) => toScreen(at));
    const taken = dots.map(([x, y]) => [x - 6, y - 6, x + 6, y + 6]);
    ctx.font = "11px sans-serif";
    materials.forEach(({ name }, i) => {
      ctx.fillStyle = name === model.get("held") ? "#000" : "#ccc";
      ctx.strokeStyle = "#333";
      ctx.beginPath();
      ctx.arc(...dots[i], 5, 0, 7);
      ctx.fill();
      ctx.stroke();
      ctx.fillStyle = "#222";
      const label = name.replace("damp", "").replace("-mass", ", ");
      ctx.fillText(label, ...placeLabel(ctx.measureText(label).width, dots[i], taken));
    });
    ctx.strokeStyle = "#0072B2";
    ctx.beginPath();
    for (const point of model.get("trail")) ctx.lineTo(...toScreen(point));
    ctx.stroke();
    const [x, y] = toScreen(model.get("current"));
    ctx.strokeStyle = "#D55E00";
    ctx.lineWidth = 3;
    ctx.beginPath();
    ctx.moveTo(x - 8, y);
    ctx.lineTo(x + 8, y);
    ctx.moveTo(x, y - 8);
    ctx.lineTo(x, y + 8);
    ctx.stroke();
    ctx.lineWidth = 1;
  }

  function choose(at) {
    model.set("chosen", at);
    model.save_changes();
  }
  canvas.addEventListener("click", (event) => {
    const box = canvas.getBoundingClientRect();
    choose(toPlane(((event.clientX - box.left) * SIZE) / box.width, ((event.clientY - box.top) * SIZE) / box.height));
  });
  canvas.addEventListener("keydown", (event) => {
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (!(event.key in moves)) return;
    event.preventDefault();
    event.stopPropagation(); // the notebook would move to another cell
    const [x, y] = model.get("current"), step = reach() / 20;
    choose([x + moves[event.key][0] * step, y + moves[event.key][1] * step]);
  });
  for (const name of ["current", "trail", "materials", "held", "reach"]) model.on(`change:${name}`, draw);
  draw();
}

export default { render };
