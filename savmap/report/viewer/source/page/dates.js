// Two dates of one place: which of them are shown, the list of what changed, and the divider between their orthophotos.
import { byId, element, fill } from "./dom.js";
import { link } from "./panels.js";
import { amountOf } from "./figures.js";
import { bothOf, counts, showDates, visibleIn } from "../site/dates.js";
import { fixed } from "../site/measure.js";
import { colourOfState } from "../scene/colours.js";
import { text } from "../text.js";

const STEP = 0.05;

function motionText({ shift_m: shift, sigma_m: sigma, heading_deg: heading, pairs }) {
  const moved = ["x", "y", "z"].map((axis, k) => `${axis} ${fixed(shift[k])} \u00b1 ${fixed(sigma[k])} m`);
  return text.motion(pairs, moved.join(", "), fixed(heading, 2));
}

export class Dates {
  constructor(viewer) {
    this.viewer = viewer;
    this.share = 0.5; // of the view that is left of the divider
    const { dates } = viewer.site;
    byId("dates").hidden = byId("changed").hidden = !dates;
    if (!dates) return;
    byId("h-changes").textContent = text.changes;
    const buttons = Object.entries(text.dates).map(([which, label]) =>
      element("button", { type: "button", "data-dates": which, onclick: () => this.show(which) }, label),
    );
    fill(byId("dates"), ...buttons);
    byId("dates").setAttribute("aria-label", text.whichDates);
    this.buildDivider();
  }

  get on() {
    return this.viewer.site.dates !== null;
  }

  // Show one date or both.
  show(which) {
    if (!this.on) return;
    const { viewer } = this;
    showDates(viewer.site, which);
    for (const button of document.querySelectorAll("[data-dates]"))
      button.setAttribute("aria-pressed", String(button.dataset.dates === which));
    viewer.model.showDates(which);
    viewer.hangPhotos();
    this.refresh();
  }

  // Old, both, new, and old again.
  next() {
    const all = Object.keys(text.dates);
    this.show(all[(all.indexOf(this.viewer.site.showing) + 1) % all.length]);
  }

  // Make elements visible that are to be looked at.
  uncover(elements) {
    const { showing } = this.viewer.site;
    if (elements.some((one) => visibleIn(one, showing))) return;
    this.show(visibleIn(elements[0], "both") ? "both" : elements[0].date);
  }

  // Whether the orthophotos of both dates lie beside one another.
  get parted() {
    const { site, row, view, model } = this.viewer;
    const both = this.on && site.showing === "both" && view.kind === "face";
    return both && Boolean(row.face && row.before?.face) && model.shows("photos");
  }

  // The orthophotos that are looked at.
  get pictured() {
    const { showing } = this.viewer.site;
    return this.parted ? ["old", "new"] : [showing === "old" ? "old" : "new"];
  }

  // After another row, view or choice of dates.
  refresh() {
    if (!this.on) return;
    this.list();
    this.place(this.share);
    const drawn = `${this.parted} ${this.viewer.site.showing}`;
    byId("swipe").hidden = !this.parted;
    if (drawn !== this.drawn) this.viewer.recolour();
    this.drawn = drawn;
  }

  // ---- the list

  list() {
    const { row, site } = this.viewer;
    const lines = [...row.changes.map((one) => this.elementLine(one)), ...this.openingLines(row)];
    byId("change-count").textContent = lines.length ? String(lines.length) : "";
    const hint = (said) => element("p", { className: "hint" }, said);
    const { motion } = row.before ?? {};
    fill(
      byId("changes"),
      lines.length ? element("ul", { className: "list changes" }, ...lines) : hint(this.noneOf(row)),
      motion?.alternatives_m.length ? hint(text.ambiguous(motion.alternatives_m.map((one) => `${fixed(one, 2)} m`).join(", "))) : null,
      motion ? hint(motionText(motion)) : null,
      ...site.dates.missing.map((name) => hint(text.rowMissing(name))),
      ...this.otherRows().map((line) => element("p", { className: "hint" }, line)),
    );
  }

  noneOf(row) {
    if (row.before) return text.noChanges;
    return this.viewer.site.dates.new.includes(row.name) ? text.rowNew : text.rowNotCompared;
  }

  elementLine(one) {
    const told = one.tested?.filter((figure) => figure.significant).map(amountOf) ?? [];
    const name = one.written[0] ?? one.id;
    return this.line(one.state, name, told, () => {
      this.viewer.selection.open(bothOf(one), one.key, name);
    });
  }

  openingLines(row) {
    const { selection } = this.viewer;
    return (row.before?.openings ?? []).map(({ state, name, place, tested }) => {
      const told = tested.filter((figure) => figure.significant).map(amountOf);
      return this.line(state, name, told, () => selection.flyTo(row, place));
    });
  }

  line(state, name, told, act) {
    const line = element("li", {}, link(`${name}: ${[text.states[state], ...told].join(", ")}`, act));
    line.style.borderColor = colourOfState(state);
    return line;
  }

  otherRows() {
    const { site, row } = this.viewer;
    return site.rows
      .filter((other) => other !== row && counts(other))
      .map((other) => link(text.changesOf(other.name, counts(other)), () => this.viewer.goToRow(other)));
  }

  // ---- the divider

  buildDivider() {
    const divider = byId("swipe");
    divider.setAttribute("aria-label", text.divider);
    byId("swipe-old").textContent = text.dates.old;
    byId("swipe-new").textContent = text.dates.new;
    const own = (act) => (event) => {
      event.stopPropagation();
      act(event);
    };
    divider.addEventListener(
      "pointerdown",
      own((event) => divider.setPointerCapture(event.pointerId)),
    );
    divider.addEventListener(
      "pointermove",
      own((event) => {
        const box = byId("view").getBoundingClientRect();
        if (divider.hasPointerCapture(event.pointerId)) this.place((event.clientX - box.left) / box.width);
      }),
    );
    divider.addEventListener("pointerup", own(() => {}));
    divider.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: -STEP, ArrowRight: STEP }[event.key];
      if (by) own(() => this.place(this.share + by))(event);
    });
  }

  place(share) {
    this.share = Math.min(Math.max(share, 0), 1);
    const divider = byId("swipe");
    divider.style.left = `${100 * this.share}%`;
    divider.setAttribute("aria-valuenow", String(Math.round(100 * this.share)));
    this.viewer.redraw();
  }

  // What is under the pointer is of the date that is shown there.
  aim(x) {
    const { row, view, site } = this.viewer;
    const shown = this.parted ? (x < this.share * view.width ? "old" : "new") : site.showing;
    row.shown = row.elements.filter((one) => visibleIn(one, shown));
  }
}
