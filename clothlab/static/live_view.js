// Pictures and traces. Each frame is acknowledged after it is drawn: Python sends the next one only then, so that a slow
// browser drops frames and never queues them. No acknowledgement for a while means that the page is gone.
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"];
const DASHES = [[], [6, 3], [2, 3], [8, 3, 2, 3]];

function plot(canvas, { title, unit, lines, marks, limit }) {
  const ctx = canvas.getContext("2d"), { width, height } = canvas, left = 44, bottom = 16, top = 16;
  ctx.clearRect(0, 0, width, height);
  ctx.font = "10px sans-serif";
  ctx.fillStyle = "#222";
  ctx.fillText(`${title} [${unit}]`, left, 10);
  const values = lines.flatMap((line) => line.values).concat(limit ?? []);
  if (!values.length) return;
  const low = Math.min(0, ...values), high = Math.max(low + 1e-9, ...values), n = Math.max(...lines.map((line) => line.values.length), 2);
  const x = (k) => left + ((width - left - 6) * k) / (n - 1), y = (v) => height - bottom - ((height - bottom - top) * (v - low)) / (high - low);
  ctx.fillText(high.toPrecision(3), 2, top + 8);
  ctx.fillText(low.toPrecision(2), 2, height - bottom);
  ctx.fillText("now", width - 24, height - 3);
  ctx.strokeStyle = "#ddd";
  for (const k of marks ?? []) {
    ctx.beginPath();
    ctx.moveTo(x(k), top);
    ctx.lineTo(x(k), height - bottom);
    ctx.stroke();
  }
  if (limit !== undefined && limit !== null) {
    ctx.strokeStyle = "#888";
    ctx.setLineDash([3, 3]);
    ctx.beginPath();
    ctx.moveTo(left, y(limit));
    ctx.lineTo(width, y(limit));
    ctx.stroke();
  }
  lines.forEach((line, i) => {
    ctx.strokeStyle = ctx.fillStyle = COLOURS[i % COLOURS.length];
    ctx.setLineDash(DASHES[i % DASHES.length]);
    ctx.beginPath();
    line.values.forEach((v, k) => ctx.lineTo(x(k), y(v)));
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.fillText(line.name, left + 130 + 88 * i, 10);
  });
}

function render({ model, el }) {
  const box = document.createElement("div");
  box.style.cssText = "display:flex;flex-wrap:wrap;gap:8px;font:12px sans-serif";
  const pictures = {};
  for (const [name, caption, width] of [["scene", "the robot", 384], ["seen", "what the camera sees", 192], ["decoded", "what z says of it", 192]]) {
    const figure = document.createElement("figure");
    figure.style.margin = 0;
    pictures[name] = document.createElement("img");
    pictures[name].width = width;
    pictures[name].alt = caption;
    pictures[name].className = `clothlab-${name}`;
    const text = document.createElement("figcaption");
    text.textContent = caption;
    figure.append(pictures[name], text);
    box.append(figure);
  }
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
      canvas.width = 520;
      canvas.height = 84;
      canvas.style.display = "block";
      plots.append(canvas);
    }
    traces.forEach((trace, i) => plot(plots.children[i], trace));
    while (plots.children.length > traces.length) plots.lastChild.remove();
    box.dataset.frame = frame;
    model.set("acknowledged", frame);
    model.save_changes();
  }
  model.on("change:frame", draw);
  draw();
  return () => Object.values(urls).forEach((url) => URL.revokeObjectURL(url));
}

export default { render };
