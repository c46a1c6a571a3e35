// The three.js objects of a site: a group for each row in its own frame, with lines, solids, orthophoto, camera's path and ellipsoids.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DoubleSide,
  GridHelper,
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
  Scene,
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
import { linesOf, toSite, vertexOf } from "../site/data.js";
import { ownCovariance } from "../site/measure.js";
import { picture } from "../site/pictures.js";

export const MODEL = 1,
  PHOTO = 2; // layers: in the model alone, over panoramas alone; what is in neither is seen everywhere
const MOST_THICK = 5000; // segments: beyond that only the row at hand has thick lines
const SELECTED = "#e8007d",
  MEASURE = "#1b1f24",
  PATH = "#7b8794";

export class Model {
  constructor(site) {
    this.site = site;
    this.scene = new Scene();
    const segments = site.elements.reduce((total, one) => total + one.edges.length / 2, 0);
    this.allThick = segments <= MOST_THICK;
    this.rows = site.rows.map((row) => rowObjects(row));
    for (const objects of this.rows) this.scene.add(objects.group);
    this.marked = new Group();
    this.rule = new Group();
    this.place = new Group();
    this.scene.add(this.marked, this.rule, this.place);
    this.addFloor();
    this.shown = { solids: false, photos: false, facePhotos: true, path: true, ellipsoids: false };
    this.exaggeration = 10;
  }

  get bounds() {
    const low = [Infinity, Infinity, Infinity],
      high = [-Infinity, -Infinity, -Infinity];
    for (const row of this.site.rows)
      for (const corner of cornersOf(row.box)) {
        toSite(row, corner).forEach((value, k) => {
          low[k] = Math.min(low[k], value);
          high[k] = Math.max(high[k], value);
        });
      }
    return { low, high };
  }

  addFloor() {
    const { low, high } = this.bounds,
      size = 2 * Math.ceil(Math.max(high[0] - low[0], high[2] - low[2], 4) / 2 + 3);
    const floor = new GridHelper(size, size > 80 ? Math.round(size / 10) : size, "#dfe4ea", "#e9edf1");
    floor.position.set(Math.round((low[0] + high[0]) / 2), 0, Math.round((low[2] + high[2]) / 2));
    floor.layers.set(MODEL);
    floor.material.depthWrite = false;
    floor.renderOrder = -2;
    this.floor = floor;
    this.scene.add(floor);
  }

  colour(of) {
    this.colourOf = of;
    for (const objects of this.rows) {
      objects.colours = coloursOf(objects.owners, of);
      this.drawLines(objects);
      if (objects.solids) this.drawSolids(objects);
    }
  }

  focus(row) {
    const before = this.focused;
    this.focused = row;
    for (const one of [before, row]) if (one && this.colourOf) this.drawLines(this.rows[one.index]);
    this.update();
  }

  // Of thin lines draw only the longest of each element: for machines that draw slowly, while something moves.
  setCoarse(coarse) {
    for (const { row, lines, path, coarse: count } of this.rows) {
      if (lines.length === 1) lines[0].geometry.setDrawRange(0, coarse ? 2 * count : Infinity);
      if (!this.allThick) path.visible = this.pathShown && (!coarse || row === this.focused);
    }
  }

  // Orthophotos are shown in the face view until somebody hides them there, and in the others where somebody asks for them.
  nameOf(part) {
    return part === "photos" && this.kind === "face" ? "facePhotos" : part;
  }

  shows(part) {
    return this.shown[this.nameOf(part)];
  }

  toggle(part) {
    this.shown[this.nameOf(part)] = !this.shows(part);
    this.update();
  }

  get pathShown() {
    return this.shown.path && this.kind !== "face";
  }

  drawLines(objects) {
    const thick = this.allThick || objects.row === this.focused;
    for (const old of objects.lines.splice(0)) dispose(old);
    if (!objects.ends.length) return;
    objects.lines.push(...(thick ? thickLines(objects) : [thinLines(objects)]));
    objects.group.add(...objects.lines);
  }

  // What is heavy is made when it is first shown; of large sites for the row at hand alone.
  update(kind = this.kind) {
    this.kind = kind;
    const few = this.allThick;
    for (const objects of this.rows) {
      const here = few || objects.row === this.focused;
      objects.group.visible = kind !== "face" || objects.row === this.focused;
      objects.path.visible = this.pathShown;
      if (this.shown.solids && !objects.solids) this.drawSolids(objects);
      if (objects.solids) objects.solids.visible = this.shown.solids;
      if (objects.ellipsoids) dispose(objects.ellipsoids);
      objects.ellipsoids = this.shown.ellipsoids && here ? ellipsoids(objects.row, this.exaggeration) : null;
      if (objects.ellipsoids) objects.group.add(objects.ellipsoids);
      if (objects.photo) objects.photo.visible = this.shows("photos");
    }
  }

  drawSolids(objects) {
    if (objects.solids) dispose(objects.solids);
    objects.solids = solids(objects.row, this.colourOf);
    objects.group.add(objects.solids);
  }

  // The orthophoto of a row in the size that is wanted; resolves when it hangs there.
  async hang(row, fine) {
    const objects = this.rows[row.index],
      face = row.face;
    if (!face) return;
    const wanted = fine ? face.pictures.length - 1 : 0;
    if (objects.photoSize >= wanted) return;
    objects.photoSize = wanted;
    const image = await picture(face.pictures[wanted]);
    if (objects.photoSize !== wanted) return;
    if (!objects.photo) {
      objects.photo = photoPlane(face);
      objects.group.add(objects.photo);
    }
    objects.photo.material.map?.dispose();
    objects.photo.material.map = textureOf(image);
    objects.photo.material.needsUpdate = true;
    objects.photo.visible = this.shows("photos");
  }

