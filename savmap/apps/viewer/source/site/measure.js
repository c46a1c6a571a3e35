// The distance of two vertices and its standard deviation: from the joint covariance of the row where the map has it, else from each
// vertex's own, and between rows with the covariance of their places.
import { elementOfVertex, toSite, vertexOf } from "./data.js";
import { inSite, ownCovariance } from "./frames.js";
import { largestEigenvalue, nothing, quadratic, sum } from "./matrices.js";
import { numbers } from "./pictures.js";

// Have the joint covariance of a row at hand, which large maps keep beside the page.
export async function withJoint(row) {
  if (row.joint && !row.joint.covariance) row.joint.covariance = await numbers(row.joint.path);
}

// Whether both places are known in one frame.
export const comparable = (a, b) => a.row === b.row || (a.row.known && b.row.known);

export function measured(a, b) {
  const same = a.row === b.row;
  const [from, to] = [a, b].map((one) => {
    const place = vertexOf(one.row, one.vertex);
    return same ? place : toSite(one.row, place);
  });
  const difference = to.map((value, k) => value - from[k]);
  const covariance = same ? differenceInRow(a.row, a.vertex, b.vertex) : sum(inSite(a.row, a.vertex), inSite(b.row, b.vertex));
  const distance = Math.hypot(...difference);
  const along = difference.map((value) => value / distance);
  const variance = distance > 0 ? quadratic(along, covariance) : largestEigenvalue(covariance);
  const how = !same ? "rows" : isOld(a) || isOld(b) ? "dates" : a.row.joint?.covariance ? "joint" : "own";
  return {
    distance,
    sigma: Math.sqrt(Math.max(variance, 0)),
    difference,
    sigmas: [0, 1, 2].map((k) => Math.sqrt(Math.max(covariance[k][k], 0))),
    how,
  };
}

const isOld = ({ row, vertex }) => elementOfVertex(row, vertex).date === "old";

function differenceInRow(row, a, b) {
  if (a === b) return sum(nothing, nothing);
  if (!row.joint?.covariance) return sum(ownCovariance(row, a), ownCovariance(row, b));
  const places = [a, b].flatMap((vertex) =>
    // those of the earlier date are none of the map's
    [0, 1, 2].map((axis) => ({ vertex, axis, number: row.joint.coordinates[3 * vertex + axis] ?? -1 })),
  );
  const whole = places.map((one, k) => places.map((other, n) => shared(row, one, other, k === n)));
  return [0, 1, 2].map((k) =>
    [0, 1, 2].map((n) => whole[k][n] + whole[k + 3][n + 3] - whole[k][n + 3] - whole[k + 3][n]),
  );
}

// The covariance of two coordinates, as JointCovariance in savmap/types/maps.py: one that shares its error with no other has its vertex's own.
function shared(row, one, other, same) {
  if (one.number < 0 || other.number < 0) return same ? ownCovariance(row, one.vertex)[one.axis][one.axis] : 0;
  const { size, covariance } = row.joint,
    low = Math.min(one.number, other.number),
    high = Math.max(one.number, other.number);
  return covariance[low * size - (low * (low - 1)) / 2 + high - low];
}

// To a millimetre; nothing is "-0".
export const fixed = (value, digits = 3) => value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1");

export const metres = (value) => `${fixed(value)}\u00a0m`;

export function millimetres(value) {
  const mm = 1000 * value;
  return `${mm === 0 ? "0" : mm < 0.995 ? mm.toPrecision(2) : mm.toFixed(0)}\u00a0mm`;
}
