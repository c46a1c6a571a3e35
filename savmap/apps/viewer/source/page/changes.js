// The list of what of a row is not as it was on the earlier date.
import { byId, element, fill } from "./dom.js";
import { amountOf } from "./figures.js";
import { link } from "./panels.js";
import { colourOfState } from "../scene/colours.js";
import { bothOf, counts } from "../site/dates.js";
import { fixed } from "../site/measure.js";
import { text } from "../text.js";

export function showChanges(viewer) {
  const { row, site, selection } = viewer;
  const lines = [
    ...row.changes.map((one) => elementLine(one, selection)),
    ...(row.before?.openings ?? []).map((one) => openingLine(one, row, selection)),
  ];
  byId("change-count").textContent = lines.length ? String(lines.length) : "";
  fill(
    byId("changes"),
    lines.length ? element("ul", { className: "list changes" }, ...lines) : hint(noneOf(row, site)),
    ...motionHints(row),
    ...otherRows(viewer).map(hint),
  );
}

const hint = (said) => element("p", { className: "hint" }, said);

function noneOf(row, site) {
  if (row.gone) return text.rowGone;
  if (row.before) return text.noChanges;
  return site.dates.new.includes(row.name) ? text.rowNew : text.rowNotCompared;
}

function elementLine(one, selection) {
  const name = one.written[0] ?? one.id;
  return lineOf(one.state, name, one.tested ?? [], () => selection.open(bothOf(one), one.key, name));
}

const openingLine = ({ state, name, place, tested }, row, selection) =>
  lineOf(state, name, tested, () => selection.flyTo(row, place));

function lineOf(state, name, tested, act) {
  const told = tested.filter((figure) => figure.significant).map(amountOf);
  const line = element("li", {}, link(`${name}: ${[text.states[state], ...told].join(", ")}`, act));
  line.style.borderColor = colourOfState(state);
  return line;
}

// How the row's frames lie on one another, and how else they may.
function motionHints({ before }) {
  if (!before?.motion) return [];
  const { shift_m: shift, sigma_m: sigma, heading_deg: heading, pairs, alternatives_m: others } = before.motion;
  const moved = ["x", "y", "z"].map((axis, k) => `${axis} ${fixed(shift[k])} \u00b1 ${fixed(sigma[k])} m`);
  const ambiguous = others.length ? [text.ambiguous(others.map((one) => `${fixed(one, 2)} m`).join(", "))] : [];
  return [...ambiguous, text.motion(pairs, moved.join(", "), fixed(heading, 2))].map(hint);
}

function otherRows(viewer) {
  const { site, row } = viewer,
    others = site.rows.filter((other) => other !== row && (other.only || counts(other)));
  const said = (other) =>
    other.gone
      ? text.rowMissing(other.name)
      : other.only
        ? text.rowIsNew(other.name)
        : text.changesOf(other.name, counts(other));
  return others.map((other) => link(said(other), () => viewer.goToRow(other)));
}
