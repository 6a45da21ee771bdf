// Whether the kernel behind a widget still lives. A page can't know by itself: a dead kernel is only silent.
// So the page asks, and where no answer comes, it says so and switches off what would only pretend to work.
const GONE = "✗ The kernel behind this has stopped or does not answer: run the cells again.";
const LOOK_EVERY = 450; // [ms]
const PATIENCE = 3; // looks without a sign of life; the next one speaks, after 1.8 s at most
const NEVER_BACK = ["restarting", "autorestarting", "terminating", "dead"]; // what comes then knows no widgets of ours
const ALIVE_STYLE = `
.clothlab-gone-notice { font: 600 15px/1.4 system-ui, sans-serif; color: #b00020; background: #fdecee; border-left: 4px solid #b00020; padding: 2px 8px; margin: 4px 0; }
.clothlab.projector > .clothlab-gone-notice { font-size: 2.7vh; }
.clothlab-gone > [inert] { opacity: 0.35; }
.jp-OutputArea:has(.clothlab-alive) .clothlab-reopened { display: none; }
`;

// One for all widgets of a kernel. `kernel` is JupyterLab's; other pages have none that could be asked.
function makeHeart(kernel) {
  const watchers = new Set();
  let silent = 0, asked = false, over = false, timer = null; // looks since the last sign; whether it never comes back

  function hear() {
    silent = 0;
    asked = false;
    if (!over) tell(false);
  }
  function tell(gone) {
    for (const each of watchers) each.show(gone);
  }
  function ask() {
    // A server that stops idle kernels does not count this question as work. It waits for its turn in the kernel.
    if (kernel && (!asked || silent % (4 * PATIENCE) === 0)) {
      asked = true; // it can be lost with the connection, so it is asked again one day
      kernel.requestCommInfo({ target_name: "clothlab" }).then(hear, () => (asked = false));
    }
    // This one does count, but is answered in between, even by a kernel that is busy.
    if (!kernel || silent === 1) [...watchers].at(-1)?.ping();
  }
  function look() {
    if (kernel && (kernel.isDisposed || NEVER_BACK.includes(kernel.status))) over = true;
    if (over) return tell(true); // at every look, since a page may have drawn a widget anew
    ask();
    silent += 1;
    const waits = kernel?.status === "busy" && !kernel.supportsSubshells; // it answers when its cell is done
    tell(silent > PATIENCE && !waits);
  }
  function heed(_, status) {
    if (NEVER_BACK.includes(status)) over = true;
    if (over) tell(true);
  }
  function add(watcher) {
    watchers.add(watcher);
    if (timer !== null) return;
    silent = 0;
    kernel?.statusChanged?.connect(heed);
    timer = setInterval(look, LOOK_EVERY);
    setTimeout(look); // once the widget is on the page
  }
  function remove(watcher) {
    watchers.delete(watcher);
    if (watchers.size) return;
    kernel?.statusChanged?.disconnect(heed);
    clearInterval(timer);
    timer = null;
  }
  return { add, remove, hear };
}

function heartOf(model) {
  const kernel = model.widget_manager?.kernel, key = kernel ?? model.widget_manager ?? model;
  const hearts = (globalThis.clothlabHearts ??= new WeakMap()); // each widget's JavaScript is a module of its own
  if (!hearts.has(key)) hearts.set(key, makeHeart(kernel));
  return hearts.get(key);
}

// `root()`: the element that shows the widget, or null where another one speaks for it. `changed` is called when the
// kernel is gone or back. `signs` are events of the model that only a living kernel causes.
function watchKernel(model, root, { changed = () => {}, signs = [] } = {}) {
  const heart = heartOf(model), style = document.createElement("style"), notice = document.createElement("div");
  style.textContent = ALIVE_STYLE;
  document.head.append(style);
  notice.className = "clothlab-gone-notice";
  notice.setAttribute("role", "alert");
  notice.textContent = GONE;

  function show(gone) {
    const element = root();
    if (!element) return;
    element.classList.add("clothlab-alive");
    if (element.classList.contains("clothlab-gone") === gone) return;
    element.classList.toggle("clothlab-gone", gone);
    if (gone) element.prepend(notice);
    else notice.remove();
    for (const part of element.children) if (part !== notice) part.inert = gone;
    changed();
  }
  const watcher = { show, ping: () => model.send({ do: "alive?" }) };
  const answer = (message) => message?.do === "alive" && heart.hear();
  model.on("msg:custom", answer);
  for (const sign of signs) model.on(sign, heart.hear);
  heart.add(watcher);
  return () => {
    heart.remove(watcher);
    model.off("msg:custom", answer);
    for (const sign of signs) model.off(sign, heart.hear);
    style.remove();
  };
}
