// The panel. Python says how things stand (state down), and is told what a person does (actions up).
const STATUS = {
  running: ["▶ running", "five steps a second"],
  paused: ["❚❚ paused", "time stands still: press start"],
  late: ["▶ late", "steps began late within the last second: the machine has too much to do"],
};

// [byte] of a file that are sent: no target has more, and the server would drop the connection at ten times as many.
const LARGEST_FILE = 1 << 20;

function make(tag, properties = {}, ...children) {
  const { style, ...rest } = properties, element = document.createElement(tag);
  for (const [name, value] of Object.entries(rest))
    if (name.startsWith("aria-") || name === "role" || name === "for") element.setAttribute(name, value);
    else element[name] = value;
  if (style) element.style.cssText = style;
  element.append(...children);
  return element;
}

// A control that does not act at present looks off, and its title says why; where `why` is empty it is on.
function off(element, why) {
  element.disabled = Boolean(why);
  element.title = why;
}

// The same of the button that was just pressed: it keeps the focus.
function idle(element, why) {
  element.setAttribute("aria-disabled", Boolean(why));
  element.title = why;
}

function makeSlider(name, [low, high, step], change, event = "change") {
  const digits = step >= 1 ? 0 : step >= 0.1 ? 1 : step >= 0.01 ? 2 : 3;
  const input = make("input", { type: "range", min: low, max: high, step }), output = make("output");
  const row = make("label", { className: "slider" }, name, input, output);
  input.setAttribute("aria-label", name);
  const write = () => (output.textContent = (+input.value).toFixed(digits));
  input.addEventListener("input", write);
  input.addEventListener(event, () => change(Math.min(high, Math.max(low, +input.value))));
  input.dataset.lmSuppressShortcuts = "true"; // a notebook has its own use for arrows
  const put = (value) => {
    input.value = value;
    output.textContent = value.toFixed(digits); // what is so, not the nearest step of the slider
  };
  return { row, input, put };
}

function makeMenu(name, change) {
  const select = make("select", { "aria-label": name });
  select.addEventListener("change", () => change(select.value));
  const fill = (options) => select.replaceChildren(...options.map(([value, label]) => make("option", { value, textContent: label })));
  return { row: make("label", {}, `${name} `, select), select, fill };
}

// A picture is the bytes of a file. Or, where the page itself draws it, its canvas: a browser keeps what it decoded of files.
function makePicture(alt, width) {
  const image = make("img", { alt, width }), caption = make("figcaption", { textContent: alt });
  let url = "", seen = image;
  const put = (next) => {
    if (next !== seen) seen.replaceWith(next);
    seen = next;
  };
  const showFile = (bytes, type) => {
    if (url) URL.revokeObjectURL(url);
    url = bytes?.byteLength ? URL.createObjectURL(new Blob([bytes], { type })) : "";
    image.src = url;
    image.hidden = !url;
    put(image);
  };
  const showCanvas = (canvas) => {
    canvas.className = "drawn";
    canvas.style.setProperty("--wide", `${width}px`);
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", alt);
    put(canvas);
  };
  const show = (picture, type) => (picture instanceof HTMLCanvasElement ? showCanvas(picture) : showFile(picture, type));
  return { figure: make("figure", {}, image, caption), image, caption, show };
}

