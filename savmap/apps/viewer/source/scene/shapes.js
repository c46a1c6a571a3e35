// What three.js draws: lines, dots, planes with pictures, solids and ellipsoids.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DoubleSide,
  Group,
  InstancedMesh,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  PlaneGeometry,
  Points,
  PointsMaterial,
  ShapeUtils,
  SphereGeometry,
  SRGBColorSpace,
  Texture,
  Vector2,
  Vector3,
} from "three";
import { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
import { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";
import { linesOf, vertexOf } from "../site/data.js";
import { measuredCovariance, ownCovariance } from "../site/frames.js";
import { shades } from "./colours.js";

export const MODEL = 1,
  PHOTO = 2; // layers: in the model alone, over panoramas alone; what is in neither is seen everywhere
const DASH_M = 0.06; // as long as the gap after it

export const cornersOf = ({ low, high }) =>
  [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((axis) => (k & (1 << axis) ? high[axis] : low[axis])));

// The lines of elements, the longest of each first: `coarse` of them show what is where.
export function segmentsOf(elements) {
  const longest = [],
    others = [];
  for (const one of elements) {
    const ends = linesOf(one),
      own = [];
    for (let k = 0; k < ends.length; k += 2)
      for (const [from, to] of partsOf(one, k, ends[k], ends[k + 1])) own.push({ one, from, to });
    const length = ({ from, to }) => Math.hypot(...to.map((value, k) => value - from[k]));
    own.sort((a, b) => length(b) - length(a));
    longest.push(...own.slice(0, 1));
    others.push(...own.slice(1));
  }
  return { segments: [...longest, ...others], coarse: longest.length };
}

// A line as it is drawn: dashed where nothing measured where it is, and towards an end that is assumed, as far as that is unsure.
function partsOf(one, k, from, to) {
  const { row, edges } = one;
  if (!edges.length) return [[from, to]];
  const apart = from.map((value, axis) => Math.abs(to[axis] - value)),
    along = apart.indexOf(Math.max(...apart));
  const isAssumed = (end, axis) => row.assumed[3 * edges[end] + axis];
  if ([0, 1, 2].some((axis) => axis !== along && isAssumed(k, axis) && isAssumed(k + 1, axis))) return dashes(from, to);
  const unsure = [k, k + 1].map((end) =>
    isAssumed(end, along) ? Math.sqrt(ownCovariance(row, edges[end])[along][along]) / apart[along] : 0,
  );
  const [begin, end] = [Math.min(unsure[0], 0.5), 1 - Math.min(unsure[1], 0.5)];
  const at = (share) => from.map((value, axis) => value + share * (to[axis] - value));
  return [
    ...(begin > 0 ? dashes(from, at(begin)) : []),
    [at(begin), at(end)],
    ...(end < 1 ? dashes(to, at(end)) : []),
  ];
}

function dashes(from, to) {
  const length = Math.hypot(...to.map((value, axis) => value - from[axis])),
    count = Math.max(1, Math.round(length / (2 * DASH_M)));
  const at = (share) => from.map((value, axis) => value + share * (to[axis] - value));
  return Array.from({ length: count }, (_, k) => [at(k / count), at((k + 0.5) / count)]);
}

// The lines around a flat place.
export function frameOf({ low, high }) {
  const [a, b, c, d] = [low, [high[0], low[1], low[2]], high, [low[0], high[1], high[2]]];
  return [a, b, b, c, c, d, d, a];
}

export function coloursOf(owners, of) {
  const values = new Float32Array(6 * owners.length),
    colour = new Color();
  owners.forEach((one, k) => {
    colour.set(of(one));
    values.set([colour.r, colour.g, colour.b, colour.r, colour.g, colour.b], 6 * k);
  });
  return values;
}

export function thinLines({ ends, colours }) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(ends, 3));
  geometry.setAttribute("color", new BufferAttribute(colours, 3));
  const lines = new LineSegments(geometry, new LineBasicMaterial({ vertexColors: true }));
  lines.layers.set(MODEL);
  return lines;
}

// Over panoramas with a pale edge, so that they show on any ground.
export function thickLines({ ends, colours }) {
  const geometry = new LineSegmentsGeometry();
  geometry.setPositions(ends);
  geometry.setColors(colours);
  const plain = new LineSegments2(geometry, new LineMaterial({ vertexColors: true, linewidth: 1.8 }));
  const over = new LineSegments2(
    geometry,
    new LineMaterial({ vertexColors: true, linewidth: 2.2, depthTest: false }),
  );
  const halo = new LineSegments2(
    geometry,
    new LineMaterial({
      color: "#ffffff",
      linewidth: 5,
      transparent: true,
      opacity: 0.75,
      depthTest: false,
      depthWrite: false,
    }),
  );
  plain.layers.set(MODEL);
  over.layers.set(PHOTO);
  halo.layers.set(PHOTO);
  over.renderOrder = 3;
  over.material.transparent = true;
  halo.renderOrder = 2;
  return [plain, over, halo];
}

export function fatLines(positions, colour, width) {
  const geometry = new LineSegmentsGeometry();
  geometry.setPositions(positions);
  const lines = new LineSegments2(
    geometry,
    new LineMaterial({ color: colour, linewidth: width, depthTest: false, transparent: true }),
  );
  lines.renderOrder = 5;
  lines.frustumCulled = false;
  return lines;
}

