// The live lab as the model of the panel: what Python's `LivePanel` is in a notebook. The session is in the worker; here
// are time, words, and pictures. Each action says in the panel's message what it did, if it can't be seen.
const PATIENT = 15; // steps, over whose mean time a tier is chosen
// What is left out on a machine that is too slow: a solve or an estimate comes every so many steps.
const TIERS = [
  { solveEvery: 1, estimateEvery: 1, about: "" },
  { solveEvery: 2, estimateEvery: 1, about: "a solve every 2nd step" },
  { solveEvery: 2, estimateEvery: 2, about: "a solve and an estimate every 2nd step" },
  { solveEvery: 4, estimateEvery: 4, about: "a solve and an estimate every 4th step" },
];

// A tier by the time that steps take [s].
function makeTiers(period) {
  let tier = 0;
  let times = [];
  const mean = (count) => times.slice(-count).reduce((sum, x) => sum + x, 0) / count;
  // Takes in a step; whether the tier is another one now.
  function took(seconds) {
    times = [...times, seconds].slice(-4 * PATIENT);
    const slower = times.length >= PATIENT && mean(PATIENT) > period && tier < TIERS.length - 1;
    const faster = times.length === 4 * PATIENT && mean(4 * PATIENT) < 0.4 * period && tier > 0;
    if (!slower && !faster) return false;
    tier += slower ? 1 : -1;
    times = [];
    return true;
  }
  return { took, now: () => TIERS[tier], mean: () => mean(Math.min(times.length, PATIENT)) };
}

// Pictures as files, which the panel shows.
function fileOf(canvas, type) {
  return new Promise((resolve, reject) => {
    async function take(blob) {
      if (blob) resolve(new Uint8Array(await blob.arrayBuffer()));
      else reject(new Error("this browser made no picture of a canvas"));
    }
    canvas.toBlob(take, type, 0.85);
  });
}
function makeGrey([width, height]) {
  const canvas = make("canvas", { width, height });
  const ctx = canvas.getContext("2d");
  // Of an image of 0 to 1.
  return function grey(image) {
    const pixels = ctx.createImageData(width, height);
    image.forEach((bright, k) => pixels.data.fill(255 * bright, 4 * k, 4 * k + 3).fill(255, 4 * k + 3, 4 * k + 4));
    ctx.putImageData(pixels, 0, 0);
    return fileOf(canvas, "image/png");
  };
}

