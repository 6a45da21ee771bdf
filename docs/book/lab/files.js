// What belongs to the page lies beside it in scripts, as base64 of gzip files: from a folder a browser fetches nothing.
function unpackedFile(name) {
  const bytes = Uint8Array.from(atob(globalThis.clothlabFiles[name]), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")));
}