  mark(elements) {
    this.marked.children.slice().forEach(dispose);
    const positions = elements.flatMap((one) => linesOf(one).flatMap((end) => toSite(one.row, end)));
    if (positions.length) this.marked.add(fatLines(positions, SELECTED, 4));
  }

  drawRule(points) {
    this.rule.children.slice().forEach(dispose);
    if (points.length === 2)
      this.rule.add(fatLines(points.flat(), "#ffffff", 6), fatLines(points.flat(), MEASURE, 2.5));
    if (points.length) this.rule.add(dots(points, "#ffffff", 13), dots(points, MEASURE, 9));
  }

  // Where the panorama that is shown was taken; null for nowhere.
  drawPlace(place) {
    this.place.children.slice().forEach(dispose);
    if (place) this.place.add(dots([place], SELECTED, 11));
    for (const dot of this.place.children) dot.layers.set(MODEL);
  }
}

export const cornersOf = ({ low, high }) =>
  [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((axis) => (k & (1 << axis) ? high[axis] : low[axis])));

function rowObjects(row) {
  const group = new Group();
  group.matrixAutoUpdate = false;
  group.matrix.set(...row.siteFromRow);
  const { segments, coarse } = segmentsOf(row);
  const ends = new Float32Array(segments.flatMap(({ from, to }) => [...from, ...to]));
  const owners = segments.map(({ one }) => one);
  const path = pathLine(row);
  group.add(path);
  const made = { solids: null, photo: null, ellipsoids: null, photoSize: -1, lines: [] };
  const objects = { row, group, ends, owners, coarse, path, ...made };
  // over panoramas only the row is drawn that they are of
  objects.drawOver = (shown) => {
    for (const line of objects.lines.slice(1)) line.visible = shown;
  };
  return objects;
}

// The lines of a row's elements, the longest of each first: `coarse` of them show what is where.
function segmentsOf(row) {
  const longest = [],
    others = [];
  for (const one of row.elements) {
    const ends = linesOf(one),
      own = [];
    for (let k = 0; k < ends.length; k += 2) own.push({ one, from: ends[k], to: ends[k + 1] });
    const length = ({ from, to }) => Math.hypot(...to.map((value, k) => value - from[k]));
    own.sort((a, b) => length(b) - length(a));
    longest.push(...own.slice(0, 1));
    others.push(...own.slice(1));
  }
  return { segments: [...longest, ...others], coarse: longest.length };
}

function coloursOf(owners, of) {
  const values = new Float32Array(6 * owners.length),
    colour = new Color();
  owners.forEach((one, k) => {
    colour.set(of(one));
    values.set([colour.r, colour.g, colour.b, colour.r, colour.g, colour.b], 6 * k);
  });
  return values;
}

function thinLines({ ends, colours }) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(ends, 3));
  geometry.setAttribute("color", new BufferAttribute(colours, 3));
  const lines = new LineSegments(geometry, new LineBasicMaterial({ vertexColors: true }));
  lines.layers.set(MODEL);
  return lines;
}

// Over panoramas with a pale edge, so that they show on any ground.
function thickLines({ ends, colours }) {
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

function fatLines(positions, colour, width) {
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

function dots(points, colour, size) {
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

function pathLine(row) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(row.path.positions), 3));
  const path = new Group(),
    passes = row.path.pass;
  const joined = [];
  for (let k = 1; k < passes.length; k++) if (passes[k] === passes[k - 1]) joined.push(k - 1, k);
  geometry.setIndex(joined);
  const line = new LineSegments(geometry, new LineBasicMaterial({ color: PATH }));
  const index = new Map(row.path.number.map((frame, k) => [frame, k]));
  const stills = row.stills
    .filter((one) => index.has(one.frame))
    .map((one) => vertexOf(row.path, index.get(one.frame)));
  path.add(line);
  if (stills.length) path.add(dots(stills, PATH, 5));
  for (const part of path.children) part.layers.set(MODEL);
  return path;
}

function photoPlane(face) {
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
function solids(row, of) {
  const places = [],
    colours = [],
    colour = new Color();
  for (const one of row.elements) {
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

// Unit spheres under three times the Cholesky factor of each vertex's covariance, exaggerated.
function ellipsoids(row, times) {
  const count = row.positions.length / 3;
  const made = new InstancedMesh(
    new SphereGeometry(1, 12, 8),
    new MeshBasicMaterial({ color: "#8e4585", transparent: true, opacity: 0.35, depthWrite: false }),
    count,
  );
  const matrix = new Matrix4();
  for (let k = 0; k < count; k++) {
    const [a, b, c] = cholesky(ownCovariance(row, k)).map((line) => line.map((value) => 3 * times * value));
    const [x, y, z] = row.positions.subarray(3 * k, 3 * k + 3);
    made.setMatrixAt(k, matrix.set(a[0], 0, 0, x, b[0], b[1], 0, y, c[0], c[1], c[2], z, 0, 0, 0, 1));
  }
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

function dispose(object) {
  object.removeFromParent();
  object.geometry?.dispose();
  object.material?.dispose();
}
