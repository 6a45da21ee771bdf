// Curves over the last steps. Titles and legends are text of the page, which never collides; only the plot is a canvas.
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"]; // Okabe and Ito's
const DASHES = [[], [6, 3]];
const GREY = "#555", SHARP = 2; // canvas pixels to each CSS pixel, so that a projector shows no blur

function roundStep(span, wanted) {
  const rough = span / wanted, power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((k) => k * power >= rough);
}

function legendKey(name, colour, dashes) {
  const key = document.createElement("span");
  key.className = "key";
  key.append(swatch(colour, dashes), name);
  return key;
}

function swatch(colour, dashes) {
  const canvas = document.createElement("canvas"), ctx = canvas.getContext("2d");
  canvas.width = 28 * SHARP;
  canvas.height = 10 * SHARP;
  canvas.style.cssText = "width:28px;height:10px;margin:0 4px 0 12px";
  ctx.scale(SHARP, SHARP);
  ctx.strokeStyle = colour;
  ctx.setLineDash(dashes);
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.moveTo(0, 5);
  ctx.lineTo(28, 5);
  ctx.stroke();
  return canvas;
}

function tracePlot() {
  const HEIGHT = 116, left = 46, bottom = HEIGHT - 21, top = 8;
  const figure = document.createElement("figure"), caption = document.createElement("figcaption"), canvas = document.createElement("canvas");
  figure.append(caption, canvas);
  canvas.style.cssText = `width:100%;height:${HEIGHT}px;display:block`;
  const ctx = canvas.getContext("2d");
  let captioned = "";

  function draw({ title, unit, lines, limit }, marks, { history, period }) {
    const names = [...lines.map(({ name }) => name), limit?.[0]].join();
    const WIDTH = figure.clientWidth || 470, right = WIDTH - 12;
    if (canvas.width !== WIDTH * SHARP) [canvas.width, canvas.height] = [WIDTH * SHARP, HEIGHT * SHARP];
    if (captioned !== title + names) {
      captioned = title + names;
      const bold = document.createElement("b");
      bold.textContent = `${title} [${unit}]`;
      caption.replaceChildren(bold);
      if (lines.length > 1) lines.forEach(({ name, colour, dash }) => caption.append(legendKey(name, COLOURS[colour], DASHES[dash])));
      if (limit) caption.append(legendKey(limit[0], GREY, [3, 3]));
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `${title} [${unit}]`);
    }
    ctx.setTransform(SHARP, 0, 0, SHARP, 0, 0);
    ctx.fillStyle = "#fff";
    ctx.fillRect(0, 0, WIDTH, HEIGHT);
    const values = lines.flatMap((line) => line.values.filter((v) => v !== null)).concat(limit ? [limit[1]] : []);
    const least = Math.min(0, ...values), most = Math.max(least + 1e-3, ...values), step = roundStep(most - least, 3);
    const low = Math.floor(least / step + 1e-9) * step, high = Math.ceil(most / step - 1e-9) * step;
    const count = Math.max(0, ...lines.map((line) => line.values.length)), first = history - count;
    const x = (k) => left + ((right - left) * (first + k)) / (history - 1), y = (v) => bottom - ((bottom - top) * (v - low)) / (high - low);
    const path = (points, colour, width, dashes) => {
      ctx.strokeStyle = colour;
      ctx.lineWidth = width;
      ctx.setLineDash(dashes);
      ctx.beginPath();
      points.forEach((point, k) => point && (points[k - 1] ? ctx.lineTo(...point) : ctx.moveTo(...point))); // null is a gap
      ctx.stroke();
    };
    ctx.font = "13px sans-serif";
    ctx.textBaseline = "middle";
    ctx.textAlign = "right";
    for (let v = low; v < high + step / 2; v += step) {
      path([[left, y(v)], [right, y(v)]], "#e4e4e4", 1, []);
      ctx.fillStyle = "#222";
      ctx.fillText(+v.toPrecision(6), left - 6, y(v));
    }
    for (const k of marks) path([[x(k), top], [x(k), bottom]], "#cfcfcf", 1, []);
    const seconds = history * period, apart = roundStep(seconds, 4);
    ctx.textBaseline = "alphabetic";
    ctx.textAlign = "center";
    ctx.fillStyle = "#222";
    for (let ago = apart; ago < seconds; ago += apart) ctx.fillText(`${ago} s ago`, x(count - 1 - ago / period), HEIGHT - 4);
    ctx.textAlign = "right";
    ctx.fillText("now", right, HEIGHT - 4);
    if (limit) path([[left, y(limit[1])], [right, y(limit[1])]], GREY, 1.5, [3, 3]);
    for (const { values, colour, dash } of lines) path(values.map((v, k) => v === null ? null : [x(k), y(v)]), COLOURS[colour], 2, DASHES[dash]);
    ctx.setLineDash([]);
  }
  return { figure, draw };
}
