// Where one looks from: the model in perspective, the plan, a row's face.
import { OrthographicCamera, PerspectiveCamera, Vector3, Matrix4, MOUSE, TOUCH } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { boxOf, toSite } from "../site/data.js";
import { MODEL, cornersOf } from "./shapes.js";

const MARGIN = 1.06,
  FLY_MS = 420;
const still = matchMedia("(prefers-reduced-motion: reduce)");

// A camera with controls of its own on one part of the page.
export class ModelView {
  constructor(area, changed) {
    this.area = area;
    this.changed = changed;
    this.perspective = new PerspectiveCamera(40, 1, 0.05, 5000);
    this.flat = new OrthographicCamera(-1, 1, 1, -1, -3000, 3000);
    for (const camera of [this.perspective, this.flat]) camera.layers.enable(MODEL);
    this.kind = "model";
    this.controls = new OrbitControls(this.perspective, area);
    this.controls.addEventListener("change", changed);
    this.controls.zoomToCursor = true;
    this.controls.keys = {};
  }

  get camera() {
    return this.kind === "model" ? this.perspective : this.flat;
  }

  // Pixels of a metre where there is no perspective, else 0.
  get metrePx() {
    return this.kind === "model" ? 0 : (this.height * this.flat.zoom) / (2 * this.flat.top);
  }

  resize(width, height) {
    this.width = width;
    this.height = height;
    this.perspective.aspect = width / height;
    this.perspective.updateProjectionMatrix();
    this.flat.right = (this.flat.top * width) / height;
    this.flat.left = -this.flat.right;
    this.flat.updateProjectionMatrix();
  }

  // Show a box of points (site's frame), in perspective from a direction, else straight.
  look(kind, points, row, rows) {
    this.flight = null;
    this.kind = kind;
    this.row = row;
    const from = directionOf(kind, row, rows),
      up = kind === "plan" ? axisOf(row, 2, -1) : new Vector3(0, 1, 0);
    const camera = this.camera;
    camera.up.copy(up);
    this.controls.object = camera;
    const flat = kind !== "model";
    this.controls.enableRotate = !flat;
    this.controls.screenSpacePanning = true;
    this.controls.mouseButtons = { LEFT: flat ? MOUSE.PAN : MOUSE.ROTATE, MIDDLE: MOUSE.DOLLY, RIGHT: MOUSE.PAN };
    this.controls.touches = { ONE: flat ? TOUCH.PAN : TOUCH.ROTATE, TWO: TOUCH.DOLLY_PAN };
    this.controls.dispose();
    this.controls.connect(this.area);
    const place = this.framing(points, from, up);
    this.controls.target.copy(place.target);
    camera.position.copy(place.position);
    if (flat) this.setHalfHeight(place.half);
    this.controls.update();
    this.changed();
  }

  setHalfHeight(half) {
    this.flat.zoom = 1;
    this.flat.top = half;
    this.flat.bottom = -half;
    this.resize(this.width, this.height);
  }

  // Fly so that points fill so much of the view, in the direction that one looks in.
  fly(points, share = 1) {
    const camera = this.camera,
      from = camera.position.clone().sub(this.controls.target).normalize();
    const place = this.framing(points, from, camera.up, share);
    const begin = { target: this.controls.target.clone(), position: camera.position.clone(), zoom: this.flat.zoom };
    const zoom = this.flat.top / Math.max(place.half, 1e-6);
    const since = performance.now(),
      flight = (this.flight = {});
    const step = (now) => {
      if (this.flight !== flight) return;
      const t = still.matches ? 1 : Math.min((now - since) / FLY_MS, 1),
        eased = t * t * (3 - 2 * t);
      this.controls.target.lerpVectors(begin.target, place.target, eased);
      camera.position.lerpVectors(begin.position, place.position, eased);
      this.flat.zoom = begin.zoom * Math.pow(zoom / begin.zoom, eased);
      this.flat.updateProjectionMatrix();
      this.controls.update();
      this.changed();
      if (t < 1) requestAnimationFrame(step);
    };
    step(still.matches ? since + FLY_MS : since);
  }

  framing(points, from, up, share = 1) {
    const basis = new Matrix4().lookAt(from, new Vector3(), up),
      right = new Vector3(),
      high = new Vector3(),
      out = new Vector3();
    basis.extractBasis(right, high, out);
    const given = points.map((point) => new Vector3(...point));
    const spans = [right, high, out].map((axis) => spanOf(given, axis));
    const target = [right, high, out].reduce(
      (sum, axis, k) => sum.addScaledVector(axis, (spans[k][0] + spans[k][1]) / 2),
      new Vector3(),
    );
    const aspect = this.width / this.height;
    const [wide, tall] = spans.map(([low, top]) => Math.max((top - low) / 2, 0.02));
    const half = (MARGIN * Math.max(tall, wide / aspect)) / share;
    return this.kind === "model"
      ? this.inPerspective(given, target, right, high, out, share)
      : { target, half, position: target.clone().addScaledVector(out, 500) };
  }

  // The nearest place on a line of sight from which all points are in the picture, and the picture's middle is theirs.
  inPerspective(points, target, right, high, out, share) {
    const slope = (Math.tan((this.perspective.fov * Math.PI) / 360) * share) / MARGIN,
      slopes = [slope * this.perspective.aspect, slope];
    const middle = target.clone();
    let distance = 1;
    for (let round = 0; round < 6; round++) {
      distance = 0.3;
      for (const point of points) {
        const from = point.clone().sub(middle),
          depth = from.dot(out);
        distance = Math.max(
          distance,
          depth + Math.abs(from.dot(right)) / slopes[0],
          depth + Math.abs(from.dot(high)) / slopes[1],
        );
      }
      for (const axis of [right, high]) {
        const angles = points.map(
          (point) => point.clone().sub(middle).dot(axis) / (distance - point.clone().sub(middle).dot(out)),
        );
        middle.addScaledVector(axis, (distance * (Math.max(...angles) + Math.min(...angles))) / 2);
      }
    }
    return { target: middle, half: distance * slope, position: middle.clone().addScaledVector(out, distance) };
  }
}

// Many rows are looked down on, so that those in front do not hide the others.
function directionOf(kind, row, rows) {
  if (kind === "plan") return new Vector3(0, 1, 0);
  const out = axisOf(row, 2, 1);
  return kind === "face"
    ? out
    : out
        .add(axisOf(row, 0, -0.42))
        .add(new Vector3(0, rows > 4 ? 0.85 : 0.3, 0))
        .normalize();
}

function axisOf(row, axis, sign) {
  const m = row.siteFromRow;
  return new Vector3(m[axis], m[4 + axis], m[8 + axis]).multiplyScalar(sign);
}

function spanOf(points, axis) {
  const along = points.map((point) => point.dot(axis));
  return [Math.min(...along), Math.max(...along)];
}

export const boxInSite = (row) => cornersOf(row.box).map((corner) => toSite(row, corner));

// From above the camera's path belongs to a row.
export function planInSite(row) {
  const path = row.path.positions.length ? cornersOf(boxOf(row.path.positions)) : [];
  return [...boxInSite(row), ...path.map((corner) => toSite(row, corner))];
}

export function pointsOf(elements) {
  return elements.flatMap((one) =>
    Array.from({ length: one.count }, (_, k) => {
      const n = 3 * (one.first + k);
      return toSite(one.row, one.row.positions.slice(n, n + 3));
    }),
  );
}
