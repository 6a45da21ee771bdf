// What belongs to the page lies beside it in scripts, as base64 of gzip files: from a folder a browser fetches nothing.
// In a page that is one file, each is an element that bears its name.
function loadScript(address) {
  const name = address.split("/").pop();
  const within = document.getElementById(name);
  return new Promise((resolve, reject) => {
    const script = document.createElement("script");
    const onerror = () => reject(new Error(`${name} can't be loaded`));
    const onload = () => resolve(script.remove()); // else its text stays in memory
    const source = within ? { text: within.text } : { src: address };
    document.head.append(Object.assign(script, { onload, onerror, ...source }));
    if (!within) return;
    within.remove();
    onload(); // what is within runs at once, and says nothing
  });
}

// What was started once is not started again, unless it failed: the next time a part may arrive.
function once(start) {
  let started = null;
  function forget(error) {
    started = null;
    throw error;
  }
  return () => (started ??= start().catch(forget));
}

// A file of a script that was loaded, once: what is packed is forgotten then.
function unpackedFile(name) {
  const packed = globalThis.clothlabFiles[name];
  delete globalThis.clothlabFiles[name];
  const { body } = new Response(bytesOfBase64(packed));
  return new Response(body.pipeThrough(new DecompressionStream("gzip")));
}

// Browsers of before 2025 need the slower way.
const bytesOfBase64 = (text) =>
  Uint8Array.fromBase64?.(text) ?? Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

// Of what JSON holds, bytes as a panel takes them, and numbers.
function unpacked(value) {
  if (value === null || typeof value !== "object") return value;
  if (Array.isArray(value)) return value.map(unpacked);
  if ("bytes" in value) return bytesOfBase64(value.bytes);
  if ("floats" in value) return new Float32Array(bytesOfBase64(value.floats).buffer);
  return Object.fromEntries(Object.entries(value).map(([name, each]) => [name, unpacked(each)]));
}
