// Two dates of one place: each element's state, the figures that were tested, and which elements are shown of which dates.
const UNIT_M = 1e-5;
const CHANGES = ["missing", "new", "moved", "changed"];
export const STATES = ["same", ...CHANGES, "not seen"];

// Of both dates, an old element that is as it was lies under its new self.
export const visibleIn = (one, dates) =>
  dates === one.date || (dates === "both" && (one.date === "new" || one.state !== "same"));

export const rowVisibleIn = (row, dates) => !row.only || dates === "both" || dates === row.only;

export function showDates(site, dates) {
  site.showing = dates;
  for (const row of site.rows) row.shown = row.elements.filter((one) => visibleIn(one, dates));
}

// Give a row's elements the states of a comparison: those of the old date come after those of the new one.
export function compareRow(row, before, isNew) {
  row.before = before && { face: before.face, motion: before.motion, openings: before.openings.map(openingOf) };
  row.changes = [];
  const ofDate = (date) => row.elements.filter((one) => one.date === date),
    [now, then] = [ofDate("new"), ofDate("old")];
  if (isNew) for (const one of now) one.state = "new";
  if (row.gone) for (const one of then) Object.assign(one, { state: "missing", pair: [one] });
  for (const entry of before?.changes ?? []) {
    const pair = [now[entry.new ?? -1], then[entry.old ?? -1]].filter(Boolean),
      tested = entry.tested.map(figureOf);
    for (const one of pair) Object.assign(one, { state: entry.state, tested, pair });
    if (CHANGES.includes(entry.state)) row.changes.push(pair[0]);
  }
  row.changes.sort((a, b) => CHANGES.indexOf(a.state) - CHANGES.indexOf(b.state) || a.centre[0] - b.centre[0]);
}

const openingOf = (entry) => ({ ...entry, tested: entry.tested.map(figureOf) });

// A tested figure: by how much it differs with its standard deviation, m, or what was written and is.
function figureOf([what, a, b, told]) {
  const significant = told === 1;
  if (typeof a === "string") return { what, old: a, new: b, significant };
  return { what, by: a * UNIT_M, sigma: b * UNIT_M, significant };
}

// The date whose elements stand for a row where it is looked for.
export const dateOf = (row) => (row.gone ? "old" : "new");

// Whose panoramas are shown: a row's own, or, of its old date, the earlier map's, where that kept any.
export const cameraOf = (row, dates) =>
  row.before?.stills.length && (dates === "old" || row.gone) ? row.before : row;

// An element on both dates, where both have it.
export const bothOf = (one) => one.pair ?? [one];

// How many of a row's elements and openings are not as they were.
export const counts = (row) => row.changes.length + (row.before?.openings.length ?? 0);
