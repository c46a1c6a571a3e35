// The panorama beside the model: opened and closed, led along the camera's path and to what is selected.
import { byId } from "./dom.js";
import { pointsOf } from "../scene/views.js";
import { toSite, vertexOf } from "../site/data.js";
import { cameraOf } from "../site/dates.js";
import { text } from "../text.js";

export class Lookout {
  constructor(viewer) {
    this.viewer = viewer;
    for (const [id, by, label] of [
      ["before", -1, text.previous],
      ["after", 1, text.next],
    ]) {
      byId(id).title = label;
      byId(id).addEventListener("click", () => this.go(by));
    }
    byId("place").setAttribute("aria-label", text.panorama);
    byId("place").addEventListener("input", () => this.lookFrom(Number(byId("place").value)));
    byId("pano-close").title = text.close;
    byId("pano-close").addEventListener("click", () => this.toggle(false));
  }

  get open() {
    return !byId("pano").hidden;
  }

  toggle(open = !this.open) {
    const { viewer } = this,
      { elements } = viewer.selection;
    byId("pano").hidden = !open;
    byId("stage").classList.toggle("split", open);
    byId("panorama").setAttribute("aria-pressed", String(open));
    if (open) {
      viewer.stage.resize();
      if (elements.length) this.visit(elements);
      else this.lookFromMiddle(viewer.row);
    } else viewer.model.drawPlace(null);
    viewer.stage.resize();
    if (elements.length) viewer.view.fly(pointsOf(elements), 0.6);
    else viewer.setKind(viewer.view.kind);
  }

  go(by) {
    this.lookFrom(this.viewer.panorama.place + by);
  }

  lookFrom(place, row = this.viewer.panorama.row ?? this.viewer.row) {
    const { panorama } = this.viewer,
      first = panorama.row !== row;
    panorama.show(row, place);
    if (first && panorama.centre) {
      const ahead = toSite(row, [0, 0, -1]).map((value, k) => value - toSite(row, [0, 0, 0])[k]);
      panorama.face(panorama.centre.map((value, k) => value + ahead[k]));
    }
    this.tellPlace();
  }

  lookFromMiddle(row) {
    this.lookFrom(Math.floor(this.viewer.panorama.placesOf(row).length / 2), row);
  }

  // From the place that is nearest by some measure of it.
  lookFromNearest(row, apart) {
    const places = this.viewer.panorama.placesOf(row);
    this.lookFrom(
      places.reduce((least, one, k) => (apart(one) < apart(places[least]) ? k : least), 0),
      row,
    );
  }

  lookFromFrame(row, frame, elements) {
    if (cameraOf(row, this.viewer.site.showing) !== row) this.viewer.dates.show("new"); // frames are the new date's
    this.lookFromNearest(row, ({ index }) => Math.abs(row.path.number[index] - frame));
    if (elements.length) this.viewer.panorama.face(pointsOf(elements)[0]);
  }

  // Show the panorama from where the camera's path was clicked.
  goTo({ row, index }) {
    if (row !== this.viewer.row) this.viewer.setRow(row);
    if (!this.open) this.toggle(true);
    if (cameraOf(row, this.viewer.site.showing) === row)
      this.lookFromNearest(row, (one) => Math.abs(one.index - index));
    else this.lookFromPlace(row, toSite(row, vertexOf(row.path, index)));
  }

  // From where the pictures that are shown were taken nearest to a point of the site.
  lookFromPlace(row, point) {
    const { path } = cameraOf(row, this.viewer.site.showing);
    this.lookFromNearest(row, ({ index }) =>
      Math.hypot(...toSite(row, vertexOf(path, index)).map((value, k) => value - point[k])),
    );
  }

  // Another date is shown: its pictures, from about the same place and in the same direction.
  followDate() {
    const { row, of, centre } = this.viewer.panorama;
    if (!this.open || !row || of === cameraOf(row, this.viewer.site.showing)) return;
    if (centre) this.lookFromPlace(row, centre);
    else this.lookFromMiddle(row);
  }

  visit(elements) {
    const { row } = elements[0];
    if (row !== this.viewer.row) this.viewer.setRow(row);
    this.viewer.panorama.visit(row, pointsOf(elements));
    this.tellPlace();
  }

  // The row at hand is another one.
  follow(row) {
    if (this.open && this.viewer.panorama.row !== row) this.lookFromMiddle(row);
  }

  tellPlace() {
    const { places, place, row, centre } = this.viewer.panorama;
    this.viewer.model.drawPlace(centre);
    if (!centre) {
      Object.assign(byId("place"), { max: "0", value: "0" });
      byId("pano-what").textContent = "";
      return;
    }
    const { index, path } = places[place],
      { of } = this.viewer.panorama,
      { passes, pass, stamp } = of.path;
    Object.assign(byId("place"), { max: String(places.length - 1), value: String(place) });
    const whose = this.viewer.site.rows.length > 1 ? `${text.row(row.name)}, ` : "";
    const date = of === row ? "" : `${text.ofOldDate}, `;
    byId("pano-what").textContent =
      `${whose}${date}${text.still(passes[pass[index]], stamp[index])}${path ? "" : `. ${text.noStill}`}`;
    this.viewer.redraw();
  }
}
