// The panels beside the view: selection, measure, warnings, notes, colours, help.
import { copyButton } from "./copy.js";
import { byId, element, fill } from "./dom.js";
import { assumedLines, attributeLines, plainText, testedLines } from "./figures.js";
import { colourOfState } from "../scene/colours.js";
import { PART, warningsOf } from "../site/data.js";
import { metres, millimetres } from "../site/measure.js";
import { text } from "../text.js";

const MOST_LISTED = 40,
  MOST_PRINTED = 6; // warnings on paper

// What is selected: elements with their name, and the place between them that is meant; `frame` tells where they are.
export function showSelection(selection, frame) {
  const { elements, name } = selection,
    panel = byId("selection"),
    place = placeOf(selection);
  const open = (...what) => selection.open(...what);
  if (!elements.length) return fill(panel, element("p", { className: "hint" }, text.nothing));
  const twice = elements.length === 2 && elements[0].pair?.includes(elements[1]);
  if (place || (elements.length > 1 && !twice)) {
    const lines = elements
      .slice(0, MOST_LISTED)
      .map((one) => element("li", {}, link(one.id, () => open([one], one.key))));
    const sizes = place ? sizeLines(elements[0].row, place) : [];
    return fill(
      panel,
      heading(name, [text.elements(elements.length), text.row(elements[0].row.name)].join(", ")),
      sizes.length ? table(sizes) : null,
      element("ul", { className: "list" }, ...lines),
      buttons(copyLink(selection)),
    );
  }
  const [one] = elements,
    { row } = one;
  const below = [one.written.length ? one.id : "", one.label, text.row(row.name), elements.length === 1 ? dateOf(one) : ""];
  const plain = plainText(one);
  fill(
    panel,
    heading(one.written[0] ?? one.id, below.filter(Boolean).join(", ")),
    plain ? element("p", { className: "plain" }, plain) : null,
    warningList(warningsOf(one), (warning) => selection.openWarning(warning)),
    ...sinceThen(one),
    table([...frame.lines(one), ...assumedLines(one), ...facts(one), ...whole(one, open)]),
    element("p", { className: "hint", id: "axes" }, frame.axes(row)),
    buttons(copyLink(selection), copyButton(text.copyPlace, () => `${one.key}: ${frame.text(row, one.centre)} (${frame.name(row)})`)),
  );
}

const copyLink = ({ elements, address }) =>
  copyButton(text.copyLink, () => `${location.href.split("#")[0]}#${encodeURI(address ?? elements[0].key)}`);

const buttons = (...own) => element("p", { className: "row-of-buttons" }, ...own);

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

// The place that is meant, or by whose name elements are selected, such as a bay.
function placeOf({ elements, name, place }) {
  const named = elements.length && elements.every((one) => one.row === elements[0].row && one.group === name && one.date === "new");
  return place ?? (named ? elements[0].row.places.find(({ id }) => id === name) : null) ?? null;
}

// The sizes of a place and its parts, and of a part those of the whole.
function sizeLines(row, place) {
  const of = row.places.filter(({ id }) => id === place.id || id === place.whole || id.startsWith(place.id + PART));
  return of.flatMap(({ id, sizes }) =>
    Object.entries(sizes).map(([what, [value, sigma]]) => [
      [...(id === place.whole ? [] : id.slice(place.id.length + PART.length).split(PART)), what].filter(Boolean).join(", "),
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

export function showWarnings(row, rows, open) {
  const { warnings } = row;
  byId("h-warnings").textContent = rows.length > 1 ? text.warningsOf(row.name) : text.warnings;
  byId("warning-count").textContent = warnings.length ? String(warnings.length) : "";
  const none = element("p", { className: "hint" }, text.noWarnings(row.grade));
  const rest = warnings.length - MOST_PRINTED;
  const more = rest > 0 ? element("p", { className: "hint on-paper" }, text.moreWarnings(rest)) : null;
  fill(byId("warnings"), warnings.length ? warningList(warnings, open) : none, more, folded(text.remarks, row.remarks));
}

function folded(title, lines) {
  if (!lines.length) return null;
  return element("details", {}, element("summary", {}, title), ...lines.map((line) => element("p", {}, line)));
}

// Warnings: what in a few words, a figure, what to do; the rest is folded.
function warningList(warnings, open) {
  if (!warnings.length) return null;
  const line = (said, className) => (said ? element("span", { className }, said) : null);
  const lines = warnings.map((warning) => {
    const { code, headline, figure, action, details } = warning,
      told = link("", () => open(warning));
    told.append(element("strong", {}, headline));
    const parts = [line(code, "tag"), line(warning.of_row ? text.ofRow : "", "tag"), line(figure, "figure"), line(action, "action")];
    return element("li", {}, told, ...parts, folded(text.details, details));
  });
  return element("ul", { className: "list warnings" }, ...lines);
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
  const lines = legend.slice(0, 12).map(([colour, said, className = ""]) => {
    const patch = element("i", { className });
    patch.style.color = colour;
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
