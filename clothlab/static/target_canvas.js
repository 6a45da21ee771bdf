// A target to draw: 128×96 pixels, brush and eraser. What is drawn goes to Python when the pointer is lifted.
// Below it a gallery of targets to choose from.
const WIDTH = 128, HEIGHT = 96, SCALE = 2.4, SMALL = 0.44;

function paint(ctx, pixels) {
  const image = ctx.createImageData(WIDTH, HEIGHT);
  pixels.forEach((on, i) => image.data.set([on ? 255 : 20, on ? 255 : 20, on ? 255 : 20, 255], 4 * i));
  ctx.putImageData(image, 0, 0);
}

function render({ model, el }) {
  const canvas = document.createElement("canvas");
  canvas.width = WIDTH;
  canvas.height = HEIGHT;
  canvas.tabIndex = 0;
  canvas.className = "clothlab-target";
  canvas.setAttribute("role", "application");
  canvas.setAttribute("aria-label", "target: draw with the pointer, or move with the arrow keys and paint with space");
  canvas.style.cssText = `width:${WIDTH * SCALE}px;height:${HEIGHT * SCALE}px;image-rendering:pixelated;border:1px solid #888;touch-action:none`;
  el.appendChild(canvas);
  const ctx = canvas.getContext("2d", { willReadFrequently: true });
  let pixels = new Uint8Array(WIDTH * HEIGHT), cursor = [WIDTH / 2, HEIGHT / 2], last = null;

  function show() {
    paint(ctx, pixels);
    if (document.activeElement === canvas) {
      ctx.strokeStyle = model.get("erase") ? "#E69F00" : "#56B4E9";
      const r = model.get("brush");
      ctx.strokeRect(cursor[0] - r, cursor[1] - r, 2 * r, 2 * r);
    }
  }
  function dab(cx, cy) {
    const r = model.get("brush"), value = model.get("erase") ? 0 : 1;
    for (let y = Math.max(0, Math.floor(cy - r)); y <= Math.min(HEIGHT - 1, cy + r); y++)
      for (let x = Math.max(0, Math.floor(cx - r)); x <= Math.min(WIDTH - 1, cx + r); x++)
        if ((x - cx) ** 2 + (y - cy) ** 2 <= r * r) pixels[y * WIDTH + x] = value;
  }
  function stroke(to) {
    const from = last ?? to, steps = Math.ceil(Math.hypot(to[0] - from[0], to[1] - from[1])) + 1;
    for (let k = 0; k <= steps; k++) dab(from[0] + ((to[0] - from[0]) * k) / steps, from[1] + ((to[1] - from[1]) * k) / steps);
    last = to;
    show();
  }
  function send() {
    last = null;
    model.set("drawn", new DataView(pixels.slice().buffer));
    model.save_changes();
  }
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * WIDTH, ((event.clientY - box.top) / box.height) * HEIGHT];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    stroke(at(event));
  });
  canvas.addEventListener("pointermove", (event) => last && stroke(at(event)));
  canvas.addEventListener("pointerup", () => last && send());
  canvas.addEventListener("pointercancel", () => last && send());
  canvas.addEventListener("keydown", (event) => {
    const moves = { ArrowLeft: [-2, 0], ArrowRight: [2, 0], ArrowUp: [0, -2], ArrowDown: [0, 2], " ": [0, 0] };
    if (!(event.key in moves)) return;
    event.preventDefault();
    event.stopPropagation();
    const move = moves[event.key];
    cursor = [Math.min(WIDTH, Math.max(0, cursor[0] + move[0])), Math.min(HEIGHT, Math.max(0, cursor[1] + move[1]))];
    if (event.key === " ") {
      stroke(cursor);
      send();
    }
    show();
  });
  canvas.addEventListener("focus", show);
  canvas.addEventListener("blur", show);
  function take() {
    const view = model.get("shown");
    if (view && view.byteLength === pixels.length) pixels = new Uint8Array(view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength));
    show();
  }
  const gallery = document.createElement("div");
  gallery.style.cssText = "display:flex;flex-wrap:wrap;gap:2px";
  el.appendChild(gallery);
  function hang() {
    gallery.replaceChildren(
      ...model.get("gallery").map(({ name, image }) => {
        const button = document.createElement("button"), picture = document.createElement("canvas");
        button.title = name;
        button.setAttribute("aria-label", `target: ${name}`);
        button.style.cssText = "padding:0;border:2px solid #ccc;background:none;cursor:pointer;line-height:0";
        picture.width = WIDTH;
        picture.height = HEIGHT;
        picture.style.width = `${WIDTH * SMALL}px`;
        paint(picture.getContext("2d"), new Uint8Array(image.buffer, image.byteOffset, image.byteLength));
        button.append(picture);
        button.addEventListener("click", () => model.send({ picked: name }));
        return button;
      })
    );
  }
  model.on("change:gallery", hang);
  hang();
  model.on("change:shown", take);
  for (const name of ["erase", "brush"]) model.on(`change:${name}`, show);
  take();
}

export default { render };
