// The side: colours, what is shown, notes.
import { byId, element, fill } from "./dom.js";
import { showNotes } from "./panels.js";
import { Notes } from "../site/notes.js";
import { text } from "../text.js";

const TIMES = [1, 2, 5, 10, 20, 50, 100, 200];

export class Side {
  constructor(viewer) {
    this.viewer = viewer;
    this.notes = new Notes();
    for (const [id, title] of [
      ["h-colour", text.colour],
      ["h-show", text.show],
      ["h-selection", text.selection],
      ["h-notes", text.notes],
    ])
      byId(id).textContent = title;
    this.buildColours();
    this.buildBoxes();
    this.buildNotes();
    const unplaced = viewer.site.rows.filter((row) => !row.known).map((row) => row.name);
    if (viewer.site.rows.length > 1 && unplaced.length) byId("remark").textContent = text.unplaced(unplaced);
  }

  buildColours() {
    const { viewer } = this,
      modes = byId("mode");
    fill(modes, ...viewer.modes.map((mode) => element("option", { value: mode }, text.modes[mode])));
    modes.setAttribute("aria-label", text.colour);
    modes.addEventListener("change", () => viewer.setMode(modes.value));
  }

  buildBoxes() {
    const { site } = this.viewer;
    const has = {
      photos: site.rows.some((row) => row.face ?? row.before?.face),
      solids: site.elements.some((one) => one.solid),
    };
    const boxes = Object.entries(text.showing)
      .filter(([name]) => has[name] ?? true)
      .map(([name, label]) => {
        const box = element("input", { type: "checkbox", id: `show-${name}`, onchange: () => this.toggle(name) });
        return element("label", {}, box, label);
      });
    fill(byId("showing"), ...boxes, this.slider());
    this.tell();
  }

  slider() {
    const { viewer } = this,
      { model } = viewer;
    const times = element("input", { type: "range", min: "0", max: "7", value: "3", id: "times" });
    const said = element("output", {}, text.exaggerated(model.exaggeration));
    times.addEventListener("input", () => {
      model.exaggeration = TIMES[Number(times.value)];
      said.textContent = text.exaggerated(model.exaggeration);
      model.update();
      viewer.redraw();
    });
    return element("label", { className: "slider" }, times, said);
  }

  // Show or hide something; nothing that this map has none of.
  toggle(name) {
    const { viewer } = this;
    if (!byId(`show-${name}`)) return;
    if (name === "labels") {
      viewer.stage.labels = !viewer.stage.labels;
      byId("names").replaceChildren();
    } else viewer.model.toggle(name);
    viewer.hangPhotos();
    viewer.dates.refresh();
    this.tell();
    viewer.redraw();
  }

  tell() {
    const { model, stage } = this.viewer;
    for (const name of Object.keys(text.showing))
      if (byId(`show-${name}`)) byId(`show-${name}`).checked = name === "labels" ? stage.labels : model.shows(name);
  }

  buildNotes() {
    const { notes } = this;
    byId("note").placeholder = text.noteHint;
    byId("note").setAttribute("aria-label", text.noteHint);
    byId("add-note").textContent = text.addNote;
    byId("save-notes").textContent = text.saveNotes;
    byId("load-notes-label").textContent = text.loadNotes;
    byId("note-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.addNote(byId("note").value.trim());
    });
    byId("save-notes").addEventListener("click", () => {
      notes.save(this.viewer.site.title);
      this.tellNotes();
    });
    byId("load-notes").addEventListener("change", async (event) => {
      const [file] = event.target.files;
      await notes.load(file).then(
        () => this.tellNotes(),
        () => (byId("notes-state").textContent = text.badNotes),
      );
      event.target.value = "";
    });
    addEventListener("beforeunload", (event) => notes.unsaved && event.preventDefault());
  }

  addNote(said) {
    const { elements, address } = this.viewer.selection;
    if (!said || !elements.length) return;
    this.notes.add(address ?? elements[0].key, said);
    byId("note").value = "";
    this.tellNotes();
  }

  tellNotes() {
    const remove = (note) => {
      this.notes.remove(note);
      this.tellNotes();
    };
    showNotes(this.notes, (place) => this.viewer.selection.openAddress(place), remove);
  }
}
