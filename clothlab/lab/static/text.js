// Text on a canvas, in the size that the page's style gives to the canvas, so that a projector's style enlarges it, too.
function textSize(canvas) {
  return parseFloat(getComputedStyle(canvas).fontSize) || 14; // outside a page there is none
}

// Writes on a canvas.
function writer(canvas, ctx) {
  const size = textSize(canvas);
  ctx.font = `${size}px system-ui, sans-serif`;
  ctx.textBaseline = "alphabetic";
  ctx.textAlign = "left";
  const width = (text) => ctx.measureText(text).width;
  const rim = (text, x, y) => {
    ctx.strokeStyle = "#fff"; // a rim, because a line may run below
    ctx.lineWidth = size / 4;
    ctx.lineJoin = "round";
    ctx.setLineDash([]);
    ctx.strokeText(text, x, y);
    ctx.lineWidth = 1;
  };
  // `align`: what of the text is at x, 0 its left end to 1 its right end; y is its baseline.
  const write = (text, x, y, { align = 0, rimmed = false, colour = "#222" } = {}) => {
    const left = x - align * width(text);
    if (rimmed) rim(text, left, y);
    ctx.fillStyle = colour;
    ctx.fillText(text, left, y);
  };
  const upwards = (text, x, y) => {
    ctx.save();
    ctx.translate(x, y);
    ctx.rotate(-Math.PI / 2);
    ctx.fillStyle = "#222";
    ctx.fillText(text, -width(text) / 2, 0);
    ctx.restore();
  };
  return { size, thick: size / 7, width, write, upwards };
}
