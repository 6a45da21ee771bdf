// The panel. Python says how things stand (state down), and is told what a person does (actions up).
const STYLE = `
.clothlab { font: 15px/1.4 system-ui, sans-serif; color: #1a1a1a; background: #fff; padding: 8px; }
.clothlab * { box-sizing: border-box; }
.clothlab figure { margin: 0; }
.clothlab .row { display: flex; flex-wrap: wrap; gap: 8px; align-items: center; }
.clothlab .columns { display: flex; flex-wrap: wrap; gap: 12px; align-items: flex-start; margin-top: 8px; }
.clothlab section { flex: 1 1 var(--least); min-width: min(100%, var(--least)); max-width: 600px; border-top: 2px solid #0072B2; padding-top: 4px; }
.clothlab .traces { flex: 1 1 470px; }
.clothlab section > .row, .clothlab .lone { margin-top: 6px; }
.clothlab h3 { font-size: 16px; margin: 2px 0 6px; }
.clothlab button, .clothlab select, .clothlab input[type=text] { font: inherit; padding: 3px 10px; border: 1px solid #888; border-radius: 4px; background: #f6f6f6; color: inherit; }
.clothlab button:hover:not(:disabled, [aria-pressed=true]) { background: #e8f1f8; }
.clothlab button[aria-pressed=true] { background: #0072B2; border-color: #0072B2; color: #fff; }
.clothlab button.picture { padding: 0; border: 2px solid #ccc; line-height: 0; }
.clothlab :disabled { opacity: 0.45; }
.clothlab :focus-visible { outline: 3px solid #E69F00; outline-offset: 1px; }
.clothlab label.slider { display: grid; grid-template-columns: 150px minmax(50px, 1fr) 48px; gap: 5px; align-items: center; white-space: nowrap; }
.clothlab label.slider input { width: 100%; min-width: 0; }
.clothlab .key { display: inline-block; white-space: nowrap; }
.clothlab label.slider output { text-align: right; font-variant-numeric: tabular-nums; }
.clothlab .status { font-weight: 600; padding: 2px 12px; border-radius: 12px; background: #e4e4e4; }
.clothlab .status.running { background: #009E73; color: #fff; }
.clothlab .message { min-height: 1.5em; overflow-wrap: anywhere; margin: 6px 0; padding: 1px 8px; border-left: 4px solid transparent; }
.clothlab .message.info:not(:empty) { border-color: #0072B2; }
.clothlab .message.mistake { border-color: #E69F00; background: #fdf3dd; }
.clothlab .message.fault { border-color: #b00020; color: #b00020; background: #fdecee; font-weight: 600; }
.clothlab .note { color: #444; font-size: 14px; margin: 4px 0; }
.clothlab .inactive { opacity: 0.5; }
.clothlab .beside { display: flex; gap: 8px; }
.clothlab .beside > div { flex: 1 1 0; min-width: 0; }
.clothlab .no { color: #b00020; font-weight: 600; }
.clothlab details { margin-top: 12px; border-top: 2px solid #0072B2; padding-top: 4px; }
.clothlab summary { font-size: 16px; font-weight: bold; cursor: pointer; }
.clothlab ol.phases { list-style: none; margin: 8px 0; padding: 0; }
.clothlab ol.phases li { padding: 1px 10px; border: 1px solid #888; border-radius: 12px; }
.clothlab ol.phases .waiting { color: #595959; border-color: #ccc; }
.clothlab ol.phases .running { background: #009E73; border-color: #009E73; color: #fff; font-weight: 600; }
.clothlab ol.phases .failed { border-color: #b00020; color: #b00020; font-weight: 600; }
`;

function make(tag, properties = {}, ...children) {
  const { style, ...rest } = properties, element = document.createElement(tag);
  for (const [name, value] of Object.entries(rest))
    if (name.startsWith("aria-") || name === "role" || name === "for") element.setAttribute(name, value);
    else element[name] = value;
  if (style) element.style.cssText = style;
  element.append(...children);
  return element;
}

