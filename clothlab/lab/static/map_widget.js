// The map by itself: what is chosen goes to Python as the trait `chosen`.
function render({ model, el }) {
  const map = pbMap((at) => {
    model.set("chosen", at);
    model.save_changes();
  }, 420);
  const draw = () => {
    const { line, ...about } = model.get("about");
    map.draw({ ...about, trail: line, at: model.get("chosen") });
  };
  model.on("change:chosen", draw);
  model.on("change:about", draw);
  const root = document.createElement("div");
  root.append(map.canvas);
  el.append(root);
  draw();
}

export default { render };
