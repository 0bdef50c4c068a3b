// What a page carries compressed.

/** Bytes of a compressed data block of the page (gzip, base64). */
export async function block(id) {
  const text = document.getElementById(id).textContent.trim();
  const compressed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([compressed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * The part that draws in three dimensions. It is run as an inline script: the page's policy names its hash, so that nothing
 * else is.
 */
export async function sceneModule() {
  if (!globalThis.carpusScene) {
    const script = document.createElement("script");
    script.textContent = new TextDecoder().decode(await block("live-scene"));
    document.head.append(script);
    if (!globalThis.carpusScene) throw new Error("the page's policy refused the part that draws");
  }
  return globalThis.carpusScene;
}
