// Colours that are told apart by colour-blind people (Okabe and Ito, darkened for a light ground; viridis without its brightest part).
import { STATES } from "../site/dates.js";
import { text } from "../text.js";

const LABELS = ["#0b6096", "#c4501b", "#0a7d5c", "#8e4585", "#8a6d00", "#2f7fb8", "#5b5f66"];
const RAMP = ["#440154", "#414487", "#2a788e", "#22a884", "#7ad151"];
const GREY = "#8a929c",
  GOOD = "#0b6096",
  CHECK = "#d0450b";
const OFF_M = 0.05;

const STATE_COLOURS = {
  same: "#7f8a80",
  moved: "#d07a00",
  changed: "#8e1f73",
  new: "#2b83c6",
  missing: "#1b1f24",
  "not seen": "#cfd4da",
};
const EARLIER = "#dcc163"; // what of the old date lies under the new one

const MODES = ["change", "label", "verdict", "uncertainty", "support", "error"];

export function modesOf(site) {
  const has = {
    change: site.dates !== null,
    label: true,
    verdict: site.rows.some((row) => row.grade),
    uncertainty: true,
    support: site.elements.some((one) => one.support !== null),
    error: site.surveyed,
  };
  return MODES.filter((mode) => has[mode]);
}

// The colour of each element, and the legend: lines of [colour, text], or a ramp from one number to another.
// `overlaid`: two dates lie over one another, and of what both have the new self is coloured.
export function colouring(site, mode, overlaid) {
  const colours = coloursOf(site, mode);
  if (!overlaid) return colours;
  const of = (one) => (one.date === "old" && one.pair?.length === 2 ? EARLIER : colours.of(one));
  return { ...colours, of, legend: [...colours.legend, [EARLIER, text.earlier]] };
}

export const colourOfState = (state) => STATE_COLOURS[state] ?? STATE_COLOURS["not seen"];

function coloursOf(site, mode) {
  if (mode === "change") return byChange(site);
  if (mode === "label") return byLabel(site);
  if (mode === "verdict") return byVerdict();
  if (mode === "support")
    return byNumber(
      site,
      (one) => one.support,
      (value) => `${Math.round(100 * value)} %`,
      [0, 1],
      true,
    );
  if (mode === "error") return byError(site);
  const sigmas = newOf(site).map((one) => one.sigma).sort((a, b) => a - b);
  const most = sigmas[Math.floor(0.98 * (sigmas.length - 1))] || 1e-3;
  const least = Math.max(sigmas[0] ?? 0, most / 1000);
  return byNumber(
    site,
    (one) => Math.log(Math.max(one.sigma, least)),
    (value) => `${(1000 * Math.exp(value)).toFixed(1)} mm`,
    [Math.log(least), Math.log(most)],
  );
}

const newOf = (site) => site.elements.filter((one) => one.date === "new");

// Each element once: what both dates have by its new self.
function byChange(site) {
  const once = site.elements.filter((one) => one.date === "new" || one.pair?.length === 1);
  const lines = STATES.map((state) => [state, once.filter((one) => one.state === state).length]);
  const unknown = once.filter((one) => one.state === null).length;
  const found = lines.filter(([, count]) => count);
  const legend = found.map(([state, count]) => [colourOfState(state), `${text.states[state]} (${count})`]);
  if (unknown) legend.push([colourOfState(null), `${text.notCompared} (${unknown})`]);
  return { of: (one) => colourOfState(one.state), legend };
}

function byLabel(site) {
  const counts = new Map();
  for (const one of newOf(site)) counts.set(one.label, (counts.get(one.label) ?? 0) + 1);
  const labels = [...counts].sort((a, b) => b[1] - a[1]).map(([label]) => label);
  const colours = new Map(labels.map((label, k) => [label, LABELS[Math.min(k, LABELS.length - 1)]]));
  return {
    of: (one) => colours.get(one.label) ?? GREY,
    legend: labels.map((label) => [colours.get(label), `${label} (${counts.get(label)})`]),
  };
}

function byVerdict() {
  const of = (one) => (one.row.grade === null || one.date === "old" ? GREY : one.row.doubtful.has(one) ? CHECK : GOOD);
  return {
    of,
    legend: [
      [GOOD, text.trusted],
      [CHECK, text.check],
      [GREY, text.notJudged],
    ],
  };
}

function byError(site) {
  // beyond 5 cm it is wrong, however much
  const finite = (one) => (typeof one.off === "number" ? Math.min(one.off, OFF_M) : null);
  const most = Math.max(1e-3, ...site.elements.map(finite));
  const ramp = byNumber(site, finite, (value) => `${(1000 * value).toFixed(most < 0.01 ? 1 : 0)} mm`, [0, most]);
  const of = (one) => (one.off === "spurious" ? CHECK : ramp.of(one));
  return {
    of,
    ramp: ramp.ramp,
    legend: [
      [CHECK, text.spurious],
      [GREY, text.notCompared],
    ],
  };
}

function byNumber(site, value, shown, [low, high], reversed = false) {
  const stops = reversed ? [...RAMP].reverse() : RAMP;
  const of = (one) => {
    const given = value(one);
    return given === null ? GREY : mixed(stops, (given - low) / Math.max(high - low, 1e-12));
  };
  return { of, ramp: { stops, low: shown(low), high: shown(high) }, legend: [] };
}

function mixed(stops, share) {
  const place = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const k = Math.min(Math.floor(place), stops.length - 2);
  const [a, b] = [stops[k], stops[k + 1]].map((one) => [1, 3, 5].map((n) => parseInt(one.slice(n, n + 2), 16)));
  return `#${a
    .map((low, n) =>
      Math.round(low + (place - k) * (b[n] - low))
        .toString(16)
        .padStart(2, "0"),
    )
    .join("")}`;
}
