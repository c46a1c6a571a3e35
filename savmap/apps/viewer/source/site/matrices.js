// Small matrices as lines of numbers.
export const nothing = [
  [0, 0, 0],
  [0, 0, 0],
  [0, 0, 0],
];
export const sum = (a, b) => a.map((line, k) => line.map((value, n) => value + b[k][n]));
export const transposed = (a) => a[0].map((_, n) => a.map((line) => line[n]));
export const product = (a, b) =>
  a.map((line) => b[0].map((_, n) => line.reduce((total, value, k) => total + value * b[k][n], 0)));
export const quadratic = (u, c) =>
  u.reduce((total, value, k) => total + value * c[k].reduce((t, one, n) => t + one * u[n], 0), 0);

// Of a symmetric matrix (3, 3): the variance along the longest axis of its ellipsoid.
export function largestEigenvalue(c) {
  const mean = (c[0][0] + c[1][1] + c[2][2]) / 3;
  const rest = c.map((line, k) => line.map((value, n) => (k === n ? value - mean : value)));
  const spread = Math.sqrt(rest.flat().reduce((total, value) => total + value * value, 0) / 6);
  if (spread === 0) return mean;
  const [[a, b, d], [, e, f], [, , g]] = rest.map((line) => line.map((value) => value / spread));
  const half = (a * (e * g - f * f) - b * (b * g - f * d) + d * (b * f - e * d)) / 2;
  return mean + 2 * spread * Math.cos(Math.acos(Math.min(Math.max(half, -1), 1)) / 3);
}

// What a turn makes of a covariance.
export const turnedBy = (turn, covariance) => product(product(turn, covariance), transposed(turn));

// The symmetric matrix (3, 3) of its upper triangle.
export const symmetric = ([xx, xy, xz, yy, yz, zz]) => [
  [xx, xy, xz],
  [xy, yy, yz],
  [xz, yz, zz],
];

export const applied = (matrix, point) =>
  matrix.map((line) => line.reduce((total, value, k) => total + value * point[k], 0));
