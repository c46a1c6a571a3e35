// The axes of a frame in a corner of the view.
import { Vector3 } from "three";

const SVG = "http://www.w3.org/2000/svg",
  LENGTH = 30,
  LEAST = 5; // of an axis that points at the viewer, nothing is drawn

// `axes`: names and directions (site's frame).
export function drawCompass(layer, axes, camera) {
  const basis = [new Vector3(), new Vector3(), new Vector3()];
  camera.updateMatrixWorld();
  camera.matrixWorld.extractBasis(...basis);
  const [right, up] = basis.map((axis) => axis.normalize());
  const made = [];
  for (const { name, to } of axes) {
    const along = new Vector3(...to),
      [x, y] = [LENGTH * along.dot(right), -LENGTH * along.dot(up)];
    if (Math.hypot(x, y) < LEAST) continue;
    const far = 1 + (6 + 3 * name.length) / Math.hypot(x, y),
      style = name.endsWith("N") ? "north" : "";
    made.push(
      node("line", { x1: 0, y1: 0, x2: x, y2: y, class: style }),
      node("text", { x: far * x, y: far * y, class: style }, name),
    );
  }
  layer.replaceChildren(...made);
}

function node(tag, attributes, said = "") {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  made.append(said);
  return made;
}
