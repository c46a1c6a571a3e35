// Pictures that lie beside the page, as scripts that hand over data URIs: a page opened from a disk may run scripts beside it, and may not
// draw pictures beside it into WebGL.

const waiting = new Map(), kept = new Map();
const MOST_KEPT = 24;

export function picture(path) {
  if (kept.has(path)) return kept.get(path);
  const asked = new Promise((resolve, reject) => {
    const script = document.createElement("script");
    waiting.set(path, (address) => decoded(address).then(resolve, reject));
    script.onerror = () => reject(new Error(path));
    script.onload = () => script.remove();
    script.src = path.split("/").map(encodeURIComponent).join("/");
    document.head.append(script);
  });
  kept.set(path, asked);
  asked.catch(() => kept.delete(path));
  if (kept.size > MOST_KEPT) kept.delete(kept.keys().next().value);
  return asked;
}

window.savmapPicture = (path, address) => {
  if (waiting.has(path) && /^data:image\/jpeg;base64,[A-Za-z0-9+/=]*$/.test(address)) waiting.get(path)(address);
  waiting.delete(path);
};

async function decoded(address) {
  const image = new Image();
  image.src = address;
  await image.decode();
  return image;
}