function render({ model, el }) {
  const get = (name) => model.get(name), cleanUp = [];
  let pending = null; // the last message that Python has not answered yet: until then, controls stay as they were put
  function act(what, more = {}, buffers = []) {
    pending = crypto.getRandomValues(new Uint32Array(2)).join("-");
    model.send({ do: what, id: pending, ...more }, undefined, buffers);
  }
  const button = (name, press) => make("button", { type: "button", textContent: name, onclick: press });

  // -- what is always there
  const commands = ["start", "pause", "step", "reset"].map((name) => button(name, () => act(name))), [start, pause] = commands;
  const status = make("span", { className: "status", role: "status" });
  const message = make("div", { role: "alert" }), again = make("div", { "aria-hidden": true }); // at the top and, for small screens, below
  const arm = makeMenu("arm", (name) => act("set arm", { name })), driver = makeMenu("driven by", (name) => act("set driver", { driver: name }));
  const explore = button("explore new plans", () => act("explore", { on: !get("state").exploring })); // else the best known one again
  const scene = makePicture("the robot", 400), seen = makePicture("what the camera sees", 196), decoded = makePicture("what z says of it", 196);
  const plots = make("div", { className: "traces distance" }), others = make("div", { className: "traces" }); // the distance; the rest
  const pair = make("div", { className: "row pair" }), pictures = make("div", {}, scene.figure, pair), curves = make("div", { className: "traces" });
  const shown = make("div", { className: "columns" });

  // -- target
  const tool = { brush: get("about").brush.start, erase: false };
  const canvas = targetCanvas(get("about").size, tool, (pixels) => act("draw", {}, [pixels.buffer]));
  const gallery = make("div", { className: "row", style: "gap:3px" });
  const erase = button("eraser", () => erase.setAttribute("aria-pressed", (tool.erase = !tool.erase)));
  erase.setAttribute("aria-pressed", false);
  const brush = makeSlider("brush [pixel]", get("about").brush.range, (value) => (tool.brush = value), "input");
  brush.put(tool.brush);
  const file = make("input", { type: "file", accept: "image/*", hidden: true });
  file.addEventListener("change", async () => {
    const [chosen] = file.files;
    file.value = ""; // the same file can then be chosen again
    act("upload", {}, [await chosen.slice(0, LARGEST_FILE).arrayBuffer()]);
  });
  const clear = button("clear", () => {
    canvas.clear();
    forgetTarget();
    act("clear");
  });
  const take = button("take this image", () => act("take")), upload = button("from a file", () => file.click());
  upload.className = "upload";
  const tools = make("div", { className: "row" }, erase, clear, take, upload, file);
  const reconstruction = makePicture("reconstruction", 150), verdict = make("div", { role: "status" }), reason = make("div", { className: "note" });
  const aim = make("figure", { className: "aim" }, canvas.canvas), aimed = make("figcaption", {}, make("span", { textContent: "the target" }));
  const beside = make("div", { className: "beside" }), side = make("div", {}, reconstruction.figure);
  const target = make("section", { style: "--least:430px" }, make("h3", { textContent: "Target" }), beside, tools, brush.row, gallery);

  // -- material
  const cloth = makeMenu("cloth", (name) => act("set cloth", { cloth: name }));
  const material = make("div"), estimate = button("estimate p online", () => act("estimate", { on: !get("state").estimating }));
  const map = pbMap((at) => act("set p", { at })), legend = make("div", { className: "note lines" });
  const strange = make("div", { role: "status", className: "no" });
  const materials = make("section", { className: "split", style: "--least:310px" }, make("div", {}, make("h3", { textContent: "Material" }), cloth.row, material, estimate, legend, strange), map.canvas);

  // -- stiffness
  const fixed = make("input", { type: "checkbox" });
  fixed.addEventListener("change", () => act("set tension", { f_const: fixed.checked ? +tension.input.value : null }));
  let tension = null;
  const tensions = make("div"), ellipse = makePicture("where a push of 1 N moves the hand, ×10", 270);
  ellipse.image.className = "ellipse";
  const stiffness = make("div", {}, make("h3", { textContent: "Stiffness" }), make("label", {}, fixed, " fix the stiffness"), tensions, ellipse.caption, ellipse.figure);

  // -- hand and recording
  const hand = make("div"), handNote = make("div", { className: "note" });
  let hands = [], sliders = [], wanted = null; // the command that the sliders ask for, until Python has it
  const name = make("input", { type: "text", placeholder: "my-swing", "aria-label": "name of the recording", size: 14 });
  name.addEventListener("keydown", (event) => event.stopPropagation());
  const record = button("record", () => act(get("state").recording ? "stop" : "record"));
  const save = button("save", () => act("save", { name: name.value })), discard = button("discard", () => act("discard"));
  const recording = make("div", { className: "recording" }, make("h3", { textContent: "Recording" }), make("div", { className: "row" }, record, name, save, discard));
  const own = make("section", { className: "split halves", style: "--least:280px" }, stiffness, make("div", {}, make("h3", { textContent: "Your own hand" }), handNote, hand, recording), again);

  const rest = make("div", { className: "columns" });

  // -- a projector: three views and the distance; the rest is folded away behind buttons
  const more = make("section"), drawer = make("div", { className: "drawer" });
  const folds = Object.entries({ target, material: materials, hand: own, "more plots": more }).map(([label, part]) => ({ part, opener: button(label, () => unfold(part)) }));
  const project = button("projector", () => arrange(!projecting()));
  project.className = "away";
  const head = make("div", { className: "row" }, ...commands, status, arm.row, driver.row, explore, project);
  const bar = make("div", { className: "folds row" }, make("div", { className: "row" }, ...folds.map(({ opener }) => opener)));
  const traces = [];
  const root = make("div", { className: "clothlab", tabIndex: -1 }, head, bar, message, shown, rest);
  const projecting = () => root.classList.contains("projector");
  function unfold(part) {
    const open = part && part.parentNode !== drawer ? part : null;
    drawer.replaceChildren(...(open ? [open] : []));
    drawer.classList.toggle("left", open === target); // beside what it is about
    for (const each of folds) each.opener.setAttribute("aria-pressed", each.part === open);
  }
  function arrange(on) {
    root.classList.toggle("projector", on);
    shown.classList.toggle("stage", on);
    shown.classList.toggle("columns", !on);
    project.setAttribute("aria-pressed", on);
    project.title = on ? "back to the notebook (key: P or Escape)" : "large text for a projector (key: P)";
    aimed.append(verdict);
    pair.replaceChildren(seen.figure, ...(on ? [] : [decoded.figure]));
    curves.replaceChildren(plots, ...(on ? [] : [others]));
    more.replaceChildren(...(on ? [others, decoded.figure] : []));
    aim.replaceChildren(canvas.canvas, ...(on ? [aimed] : []));
    side.replaceChildren(...(on ? [] : [verdict]), reconstruction.figure);
    beside.replaceChildren(...(on ? [side, reason] : [aim, side]));
    if (!on) beside.after(reason);
    shown.replaceChildren(...(on ? [scene.figure, seen.figure, aim, plots, drawer] : [pictures, curves]));
    pictures.replaceChildren(...(on ? [] : [scene.figure, pair]));
    if (on) unfold(null);
    rest.replaceChildren(...(on ? [] : [target, materials, own]));
    if (on) bar.append(message);
    else root.insertBefore(message, shown);
    if (get("frame").traces && traces.length) drawTraces(get("frame"));
    if (!root.isConnected || !root.showPopover) return;
    if (on) root.popover = "manual"; // above all else of the page, wherever in it the panel is
    if (on) root.showPopover();
    else root.popover = null;
    root.focus({ preventScroll: on });
  }
  function press(event) {
    const typing = event.target.matches?.("input[type=text], select");
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key.toLowerCase() === "p" && !typing) arrange(!projecting());
    else if (event.key === "Escape" && drawer.childElementCount) unfold(null);
    else if (event.key === "Escape" && projecting()) arrange(false);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }
  const pressAnywhere = (event) => projecting() && !root.contains(event.target) && press(event); // nothing else is seen then
  root.addEventListener("keydown", press, true); // before a slider keeps the key to itself
  document.addEventListener("keydown", pressAnywhere, true);
  cleanUp.push(() => document.removeEventListener("keydown", pressAnywhere, true));

  let met = null; // what the controls were made from
  function meetArm() {
    const about = (met = get("about"));
    arm.fill(about.arms.map((each) => [each, each]));
    driver.fill(about.drivers.map((each) => [each, each]));
    gallery.replaceChildren(...galleryButtons(about.size, about.gallery, (picked) => act("pick", { name: picked })));
    sliders = about.material.map(([label, range]) => makeSlider(label, range, () => act("set material", { damping: +sliders[0].input.value, mass: +sliders[1].input.value })));
    material.replaceChildren(...sliders.map(({ row }) => row));
    stiffness.hidden = !about.tension;
    tension = about.tension && makeSlider("f_const [N]", about.tension, (f_const) => act("set tension", { f_const }));
    tensions.replaceChildren(...(tension ? [tension.row] : []));
    hands = about.hands.map(([label, range], k) => makeSlider(label, range, (value) => moveHand(k, value), "input"));
    hand.replaceChildren(...hands.map(({ row }) => row));
    map.draw(about.map);
  }
  function moveHand(k, value) {
    wanted ??= [...get("state").hand];
    wanted[k] = value;
    act("set hand", { u: wanted });
  }
  function showState() {
    const state = get("state"), about = get("about");
    if (met !== about) meetArm(); // both are new, and nothing says which of them is told first
    const [word, meaning] = STATUS[state.status];
    status.textContent = `${word}${state.recording ? " ● recording" : ""}`;
    status.className = `status ${state.status}`;
    status.title = meaning;
    idle(start, state.running ? "time goes by already" : "");
    idle(pause, state.running ? "" : "time stands still already");
    for (const each of [message, again]) {
      each.textContent = state.message.text;
      each.className = `message ${state.message.kind}`;
    }
    if (pending !== null && state.answered !== pending) return; // this is how things stood before a control was moved
    pending = wanted = null;
    arm.select.value = state.arm;
    driver.select.value = state.driver;
    off(explore, state.driver === "iterative" ? "" : `iterative learning explores only where it drives; now ${state.driver} does`);
    explore.setAttribute("aria-pressed", state.exploring);
    const known = about.cloths.some((each) => each.name === state.cloth.name);
    cloth.fill([...(known ? [] : [["", `own: ${state.cloth.label}`]]), ...about.cloths.map((each) => [each.name, each.label])]);
    cloth.select.value = known ? state.cloth.name : "";
    sliders.forEach((each, k) => each.put(state.cloth.material[k]));
    estimate.setAttribute("aria-pressed", state.estimating);
    fixed.checked = state.fixed;
    if (tension) {
      tension.put(state.tension[0]);
      off(tension.input, state.fixed ? "" : "the stiffness is free: tick the box to fix it");
    }
    const drives = state.driver === "manual";
    hands.forEach((each, k) => {
      each.put(state.hand[k]);
      off(each.input, state.fixed && k === about.stiffness_at ? "fixed under Stiffness" : "");
      each.row.title = drives ? "" : `${state.driver} drives, and this shows what it sends: move it to take over`;
    });
    hand.classList.toggle("inactive", !drives);
    handNote.textContent = drives ? "Your sliders drive." : `Inactive: ${state.driver} drives; the sliders show what it sends. Move one, or a gamepad's stick, to take over.`;
    record.textContent = state.recording ? "stop" : "record";
    record.setAttribute("aria-pressed", state.recording);
    for (const each of [save, discard]) off(each, state.recording || state.waiting ? "" : "nothing was recorded");
    map.draw({ held: state.cloth.name });
    showLegend();
  }
  function showLegend() {
    const { label, name: held } = get("state").cloth, dot = get("about").map.dots.some((each) => each.name === held);
    legend.textContent = `${dot ? "● in the hand:" : "in the hand, none of the dots:"} ${label}\n+ p in use, nearest to ${get("frame").nearest}${get("frame").region.length ? "\n⋯ 90 % region" : ""}`;
  }
  // Of an empty canvas there is nothing to say, although the robot keeps the target that it has.
  function forgetTarget() {
    verdict.textContent = reason.textContent = "";
    reconstruction.show(null);
  }
  let version = -1;
  function showTarget() {
    const news = get("target");
    if (news.version !== version) canvas.put(bytesOf(news.image)); // what is drawn here is here already
    version = news.version;
    reconstruction.show(news.reconstruction, "image/png");
    verdict.textContent = `${news.known ? "✓" : "✗"} ${news.verdict}`;
    verdict.className = news.known ? "" : "no";
    reason.textContent = news.reason;
  }
  function showFrame() {
    const frame = get("frame");
    scene.show(frame.scene, "image/jpeg");
    seen.show(frame.seen, "image/png");
    decoded.show(frame.decoded, "image/png");
    scene.caption.textContent = `the robot, ${frame.clock}`;
    while (traces.length < frame.traces.length) traces.push(tracePlot());
    traces.length = frame.traces.length;
    if (plots.children.length + others.children.length !== traces.length) {
      plots.replaceChildren(traces[0].figure);
      others.replaceChildren(...traces.slice(1).map(({ figure }) => figure));
    }
    drawTraces(frame);
    map.draw({ at: frame.at, trail: frame.trail, region: frame.region });
    strange.textContent = frame.warning && `⚠ ${frame.warning}`;
    showLegend();
    shown.dataset.frame = frame.number;
    model.send({ do: "drawn", frame: frame.number });
  }
  function drawTraces(frame) {
    frame.traces.forEach((trace, i) => traces[i]?.draw(trace, frame.marks, get("about"), projecting()));
  }
  const showEllipse = () => ellipse.show(get("ellipse"), "image/png");

  arrange(false);
  el.append(make("style", { textContent: STYLE }), root);
  for (const [trait, show] of [["about", showState], ["state", showState], ["target", showTarget], ["frame", showFrame], ["ellipse", showEllipse]]) {
    model.on(`change:${trait}`, show);
    cleanUp.push(() => model.off(`change:${trait}`, show));
    show();
  }
  cleanUp.push(watchGamepad(model, act));
  return () => {
    cleanUp.forEach((each) => each());
    root.remove(); // or its place above the page would outlast it
  };
}

export default { render };
