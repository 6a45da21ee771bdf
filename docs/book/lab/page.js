// The page "Throw a cloth": the panel with the recorded run, which lies beside it as base64 of a gzip file.
async function showRun(el) {
  const bytes = Uint8Array.from(atob(globalThis.clothlabRun), (letter) => letter.charCodeAt(0));
  const text = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const { shots } = await new Response(text).json();
  el.replaceChildren();
  render({ model: recordedRun(shots), el });
}

const place = document.getElementById("clothlab-lab");
showRun(place).catch((error) => (place.textContent = `This browser can't play the recorded run: ${error.message}.`));
