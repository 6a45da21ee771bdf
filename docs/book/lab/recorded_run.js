// A recorded run as the model of the panel: it shows what was kept at each step, and computes nothing.
// Python's LivePanel has the same traits and takes the same messages.
const REFUSAL = "a recording can't be steered: a running notebook 08 does this";

// shots: of each step, the traits that were new then, and `caption`.
function recordedRun(shots) {
  const { get, on, off, tell, set } = makeTraits();
  const from = {}; // the shot that a trait was last shown of
  const { period } = shots[0].about;
  const last = shots.length - 1;
  let at = 0;
  let timer = null;
  let answered = "";

  function newest(name) {
    let k = at;
    while (!(name in shots[k])) k -= 1;
    return k;
  }
  function about() {
    return { ...unpacked(shots[0].about), length: last * period, refused: refused(actions, REFUSAL) };
  }
  function state() {
    const running = timer !== null;
    const text = shots[newest("caption")].caption;
    const now = {
      running,
      status: running ? "running" : "paused",
      seconds: at * period,
      message: { text, kind: "info" },
      answered,
    };
    return { ...unpacked(shots[newest("state")].state), ...now };
  }
  function show() {
    const others = ["target", "frame", "ellipse"].filter((name) => from[name] !== newest(name));
    const news = { state: state() };
    for (const name of others) {
      from[name] = newest(name);
      news[name] = unpacked(shots[from[name]][name]);
    }
    set(news);
  }

  function pause() {
    clearInterval(timer);
    timer = null;
  }
  function step() {
    at = Math.min(at + 1, last);
    if (at === last) pause();
  }
  function start() {
    if (at === last) at = 0; // once more
    timer ??= setInterval(() => {
      step();
      show();
    }, 1000 * period);
  }
  const reset = () => (at = 0);
  const seek = ({ seconds }) => (at = Math.round(seconds / period));
  const actions = { start, pause, step, reset, seek };

  function send({ do: what, id, ...more }) {
    if (what === "alive?") tell("msg:custom", { do: "alive" });
    if (!(what in actions)) return;
    actions[what](more);
    answered = id;
    show();
  }
  function leave() {
    pause();
    show();
  }
  document.addEventListener("visibilitychange", () => document.hidden && leave());

  set({ about: about() });
  show();
  return { get, on, off, send, pause: leave };
}
