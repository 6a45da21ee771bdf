// The section "Set the table": how the cloth is spread, the phases of a task, a picture, and what came of it.
const MARKS = { waiting: "○", running: "▶", done: "✓", failed: "✗", stopped: "■" };

function tableSection(act) {
  const method = makeMenu("spread the cloth:", () => {});
  const start = make("button", { type: "button", textContent: "start the task", onclick: () => act("set the table", { method: method.select.value }) });
  const stop = make("button", { type: "button", textContent: "stop the task", onclick: () => act("stop the task") });
  const message = make("div", { role: "status" }), phases = make("ol", { className: "phases row", "aria-label": "phases" }), verdict = make("div");
  const picture = makePicture("the table", 384);
  const note = make("div", { className: "note", textContent: "The robot fetches a cloth from a rack, spreads it on a table and puts a basket on it. It has a scene of its own, and as much time as it takes to compute." });
  const details = make("details", { className: "table" }, make("summary", { textContent: "Set the table" }), note,
    make("div", { className: "row" }, method.row, start, stop), message, phases, verdict, picture.figure);
  let choices = "", reached = "", frame = null;

  function draw(news) {
    if (choices !== news.choices.join()) {
      choices = news.choices.join();
      method.fill(news.choices.map((each) => [each, each]));
    }
    for (const each of [start, method.select]) off(each, news.running ? "a task runs: stop it first" : "");
    off(stop, news.running ? "" : "no task runs");
    message.textContent = news.message.text;
    message.className = `message ${news.message.kind}`;
    if (reached !== JSON.stringify(news.phases)) {
      reached = JSON.stringify(news.phases);
      phases.replaceChildren(...news.phases.map(showPhase));
    }
    verdict.replaceChildren(...news.verdict.map(({ text, good }) => make("div", { className: good ? "" : "no", textContent: `${good ? "✓" : "✗"} ${text}` })));
    if (frame !== news.picture) picture.show(news.picture, "image/jpeg");
    frame = news.picture;
    picture.caption.hidden = !news.picture.byteLength;
  }
  function showPhase([name, mark]) {
    const item = make("li", { className: mark, title: mark, textContent: `${MARKS[mark]} ${name}` });
    if (mark === "running") item.setAttribute("aria-current", "step");
    return item;
  }
  return { details, draw };
}
