// What lies beside the page, as scripts that hand over a text: pictures as data URIs, covariances as base64. A page opened from a disk may run
// scripts beside it, and may neither fetch what lies there nor draw pictures from there into WebGL.

const waiting = new Map(),
  kept = new Map();
const MOST_KEPT = 24;
const PICTURE = /^data:image\/jpeg;base64,[A-Za-z0-9+/=]*$/,
  NUMBERS = /^[A-Za-z0-9+/=]*$/;

function part(path, pattern, read) {
  if (kept.has(path)) return kept.get(path);
  const asked = new Promise((resolve, reject) => {
    const script = document.createElement("script");
    const failed = () => reject(new Error(path));
    waiting.set(path, (content) =>
      pattern.test(content) ? Promise.resolve(read(content)).then(resolve, reject) : failed(),
    );
    script.onerror = failed;
    script.onload = () => script.remove();
    script.src = path.split("/").map(encodeURIComponent).join("/");
    document.head.append(script);
  });
  kept.set(path, asked);
  asked.catch(() => kept.delete(path));
  if (kept.size > MOST_KEPT) kept.delete(kept.keys().next().value);
  return asked;
}

window.savmapPart = (path, content) => {
  waiting.get(path)?.(content);
  waiting.delete(path);
};

export const picture = (path) => part(path, PICTURE, decoded);

export const numbers = (path) => part(path, NUMBERS, floatsOf);

export function floatsOf(content) {
  const text = atob(content),
    bytes = new Uint8Array(text.length);
  for (let k = 0; k < bytes.length; k++) bytes[k] = text.charCodeAt(k);
  return new Float32Array(bytes.buffer);
}

async function decoded(address) {
  const image = new Image();
  image.src = address;
  await image.decode();
  return image;
}
