// Search: what is written on elements, their ids, labels and groups, places between them, and rows; the address after # names the same things.
import { dateOf } from "./dates.js";

const MOST = 60;

// Words as they are compared: "Section 3 / beam 2", as older maps have it, is "bay 3 beam 2".
const plain = (words) =>
  words
    .toLowerCase()
    .replace(/\bsection\b/g, "bay")
    .replace(/[\s/]+/g, " ")
    .trim();

export function searchIndex(site) {
  const entries = [];
  for (const row of site.rows) {
    const own = row.elements.filter((one) => one.date === dateOf(row));
    if (site.rows.length > 1) entries.push(entry(row.name, "row", row, own, row.name));
    for (const [group, elements] of grouped(own))
      if (group) entries.push(entry(group, "group", row, elements, `${row.name}/${group}`));
    for (const place of row.places.filter(({ whole }) => whole))
      entries.push(entry(place.id, "place", row, place.elements, `${row.name}/${place.id}`, place));
  }
  for (const one of site.elements) {
    const shown = one.written.length ? one.written[0] : one.id;
    const words = [...one.written, one.id, one.label, one.attributes.bay ?? ""].join(" ");
    const found = entry(shown, one.label, one.row, [one], one.key);
    // what both dates have is found by its new self; an address may still name the old one
    const twice = one.date === "old" && one.pair?.length === 2;
    entries.push({ ...found, words: twice ? "" : wordsOf(words, one.row), twice });
  }
  return entries;
}

export function grouped(elements) {
  const groups = new Map();
  for (const one of elements) groups.set(one.group, [...(groups.get(one.group) ?? []), one]);
  return groups;
}

function entry(shown, kind, row, elements, key, place = null) {
  return { shown, kind, row, elements, key, words: wordsOf(shown, row), place };
}

const wordsOf = (words, row) => plain(`${words} row ${row.name}`);

export function search(index, query) {
  const wanted = plain(query);
  if (!wanted) return [];
  const parts = wanted.match(/[^\d\s]+ \d+|\S+/g); // "bay 3" is one
  const found = [];
  for (const one of index) {
    if (!parts.every((part) => one.words.includes(part))) continue;
    const shown = plain(one.shown);
    const rank = shown === wanted ? 0 : shown.startsWith(wanted) ? 1 : shown.includes(wanted) ? 2 : 3;
    const words = ` ${one.words} `;
    found.push([rank, one, parts.filter((part) => words.includes(` ${part} `)).length]);
  }
  found.sort((a, b) => a[0] - b[0] || b[2] - a[2]);
  return found.slice(0, MOST).map((pair) => pair[1]);
}

// What an address names: "A/bay 3", "A/bay 3 / beam 2", "A/bay 3 / level 1", "A", or a text that is written somewhere, such as "A21-03".
// Letters' case counts where that finds something: rows may differ in nothing else.
export function named(index, address) {
  const wanted = address.trim();
  if (!wanted) return null;
  return (
    namedSo(index, (text) => text === wanted) ??
    namedSo(index, (text) => text.toLowerCase() === wanted.toLowerCase()) ??
    namedSo(index, (text) => plain(text) === plain(wanted)) ??
    null
  );
}

function namedSo(index, fits) {
  const exact = index.find((one) => fits(one.key));
  if (exact) return exact;
  const single = index.filter((one) => one.elements.length === 1 && !one.twice && !one.place);
  const written = single.filter((one) => one.elements[0].written.some(fits));
  if (written.length) return { ...written[0], elements: written.map((one) => one.elements[0]) };
  return single.find((one) => fits(one.elements[0].id)) ?? index.find((one) => !one.twice && fits(one.shown));
}
