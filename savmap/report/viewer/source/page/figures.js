// Figures of elements in words: sizes with standard deviations, and what differs between two dates.
import { placeIn } from "../site/frames.js";
import { fixed, metres, millimetres } from "../site/measure.js";
import { text } from "../text.js";

const DEGREES = 8; // decimals: a millimetre

// A point of a row in a frame, as people write it.
export function placeText(site, row, frame, point) {
  const place = placeIn(site, row, frame, point);
  if (frame !== "earth") return `${place.map((value) => fixed(value)).join(" ")}\u00a0m`;
  const [latitude, longitude, height] = place;
  return `${latitude.toFixed(DEGREES)} ${longitude.toFixed(DEGREES)}, ${metres(height)}`;
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
