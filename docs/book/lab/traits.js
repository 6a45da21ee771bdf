// The traits of a model as the panel knows them: it asks for them by name, and is told when one is new.
function makeTraits() {
  const traits = {};
  const listeners = {};
  const of = (event) => (listeners[event] ??= new Set());
  const on = (event, listener) => of(event).add(listener);
  const off = (event, listener) => of(event).delete(listener);
  function tell(event, ...news) {
    for (const listener of of(event)) listener(...news);
  }
  // All are new before the first is told of.
  function set(news) {
    Object.assign(traits, news);
    for (const name of Object.keys(news)) tell(`change:${name}`);
  }
  return { get: (name) => traits[name], on, off, tell, set };
}

// What a panel may ask of its model beside time.
const STEERING = "set arm, set driver, explore, set tension, set hand, move sticks, set cloth, set material, set p";
const OTHERS = "estimate, draw, clear, pick, take, upload, record, save, discard";

// Of that, what has no action, and why: the panel switches it off.
function refused(actions, why) {
  const names = [STEERING, OTHERS].flatMap((each) => each.split(", "));
  return Object.fromEntries(names.filter((name) => !(name in actions)).map((name) => [name, why]));
}
