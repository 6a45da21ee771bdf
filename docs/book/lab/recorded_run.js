// A recorded run as the model of the panel: it shows what was kept at each step, and computes nothing.
// Python's LivePanel has the same traits and takes the same messages.

// shots: of each step, the traits that were new then, `caption`, and of which step each of them is `newest`.
function recordedRun(shots) {
  const { get, on, off, set } = makeTraits();
  const from = {}; // the shot that a trait was last shown of
  const about = unpacked(shots[0].about);
  const last = shots.length - 1;
  let at = 0;
  let timer = null;
  let answered = "";

  const newest = (name) => shots[shots[at].newest[name]][name];
  function state() {
    const running = timer !== null;
    const message = { text: newest("caption"), kind: "info" };
    const now = { running, status: running ? "running" : "paused", seconds: at * about.period, message, answered };
    return { ...unpacked(newest("state")), ...now };
  }
  function show() {
    const news = { state: state() };
    for (const name of ["target", "frame", "ellipse"]) {
      if (from[name] !== shots[at].newest[name]) news[name] = unpacked(newest(name));
      from[name] = shots[at].newest[name];
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
    }, 1000 * about.period);
  }
  const reset = () => (at = 0);
  const seek = ({ seconds }) => (at = Math.round(seconds / about.period));
  function does(action, id) {
    action();
    answered = id;
    show();
  }
  // Nobody looks any more.
  function rest() {
    pause();
    show();
  }

  set({ about });
  show();
  return { get, on, off, send: makeSend({ start, pause, step, reset, seek }, does), rest };
}
