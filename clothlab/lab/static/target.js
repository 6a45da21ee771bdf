// A target to draw on, with brush and eraser. What is drawn goes to Python when the pointer is lifted.
function paint(ctx, [width, height], pixels) {
  const image = ctx.createImageData(width, height);
  pixels.forEach((on, i) => image.data.set([on ? 255 : 20, on ? 255 : 20, on ? 255 : 20, 255], 4 * i));
  ctx.putImageData(image, 0, 0);
}

const bytesOf = (view) => new Uint8Array(view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength));

function targetCanvas(size, tool, drawn) {
  // tool: {brush, erase}, read at every stroke
  const [width, height] = size, SCALE = 2;
  const canvas = document.createElement("canvas"), ctx = canvas.getContext("2d", { willReadFrequently: true });
  canvas.width = width;
  canvas.height = height;
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "application");
  canvas.setAttribute("aria-label", "target: draw with the pointer, or move with the arrow keys and paint with space");
  canvas.style.cssText = `display:block;width:var(--target, ${width * SCALE}px);aspect-ratio:${width}/${height};image-rendering:pixelated;touch-action:none;cursor:crosshair`;
  let pixels = new Uint8Array(width * height), cursor = [width / 2, height / 2], last = null;

  function show() {
    paint(ctx, size, pixels);
    if (document.activeElement !== canvas) return;
    const r = tool.brush;
    ctx.strokeStyle = tool.erase ? "#E69F00" : "#56B4E9";
    ctx.strokeRect(cursor[0] - r, cursor[1] - r, 2 * r, 2 * r);
  }
  function dab(cx, cy) {
    const r = tool.brush;
    for (let y = Math.max(0, Math.floor(cy - r)); y <= Math.min(height - 1, cy + r); y++)
      for (let x = Math.max(0, Math.floor(cx - r)); x <= Math.min(width - 1, cx + r); x++)
        if ((x - cx) ** 2 + (y - cy) ** 2 <= r * r) pixels[y * width + x] = tool.erase ? 0 : 1;
  }
  function stroke(to) {
    const from = last ?? to, steps = Math.ceil(Math.hypot(to[0] - from[0], to[1] - from[1])) + 1;
    for (let k = 0; k <= steps; k++) dab(from[0] + ((to[0] - from[0]) * k) / steps, from[1] + ((to[1] - from[1]) * k) / steps);
    last = cursor = to;
    show();
  }
  function finish() {
    if (!last) return;
    last = null;
    drawn(pixels.slice());
  }
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    stroke(at(event));
  });
  canvas.addEventListener("pointermove", (event) => last && stroke(at(event)));
  canvas.addEventListener("pointerup", finish);
  canvas.addEventListener("pointercancel", finish);
  canvas.dataset.lmSuppressShortcuts = "true"; // a notebook has its own use for arrows
  canvas.addEventListener("keydown", (event) => {
    const move = { ArrowLeft: [-2, 0], ArrowRight: [2, 0], ArrowUp: [0, -2], ArrowDown: [0, 2], " ": [0, 0] }[event.key];
    if (!move) return;
    event.preventDefault();
    cursor = [Math.min(width, Math.max(0, cursor[0] + move[0])), Math.min(height, Math.max(0, cursor[1] + move[1]))];
    show();
    if (event.key !== " ") return;
    stroke(cursor);
    finish();
  });
  canvas.addEventListener("focus", show);
  canvas.addEventListener("blur", show);
  const put = (image) => {
    pixels = image;
    show();
  };
  return { canvas, put, clear: () => put(new Uint8Array(width * height)) };
}

function galleryButtons(size, gallery, pick) {
  return gallery.map(({ name, image }) => {
    const button = document.createElement("button"), picture = document.createElement("canvas");
    button.type = "button";
    button.title = name;
    button.className = "picture";
    button.setAttribute("aria-label", `target: ${name}`);
    [picture.width, picture.height] = size;
    paint(picture.getContext("2d"), size, bytesOf(image));
    button.append(picture);
    button.addEventListener("click", () => pick(name));
    return button;
  });
}
