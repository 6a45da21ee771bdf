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
  return { get: (name) => traits[name], on, off, set };
}

// How a model takes what a panel sends it: `does(action, id)` for each that it knows.
function makeSend(actions, does) {
  return async function send({ do: what, id, ...more }, _, buffers = []) {
    if (what in actions) await does(() => actions[what](more, buffers), id);
  };
}
