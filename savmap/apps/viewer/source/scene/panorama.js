// What the camera saw from a place of its path, with the wireframe over it.
import {
  BufferAttribute,
  BufferGeometry,
  DoubleSide,
  Mesh,
  MeshBasicMaterial,
  PerspectiveCamera,
  Quaternion,
  Vector3,
} from "three";
import { toSite, vertexOf } from "../site/data.js";
import { picture } from "../site/pictures.js";
import { PHOTO, textureOf } from "./shapes.js";

const COLUMNS = 64,
  LINES = 32,
  LEAST_FOV = 12,
  MOST_FOV = 110;

export class PanoramaView {
  // `taken`: the camera (path, stills) of a row whose pictures are shown.
  constructor(area, scene, taken, changed) {
    Object.assign(this, { area, taken, changed, row: null, of: null, place: 0, yaw: 0, pitch: 0, shows: false });
    this.camera = new PerspectiveCamera(75, 1, 0.02, 500);
    this.camera.layers.enable(PHOTO);
    this.sphere = new Mesh(
      sphere(),
      new MeshBasicMaterial({ side: DoubleSide, depthTest: false, depthWrite: false }),
    );
    this.sphere.layers.set(PHOTO);
    this.sphere.renderOrder = -5;
    this.sphere.frustumCulled = false;
    this.sphere.visible = false;
    scene.add(this.sphere);
    this.listen();
  }

  resize(width, height) {
    this.width = width;
    this.height = height;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  // Places of a row's camera that can be shown: those of the pictures that were kept, else some of all.
  placesOf(row) {
    const { path, stills } = this.taken(row),
      { number } = path;
    if (stills.length) {
      const index = new Map(number.map((frame, k) => [frame, k]));
      return stills
        .filter((one) => index.has(one.frame))
        .map((one) => ({ path: one.path, index: index.get(one.frame) }));
    }
    const every = Math.max(1, Math.round(number.length / 60));
    return number.map((_, k) => ({ path: null, index: k })).filter((one) => one.index % every === 0);
  }

  show(row, place) {
    if (row !== this.row || this.taken(row) !== this.of) {
      this.row = row;
      this.of = this.taken(row);
      this.places = this.placesOf(row);
    }
    if (!this.places.length) return this.showNothing();
    this.place = Math.min(Math.max(place, 0), this.places.length - 1);
    const { index, path } = this.places[this.place],
      { positions, quaternions } = this.of.path;
    this.centre = toSite(row, [...positions.subarray(3 * index, 3 * index + 3)]);
    this.camera.position.set(...this.centre);
    this.sphere.position.set(...this.centre);
    this.sphere.quaternion.set(...quaternions.subarray(4 * index, 4 * index + 4));
    const turn = (row.placement[2] * Math.PI) / 180;
    this.sphere.quaternion.premultiply(new Quaternion().setFromAxisAngle(new Vector3(0, 1, 0), turn));
    this.load(path);
    this.aim();
  }

  // A row whose camera's path is not known has no panorama: that of another row must not stay.
  showNothing() {
    this.centre = this.path = null;
    this.sphere.visible = this.shows = false;
    this.changed();
  }

  async load(path) {
    this.path = path;
    if (!path) {
      this.sphere.visible = this.shows = false;
      return;
    }
    const image = await picture(path).catch(() => null);
    if (this.path !== path) return;
    this.shows = this.sphere.visible = Boolean(image);
    if (image) {
      this.sphere.material.map?.dispose();
      this.sphere.material.map = textureOf(image);
      this.sphere.material.needsUpdate = true;
    }
    this.changed();
  }

  // Turn to a point of the site.
  face(point) {
    if (!this.centre) return;
    const away = point.map((value, k) => value - this.centre[k]);
    this.yaw = Math.atan2(away[0], away[2]);
    this.pitch = Math.atan2(away[1], Math.hypot(away[0], away[2]));
    this.aim();
  }

  // Show elements from the place that sees them best: near, and from the front.
  visit(row, points) {
    const centre = [0, 1, 2].map((k) => points.reduce((sum, point) => sum + point[k] / points.length, 0));
    const places = this.placesOf(row),
      { path } = this.taken(row);
    let best = 0,
      least = Infinity;
    places.forEach(({ index }, k) => {
      const at = toSite(row, vertexOf(path, index));
      const apart = Math.hypot(...at.map((value, n) => value - centre[n]));
      if (apart < least) [best, least] = [k, apart];
    });
    this.show(row, best);
    if (places.length) this.face(centre);
  }

  aim() {
    const level = Math.cos(this.pitch);
    const ahead = [Math.sin(this.yaw) * level, Math.sin(this.pitch), Math.cos(this.yaw) * level];
    if (this.centre) this.camera.lookAt(...this.centre.map((value, k) => value + ahead[k]));
    this.camera.updateMatrixWorld();
    this.changed();
  }

  zoom(times) {
    this.camera.fov = Math.min(Math.max(this.camera.fov * times, LEAST_FOV), MOST_FOV);
    this.camera.updateProjectionMatrix();
    this.changed();
  }

  listen() {
    const down = new Map();
    let apart = 0;
    const spread = () => {
      const [a, b] = [...down.values()];
      return Math.hypot(a[0] - b[0], a[1] - b[1]);
    };
    this.area.addEventListener("pointerdown", (event) => {
      down.set(event.pointerId, [event.clientX, event.clientY]);
      this.area.setPointerCapture(event.pointerId);
      if (down.size === 2) apart = spread();
    });
    this.area.addEventListener("pointermove", (event) => {
      const before = down.get(event.pointerId);
      if (!before) return;
      const angle = (this.camera.fov * Math.PI) / 180 / this.height;
      down.set(event.pointerId, [event.clientX, event.clientY]);
      if (down.size === 2) {
        const now = spread();
        this.zoom(apart / Math.max(now, 1));
        apart = now;
        return;
      }
      this.yaw += (event.clientX - before[0]) * angle;
      this.pitch = Math.min(Math.max(this.pitch + (event.clientY - before[1]) * angle, -1.55), 1.55);
      this.aim();
    });
    for (const kind of ["pointerup", "pointercancel"])
      this.area.addEventListener(kind, (event) => down.delete(event.pointerId));
    this.area.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.zoom(Math.exp(event.deltaY / 900));
      },
      { passive: false },
    );
  }
}

// A sphere in the camera's frame (x right, y down, z towards the picture's middle) whose pixels lie as savmap/geometry/sphere.py has them.
function sphere() {
  const places = [],
    on = [],
    index = [];
  for (let line = 0; line <= LINES; line++)
    for (let column = 0; column <= COLUMNS; column++) {
      const u = column / COLUMNS,
        v = line / LINES,
        lon = 2 * Math.PI * u - Math.PI,
        lat = Math.PI / 2 - Math.PI * v;
      places.push(Math.cos(lat) * Math.sin(lon), -Math.sin(lat), Math.cos(lat) * Math.cos(lon));
      on.push(u, 1 - v);
    }
  for (let line = 0; line < LINES; line++)
    for (let column = 0; column < COLUMNS; column++) {
      const a = line * (COLUMNS + 1) + column,
        b = a + COLUMNS + 1;
      index.push(a, b, a + 1, b, b + 1, a + 1);
    }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(places), 3));
  geometry.setAttribute("uv", new BufferAttribute(new Float32Array(on), 2));
  geometry.setIndex(index);
  return geometry;
}
