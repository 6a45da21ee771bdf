// The page "Throw a cloth": the panel with the recorded run.
async function showRun(el) {
  const { shots } = await unpackedFile("run.json").json();
  el.replaceChildren();
  render({ model: recordedRun(shots), el });
}

const place = document.getElementById("clothlab-lab");
showRun(place).catch((error) => (place.textContent = `This browser can't play the recorded run: ${error.message}.`));
