// The bar above: title, views, rows, and what is done with the page.
import { byId, element, fill } from "./dom.js";
import { showHelp } from "./panels.js";
import { text } from "../text.js";

export function buildBar(viewer) {
  document.title = byId("title").textContent = viewer.site.title;
  const kinds = Object.entries(text.views).map(([kind, label]) =>
    element("button", { type: "button", "data-kind": kind, onclick: () => viewer.setKind(kind) }, label),
  );
  fill(byId("kinds"), ...kinds);
  const buttons = {
    panorama: () => viewer.lookout.toggle(),
    measure: () => viewer.ruler.turn(!viewer.ruler.on),
    fit: () => viewer.setKind(viewer.view.kind),
    print: () => print(),
  };
  for (const [id, act] of Object.entries(buttons)) {
    byId(id).textContent = text[id];
    byId(id).addEventListener("click", act);
  }
  byId("help-button").textContent = "?";
  byId("help-button").setAttribute("aria-label", text.help);
  byId("help-button").addEventListener("click", showHelp);
  buildRows(viewer);
}

function buildRows(viewer) {
  const picker = byId("row"),
    { rows } = viewer.site;
  const options = rows.map((row) =>
    element("option", { value: String(row.index) }, nameOf(row)),
  );
  fill(picker, ...options);
  picker.hidden = rows.length < 2;
  picker.setAttribute("aria-label", text.rows);
  picker.addEventListener("change", () => viewer.goToRow(rows[Number(picker.value)]));
}

function nameOf(row) {
  const dated = row.only ? ` (${text.states[row.gone ? "missing" : "new"]})` : "";
  return `${text.row(row.name)}${dated}${row.warnings.length ? " !" : ""}`;
}

export function showKind(kind) {
  for (const button of document.querySelectorAll("[data-kind]"))
    button.setAttribute("aria-pressed", String(button.dataset.kind === kind));
}
