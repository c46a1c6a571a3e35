// The frames in which places are told: the row's own, the site's, the user's world (`align:` of the site file), and the Earth.
import { toSite } from "./data.js";
import { applied, product, sum, symmetric, transposed, turnedBy } from "./matrices.js";

const DEGREE = Math.PI / 180;
const SEMI_MAJOR_M = 6378137,
  FLATTENING = 1 / 298.257223563,
  ECCENTRICITY2 = FLATTENING * (2 - FLATTENING); // WGS 84
const ROUNDS = 5;

// Those that a site has, the widest last.
export function framesOf({ rows, alignment }) {
  const frames = ["row"];
  if (rows.some((row) => row.known)) frames.push("site");
  if (alignment && rows.some((row) => row.aligned)) frames.push("world", ...(alignment.anchor ? ["earth"] : []));
  return frames;
}

// The frame in which a row's places are told where another is asked for: a row without a place has its own alone.
export function frameOf(row, asked) {
  const known = { row: true, site: row.known, world: row.aligned, earth: row.aligned };
  return known[asked] ? asked : "row";
}

// A point of a row in a frame; on the Earth latitude and longitude, degrees, and the world's z.
export function placeIn({ alignment }, row, frame, point) {
  if (frame === "row") return point;
  const onSite = toSite(row, point);
  if (frame === "site") return onSite;
  const [x, y, z] = alignment.place;
  const inWorld = applied(worldFromSite(alignment), onSite).map((value, k) => value + [x, y, z][k]);
  return frame === "world" ? inWorld : [...onEarth(alignment.anchor, inWorld), inWorld[2]];
}

// As `elements` of savmap/maps/exports/frames.py: the covariances of the row's place and of the alignment are added.
function covarianceIn({ alignment }, row, frame, vertex) {
  const own = measuredCovariance(row, vertex);
  if (frame === "row") return own;
  const onSite = inSite(row, vertex, own);
  if (frame === "site") return onSite;
  const turn = worldFromSite(alignment),
    point = row.positions.subarray(3 * vertex, 3 * vertex + 3);
  const [ax, ay] = applied(turn, toSite(row, point)).map((value) => value * DEGREE);
  const slopes = [
    [1, 0, -ay],
    [0, 1, ax],
    [0, 0, 0],
  ];
  return sum(turnedBy(turn, onSite), turnedBy(slopes, symmetric(alignment.covariance)));
}

// The largest standard deviation of what was measured of an element's vertices along the axes of a frame.
export function sigmaIn(site, one, frame) {
  let most = 0;
  for (let k = one.first; k < one.first + one.count; k++)
    most = Math.max(most, ...covarianceIn(site, one.row, frame, k).map((line, axis) => line[axis]));
  return Math.sqrt(most);
}

// The axes of a frame as directions on the site, with north where it is known: name and direction.
export function axesIn({ alignment }, row, frame) {
  const named = (names, lines) => names.map((name, k) => ({ name, to: lines[k] }));
  const inWorld = alignment && worldFromSite(alignment); // its lines are the world's axes
  if (frame === "earth") return named(["E", "N", "z"], inWorld);
  if (frame === "world") return named(["x", alignment.anchor ? "y, N" : "y", "z"], inWorld);
  const north = alignment?.anchor && row.aligned ? named(["N"], [inWorld[1]]) : [];
  const turn = frame === "row" ? transposed(turnOf(row)) : product(turnOf(row), transposed(turnOf(row)));
  return [...named(["x", "y", "z"], turn), ...north];
}

const turnOf = ({ siteFromRow: m }) => [m.slice(0, 3), m.slice(4, 7), m.slice(8, 11)];

// Rotation: the site's y points up along the world's z, and its z, without the heading, down along y.
function worldFromSite({ place }) {
  const heading = place[3] * DEGREE,
    cos = Math.cos(heading),
    sin = Math.sin(heading);
  return [
    [cos, 0, sin],
    [sin, 0, -cos],
    [0, 1, 0],
  ];
}

// As savmap/maps/exports/plans/geodesy.py: the world's plane touches the Earth at the anchor, x to the east, y to the north.
function onEarth([latitude, longitude], [x, y]) {
  const [lat, lon] = [latitude * DEGREE, longitude * DEGREE],
    [sin, cos] = [Math.sin(lat), Math.cos(lat)];
  const axes = [
    [-Math.sin(lon), -sin * Math.cos(lon), cos * Math.cos(lon)],
    [Math.cos(lon), -sin * Math.sin(lon), cos * Math.sin(lon)],
    [0, cos, sin],
  ];
  const radius = (at) => SEMI_MAJOR_M / Math.sqrt(1 - ECCENTRICITY2 * Math.sin(at) ** 2);
  const anchor = [
    radius(lat) * cos * Math.cos(lon),
    radius(lat) * cos * Math.sin(lon),
    radius(lat) * (1 - ECCENTRICITY2) * sin,
  ];
  const [ex, ey, ez] = applied(axes, [x, y, 0]).map((value, k) => value + anchor[k]);
  const across = Math.hypot(ex, ey);
  let found = Math.atan2(ez, across * (1 - ECCENTRICITY2));
  for (let k = 0; k < ROUNDS; k++)
    found = Math.atan2(ez + ECCENTRICITY2 * radius(found) * Math.sin(found), across);
  return [found / DEGREE, Math.atan2(ey, ex) / DEGREE];
}

// Of a vertex, in its row's frame.
export function ownCovariance(row, vertex) {
  return symmetric(row.covariances.slice(6 * vertex, 6 * vertex + 6));
}

// The same without what is assumed, which no measurement is unsure of.
export const measuredCovariance = (row, vertex) =>
  ownCovariance(row, vertex).map((line, k) =>
    line.map((value, n) => (row.assumed[3 * vertex + k] || row.assumed[3 * vertex + n] ? 0 : value)),
  );

// As Placement.covariances in savmap/types/maps.py.
export function inSite(row, vertex, own = ownCovariance(row, vertex)) {
  const turn = turnOf(row),
    turned = turnedBy(turn, own);
  if (!row.placementCovariance) return turned;
  const arm = applied(turn, row.positions.subarray(3 * vertex, 3 * vertex + 3)).map((value) => value * DEGREE);
  const slopes = [
    [1, 0, arm[2]],
    [0, 0, 0],
    [0, 1, -arm[0]],
  ];
  return sum(turned, turnedBy(slopes, symmetric(row.placementCovariance)));
}
