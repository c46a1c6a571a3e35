// What is selected, by a click, a key, a warning, or the address after #, which names it.
import { tell } from "./banner.js";
import { byId } from "./dom.js";
import { showSelection } from "./panels.js";
import { boxInSite, pointsOf } from "../scene/views.js";
import { toSite } from "../site/data.js";
import { visibleIn } from "../site/dates.js";
import { named } from "../site/search.js";
import { text } from "../text.js";

export class Selection {
  constructor(viewer) {
    Object.assign(this, { viewer, elements: [], address: null, name: "", place: null });
    addEventListener("hashchange", () => this.followAddress());
    byId("selection").setAttribute("tabindex", "-1");
  }

  // `place`: that between elements which is meant, such as a level.
  select(elements, address = null, name = "", place = null) {
    const { viewer } = this;
    Object.assign(this, { elements, address, name, place });
    if (elements.length) viewer.dates.uncover(elements);
    viewer.model.mark(elements, place);
    viewer.tree.mark(elements);
    tell("");
    viewer.pointer.forget();
    this.show();
    byId("note").disabled = byId("add-note").disabled = !elements.length;
    if (elements.length) {
      if (elements[0].row !== viewer.row) viewer.setRow(elements[0].row);
      if (viewer.lookout.open) viewer.lookout.visit(elements);
      const hash = `#${encodeURI(address ?? elements[0].key)}`;
      if (location.hash !== hash) location.replace(hash);
      this.written = location.hash; // its event comes later, when something else may be selected
    }
    viewer.redraw();
  }

  show() {
    showSelection(this, this.viewer.frame);
  }

  // Select and fly there.
  open(elements, address, name, place = null) {
    this.select(elements, address, name, place);
    if (elements.length) this.viewer.view.fly(pointsOf(elements), elements.length > 1 ? 0.8 : 0.45);
  }

  openAddress(address) {
    const found = named(this.viewer.finder.index, address);
    if (found) this.open(found.elements, address, found.shown, found.place);
    else tell(text.badLink(address));
  }

  followAddress() {
    if (location.hash === this.written) return;
    this.written = location.hash;
    let address = location.hash.slice(1);
    try {
      address = decodeURIComponent(address);
    } catch {
      // as it stands: it will name nothing
    }
    if (address) this.openAddress(address);
  }

  openWarning(warning) {
    const { row, view, lookout } = this.viewer,
      { elements } = warning;
    if (elements.length) this.open(elements, elements[0].key, warning.headline);
    else if (warning.place) this.flyTo(row, warning.place);
    else view.fly(boxInSite(row));
    if (warning.frame !== null && lookout.open) lookout.lookFromFrame(row, warning.frame, elements);
  }

  // To a place in a row, with what is around it.
  flyTo(row, [x, y, z]) {
    const around = [-0.8, 0.8].map((by) => toSite(row, [x + by, y + by, z]));
    this.viewer.view.fly(around, 0.8);
  }

  // Go to the next element of the row at hand, or to the one before.
  step(by) {
    const { row, site } = this.viewer,
      all = row.elements.filter((one) => visibleIn(one, site.showing)),
      at = this.elements.length ? all.indexOf(this.elements[0]) : by > 0 ? -1 : 0;
    const next = all[(at + by + all.length) % all.length];
    if (next) this.open([next], next.key);
  }
}
