// Two dates of one place: which of them are shown, and the divider between their orthophotos.
import { showChanges } from "./changes.js";
import { byId, element, fill } from "./dom.js";
import { showDates, visibleIn } from "../site/dates.js";
import { text } from "../text.js";

const STEP = 0.05;

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
    viewer.lookout.followDate();
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
    if (!this.on || !elements.length || elements.some((one) => visibleIn(one, showing))) return;
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
    showChanges(this.viewer);
    this.place(this.share);
    const drawn = `${this.parted} ${this.viewer.site.showing}`;
    byId("swipe").hidden = !this.parted;
    if (drawn !== this.drawn) this.viewer.recolour();
    this.drawn = drawn;
  }

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
