// Pictures and traces. Each frame is acknowledged after it is drawn: Python sends the next one only then, so that a slow
// browser drops frames and never queues them. No acknowledgement for a while means that the page is gone.
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"];
const DASHES = [[], [6, 3], [2, 3], [8, 3, 2, 3]];

const WIDTH = 470, HEIGHT = 84, SHARP = 2; // [CSS pixel], and canvas pixels to each, so that a projector shows no blur

function plot(canvas, { title, unit, lines, marks, limit }) {
  const ctx = canvas.getContext("2d"), left = 40, right = WIDTH - 6, bottom = HEIGHT - 14, top = 18;
  ctx.setTransform(SHARP, 0, 0, SHARP, 0, 0);
  ctx.fillStyle = "#fff";
  ctx.fillRect(0, 0, WIDTH, HEIGHT);
  ctx.font = "12px sans-serif";
  ctx.fillStyle = "#222";
  ctx.fillText(`${title} [${unit}]`, left, 12);
  let legend = left + ctx.measureText(`${title} [${unit}]`).width + 16;
  const values = lines.flatMap((line) => line.values).concat(limit ?? []);
  if (!values.length) return;
  const low = Math.min(0, ...values), high = Math.max(low + 1e-9, ...values), n = Math.max(...lines.map((line) => line.values.length), 2);
  const x = (k) => left + ((right - left) * k) / (n - 1), y = (v) => bottom - ((bottom - top) * (v - low)) / (high - low);
  ctx.font = "11px sans-serif";
  ctx.fillText(+high.toPrecision(3), 2, top + 8);
  ctx.fillText(+low.toPrecision(2), 2, bottom);
  ctx.fillText("now", right - 20, HEIGHT - 2);
  ctx.fillText(`${(n - 1) / 5} s ago`, left, HEIGHT - 2);
  const rule = (from, to, colour, dashes) => {
    ctx.strokeStyle = colour;
    ctx.setLineDash(dashes);
    ctx.beginPath();
    ctx.moveTo(...from);
    ctx.lineTo(...to);
    ctx.stroke();
  };
  for (const k of marks) rule([x(k), top], [x(k), bottom], "#ccc", []);
  if (limit !== null) rule([left, y(limit)], [right, y(limit)], "#666", [3, 3]);
  ctx.lineWidth = 1.5;
  lines.forEach((line, i) => {
    ctx.strokeStyle = COLOURS[i % COLOURS.length];
    ctx.setLineDash(DASHES[i % DASHES.length]);
    ctx.beginPath();
    line.values.forEach((v, k) => ctx.lineTo(x(k), y(v)));
    ctx.stroke();
    if (lines.length === 1) return; // the title says it
    rule([legend, 8], [legend + 18, 8], ctx.strokeStyle, DASHES[i % DASHES.length]);
    ctx.fillStyle = "#222";
    ctx.fillText(line.name, legend + 21, 12);
    legend += 29 + ctx.measureText(line.name).width;
  });
  ctx.lineWidth = 1;
  ctx.setLineDash([]);
}

function render({ model, el }) {
  const box = document.createElement("div");
  box.style.cssText = "display:flex;flex-wrap:wrap;gap:8px;font:12px sans-serif";
  const pictures = {}, captions = {}, side = document.createElement("div");
  for (const [name, caption, width] of [["scene", "the robot", 384], ["seen", "what the camera sees", 180], ["decoded", "what z says of it", 180]]) {
    const figure = document.createElement("figure");
    figure.style.margin = 0;
    pictures[name] = document.createElement("img");
    pictures[name].width = width;
    pictures[name].alt = caption;
    pictures[name].className = `clothlab-${name}`;
    captions[name] = document.createElement("figcaption");
    captions[name].textContent = caption;
    figure.append(pictures[name], captions[name]);
    (name === "scene" ? box : side).append(figure);
  }
  box.append(side);
  const plots = document.createElement("div");
  box.append(plots);
  el.append(box);
  const urls = {};

  function draw() {
    const frame = model.get("frame");
    for (const name of Object.keys(pictures)) {
      const bytes = model.get(name);
      if (!bytes || !bytes.byteLength) continue;
      if (urls[name]) URL.revokeObjectURL(urls[name]);
      urls[name] = URL.createObjectURL(new Blob([bytes], { type: name === "scene" ? "image/jpeg" : "image/png" }));
      pictures[name].src = urls[name];
    }
    const traces = model.get("traces");
    while (plots.children.length < traces.length) {
      const canvas = document.createElement("canvas");
      canvas.width = WIDTH * SHARP;
      canvas.height = HEIGHT * SHARP;
      canvas.style.cssText = `display:block;width:${WIDTH}px;height:${HEIGHT}px`;
      plots.append(canvas);
    }
    traces.forEach((trace, i) => plot(plots.children[i], trace));
    while (plots.children.length > traces.length) plots.lastChild.remove();
    captions.scene.textContent = `the robot, ${model.get("clock")}`;
    box.dataset.frame = frame;
    model.send({ drawn: frame });
  }
  model.on("change:frame", draw);
  draw();
  return () => Object.values(urls).forEach((url) => URL.revokeObjectURL(url));
}

export default { render };
