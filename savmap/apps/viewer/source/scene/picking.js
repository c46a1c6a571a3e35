// What is under the pointer: elements, their corners, places of the camera's path.
import { Matrix4, Vector4 } from "three";

// Pixels (x, y, depth) of a row's vertices in a view of so many pixels; depth is NaN behind the camera.
export function projected(row, camera, width, height) {
  camera.updateMatrixWorld();
  const matrix = new Matrix4()
    .set(...row.siteFromRow)
    .premultiply(camera.matrixWorldInverse)
    .premultiply(camera.projectionMatrix);
  const count = row.positions.length / 3,
    pixels = new Float32Array(3 * count),
    place = new Vector4();
  for (let k = 0; k < count; k++) {
    place.set(row.positions[3 * k], row.positions[3 * k + 1], row.positions[3 * k + 2], 1).applyMatrix4(matrix);
    pixels[3 * k] = ((place.x / place.w + 1) * width) / 2;
    pixels[3 * k + 1] = ((1 - place.y / place.w) * height) / 2;
    pixels[3 * k + 2] = place.w > 0 ? place.z / place.w : NaN;
  }
  return pixels;
}

const EDGE_PX = 8;

// The element whose edge is nearest the pointer, or, where there is none near, the nearest one that surrounds it.
export function pick(rows, camera, width, height, x, y, reach = EDGE_PX, within = true) {
  let best = null,
    score = Infinity;
  for (const row of rows) {
    const pixels = projected(row, camera, width, height);
    for (const one of row.shown) {
      const found = edgeDistance(one, pixels, x, y);
      const here =
        found <= reach
          ? found
          : within && surrounds(one, pixels, x, y)
            ? reach + 1 + pixels[3 * one.first + 2]
            : Infinity;
      if (here < score) [best, score] = [one, here];
    }
  }
  return best;
}

export function pickVertex(rows, camera, width, height, x, y, reach = 18) {
  return nearest(rows, (row) => row.shown, camera, width, height, x, y, reach);
}

// The place of a camera's path that is nearest the pointer.
export function pickPlace(rows, camera, width, height, x, y) {
  const paths = rows.map((row) => ({ row, siteFromRow: row.siteFromRow, positions: row.path.positions }));
  const whole = (path) => [{ first: 0, count: path.positions.length / 3 }];
  const found = nearest(paths, whole, camera, width, height, x, y, EDGE_PX);
  return found && { row: found.row.row, index: found.vertex };
}

// The vertex nearest a pixel, of those parts of each row.
function nearest(rows, partsOf, camera, width, height, x, y, reach) {
  let best = null,
    least = reach;
  for (const row of rows) {
    const pixels = projected(row, camera, width, height);
    for (const { first, count } of partsOf(row))
      for (let k = first; k < first + count; k++) {
        const apart = Math.hypot(pixels[3 * k] - x, pixels[3 * k + 1] - y);
        if (apart < least && pixels[3 * k + 2] <= 1) [best, least] = [{ row, vertex: k }, apart];
      }
  }
  return best;
}

function edgeDistance(one, pixels, x, y) {
  let least = Infinity;
  for (let k = 0; k < one.edges.length; k += 2) {
    const a = 3 * one.edges[k],
      b = 3 * one.edges[k + 1];
    if (!(pixels[a + 2] <= 1) || !(pixels[b + 2] <= 1)) continue;
    least = Math.min(least, toSegment(x, y, pixels[a], pixels[a + 1], pixels[b], pixels[b + 1]));
  }
  if (!one.edges.length)
    for (let k = one.first; k < one.first + one.count; k++)
      if (pixels[3 * k + 2] <= 1) least = Math.min(least, Math.hypot(pixels[3 * k] - x, pixels[3 * k + 1] - y));
  return least;
}

function toSegment(x, y, ax, ay, bx, by) {
  const dx = bx - ax,
    dy = by - ay,
    length = dx * dx + dy * dy;
  const t = length ? Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / length, 0), 1) : 0;
  return Math.hypot(x - ax - t * dx, y - ay - t * dy);
}

// Whether the closed line of an element's edges goes around a pixel.
function surrounds(one, pixels, x, y) {
  if (one.edges.length < 6) return false;
  let inside = false;
  for (let k = 0; k < one.edges.length; k += 2) {
    const a = 3 * one.edges[k],
      b = 3 * one.edges[k + 1];
    if (!(pixels[a + 2] <= 1) || !(pixels[b + 2] <= 1)) return false;
    const [ax, ay, bx, by] = [pixels[a], pixels[a + 1], pixels[b], pixels[b + 1]];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
  }
  return inside;
}