function makeSlider(name, [low, high, step], change, event = "change") {
  const digits = step >= 1 ? 0 : step >= 0.1 ? 1 : step >= 0.01 ? 2 : 3;
  const input = make("input", { type: "range", min: low, max: high, step }), output = make("output");
  const row = make("label", { className: "slider" }, name, input, output);
  input.setAttribute("aria-label", name);
  const write = () => (output.textContent = (+input.value).toFixed(digits));
  input.addEventListener("input", write);
  input.addEventListener(event, () => change(Math.min(high, Math.max(low, +input.value))));
  input.addEventListener("keydown", (pressed) => pressed.stopPropagation()); // the notebook has its own use for arrows
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

function makePicture(alt, width) {
  const image = make("img", { alt, width }), caption = make("figcaption", { textContent: alt });
  let url = "";
  const show = (bytes, type) => {
    if (url) URL.revokeObjectURL(url);
    url = bytes?.byteLength ? URL.createObjectURL(new Blob([bytes], { type })) : "";
    image.src = url;
    image.hidden = !url;
  };
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
  const commands = ["start", "pause", "step", "reset"].map((name) => button(name, () => act(name)));
  const status = make("span", { className: "status", role: "status" });
  const message = make("div", { role: "alert" }), again = make("div", { "aria-hidden": true }); // at the top and, for small screens, below
  const arm = makeMenu("arm", (name) => act("set arm", { name })), driver = makeMenu("driven by", (name) => act("set driver", { driver: name }));
  const practise = button("try new plans", () => act("practise", { on: !get("state").practising })); // else the best known one again
  const scene = makePicture("the robot", 400), seen = makePicture("what the camera sees", 196), decoded = makePicture("what z says of it", 196);
  const plots = make("div", { className: "traces" }), pair = make("div", { className: "row" }, seen.figure, decoded.figure);
  const shown = make("div", { className: "columns" }, make("div", {}, scene.figure, pair), plots);

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
    const small = chosen.size <= get("about").largest_file;
    act("upload", { size: chosen.size }, small ? [await chosen.arrayBuffer()] : []);
  });
  const clear = button("clear", () => {
    canvas.clear();
    act("clear");
  });
  const tools = make("div", { className: "row" }, erase, clear, button("take this image", () => act("take")), button("from a file", () => file.click()), file);
  const believed = makePicture("what it believes", 150), verdict = make("div", { role: "status" }), reason = make("div", { className: "note" });
  const target = make("section", { style: "--least:430px" }, make("h3", { textContent: "Target" }),
    make("div", { className: "beside" }, make("div", { style: "flex:none" }, canvas.canvas), make("div", {}, verdict, believed.figure)), reason, tools, brush.row, gallery);

  // -- material
  const cloth = makeMenu("cloth", (name) => act("set cloth", { cloth: name }));
  const material = make("div"), estimate = button("estimate p online", () => act("estimate", { on: !get("state").estimating }));
  const map = pbMap((at) => act("set p", { at })), legend = make("div", { className: "note" });
  const strange = make("div", { role: "status", className: "no" });
  const materials = make("section", { style: "--least:310px" }, make("h3", { textContent: "Material" }), cloth.row, material, estimate, legend, map.canvas, strange);

  // -- stiffness
  const fixed = make("input", { type: "checkbox" });
  fixed.addEventListener("change", () => act("set tension", { f_const: fixed.checked ? +tension.input.value : null }));
  let tension = null;
  const tensions = make("div"), ellipse = makePicture("stiffness ellipse of the hand", 270);
  const stiffness = make("div", {}, make("h3", { textContent: "Stiffness" }), make("label", {}, fixed, " fix the stiffness"), tensions, ellipse.figure);

  // -- hand and recording
  const hand = make("div"), handNote = make("div", { className: "note" });
  let hands = [], sliders = [], wanted = null; // the command that the sliders ask for, until Python has it
  const name = make("input", { type: "text", placeholder: "my-swing", "aria-label": "name of the recording", size: 14 });
  name.addEventListener("keydown", (event) => event.stopPropagation());
  const record = button("record", () => act(get("state").recording ? "stop" : "record"));
  const save = button("save", () => act("save", { name: name.value })), discard = button("discard", () => act("discard"));
  const own = make("section", { style: "--least:280px" }, stiffness, make("h3", { textContent: "Your own hand" }), handNote, hand,
    make("h3", { textContent: "Recording" }), make("div", { className: "row" }, record, name, save, discard), again);

  const table = tableSection(act);

  function meetArm() {
    const about = get("about");
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
    status.textContent = `${state.running ? "▶ running" : "paused"}${state.recording ? " ● recording" : ""}`;
    status.classList.toggle("running", state.running);
    for (const each of [message, again]) {
      each.textContent = state.message.text;
      each.className = `message ${state.message.kind}`;
    }
    if (pending !== null && state.answered !== pending) return; // this is how things stood before a control was moved
    pending = wanted = null;
    arm.select.value = state.arm;
    driver.select.value = state.driver;
    practise.hidden = state.driver !== "practise";
    practise.setAttribute("aria-pressed", state.practising);
    const known = about.cloths.some((each) => each.name === state.cloth.name);
    cloth.fill([...(known ? [] : [["", `own: ${state.cloth.label}`]]), ...about.cloths.map((each) => [each.name, each.label])]);
    cloth.select.value = known ? state.cloth.name : "";
    sliders.forEach((each, k) => each.put(state.cloth.material[k]));
    estimate.setAttribute("aria-pressed", state.estimating);
    fixed.checked = state.fixed;
    if (tension) {
      tension.put(state.tension[0]);
      tension.input.disabled = !state.fixed;
    }
    hands.forEach((each, k) => {
      each.put(state.hand[k]);
      each.input.disabled = state.fixed && k === about.stiffness_at;
    });
    hand.classList.toggle("inactive", state.driver !== "hand");
    handNote.textContent = state.driver === "hand" ? "Your sliders drive." : `Inactive: ${state.driver} drives. Move a slider, or a gamepad's stick, to take over.`;
    record.textContent = state.recording ? "stop" : "record";
    record.setAttribute("aria-pressed", state.recording);
    save.disabled = discard.disabled = !(state.recording || state.waiting);
    map.draw({ held: state.cloth.name });
    showLegend();
  }
  function showLegend() {
    const { label } = get("state").cloth;
    legend.textContent = `● in the hand: ${label}   + p in use, nearest to ${get("frame").nearest}${get("frame").region.length ? "   ⋯ 90 % region" : ""}`;
  }
  let version = -1;
  function showTarget() {
    const news = get("target");
    if (news.version !== version) canvas.put(bytesOf(news.image)); // what is drawn here is here already
    version = news.version;
    believed.show(news.believed, "image/png");
    verdict.textContent = `${news.known ? "✓" : "✗"} ${news.verdict}`;
    verdict.className = news.known ? "" : "no";
    reason.textContent = news.reason;
  }
  const traces = [];
  function showFrame() {
    const frame = get("frame");
    scene.show(frame.scene, "image/jpeg");
    seen.show(frame.seen, "image/png");
    decoded.show(frame.decoded, "image/png");
    scene.caption.textContent = `the robot, ${frame.clock}`;
    while (traces.length < frame.traces.length) traces.push(tracePlot());
    traces.length = frame.traces.length;
    if (plots.children.length !== traces.length) plots.replaceChildren(...traces.map(({ figure }) => figure));
    frame.traces.forEach((trace, i) => traces[i].draw(trace, frame.marks, get("about")));
    map.draw({ at: frame.at, trail: frame.trail, region: frame.region });
    strange.textContent = frame.warning && `⚠ ${frame.warning}`;
    showLegend();
    shown.dataset.frame = frame.number;
    model.send({ do: "drawn", frame: frame.number });
  }
  const showEllipse = () => ellipse.show(get("ellipse"), "image/png");
  function showTable() {
    table.draw(get("table"));
    model.send({ do: "table drawn", frame: get("table").number });
  }

  const head = make("div", { className: "row" }, ...commands, status, arm.row, driver.row, practise);
  el.append(make("style", { textContent: STYLE }), make("div", { className: "clothlab" }, head, message, shown, make("div", { className: "columns" }, target, materials, own), table.details));
  for (const [trait, show] of [["about", meetArm], ["state", showState], ["target", showTarget], ["frame", showFrame], ["ellipse", showEllipse], ["table", showTable]]) {
    const showSafely = trait === "about" ? () => (meetArm(), showState()) : show;
    model.on(`change:${trait}`, showSafely);
    cleanUp.push(() => model.off(`change:${trait}`, showSafely));
    show();
  }
  cleanUp.push(watchGamepad(model, act));
  return () => cleanUp.forEach((each) => each());
}

export default { render };
