// A widget of the library has no JavaScript of ours: this one stands in it unseen, and watches the kernel for it.
function render({ model, el }) {
  el.style.display = "none";
  const stop = watchKernel(model, () => el.closest(".clothlab-widget"));
  return stop;
}

export default { render };
