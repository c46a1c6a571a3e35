// Figures of elements in words: sizes with standard deviations, and what differs between two dates.
import { ownCovariance, placeIn } from "../site/frames.js";
import { vertexOf } from "../site/data.js";
import { fixed, metres, millimetres } from "../site/measure.js";
import { text } from "../text.js";

const DEGREES = 8; // decimals: a millimetre
const AXES = ["x", "y", "z"];
const LONG = 3, // times as long as it is thick
  LEVEL = 0.05;

// A point of a row in a frame, as people write it.
export function placeText(site, row, frame, point) {
  const place = placeIn(site, row, frame, point);
  if (frame !== "earth") return `${place.map((value, k) => `${AXES[k]}\u00a0${fixed(value)}`).join(", ")}\u00a0m`;
  const [latitude, longitude, height] = place;
  return `${latitude.toFixed(DEGREES)} ${longitude.toFixed(DEGREES)}, z\u00a0${metres(height)}`;
}

// What an element is in plain quantities: where its edges are, and how far apart; nothing that is assumed.
export function plainText(one) {
  const points = Array.from({ length: one.count }, (_, k) => vertexOf(one.row, one.first + k));
  const sides = [0, 1].map((axis) => {
    const sorted = points.map((point) => point[axis]).sort((a, b) => a - b),
      half = sorted.length >> 1;
    const mean = (values) => values.reduce((sum, value) => sum + value / values.length, 0);
    return half ? [mean(sorted.slice(0, half)), mean(sorted.slice(-half))] : [sorted[0], sorted[0]];
  });
  const [[left, right], [low, high]] = sides,
    [long, tall] = [right - left, high - low];
  const ends = points.length === 2 && Math.hypot(...points[0].map((value, k) => points[1][k] - value));
  const assumed = (axis) => points.some((_, k) => one.row.assumed[3 * (one.first + k) + axis]);
  const { plain } = text;
  if (ends && tall < LEVEL * ends) return plain.line(metres(ends), metres((low + high) / 2));
  if (points.length < 3) return assumed(1) ? "" : plain.point(metres(low));
  if (tall > LONG * long && !assumed(0)) return plain.standing(thick(long), metres(left));
  if (assumed(1)) return "";
  if (long > LONG * tall && !one.written.length) return plain.lying(thick(tall), metres(low));
  return plain.plate(metres(long), metres(tall), metres(low));
}

const thick = (size) => `${(1000 * size).toFixed(0)}\u00a0mm`;

// What of an element is assumed: the axis and by how much, with the corners.
export function assumedLines(one) {
  const found = new Map();
  for (let k = one.first; k < one.first + one.count; k++)
    for (const axis of [0, 1, 2]) {
      if (!one.row.assumed[3 * k + axis]) continue;
      const what = `${AXES[axis]} \u00b1 ${millimetres(Math.sqrt(ownCovariance(one.row, k)[axis][axis]))}`;
      const label = one.vertexLabels[k - one.first];
      const corner = label.startsWith(one.id) ? label.slice(one.id.length).replace(/^ \/ /, "") : label;
      found.set(what, [...(found.get(what) ?? []), corner]);
    }
  return [...found].map(([what, corners]) => [text.assumed, `${what} (${corners.join(", ")})`, "wide"]);
}

// An element's attributes: name, value with its standard deviation.
export function attributeLines(attributes) {
  const lines = [];
  for (const [name, value] of Object.entries(attributes)) {
    if (name.endsWith("_sigma_m")) continue;
    const sigma =
      typeof value === "object"
        ? value.sigma
        : name.endsWith("_m")
          ? attributes[name.replace(/_m$/, "_sigma_m")]
          : undefined;
    const number = typeof value === "object" ? value.value : value;
    const size = name.endsWith("_m") && typeof number === "number";
    const shown = size ? metres(number) : typeof number === "number" ? String(Number(number.toPrecision(4))) : number;
    const spread = sigma === undefined ? "" : ` \u00b1 ${size ? millimetres(sigma) : Number(sigma.toPrecision(2))}`;
    lines.push([name.replace(/_m$/, "").replaceAll("_", " "), shown + spread]);
  }
  return lines;
}

const nameOf = (what) => text.figures[what] ?? what.replace(/_m$/, "").replaceAll("_", " ");

const signed = (metres_) => `${metres_ < 0 ? "\u2212" : "+"}${(1000 * Math.abs(metres_)).toFixed(1)}\u00a0mm`;

const difference = ({ old, new: now, by, sigma }) =>
  old === undefined ? `${signed(by)} \u00b1 ${millimetres(sigma)}` : text.wasAndIs(old, now);

// Such as "up +60.1 mm ± 1.4 mm".
export const amountOf = (figure) => `${nameOf(figure.what)} ${difference(figure)}`;

// All that was tested of an element, what is significant first.
export function testedLines(tested) {
  const inOrder = [...tested].sort((a, b) => b.significant - a.significant);
  return inOrder.map((figure) => {
    const many = figure.sigma ? `, ${text.sigmas(Math.abs(figure.by) / figure.sigma)}` : "";
    return [nameOf(figure.what), `${difference(figure)}${many}`, figure.significant];
  });
}
