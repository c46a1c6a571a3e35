// The search box and what it finds.
import { byId, element, fill } from "./dom.js";
import { link } from "./panels.js";
import { search, searchIndex } from "../site/search.js";
import { text } from "../text.js";

export class Finder {
  constructor(viewer) {
    this.viewer = viewer;
    this.index = searchIndex(viewer.site);
    const box = byId("search");
    box.placeholder = text.search;
    box.setAttribute("aria-label", text.search);
    for (const kind of ["input", "focus"]) box.addEventListener(kind, () => this.show());
    box.addEventListener("keydown", (event) => {
      if (event.key === "Enter") this.show().slice(0, 1).forEach((one) => this.choose(one));
      if (event.key === "ArrowDown") byId("results").querySelector("button")?.focus();
    });
    addEventListener("pointerdown", (event) => {
      if (!event.target.closest?.("#finder")) byId("results").hidden = true;
    });
  }

  show() {
    const query = byId("search").value,
      found = search(this.index, query);
    const none = query.trim() && !found.length ? element("li", { className: "hint" }, text.noResult) : null;
    fill(byId("results"), ...found.map((one) => this.line(one)), none);
    byId("results").hidden = !query.trim();
    return found;
  }

  line(one) {
    const line = link("", () => this.choose(one)),
      kind = text.kinds[one.kind] ?? one.kind;
    const many = one.elements.length > 1 ? `, ${text.elements(one.elements.length)}` : "";
    line.append(
      element("b", {}, one.shown),
      element("span", {}, [kind, `${text.row(one.row.name)}${many}`, one.elements[0]?.date === "old" ? text.ofOldDate : ""].filter(Boolean).join(", ")),
    );
    return element("li", {}, line);
  }

  choose(entry) {
    byId("search").blur();
    byId("results").hidden = true;
    this.viewer.selection.open(entry.elements, entry.key, entry.shown, entry.place);
  }
}
