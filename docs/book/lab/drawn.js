// Figures of notebooks whose sliders, menus and maps work in a page without a kernel. Python drew them beforehand, on a
// grid of what the controls can choose, and wrote the controls (`course/drawn.py`); shown is the figure that belongs to
// where they stand.
const FIGURES = document.currentScript.src.replace(/lab\/[^/]*$/, "drawn/");

// Each kind of control calls `moved` after another choice; returned is what gives the number of the choice.
function heedInput(root, { names }, moved) {
  const [input, value] = root.querySelectorAll("input, select, output");
  root.addEventListener("input", () => {
    if (value) value.textContent = names[input.value];
    if (value) input.setAttribute("aria-valuetext", names[input.value]);
    moved();
  });
  return () => Number(input.value);
}

// Of a map's places, `next` are those to which the arrow keys lead.
function heedMap(root, { map: { line, ...map }, places, names, next, start }, moved) {
  let chosen = start;
  const { canvas, draw } = pbMap(([x, y]) => {
    const gaps = places.map(([placeX, placeY]) => Math.hypot(placeX - x, placeY - y));
    choose(gaps.indexOf(Math.min(...gaps)));
  }, 420);
  const output = root.querySelector("output");
  function show() {
    draw({ ...map, trail: line, at: places[chosen] });
    output.textContent = names[chosen];
  }
  function choose(k) {
    if (k === chosen) return;
    chosen = k;
    show();
    moved();
  }
  // Before the map's own steps, which are shorter than the way to the next place.
  function heed(event) {
    if (!(event.key in next)) return;
    event.preventDefault();
    event.stopPropagation();
    choose(next[event.key][chosen]);
  }
  root.addEventListener("keydown", heed, { capture: true });
  root.prepend(canvas);
  show();
  return () => chosen;
}

const KINDS = { slider: heedInput, menu: heedInput, map: heedMap };

// Of what a cell shows, the last such element in front of another.
function lastBefore(other, selector) {
  const found = [...other.closest(".cell_output").querySelectorAll(selector)];
  return found.filter((each) => each.compareDocumentPosition(other) & Node.DOCUMENT_POSITION_FOLLOWING).pop();
}

// `root` stands behind a picture and its words; both then follow the controls, which it holds as a template.
function enliven(root) {
  const { controls, sizes, file } = JSON.parse(root.dataset.figure);
  const image = lastBefore(root, "img");
  const words = lastBefore(root, ".figure-in-words");
  image.replaceWith(root);
  root.append(root.querySelector("template").content);
  root.querySelector(".beside").append(image);
  const status = root.querySelector("[role=status]");

  // All figures, from the first touch on.
  const load = once(async () => {
    status.textContent = "The figures are being loaded …";
    await loadScript(`${FIGURES}${file}.js`);
    const packed = unpackedFile(file);
    return packed.json();
  });
  const standing = () => choices.reduce((k, choice, n) => k * sizes[n] + choice(), 0);
  async function show() {
    try {
      const figures = await load();
      const { picture, alt, details } = figures[standing()]; // not of when it was asked for
      image.src = `data:image/webp;base64,${picture}`;
      image.alt = alt;
      words.replaceChildren(words.firstElementChild);
      words.insertAdjacentHTML("beforeend", details);
      status.textContent = "";
    } catch (error) {
      status.textContent = `The figures can't be shown: ${error.message}.`;
    }
  }
  const choices = controls.map((control, k) =>
    KINDS[control.kind](root.querySelector(`[data-control="${k}"]`), control, show),
  );
  for (const event of ["pointerdown", "focusin"]) root.addEventListener(event, show, { once: true });
}

document.querySelectorAll(".drawn").forEach(enliven);
