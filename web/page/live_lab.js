// The live lab as the model of the panel: what Python's `LivePanel` is in a notebook. The session is in the worker, and
// here are time, words, and pictures. Each action says in the panel's message what it did, if it can't be seen.
const RECENT = 5; // steps, one of which was late where time is said to be
// What the session does just as the panel asks for it.
const FORWARDED = ["set cloth", "set material", "set driver", "set tension", "set hand", "estimate", "explore"];
// A picture in grey, which the panel shows.
function makeGrey([width, height]) {
  const canvas = make("canvas", { width, height });
  const ctx = canvas.getContext("2d");
  const pixels = ctx.createImageData(width, height);
  // Of an image of 0 to 1.
  return function grey(image) {
    image.forEach((bright, k) => pixels.data.fill(255 * bright, 4 * k, 4 * k + 3).fill(255, 4 * k + 3, 4 * k + 4));
    ctx.putImageData(pixels, 0, 0);
    return canvas;
  };
}

// `ask` asks the session in the worker; `first` is what it said of its first arm; `filesOf` loads another one's.
function liveLab(ask, first, filesOf) {
  const { period, size, history: longest } = first.answer.lab.about;
  const { get, on, off, set } = makeTraits();
  const canvas = make("canvas", { width: 560, height: 420 });
  const ellipseCanvas = make("canvas", { width: 540, height: 578 });
  const [seenImage, decodedImage, reconstructedImage] = [0, 1, 2].map(() => makeGrey(size));
  const met = new Set(); // names of the arms that the worker has
  let session = first.now;
  let arm = null; // what there is about it, and what draws it
  let history = [];
  let running = false;
  let turn = 0; // number of times that it was started
  let message = { text: "", kind: "info" };
  let answered = "";
  let frames = 0;
  let targets = 0; // that were put on the canvas

  const say = (text, kind = "info") => (message = { text, kind });
  async function guarded(act) {
    try {
      await act();
      return true;
    } catch (error) {
      if (error.now) session = error.now;
      if (error.name === "Refusal") say(`⚠ ${error.message}`, "mistake");
      else say(`✗ a fault in the lab: ${error.message}`, "fault");
      return false;
    }
  }

  // -- what is shown
  function status() {
    if (!running) return "paused";
    return history.slice(-RECENT).some(({ late }) => late) ? "late" : "running";
  }
  function state() {
    const { controls, tension } = session;
    const stiffness = { fixed: tension !== null, tension: controls.hand.slice(arm.about.stiffness_at) };
    const steered = { arm: arm.about.arm, ...controls, ...stiffness };
    return { ...steered, recording: false, waiting: false, running, status: status(), message, answered };
  }
  const refresh = () => set({ state: state() });
  function clock() {
    const basis = history.at(-1)?.basis;
    const more = basis ? [`plan from ${basis}`] : [];
    return [`${(session.step * period).toFixed(1)} s`, `step ${session.step}`, ...more].join(", ");
  }
  // What a frame shows beside its pictures.
  function plots() {
    const { plane, about } = arm;
    const at = plane.at(session.p);
    return {
      clock: clock(),
      traces: traces(arm.plots, session, history),
      marks: history.flatMap((moment, k) => (moment.periodEnded ? [k] : [])),
      at,
      trail: history.map((moment) => plane.at(moment.p)),
      nearest: nearestDot(at, about.map.dots).label,
      region: [],
      warning: session.warning,
    };
  }
  function drawFrame() {
    const { stage, mask, reconstruction } = session;
    arm.drawScene(stage);
    frames += 1;
    const pictures = { scene: canvas, seen: seenImage(mask), decoded: decodedImage(reconstruction) };
    set({ frame: { number: frames, ...pictures, ...plots() }, ellipse: drawnEllipse() });
  }
  // Of the command that was sent, and the tension that is fixed, or sent with it.
  function drawnEllipse() {
    const command = history.at(-1)?.command ?? session.controls.hand;
    return arm.drawEllipse && arm.drawEllipse(command.slice(0, -1), session.tension ?? command.at(-1));
  }
  // All that is new before the browser shows the page again is one frame.
  let drawing = null;
  async function draw() {
    drawing = null;
    if (!(await guarded(drawFrame))) pause();
  }
  function show() {
    refresh();
    drawing ??= requestAnimationFrame(draw);
  }
  function showTarget(aim, { onCanvas = true } = {}) {
    const view = targetView(aim, arm);
    if (onCanvas) targets += 1;
    set({ target: { ...view, version: targets, reconstruction: reconstructedImage(view.reconstruction) } });
  }

  // -- what is asked of the session
  // `remember` makes the history that belongs to an answer, so that both are new at once.
  async function told(what, more, remember = () => history) {
    const { now, answer } = await ask(what, more);
    session = now;
    history = remember(answer);
    return answer;
  }
  async function aim(what, more, options) {
    showTarget(await told(what, more), options);
  }
  // Another arm is there, with its own cloth, target and p: all of it is new at once.
  function meet({ lab }) {
    const { about, plane, scene, pushes, ...more } = lab;
    arm = {
      ...more,
      about,
      plane: makePlane(plane),
      drawScene: scenePicture(canvas, scene.onlooker, scene.shapes),
      drawEllipse: pushes && ellipsePicture(pushes, ellipseCanvas, show),
    };
    met.add(about.arm);
    set({ about, state: state() });
    guarded(() => ask("prepare")); // while a visitor looks around
    return []; // its history
  }
  async function changeArm(name) {
    say(`the ${name} arm is being loaded`);
    refresh();
    const files = met.has(name) ? {} : await filesOf(name);
    const { aim } = await told("set arm", { name, files }, meet);
    say("");
    showTarget(aim);
  }
  // A step that is so far behind its place in time [s]. Where that is a whole period, it leaves out solve and estimate.
  async function advance(behind = 0) {
    const late = behind > period / 2;
    const remember = (moment) => [...history, { ...moment, late }].slice(-longest);
    await told("step", { solve: behind < period }, remember);
  }

  // -- time
  const now = () => performance.now() / 1000;
  async function run() {
    const mine = (turn += 1);
    for (let due = now(); running && turn === mine;) {
      const behind = now() - due;
      if (!(await guarded(() => advance(behind)))) pause();
      show();
      due = Math.max(due + period, now() - 2 * period); // lost time is not made up for
      await new Promise((resolve) => setTimeout(resolve, Math.max(5, 1000 * (due - now()))));
    }
  }
  function start() {
    if (running) return;
    running = true;
    guarded(run);
  }
  function pause() {
    running = false;
    refresh();
  }

  // -- what a person does
  const actions = {
    start,
    pause,
    step: () => advance(),
    reset: () => told("reset", {}, () => []),
    "set arm": ({ name }) => changeArm(name),
    "set p": ({ at }) => told("set p", { p: arm.plane.p(at) }),
    "move sticks": ({ places }) =>
      told("set hand", { u: arm.about.hands.map(([, [low, high]], k) => low + places[k] * (high - low)) }),
    "greet gamepad"({ enough }) {
      const trigger = arm.about.tension ? ", right trigger: stiffness" : "";
      if (enough) say(`gamepad: left stick: shoulder, right stick: elbow${trigger}`);
      else say("⚠ a gamepad needs two sticks and a trigger", "mistake");
    },
    draw: (_, [pixels]) => aim("draw", { mask: new Uint8Array(pixels) }, { onCanvas: false }),
    clear: () => say("draw a target; until then the robot keeps the one that it has"),
    pick: ({ name }) => aim("pick", { name }),
    take: () => aim("take"),
  };
  for (const what of FORWARDED) actions[what] = (more) => told(what, more);
  async function does(action, id) {
    say("");
    await guarded(action);
    answered = id;
    if (running) refresh();
    else show();
  }
  // Nobody looks any more.
  function rest() {
    if (running) say("paused while nobody saw the page: press start");
    pause();
  }

  meet(first.answer);
  showTarget(first.answer.aim);
  drawFrame();
  return { get, on, off, send: makeSend(actions, does), rest };
}
