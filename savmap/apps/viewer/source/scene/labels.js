// Names over a view: the most important first, and none where it would cover another.
import { Matrix4, Vector4 } from "three";
import { element } from "../page/dom.js";
import { toSite } from "../site/data.js";
import { rowVisibleIn, visibleIn } from "../site/dates.js";

const MOST = 90,
  HEIGHT = 17,
  LETTER = 6.7,
  LEAST_PX = 34;

// All that may be named: rows, groups, elements, with their middle and ends in the site's frame.
export function namesOf(site) {
  const names = [];
  for (const row of site.rows) {
    const top = [(row.box.low[0] + row.box.high[0]) / 2, row.box.high[1] + 0.3, 0];
    if (site.rows.length > 1)
      names.push({ text: row.name, rank: 0, style: "of-row", row, at: toSite(row, top), ends: null });
    const groups = new Map();
    for (const one of row.elements) {
      const { date } = one,
        of = { row, date, state: one.pair?.length === 2 ? "same" : one.state, at: toSite(row, one.centre) };
      if (one.written.length)
        names.push({ text: one.written[0], rank: 1, style: "written", ends: null, ...of });
      else names.push({ text: one.short, rank: one.group ? 4 : 3, style: "", ends: endsOf(one), ...of });
      const key = `${date} ${one.group}`;
      if (one.group) groups.set(key, [...(groups.get(key) ?? []), one]);
    }
    for (const elements of groups.values()) {
      const [{ group, date }] = elements;
      const centre = [0, 1, 2].map((k) => elements.reduce((sum, one) => sum + one.centre[k] / elements.length, 0));
      const low = Math.min(...elements.map((one) => one.centre[1]));
      names.push({
        text: group,
        date,
        state: "same",
        rank: 2,
        style: "of-group",
        row,
        at: toSite(row, [centre[0], Math.max(low - 0.22, 0.05), centre[2]]),
        ends: endsOf(...elements),
      });
    }
  }
  return names.sort((a, b) => a.rank - b.rank);
}

function endsOf(...elements) {
  const { row } = elements[0],
    low = [Infinity, Infinity, Infinity],
    high = [-Infinity, -Infinity, -Infinity];
  for (const one of elements)
    for (let k = 3 * one.first; k < 3 * (one.first + one.count); k++) {
      low[k % 3] = Math.min(low[k % 3], row.positions[k]);
      high[k % 3] = Math.max(high[k % 3], row.positions[k]);
    }
  return [toSite(row, low), toSite(row, high)];
}

export function drawNames(layer, names, dates, camera, width, height, focused, taken) {
  const matrix = new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse),
    place = new Vector4();
  const pixel = (point) => {
    place.set(...point, 1).applyMatrix4(matrix);
    return place.w > 0 ? [((place.x / place.w + 1) * width) / 2, ((1 - place.y / place.w) * height) / 2] : null;
  };
  let made = 0;
  for (const name of names) {
    if (made >= MOST) break;
    if (name.rank > 0 ? name.row !== focused || !visibleIn(name, dates) : !rowVisibleIn(name.row, dates)) continue;
    const at = pixel(name.at);
    if (!at || at[0] < 0 || at[1] < 0 || at[0] > width || at[1] > height || tooSmall(name, pixel)) continue;
    const half = (LETTER * name.text.length) / 2 + 5,
      box = [at[0] - half, at[1] - HEIGHT / 2, at[0] + half, at[1] + HEIGHT / 2];
    if (box[0] < 2 || box[2] > width - 2) continue;
    if (taken.some((other) => box[0] < other[2] && box[2] > other[0] && box[1] < other[3] && box[3] > other[1]))
      continue;
    taken.push(box);
    const shown = layer.children[made++] ?? layer.appendChild(element("span"));
    if (shown.textContent !== name.text) shown.textContent = name.text;
    shown.className = `name ${name.style}`;
    shown.style.transform = `translate(-50%, -50%) translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px)`;
  }
  while (layer.children.length > made) layer.lastChild.remove();
}

function tooSmall(name, pixel) {
  if (!name.ends) return false;
  const [a, b] = name.ends.map(pixel);
  if (!a || !b) return false;
  const size = Math.hypot(a[0] - b[0], a[1] - b[1]);
  return size < Math.max(LEAST_PX, LETTER * name.text.length + (name.rank > 2 ? 24 : 10));
}
