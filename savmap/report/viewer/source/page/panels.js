// The panels beside the view: selection, measure, doubts, notes, colours, help.
import { byId, element, fill } from "./dom.js";
import { attributeLines, testedLines } from "./figures.js";
import { colourOfState } from "../scene/colours.js";
import { metres, millimetres } from "../site/measure.js";
import { text } from "../text.js";

const MOST_LISTED = 40;
const PART = " / "; // between the parts of an id

// `place` tells where an element is: lines of a name and a value.
export function showSelection(elements, name, place, open) {
  const panel = byId("selection");
  if (!elements.length) return fill(panel, element("p", { className: "hint" }, text.nothing));
  const sizes = sizeLines(elements, name);
  if (elements.length > 1 || sizes.length) {
    const lines = elements.slice(0, MOST_LISTED).map((one) =>
      element(
        "li",
        {},
        link(one.id, () => open([one], one.key)),
      ),
    );
    const twice = elements.length === 2 && elements[0].pair?.includes(elements[1]);
    if (!twice)
      return fill(
        panel,
        heading(name, text.elements(elements.length)),
        sizes.length ? table(sizes) : null,
        element("ul", { className: "list" }, ...lines),
      );
  }
  const [one] = elements;
  const address = element("a", { href: `#${encodeURI(one.key)}` }, text.link);
  fill(
    panel,
    heading(
      one.written[0] ?? one.id,
      [one.written.length ? one.id : "", one.label, text.row(one.row.name), elements.length === 1 ? dateOf(one) : ""]
        .filter(Boolean)
        .join(", "),
    ),
    ...sinceThen(one),
    table([...place(one), ...facts(one), ...whole(one, open)]),
    element("p", {}, address),
  );
}

const dateOf = (one) => (one.date === "old" ? text.ofOldDate : "");

const heading = (title, below) =>
  element("div", { className: "what" }, element("strong", {}, title), element("span", {}, below));

export const link = (label, act) => element("button", { type: "button", className: "link", onclick: act }, label);

function table(lines) {
  const cells = ([name, value, style]) => [
    element("dt", { className: style ?? "" }, name),
    element("dd", { className: style ?? "" }, value),
  ];
  return element("dl", {}, ...lines.flatMap(cells));
}

// What is known of an element: sizes with their standard deviations, then the rest.
function facts(one) {
  const lines = [];
  if (typeof one.off === "number") lines.push([text.off, millimetres(one.off)]);
  if (one.off === "spurious") lines.push([text.off, text.spurious]);
  return [...lines, ...attributeLines(one.attributes)];
}

// The sizes of the place by whose name elements are selected, such as a section, and of its parts.
function sizeLines(elements, name) {
  const [{ row }] = elements;
  if (elements.some((one) => one.row !== row || one.group !== name || one.date !== "new")) return [];
  return row.places
    .filter(({ id }) => id === name || id.startsWith(name + PART))
    .flatMap(({ id, sizes }) =>
      Object.entries(sizes).map(([what, [value, sigma]]) => [
        [...id.slice(name.length + PART.length).split(PART), what].filter(Boolean).join(", "),
        `${metres(value)} \u00b1 ${millimetres(sigma)}`,
      ]),
    );
}

// A link to the place whose part an element is, where that has sizes.
function whole(one, open) {
  const { row, group } = one;
  if (one.date !== "new" || !row.places.some(({ id }) => id === group)) return [];
  const all = row.elements.filter((other) => other.group === group && other.date === "new");
  return [[text.partOf, link(group, () => open(all, `${row.name}/${group}`, group))]];
}

// What a comparison says of an element.
function sinceThen({ state, tested }) {
  if (state === null) return [];
  const lines = testedLines(tested ?? []).map(([name, value, significant]) => [name, value, significant ? "told" : ""]);
  const said = element("p", { className: "state", id: "state" }, text.since(text.states[state]));
  said.style.borderColor = colourOfState(state);
  return [said, lines.length ? table(lines) : null];
}

export function showMeasure(points, result, remark = null) {
  const panel = byId("measured");
  panel.hidden = points === null;
  if (points === null) return;
  const hint = element(
    "p",
    { className: "hint" },
    remark ?? [text.measureFirst, text.measureSecond, ""][points.length],
  );
  if (!result) return fill(panel, element("h2", {}, text.measure), ...points.map(pointLine), hint);
  const axes = text.axes[result.how === "rows" ? "other" : "same"];
  const parts = axes.map((axis, k) => [
    axis,
    `${metres(result.difference[k])} \u00b1 ${millimetres(result.sigmas[k])}`,
  ]);
  fill(
    panel,
    element("h2", {}, text.measure),
    element("p", { className: "distance", id: "distance" }, distanceText(result)),
    ...points.map(pointLine),
    table(parts),
    element("p", { className: "hint", id: "measured-how" }, text.how[result.how]),
  );
}

const pointLine = ({ label, at }) => element("p", { className: "point" }, label, element("span", {}, at));

export const distanceText = (result) => `${metres(result.distance)} \u00b1 ${millimetres(result.sigma)}`;

export function showDoubts(row, open) {
  const lines = row.doubts.map((doubt) =>
    element(
      "li",
      {},
      link(`${doubt.kind}: ${doubt.what}`, () => open(doubt)),
    ),
  );
  const none = element("p", { className: "hint" }, text.noDoubts(row.grade));
  byId("doubt-count").textContent = row.doubts.length ? String(row.doubts.length) : "";
  const remarks = row.remarks.map((remark) => element("p", { className: "hint" }, remark));
  fill(byId("doubts"), row.doubts.length ? element("ul", { className: "list doubts" }, ...lines) : none, ...remarks);
}

export function showLegend({ legend, ramp }) {
  const bar =
    ramp &&
    element(
      "div",
      { className: "ramp" },
      element("span", {}, ramp.low),
      bandOf(ramp.stops),
      element("span", {}, ramp.high),
    );
  const lines = legend.slice(0, 12).map(([colour, said]) => {
    const patch = element("i", {});
    patch.style.background = colour;
    return element("li", {}, patch, said);
  });
  fill(byId("legend"), bar, element("ul", {}, ...lines));
}

function bandOf(stops) {
  const band = element("i", {});
  band.style.background = `linear-gradient(90deg, ${stops.join(", ")})`;
  return band;
}

export function showNotes(notes, open, changed) {
  const lines = notes.list.map((one) =>
    element(
      "li",
      {},
      link(one.place, () => open(one.place)),
      element("span", {}, `${one.note} (${one.date})`),
      element(
        "button",
        { type: "button", className: "quiet", title: text.remove, onclick: () => changed(one) },
        "\u00d7",
      ),
    ),
  );
  byId("notes-state").textContent = notes.unsaved ? text.unsaved : "";
  fill(byId("notes"), ...lines);
}

export function showHelp() {
  const keys = (lines) =>
    element(
      "dl",
      { className: "keys" },
      ...lines.flatMap(([key, said]) => [element("dt", {}, key), element("dd", {}, said)]),
    );
  const close = element("button", { type: "button", onclick: () => byId("help").close() }, text.close);
  fill(byId("help"), element("h2", {}, text.help), keys(text.pointer), keys(text.keys), close);
  byId("help").showModal();
}
