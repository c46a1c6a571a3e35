// Colours that are told apart by colour-blind people on a light ground and on a dark one (Okabe and Ito; viridis without what is lost on the
// ground). What the row's warnings paint differs from an element's own by lightness, which every eye sees.
import { STATES } from "../site/dates.js";
import { text } from "../text.js";

const SHADES = {
  light: {
    ground: "#fbfcfd",
    night: "#eef1f4", // around the panorama
    grid: ["#dfe4ea", "#e9edf1"],
    path: "#7b8794",
    rule: ["#1b1f24", "#ffffff"],
    selected: "#e8007d",
    ellipsoids: "#8e4585",
    labels: ["#0b6096", "#c4501b", "#9f3df5", "#373115", "#3e1f93", "#c07459", "#5c2349"],
    ramp: ["#440154", "#46307e", "#365c8d", "#277f8e", "#1fa187"],
    grey: "#8a929c",
    good: "#0b6096",
    check: "#8c2600",
    ofRow: "#dc6a1c",
    states: {
      same: "#7f8a80",
      moved: "#d07a00",
      changed: "#8e1f73",
      new: "#2b83c6",
      missing: "#1b1f24",
      "not seen": "#cfd4da",
    },
    earlier: "#dcc163", // what of the old date lies under the new one
  },
  dark: {
    ground: "#12171d",
    night: "#0c1014",
    grid: ["#2a323b", "#20272f"],
    path: "#8693a1",
    rule: ["#ffffff", "#12171d"],
    selected: "#ff5fae",
    ellipsoids: "#cf8bc6",
    labels: ["#56b4e9", "#f08a4b", "#edc5ab", "#9a5cf7", "#da0b7a", "#4665b9", "#c8daea"],
    ramp: ["#31688e", "#21918c", "#35b779", "#90d743", "#fde725"],
    grey: "#7d8792",
    good: "#56b4e9",
    check: "#ff5a1f",
    ofRow: "#ffc9a3",
    states: {
      same: "#9aa59b",
      moved: "#f0a030",
      changed: "#9325f4",
      new: "#56b4e9",
      missing: "#ffffff",
      "not seen": "#454e58",
    },
    earlier: "#a08a3a",
  },
};
const OFF_M = 0.05;

export let shades = SHADES.light; // those of the theme at hand

export function setShades(theme) {
  shades = SHADES[theme];
}

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
  if (site.rows.some((row) => row.assumed.includes(1))) colours.legend.push([shades.grey, text.assumed, "dashed"]);
  if (!overlaid) return colours;
  const of = (one) => (one.date === "old" && one.pair?.length === 2 ? shades.earlier : colours.of(one));
  return { ...colours, of, legend: [...colours.legend, [shades.earlier, text.earlier]] };
}

export const colourOfState = (state) => shades.states[state] ?? shades.states["not seen"];

function coloursOf(site, mode) {
  if (mode === "change") return byChange(site);
  if (mode === "label") return byLabel(site);
  if (mode === "verdict") return byVerdict(site);
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
  const colours = new Map(labels.map((label, k) => [label, shades.labels[Math.min(k, shades.labels.length - 1)]]));
  return {
    of: (one) => colours.get(one.label) ?? shades.grey,
    legend: labels.map((label) => [colours.get(label), `${label} (${counts.get(label)})`]),
  };
}

function byVerdict(site) {
  const { grey, good, check, ofRow } = shades;
  const of = (one) => {
    if (one.row.grade === null || one.date === "old") return grey;
    return one.row.warnedElements.has(one) ? check : one.row.warnedAsWhole ? ofRow : good;
  };
  const legend = [
    [good, text.trusted],
    [check, text.check],
    [ofRow, text.checkRow],
    [grey, text.notJudged],
  ];
  const used = new Set(site.elements.map(of));
  return { of, legend: legend.filter(([colour]) => used.has(colour)) };
}

function byError(site) {
  // beyond 5 cm it is wrong, however much
  const finite = (one) => (typeof one.off === "number" ? Math.min(one.off, OFF_M) : null);
  const most = Math.max(1e-3, ...site.elements.map(finite));
  const ramp = byNumber(site, finite, (value) => `${(1000 * value).toFixed(most < 0.01 ? 1 : 0)} mm`, [0, most]);
  const of = (one) => (one.off === "spurious" ? shades.check : ramp.of(one));
  const legend = [
    [shades.check, text.spurious],
    [shades.grey, text.notCompared],
  ];
  return { of, ramp: ramp.ramp, legend };
}

function byNumber(site, value, shown, [low, high], reversed = false) {
  const stops = reversed ? [...shades.ramp].reverse() : shades.ramp;
  const of = (one) => {
    const given = value(one);
    return given === null ? shades.grey : mixed(stops, (given - low) / Math.max(high - low, 1e-12));
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
