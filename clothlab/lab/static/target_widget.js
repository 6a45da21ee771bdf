// The canvas by itself: what is drawn goes to Python as the trait `chosen`.
function render({ model, el }) {
  const tool = { brush: 4, erase: false }, size = model.get("size");
  const send = (pixels) => {
    model.set("chosen", new DataView(pixels.buffer));
    model.save_changes();
  };
  const target = targetCanvas(size, tool, send);
  const button = (text, act) => {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = text;
    made.addEventListener("click", () => act(made));
    return made;
  };
  const erase = button("eraser", (self) => self.setAttribute("aria-pressed", (tool.erase = !tool.erase)));
  erase.setAttribute("aria-pressed", false);
  const clear = button("clear", () => {
    target.clear();
    send(new Uint8Array(size[0] * size[1]));
  });
  const style = document.createElement("style"), root = document.createElement("div"), row = document.createElement("div");
  style.textContent = ".clothlab-canvas button[aria-pressed=true] { background: #0072B2; color: #fff }";
  root.className = "clothlab-canvas";
  row.append(erase, " ", clear);
  root.append(style, target.canvas, row);
  el.append(root);
  target.put(bytesOf(model.get("chosen")));
}

export default { render };
