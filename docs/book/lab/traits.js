// The traits of a model as the panel knows them: it asks for them by name, and is told when one is new.
function makeTraits() {
  const traits = {};
  const listeners = new Map();
  const of = (event) => listeners.get(event) ?? [];
  function on(event, listener) {
    listeners.set(event, [...of(event), listener]);
  }
  function off(event, listener) {
    listeners.set(
      event,
      of(event).filter((each) => each !== listener),
    );
  }
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
