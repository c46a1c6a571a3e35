// Notes on elements, kept in a JSON file of the user's own: the page itself keeps nothing.

const FORMAT = "savmap-notes",
  MOST = 5000;

export class Notes {
  constructor() {
    this.list = [];
    this.unsaved = false;
  }

  add(place, said) {
    this.list.push({ place, note: said, date: new Date().toISOString().slice(0, 10) });
    this.unsaved = true;
  }

  remove(note) {
    this.list = this.list.filter((one) => one !== note);
    this.unsaved = true;
  }

  save(title) {
    const content = JSON.stringify({ format: FORMAT, version: 1, notes: this.list }, null, 1);
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([content], { type: "application/json" }));
    link.download = `notes-${title.replace(/[^\w-]+/g, "-")}.json`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    this.unsaved = false;
  }

  // Those of a file beside those that are there. Throws where it is no file of notes.
  async load(file) {
    const content = JSON.parse(await file.text());
    if (content?.format !== FORMAT || !Array.isArray(content.notes)) throw new Error(FORMAT);
    const texts = content.notes
      .slice(0, MOST)
      .filter((one) => [one?.place, one?.note, one?.date].every((value) => typeof value === "string"));
    const known = new Set(this.list.map((one) => JSON.stringify(one)));
    this.list.push(
      ...texts
        .map(({ place, note, date }) => ({ place, note, date }))
        .filter((one) => !known.has(JSON.stringify(one))),
    );
  }
}
