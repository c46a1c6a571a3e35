// The map as the page holds it (JSON, gzip, base64), and what is worked out of it once: savmap/apps/viewer/data.py writes it.
import { compareRow, showDates } from "./dates.js";
import { floatsOf } from "./pictures.js";

const UNIT_M = 1e-5;
const GAP_M = 6;
const CROSS_M = 0.04;
const TOUCH_M = 0.02;
export const PART = " / "; // between the parts of an id
const WRITTEN = ["text", "code"];
const OLD = "old date/"; // in the address of an element of the earlier map

export async function readSite() {
  const text = atob(document.getElementById("map").textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let k = 0; k < bytes.length; k++) bytes[k] = text.charCodeAt(k);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return siteOf(JSON.parse(await new Response(stream).text()));
}

function siteOf(content) {
  const { title, banner, surveyed, alignment, dates } = content;
  const site = { title, banner, surveyed, alignment, dates, elements: [], rows: [] };
  for (const entry of content.rows) site.rows.push(rowOf(site, entry, content.vertex_labels));
  placeOthers(site.rows);
  showDates(site, dates ? "both" : "new");
  return site;
}

function rowOf(site, entry, names) {
  const { before } = entry;
  const row = {
    index: site.rows.length,
    name: entry.name,
    gone: Boolean(entry.gone), // only the earlier map has it
    placement: entry.placement,
    placementCovariance: entry.placement_covariance,
    aligned: entry.aligned,
    grade: entry.grade,
    warnings: entry.warnings,
    remarks: entry.remarks,
    positions: Float64Array.from(entry.positions.concat(before?.positions ?? []), (value) => value * UNIT_M),
    covariances: Float64Array.from(entry.covariances.concat(before?.covariances ?? [])),
    joint: entry.joint && { ...entry.joint, covariance: entry.joint.covariance && floatsOf(entry.joint.covariance) },
    path: pathOf(entry.frames),
    face: entry.face,
    stills: entry.stills,
    places: entry.places.map(({ id, sizes, corners }) => placeOf(id, sizes, corners)),
    elements: [],
  };
  row.assumed = new Uint8Array(row.positions.length); // 1 for each coordinate that nothing measured
  let first = 0;
  for (const [date, parts] of [
    ["new", entry.structures],
    ["old", before?.structures ?? []],
  ])
    for (const part of parts) {
      row.elements.push(elementOf(row, part, first, names, date));
      first += part.labels.length;
    }
  site.elements.push(...row.elements);
  keyApart(row);
  const isNew = Boolean(site.dates?.new.includes(row.name));
  compareRow(row, before, isNew);
  if (row.before) Object.assign(row.before, { stills: before.stills, path: pathOf(before.frames) });
  row.only = row.gone ? "old" : isNew ? "new" : null; // the one date that has it
  row.box = boxOf(row.positions);
  for (const warning of row.warnings) warning.elements = warnedOf(row, warning);
  row.warnedElements = new Set(row.warnings.flatMap((warning) => warning.elements));
  row.warnedAsWhole = row.warnings.some((warning) => warning.of_row); // as a whole
  for (const place of row.places) place.elements = around(row, place);
  return row;
}

function placeOf(id, sizes, corners) {
  const [low, high] = [corners.slice(0, 3), corners.slice(3)].map((corner) => corner.map((value) => value * UNIT_M));
  return { id, whole: id.slice(0, Math.max(id.lastIndexOf(PART), 0)), sizes, box: { low, high } };
}

// The elements that a place is told by: all of a bay, those that bound a part of it.
function around(row, { id, whole, box }) {
  const own = row.elements.filter((one) => one.date === "new" && one.group === (whole || id));
  const touches = (one) => {
    const { low, high } = boxOf(row.positions.subarray(3 * one.first, 3 * (one.first + one.count)));
    return [0, 1].every((k) => low[k] < box.high[k] + TOUCH_M && high[k] > box.low[k] - TOUCH_M);
  };
  return whole ? own.filter(touches) : own;
}

// The warnings that an element has: its own, and the row's.
export const warningsOf = (one) =>
  one.date === "old" ? [] : one.row.warnings.filter((warning) => warning.of_row || warning.elements.includes(one));

function elementOf(row, part, first, names, date) {
  const cut = part.id.lastIndexOf(PART);
  const written = WRITTEN.map((key) => part.attributes[key]).filter((value) => typeof value === "string" && value);
  for (const text of [...written]) if (text.includes(":")) written.push(text.slice(text.indexOf(":") + 1));
  const count = part.labels.length;
  for (const k of part.assumed) row.assumed[3 * first + k] = 1;
  return {
    row,
    id: part.id,
    date,
    state: null,
    key: `${row.name}/${date === "old" ? OLD : ""}${part.id}`,
    label: part.label,
    plugin: part.plugin,
    group: cut > 0 ? part.id.slice(0, cut) : "",
    short: cut > 0 ? part.id.slice(cut + 3) : part.id,
    written,
    attributes: part.attributes,
    first,
    count,
    edges: part.edges.map((end) => end + first),
    vertexLabels: part.labels.map((number) => fullLabel(names[number], part.id)),
    solid: part.solid,
    off: part.off,
    support: typeof part.attributes.support === "number" ? part.attributes.support : null,
    sigma: largestSigma(row, first, count),
    centre: centreOf(row.positions, first, count),
  };
}

