// The tree of elements: rows, their bays, and what is in these. A branch is made when it is opened first.
import { byId, element } from "./dom.js";
import { dateOf } from "../site/dates.js";
import { grouped } from "../site/search.js";
import { text } from "../text.js";

export class Tree {
  constructor(viewer) {
    this.viewer = viewer;
    this.root = byId("tree");
    this.root.setAttribute("aria-label", text.tree);
    byId("h-tree").textContent = text.tree;
    this.root.append(...viewer.site.rows.map((row) => this.branch(rowBranch(row))));
    this.root.firstElementChild.tabIndex = 0;
    this.root.addEventListener("keydown", (event) => this.key(event));
    this.root.addEventListener("click", (event) => this.click(event));
    if (viewer.site.rows.length === 1) this.unfold(this.root.firstElementChild);
  }

  branch({ label, warned = false, elements, key, name, parts = null, row = null }) {
    const mark = warned ? element("b", { className: "warned", title: text.check }, "!") : null;
    const made = element("li", { role: "treeitem", tabIndex: -1 }, element("span", { className: "leaf" }, label, mark));
    made.setAttribute("aria-selected", "false");
    if (parts) made.setAttribute("aria-expanded", "false");
    return Object.assign(made, { branchOf: { elements, key, name, parts, row } });
  }

  unfold(item, open = true) {
    const { parts } = item.branchOf;
    if (!parts) return;
    item.setAttribute("aria-expanded", String(open));
    if (open && item.children.length === 1) {
      const inner = element("ul", {}, ...parts().map((one) => this.branch(one)));
      inner.setAttribute("role", "group");
      item.append(inner);
    }
    if (item.children.length > 1) item.lastElementChild.hidden = !open;
  }

  isOpen(item) {
    return item.getAttribute("aria-expanded") === "true";
  }

  click(event) {
    const item = event.target.closest("[role=treeitem]");
    if (!item) return;
    this.focus(item);
    // left of the name is the mark that folds
    const folds = item.branchOf.parts && event.clientX < item.firstElementChild.getBoundingClientRect().left + 18;
    if (folds) this.unfold(item, !this.isOpen(item));
    else this.choose(item);
  }

  choose(item) {
    const { row, elements, key, name } = item.branchOf;
    this.unfold(item, key || row ? true : !this.isOpen(item));
    if (row) this.viewer.goToRow(row);
    else if (key) this.viewer.selection.open(elements, key, name);
  }

  key(event) {
    const item = event.target.closest("[role=treeitem]"),
      seen = [...this.root.querySelectorAll("[role=treeitem]")].filter((one) => !one.closest("[hidden]")),
      at = seen.indexOf(item);
    const acts = {
      ArrowDown: () => this.focus(seen[at + 1]),
      ArrowUp: () => this.focus(seen[at - 1]),
      Home: () => this.focus(seen[0]),
      End: () => this.focus(seen.at(-1)),
      ArrowRight: () => (this.isOpen(item) ? this.focus(seen[at + 1]) : this.unfold(item)),
      ArrowLeft: () =>
        this.isOpen(item) ? this.unfold(item, false) : this.focus(item.parentElement.closest("[role=treeitem]")),
      Enter: () => this.choose(item),
      " ": () => this.choose(item),
    };
    if (!item || !acts[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    acts[event.key]();
  }

  focus(item) {
    if (!item) return;
    for (const one of this.root.querySelectorAll("[tabindex='0']")) one.tabIndex = -1;
    item.tabIndex = 0;
    item.focus({ preventScroll: true });
    this.reveal(item);
  }

  reveal(item) {
    const box = byId("tree-box"),
      line = item.firstElementChild.getBoundingClientRect(),
      seen = box.getBoundingClientRect();
    if (line.top < seen.top) box.scrollTop += line.top - seen.top;
    if (line.bottom > seen.bottom) box.scrollTop += line.bottom - seen.bottom;
  }

  // Mark what is selected, and open the way to it.
  mark(elements) {
    for (const old of this.root.querySelectorAll("[aria-selected=true]")) old.setAttribute("aria-selected", "false");
    if (!elements.length) return;
    const [{ row }] = elements;
    let item = this.root.children[row.index];
    const holds = ({ branchOf: own }) => own.elements.length >= elements.length && elements.every((one) => own.elements.includes(one));
    while (item && item.branchOf.parts && item.branchOf.elements.length > elements.length) {
      this.unfold(item);
      const inner = [...item.lastElementChild.children].find(holds);
      if (!inner) break;
      item = inner;
    }
    item.setAttribute("aria-selected", "true");
    this.reveal(item);
  }
}

function rowBranch(row) {
  const elements = row.elements.filter((one) => one.date === dateOf(row));
  const warned = row.warnings.length > 0;
  return { label: text.row(row.name), warned, elements, row, parts: () => partsOf(row, elements) };
}

// The bays of a row, from its beginning on, with what hangs in them; then the rest by its label.
function partsOf(row, elements) {
  const groups = grouped(elements);
  const inBay = (one) => one.group || (groups.has(one.attributes.bay) ? one.attributes.bay : "");
  const bays = new Map(),
    kinds = new Map();
  for (const one of elements) {
    const [into, name] = inBay(one) ? [bays, inBay(one)] : [kinds, one.label];
    into.set(name, [...(into.get(name) ?? []), one]);
  }
  const first = (own) => Math.min(...own.map((one) => one.centre[0]));
  const inOrder = [...bays].sort(([, a], [, b]) => first(a) - first(b));
  return [
    ...inOrder.map(([name, own]) => folder(name, own, `${row.name}/${name}`)),
    ...[...kinds].map(([name, own]) => folder(text.counted(name, own.length), own, null)),
  ];
}

function folder(label, elements, key) {
  const warned = elements.some((one) => one.row.warnedElements.has(one));
  return { label, warned, elements, key, name: label, parts: () => elements.map(leaf) };
}

function leaf(one) {
  const label = one.written.length ? `${one.short}: ${one.written[0]}` : one.short;
  return { label, warned: one.row.warnedElements.has(one), elements: [one], key: one.key, name: "" };
}