// `ask` asks the session in the worker; `first` is how that stands; `lab` is what there is about it.
async function liveLab(ask, first, lab) {
  const { about } = lab;
  const { get, on, off, tell, set } = makeTraits();
  const plane = makePlane(lab.plane);
  const tiers = makeTiers(about.period);
  const canvas = make("canvas", { width: 560, height: 420 });
  const drawScene = scenePicture(canvas);
  const [seen, decoded, reconstructed] = [0, 1, 2].map(() => makeGrey(about.size));
  let session = first.now;
  let history = [];
  let running = false;
  let turn = 0; // number of times that it was started
  let broken = false; // whether time stands still since a step failed
  let late = false;
  let message = { text: "", kind: "info" };
  let answered = "";
  let frames = 0;

  const say = (text, kind = "info") => (message = { text, kind });
  async function guarded(act) {
    try {
      await act();
      return true;
    } catch (error) {
      if (error.name === "Refusal") say(`⚠ ${error.message}`, "mistake");
      else say(`✗ a fault in the lab: ${error.message}`, "fault");
      return false;
    }
  }

  // -- what is shown
  function status() {
    if (broken || message.kind === "fault") return "fault";
    if (!running) return "paused";
    return late ? "late" : "running";
  }
  function refresh() {
    const { driver, exploring, estimating, hand, cloth } = session;
    const { name, label, damping, mass } = cloth;
    set({
      state: {
        ...{
          arm: about.arms[0],
          driver,
          exploring,
          estimating,
          hand,
          cloth: { name, label, material: [damping, mass] },
        },
        ...{ fixed: false, tension: [], recording: false, waiting: false },
        ...{ running, status: status(), message, answered },
      },
    });
  }
  function clock() {
    const basis = history.at(-1)?.basis;
    const { about: left } = tiers.now();
    const more = [basis && `plan from ${basis}`, left].filter(Boolean);
    return [`${(session.step * about.period).toFixed(1)} s`, `step ${session.step}`, ...more].join(", ");
  }
  async function drawFrame() {
    const { stage, mask, reconstruction, p, report } = session;
    drawScene(stage);
    const [scene, ...images] = await Promise.all([fileOf(canvas, "image/jpeg"), seen(mask), decoded(reconstruction)]);
    frames += 1;
    set({
      frame: {
        ...{ number: frames, scene, seen: images[0], decoded: images[1], clock: clock() },
        traces: traces(session, history, about.period),
        marks: history.flatMap((moment, k) => (moment.periodEnded ? [k] : [])),
        at: plane.at(p),
        trail: history.map((moment) => plane.at(moment.p)),
        nearest: lab.cloths.find(({ name }) => name === nearestMaterial(p, lab.biases)).label,
        region: report ? report.region.map(plane.at) : [],
        warning: report?.warning ?? "",
      },
    });
  }
  let drawing = null; // the frame that is being drawn; frames come one after the other
  async function show({ force = true } = {}) {
    refresh();
    if (drawing && !force) return; // a slow page leaves some out
    const mine = (drawing = Promise.resolve(drawing).then(() => guarded(drawFrame)));
    await mine;
    if (drawing === mine) drawing = null;
  }
  async function showTarget(aim, { onCanvas = true } = {}) {
    const view = targetView(aim, lab);
    const version = (get("target")?.version ?? 0) + (onCanvas ? 1 : 0);
    set({ target: { ...view, version, reconstruction: await reconstructed(view.reconstruction) } });
  }

  // -- what is asked of the session
  async function told(what, more) {
    const { now, answer, aim } = await ask(what, more);
    session = now;
    return { answer, aim };
  }
  async function aim(what, more, options) {
    const { aim: next } = await told(what, more);
    await showTarget(next, options);
  }
  async function advance({ solve = true } = {}) {
    const { solveEvery, estimateEvery } = tiers.now();
    const { answer } = await told("step", { solve, solveEvery, estimateEvery });
    history = [...history, answer].slice(-about.history);
  }
  const forget = () => (history = []);

  // -- time
  const now = () => performance.now() / 1000;
  async function run() {
    const mine = (turn += 1);
    for (let due = now(); running && turn === mine;) {
      const began = now();
      late = began - due > about.period / 2;
      const well = await guarded(() => advance({ solve: began - due < about.period }));
      if (!well) {
        running = false;
        broken = true;
      }
      const took = now() - began; // the page draws meanwhile
      show({ force: !well });
      if (running && tiers.took(took)) {
        const { about: left } = tiers.now();
        say(left ? `this machine is slow for 5 steps a second: from now on ${left}` : "");
      }
      due = Math.max(due + about.period, now() - 2 * about.period); // lost time is not made up for
      await new Promise((resolve) => setTimeout(resolve, Math.max(5, 1000 * (due - now()))));
    }
  }
  function start() {
    broken = false;
    if (running) return;
    running = true;
    guarded(run);
  }
  const pause = () => (running = false);

  // -- what a person does
  const actions = {
    start,
    pause,
    async step() {
      broken = false;
      await advance();
    },
    async reset() {
      await told("reset");
      broken = false;
      forget();
    },
    "set cloth": ({ cloth }) => told("setCloth", { name: cloth }),
    "set material": ({ damping, mass }) => told("setMaterial", { damping, mass }),
    "set p": ({ at }) => told("setBias", { p: plane.p(at) }),
    explore: ({ on: wanted }) => told("explore", { on: wanted }),
    estimate: ({ on: wanted }) => told("estimate", { on: wanted }),
    "set driver": ({ driver }) => told("setDriver", { driver }),
    "set hand": ({ u }) => told("setHand", { u }),
    "move sticks": ({ places }) =>
      told("setHand", { u: about.hands.map(([, [low, high]], k) => low + places[k] * (high - low)) }),
    "greet gamepad"({ enough }) {
      say(enough ? "gamepad: left stick: shoulder, right stick: elbow" : "⚠ a gamepad needs two sticks and a trigger");
    },
    draw: (_, [pixels]) => aim("setTarget", { mask: new Uint8Array(pixels) }, { onCanvas: false }),
    clear: () => say("draw a target; until then the robot keeps the one that it has"),
    pick: ({ name }) => aim("setTarget", { mask: about.gallery.find((each) => each.name === name).image }),
    take: () => aim("takeImage"),
  };
  async function send({ do: what, id, ...more }, _, buffers = []) {
    if (what === "alive?") tell("msg:custom", { do: "alive" });
    if (!(what in actions)) return;
    say("");
    await guarded(() => actions[what](more, buffers));
    answered = id;
    if (running) refresh();
    else show();
  }
  function hide() {
    if (!document.hidden || !running) return;
    pause();
    say("paused while nobody saw the page: press start");
    refresh();
  }
  document.addEventListener("visibilitychange", hide);

  set({ about, ellipse: null });
  await showTarget(first.aim);
  await show();
  return { get, on, off, send, pause };
}
