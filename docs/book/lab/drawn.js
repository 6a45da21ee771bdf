// Figures of notebooks whose sliders, menus and maps work in a page without a kernel. Python drew them beforehand, on a
// grid of what the controls can choose (`_drawn.py`); shown is the one that belongs to where the controls stand.
const FIGURES = document.currentScript.src.replace(/lab\/[^/]*$/, "drawn/");
const THINNED =
  "These figures were drawn beforehand, so the controls have fewer stops here than in a running notebook.";
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

// Each control has a `root` to show and `at()`, the number of its choice; it calls `moved` after another one is chosen.
function makeSlider({ label, names, start }, moved) {
  const input = element("input", { type: "range", min: 0, max: names.length - 1, value: start });
  const value = element("span");
  input.setAttribute("aria-label", label); // without the value, which a label around both would have in it
  function say() {
    value.textContent = names[input.value];
    input.setAttribute("aria-valuetext", names[input.value]);
  }
  input.addEventListener("input", () => {
    say();
    moved();
  });
  say();
  return { root: element("label", {}, element("span", {}, label), input, value), at: () => Number(input.value) };
}

function makeMenu({ label, names, start }, moved) {
  const select = element("select", {}, ...names.map((name) => element("option", {}, name)));
  select.selectedIndex = start;
  select.addEventListener("change", moved);
  return { root: element("label", {}, element("span", {}, label), select), at: () => select.selectedIndex };
}

const distance = ([x, y], [otherX, otherY]) => Math.hypot(otherX - x, otherY - y);

// Of places, the number of the one that is nearest, among those that `may` be taken; -1 if none may.
function nearestPlace(places, from, may = () => true) {
  let best = -1;
  places.forEach((place, k) => {
    if (may(place) && (best < 0 || distance(from, place) < distance(from, places[best]))) best = k;
  });
  return best;
}

// The nearest place in a direction: it lies at least as far along it as beside it.
function nextPlace(places, from, [dx, dy]) {
  return nearestPlace(places, from, ([x, y]) => {
    const along = (x - from[0]) * dx + (y - from[1]) * dy;
    const beside = Math.abs((x - from[0]) * dy - (y - from[1]) * dx);
    return along > 0 && beside <= along;
  });
}

function makeMap({ map: { line, ...map }, places, start }, moved) {
  const { canvas, draw } = pbMap((place) => choose(nearestPlace(places, place)), 420);
  const output = element("output");
  let chosen = start;
  function show() {
    const place = places[chosen];
    const dot = map.dots.find(({ at }) => distance(at, place) < 1e-6);
    draw({ ...map, trail: line, at: place });
    output.textContent = dot?.label || map.axes.map((axis, k) => `${axis}: ${place[k].toFixed(2)}`).join(", ");
  }
  function choose(k) {
    if (k < 0 || k === chosen) return;
    chosen = k;
    show();
    moved();
  }
  const root = element("div", { className: "place" }, canvas, output);
  // Before the map's own steps, which are shorter than the way to the next place.
  const heed = (event) => {
    if (!(event.key in STEPS)) return;
    event.preventDefault();
    event.stopPropagation();
    choose(nextPlace(places, places[chosen], STEPS[event.key]));
  };
  root.addEventListener("keydown", heed, { capture: true });
  show();
  return { root, at: () => chosen };
}

const KINDS = { slider: makeSlider, menu: makeMenu, map: makeMap };

// Of what a cell shows, the last such element in front of another.
function lastBefore(other, selector) {
  const found = [...other.closest(".cell_output").querySelectorAll(selector)];
  return found.filter((each) => each.compareDocumentPosition(other) & Node.DOCUMENT_POSITION_FOLLOWING).pop();
}

// `root` stands behind a picture and its words; both then follow the controls.
function enliven(root) {
  const { controls, thinned, sizes, file } = JSON.parse(root.dataset.figure);
  const image = lastBefore(root, "img");
  const words = lastBefore(root, ".figure-in-words");
  const note = element("p", { className: "note" }, thinned ? THINNED : "");
  const status = element("p", { className: "note" });
  status.setAttribute("role", "status");
  let loading = null; // the promise of all figures; null before the first touch, and after one that failed

  async function load() {
    await loadScript(`${FIGURES}${file}.js`);
    const packed = await unpackedFile(file);
    return packed.json();
  }
  const standing = () => made.reduce((k, { at }, n) => k * sizes[n] + at(), 0);
  async function show() {
    if (!loading) status.textContent = "The figures are being loaded …";
    try {
      const figures = await (loading ??= load());
      const { picture, alt, details } = figures[standing()]; // not of when it was asked for
      image.src = `data:image/webp;base64,${picture}`;
      image.alt = alt;
      words.replaceChildren(words.firstElementChild, ...details.map((text) => element("p", {}, text)));
      status.textContent = "";
    } catch (error) {
      loading = null;
      status.textContent = `The figures can't be shown: ${error.message}.`;
    }
  }
  const made = controls.map((control) => KINDS[control.kind](control, show));
  const roots = (isMap) => made.filter((_, k) => (controls[k].kind === "map") === isMap).map((each) => each.root);
  const beside = element("div", { className: "beside" });
  image.replaceWith(root);
  beside.append(...roots(true), image);
  root.append(...roots(false), beside, status, note);
  root.setAttribute("role", "group");
  root.setAttribute("aria-label", "a figure with its controls");
  for (const event of ["pointerdown", "focusin"]) root.addEventListener(event, show, { once: true });
}

document.querySelectorAll(".drawn").forEach(enliven);
