// Curves over the last steps. Titles and legends are text of the page, which never collides; only the plot is a canvas.
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"]; // Okabe and Ito's
const DASHES = [[], [6, 3]];
const GREY = "#555", SHARP = 2; // canvas pixels to each CSS pixel, so that a projector shows no blur

// Ticks at round numbers around least and most, as many as have room: 1, 2 or 5 times a power of ten apart.
function roundTicks(least, most, room) {
  const intervals = Math.max(room, 2); // one below 0 and one above
  for (let power = 10 ** Math.floor(Math.log10((most - least) / intervals)); ; power *= 10)
    for (const step of [power, 2 * power, 5 * power]) {
      const first = Math.floor(least / step + 1e-9), last = Math.ceil(most / step - 1e-9);
      if (last - first <= intervals) return Array.from({ length: last - first + 1 }, (_, k) => +((first + k) * step).toPrecision(6));
    }
}

function legendKey(name, paint) {
  const key = document.createElement("span"), canvas = document.createElement("canvas"), ctx = canvas.getContext("2d");
  canvas.width = 28 * SHARP;
  canvas.height = 12 * SHARP;
  ctx.scale(SHARP, SHARP);
  paint(ctx);
  key.className = "key";
  key.append(canvas, name);
  return key;
}

function path(ctx, points, colour, width, dashes = []) {
  ctx.strokeStyle = colour;
  ctx.lineWidth = width;
  ctx.setLineDash(dashes);
  ctx.beginPath();
  points.forEach((point, k) => point && (points[k - 1] ? ctx.lineTo(...point) : ctx.moveTo(...point))); // null is a gap
  ctx.stroke();
  ctx.setLineDash([]);
}

const lineKey = (name, colour, dashes) => legendKey(name, (ctx) => path(ctx, [[0, 6], [28, 6]], colour, 2, dashes));

function diamond(ctx, [x, y], r, thick = 2) {
  ctx.beginPath();
  for (const [dx, dy] of [[0, -r], [r, 0], [0, r], [-r, 0]]) ctx.lineTo(x + dx, y + dy);
  ctx.closePath();
  ctx.fillStyle = "#fff";
  ctx.fill();
  ctx.strokeStyle = COLOURS[1];
  ctx.lineWidth = thick;
  ctx.stroke();
}

function dot(ctx, [x, y], r) {
  ctx.beginPath();
  ctx.arc(x, y, r, 0, 7);
  ctx.fillStyle = COLOURS[0];
  ctx.fill();
}

function tracePlot() {
  const figure = document.createElement("figure"), caption = document.createElement("figcaption"), canvas = document.createElement("canvas");
  figure.append(caption, canvas);
  canvas.className = "plot";
  const ctx = canvas.getContext("2d");
  let captioned = "", last = null;

  function describe({ title, unit, limit, pairs }, lines) {
    const names = JSON.stringify([title, lines.map(({ name }) => name), limit?.[0], pairs.length > 0]);
    if (captioned === names) return;
    captioned = names;
    const bold = document.createElement("b");
    bold.textContent = `${title} [${unit}]`;
    caption.replaceChildren(bold);
    if (lines.length > 1) lines.forEach(({ name, colour, dash }) => caption.append(lineKey(name, COLOURS[colour], DASHES[dash])));
    if (pairs.length) caption.append(legendKey("predicted", (context) => diamond(context, [20, 6], 5)), legendKey("achieved", (context) => dot(context, [20, 6], 5)));
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${title} [${unit}]${limit ? `, with a line for ${limit[0]} at ${+limit[1].toPrecision(3)}` : ""}`);
  }

  function draw(...news) {
    const [{ limit, pairs }, marks, { history, period }, plain] = (last = news); // plain: without what only a near reader tells apart
    const lines = news[0].lines.filter((line) => !(plain && line.fine));
    describe(news[0], lines);
    const [WIDTH, HEIGHT] = [canvas.clientWidth, canvas.clientHeight];
    if (!WIDTH || !HEIGHT) return; // folded away
    if (canvas.width !== WIDTH * SHARP || canvas.height !== HEIGHT * SHARP) [canvas.width, canvas.height] = [WIDTH * SHARP, HEIGHT * SHARP];
    ctx.setTransform(SHARP, 0, 0, SHARP, 0, 0);
    ctx.fillStyle = "#fff";
    ctx.fillRect(0, 0, WIDTH, HEIGHT);
    const { size, thick, width, write } = writer(canvas, ctx);
    const values = lines.flatMap((line) => line.values.filter((v) => v !== null)).concat(limit ? [limit[1]] : [], pairs.flatMap((pair) => pair.slice(1)));
    const bottom = HEIGHT - 1.7 * size, top = 0.6 * size, least = Math.min(0, ...values), most = Math.max(least + 1e-3, ...values);
    const ticks = roundTicks(least, most, Math.floor((bottom - top) / (1.5 * size))), low = ticks[0], high = ticks.at(-1);
    const left = Math.max(...ticks.map((v) => width(`${v}`.replace("-", "−")))) + 0.9 * size, right = WIDTH - 0.8 * size;
    const count = Math.max(0, ...lines.map((line) => line.values.length)), first = history - count;
    const x = (k) => left + ((right - left) * (first + k)) / (history - 1), y = (v) => bottom - ((bottom - top) * (v - low)) / (high - low);
    for (const v of ticks) {
      path(ctx, [[left - 0.3 * size, y(v)], [right, y(v)]], v ? "#dcdcdc" : "#888", 1);
      write(`${v}`.replace("-", "−"), left - 0.5 * size, y(v) + 0.35 * size, { align: 1 });
    }
    for (const k of marks) path(ctx, [[x(k), top], [x(k), bottom]], "#cfcfcf", 1);
    const seconds = history * period, now = width("now"), apart = roundTicks(0, seconds, Math.min(6, Math.floor((right - left) / (6 * size))))[1];
    for (let ago = 0; ago < seconds; ago += apart) {
      const at = x(count - 1 - ago / period), text = ago ? `${ago} s ago` : "now";
      path(ctx, [[at, bottom], [at, bottom + 0.3 * size]], "#888", 1);
      if (!ago) write(text, right, HEIGHT - 0.3 * size, { align: 1 });
      else if (at - width(text) / 2 > 0 && at + width(text) / 2 < right - now - size) write(text, at, HEIGHT - 0.3 * size, { align: 0.5 });
    }
    if (limit) path(ctx, [[left, y(limit[1])], [right, y(limit[1])]], GREY, thick, [1.5 * thick, 1.5 * thick]);
    for (const { values, colour, dash } of lines) path(ctx, values.map((v, k) => (v === null ? null : [x(k), y(v)])), COLOURS[colour], thick, DASHES[dash].map((length) => (length * thick) / 2));
    for (const [k, predicted, achieved] of pairs) {
      path(ctx, [[x(k), y(predicted)], [x(k), y(achieved)]], "#222", 0.75 * thick);
      diamond(ctx, [x(k), y(predicted)], 0.36 * size, thick);
      dot(ctx, [x(k), y(achieved)], 0.32 * size);
    }
    if (limit) {
      const above = y(limit[1]) - 0.4 * size, free = above - size > 0 ? above : y(limit[1]) + 1.1 * size;
      write(`${limit[0]}: ${+limit[1].toPrecision(2)}`, left + 0.4 * size, free, { rimmed: true, colour: "#333" });
    }
  }
  new ResizeObserver(() => last && draw(...last)).observe(canvas); // lets go of it with the canvas
  return { figure, draw };
}
