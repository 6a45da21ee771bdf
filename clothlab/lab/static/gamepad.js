// A gamepad's sticks and trigger. They act when they move by more than a resting stick trembles.
function watchGamepad(model, act) {
  let known = null, before = null;
  const look = () => {
    const { axes, trigger, moves } = model.get("about").gamepad;
    const pad = [...navigator.getGamepads()].find((each) => each?.connected);
    if (!pad) {
      known = before = null;
      return;
    }
    const enough = pad.axes.length > Math.max(...axes) && pad.buttons.length > trigger;
    if (known !== pad.id + pad.index) {
      known = pad.id + pad.index;
      before = null;
      act("greet gamepad", { enough });
    }
    if (!enough) return;
    const places = [...axes.map((k) => (pad.axes[k] + 1) / 2), pad.buttons[trigger].value];
    if (before && Math.max(...places.map((place, k) => Math.abs(place - before[k]))) < moves) return;
    if (before) act("move sticks", { places });
    before = places; // the first time: where they rest
  };
  const timer = setInterval(look, 500 * model.get("about").period); // twice a control step [ms]
  return () => clearInterval(timer);
}