// Plugins do not know of each other's ids: where two of a row have the same, the address names the plugin too.
function keyApart(row) {
  const seen = new Map();
  for (const one of row.elements) seen.set(one.key, [...(seen.get(one.key) ?? []), one]);
  for (const alike of seen.values())
    if (alike.length > 1)
      for (const one of alike) one.key = `${row.name}/${one.date === "old" ? OLD : ""}${one.plugin}/${one.id}`;
}

// The elements of a row that a warning names: of those of one name, which plugins may give twice, that which is nearest to its place.
function warnedOf(row, warning) {
  const apart = (one) => Math.hypot(...one.centre.map((value, k) => value - warning.place[k]));
  return warning.subjects.flatMap((id) => {
    const alike = row.elements.filter((one) => one.id === id && one.date === "new");
    return alike.length > 1 && warning.place ? [alike.reduce((a, b) => (apart(b) < apart(a) ? b : a))] : alike;
  });
}

const fullLabel = (name, id) => (name.startsWith("+") ? id + name.slice(1) : name.slice(1));

function pathOf(frames) {
  return {
    number: frames.number,
    pass: frames.pass,
    passes: frames.passes,
    stamp: frames.stamp,
    positions: Float64Array.from(frames.position, (value) => value * UNIT_M),
    quaternions: Float64Array.from(frames.quaternion),
  };
}

// Of what was measured.
function largestSigma({ covariances, assumed }, first, count) {
  let most = 0;
  for (let k = first; k < first + count; k++)
    [0, 3, 5].forEach((variance, axis) => {
      if (!assumed[3 * k + axis]) most = Math.max(most, covariances[6 * k + variance]);
    });
  return Math.sqrt(most);
}

function centreOf(positions, first, count) {
  const sum = [0, 0, 0];
  for (let k = 3 * first; k < 3 * (first + count); k++) sum[k % 3] += positions[k] / count;
  return sum;
}

export function boxOf(positions) {
  const low = [Infinity, Infinity, Infinity],
    high = [-Infinity, -Infinity, -Infinity];
  positions.forEach((value, k) => {
    low[k % 3] = Math.min(low[k % 3], value);
    high[k % 3] = Math.max(high[k % 3], value);
  });
  return positions.length ? { low, high } : { low: [0, 0, 0], high: [1, 1, 1] };
}

// Rows whose place is not known stand side by side in front of the others.
function placeOthers(rows) {
  let z = 0;
  const placed = rows.filter((row) => row.placement);
  for (const row of placed) z = Math.max(z, row.placement[1] + GAP_M);
  for (const row of rows) {
    row.known = Boolean(row.placement);
    if (!row.placement) {
      row.placement = [0, z, 0];
      z += GAP_M;
    }
    row.siteFromRow = transformOf(row.placement);
  }
}

// Rows of a 4 by 4 matrix, as Placement.site_from_row in savmap/types/maps.py.
function transformOf([x, z, heading]) {
  const turn = (heading * Math.PI) / 180,
    cos = Math.cos(turn),
    sin = Math.sin(turn);
  return [cos, 0, sin, x, 0, 1, 0, 0, -sin, 0, cos, z, 0, 0, 0, 1];
}

export function toSite(row, point) {
  const m = row.siteFromRow,
    [x, y, z] = point;
  return [0, 4, 8].map((k) => m[k] * x + m[k + 1] * y + m[k + 2] * z + m[k + 3]);
}

export const vertexOf = (row, k) => [row.positions[3 * k], row.positions[3 * k + 1], row.positions[3 * k + 2]];

// The ends (row's frame) of the lines that show an element: its edges, or a small cross at each vertex where it has none.
export function linesOf(one) {
  if (one.edges.length) return one.edges.map((end) => vertexOf(one.row, end));
  const ends = [];
  for (let k = one.first; k < one.first + one.count; k++)
    for (let axis = 0; axis < 3; axis++)
      for (const by of [-CROSS_M, CROSS_M])
        ends.push(vertexOf(one.row, k).map((value, n) => (n === axis ? value + by : value)));
  return ends;
}

export function elementOfVertex(row, vertex) {
  return row.elements.find((one) => vertex >= one.first && vertex < one.first + one.count);
}