export function dots(points, colour, size) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(points.flat()), 3));
  const made = new Points(
    geometry,
    new PointsMaterial({ color: colour, size, sizeAttenuation: false, depthTest: false, transparent: true }),
  );
  made.renderOrder = 6;
  made.frustumCulled = false;
  return made;
}

export function pathLine(row) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(row.path.positions), 3));
  const path = new Group(),
    passes = row.path.pass;
  const joined = [];
  for (let k = 1; k < passes.length; k++) if (passes[k] === passes[k - 1]) joined.push(k - 1, k);
  geometry.setIndex(joined);
  const line = new LineSegments(geometry, new LineBasicMaterial({ color: shades.path }));
  const index = new Map(row.path.number.map((frame, k) => [frame, k]));
  const stills = row.stills
    .filter((one) => index.has(one.frame))
    .map((one) => vertexOf(row.path, index.get(one.frame)));
  path.add(line);
  if (stills.length) path.add(dots(stills, shades.path, 5));
  for (const part of path.children) part.layers.set(MODEL);
  return path;
}

export function photoPlane(face) {
  const plane = new Mesh(new PlaneGeometry(1, 1), new MeshBasicMaterial({ side: DoubleSide, depthWrite: false }));
  const right = new Vector3(...face.right),
    up = new Vector3(...face.up),
    out = new Vector3().crossVectors(right, up);
  const middle = new Vector3(...face.origin_m)
    .addScaledVector(right, face.width_m / 2)
    .addScaledVector(up, face.height_m / 2);
  plane.matrixAutoUpdate = false;
  plane.matrix
    .makeBasis(right.clone().multiplyScalar(face.width_m), up.clone().multiplyScalar(face.height_m), out)
    .setPosition(middle);
  plane.layers.set(MODEL);
  plane.renderOrder = -1;
  return plane;
}

export function textureOf(image) {
  const texture = new Texture(image);
  texture.colorSpace = SRGBColorSpace;
  texture.anisotropy = 8;
  texture.needsUpdate = true;
  return texture;
}

// Each solid's outline pushed along its depth: its two ends and its sides.
export function solids(elements, of) {
  const places = [],
    colours = [],
    colour = new Color();
  for (const one of elements) {
    if (!one.solid) continue;
    colour.set(of(one));
    const faces = trianglesOf(one.solid);
    places.push(...faces);
    for (let k = 0; k < faces.length; k += 3) colours.push(colour.r, colour.g, colour.b);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(places), 3));
  geometry.setAttribute("color", new BufferAttribute(new Float32Array(colours), 3));
  const mesh = new Mesh(
    geometry,
    new MeshBasicMaterial({
      vertexColors: true,
      transparent: true,
      opacity: 0.28,
      side: DoubleSide,
      depthWrite: false,
    }),
  );
  mesh.layers.set(MODEL);
  return mesh;
}

function trianglesOf({ outline, depth }) {
  const near = outline.map((corner) => new Vector3(...corner)),
    push = new Vector3(...depth);
  const far = near.map((corner) => corner.clone().add(push));
  const found = [];
  for (const [a, b, c] of ShapeUtils.triangulateShape(flattened(near), []))
    found.push(near[a], near[b], near[c], far[a], far[b], far[c]);
  near.forEach((corner, k) => {
    const next = (k + 1) % near.length;
    found.push(corner, near[next], far[next], corner, far[next], far[k]);
  });
  return found.flatMap((corner) => corner.toArray());
}

function flattened(corners) {
  const normal = new Vector3();
  corners.forEach((corner, k) => normal.add(corner.clone().cross(corners[(k + 1) % corners.length])));
  const across = new Vector3().subVectors(corners[1], corners[0]).normalize(),
    up = new Vector3().crossVectors(normal, across).normalize();
  return corners.map((corner) => new Vector2(corner.dot(across), corner.dot(up)));
}

// Unit spheres under three times the Cholesky factor of each vertex's covariance, exaggerated; flat along what is assumed.
export function ellipsoids(elements, times) {
  const vertices = elements.flatMap((one) => Array.from({ length: one.count }, (_, k) => [one.row, one.first + k]));
  const made = new InstancedMesh(
    new SphereGeometry(1, 12, 8),
    new MeshBasicMaterial({ color: shades.ellipsoids, transparent: true, opacity: 0.35, depthWrite: false }),
    vertices.length,
  );
  const matrix = new Matrix4();
  vertices.forEach(([row, vertex], k) => {
    const [a, b, c] = cholesky(measuredCovariance(row, vertex)).map((line) => line.map((value) => 3 * times * value));
    const [x, y, z] = vertexOf(row, vertex);
    made.setMatrixAt(k, matrix.set(a[0], 0, 0, x, b[0], b[1], 0, y, c[0], c[1], c[2], z, 0, 0, 0, 1));
  });
  made.layers.set(MODEL);
  made.frustumCulled = false;
  return made;
}

function cholesky(m) {
  const root = (value) => Math.sqrt(Math.max(value, 1e-10));
  const a = root(m[0][0]),
    b = m[1][0] / a,
    c = root(m[1][1] - b * b),
    d = m[2][0] / a,
    e = (m[2][1] - d * b) / c;
  return [[a], [b, c], [d, e, root(m[2][2] - d * d - e * e)]];
}

export function dispose(object) {
  object.removeFromParent();
  object.geometry?.dispose();
  object.material?.dispose();
}
