// The scene of a site: its rows' objects, the floor, what is marked and measured, and what of all this is shown.
import { GridHelper, Group, Scene } from "three";
import { linesOf, toSite } from "../site/data.js";
import { shades } from "./colours.js";
import { RowObjects } from "./row.js";
import { MODEL, cornersOf, dispose, dots, fatLines, frameOf } from "./shapes.js";

const MOST_THICK = 5000; // segments: beyond that only the row at hand has thick lines

export class Model {
  constructor(site) {
    this.site = site;
    this.scene = new Scene();
    const segments = site.elements.reduce((total, one) => total + one.edges.length / 2, 0);
    this.allThick = segments <= MOST_THICK;
    this.rows = site.rows.map((row) => new RowObjects(row));
    for (const objects of this.rows) this.scene.add(objects.group);
    this.marked = new Group();
    this.rule = new Group();
    this.place = new Group();
    Object.assign(this, { markedNow: [[], null], ruled: [], placed: null });
    this.scene.add(this.marked, this.rule, this.place);
    this.addFloor();
    this.shown = { solids: false, photos: false, facePhotos: true, path: true, ellipsoids: false };
    this.exaggeration = 10;
  }

  get bounds() {
    const low = [Infinity, Infinity, Infinity],
      high = [-Infinity, -Infinity, -Infinity];
    for (const row of this.site.rows)
      for (const corner of cornersOf(row.box)) {
        toSite(row, corner).forEach((value, k) => {
          low[k] = Math.min(low[k], value);
          high[k] = Math.max(high[k], value);
        });
      }
    return { low, high };
  }

  addFloor() {
    const { low, high } = this.bounds,
      size = 2 * Math.ceil(Math.max(high[0] - low[0], high[2] - low[2], 4) / 2 + 3);
    const floor = new GridHelper(size, size > 80 ? Math.round(size / 10) : size, ...shades.grid);
    floor.position.set(Math.round((low[0] + high[0]) / 2), 0, Math.round((low[2] + high[2]) / 2));
    floor.layers.set(MODEL);
    floor.material.depthWrite = false;
    floor.renderOrder = -2;
    this.floor = floor;
    this.scene.add(floor);
  }

  // All that has a colour of its own, after another theme.
  recolour() {
    const { visible } = this.floor;
    dispose(this.floor);
    this.addFloor();
    this.floor.visible = visible;
    for (const objects of this.rows) objects.colourPath(shades.path);
    this.mark(...this.markedNow);
    this.drawRule(this.ruled);
    this.drawPlace(this.placed);
    this.update();
  }

  colour(of) {
    this.colourOf = of;
    for (const objects of this.rows) {
      for (const date of objects.each) date.colour(of);
      this.drawLines(objects);
    }
  }

  focus(row) {
    const before = this.focused;
    this.focused = row;
    for (const one of [before, row]) if (one && this.colourOf) this.drawLines(this.rows[one.index]);
    this.update();
  }

  drawLines(objects) {
    for (const date of objects.each) date.drawLines(this.allThick || objects.row === this.focused);
  }

  showDates(which) {
    for (const objects of this.rows) objects.showDates(which);
    // what is marked on both dates is shown where its date is
    const twice = this.marked.children.length > 1;
    for (const line of this.marked.children) line.visible = !twice || which === "both" || which === line.name;
  }

  // Draw only the longest lines: for machines that draw slowly, while something moves.
  setCoarse(coarse) {
    for (const { row, path, each } of this.rows) {
      for (const date of each) date.setCoarse(coarse);
      if (!this.allThick) path.visible = this.pathShown && (!coarse || row === this.focused);
    }
  }

  // Over panoramas only the row is drawn that they are of.
  drawOver(row) {
    for (const objects of this.rows) for (const date of objects.each) date.drawOver(objects.row === row);
  }

  // Orthophotos are shown in the face view until somebody hides them there, and in the others where somebody asks for them.
  nameOf(part) {
    return part === "photos" && this.kind === "face" ? "facePhotos" : part;
  }

  shows(part) {
    return this.shown[this.nameOf(part)];
  }

  toggle(part) {
    this.shown[this.nameOf(part)] = !this.shows(part);
    this.update();
  }

  get pathShown() {
    return this.shown.path && this.kind !== "face";
  }

  // What is heavy is made, of large sites, for the row at hand alone.
  update(kind = this.kind) {
    this.kind = kind;
    this.floor.visible = kind !== "face";
    for (const objects of this.rows) {
      const here = this.allThick || objects.row === this.focused;
      objects.group.visible = kind !== "face" || objects.row === this.focused;
      objects.path.visible = this.pathShown;
      const parts = {
        showSolids: this.shown.solids,
        showPhotos: this.shows("photos"),
        exaggeration: this.shown.ellipsoids && here ? this.exaggeration : 0,
      };
      for (const date of objects.each) date.update(parts);
    }
  }

  // The orthophotos of a row in the size that is wanted, of some dates; resolves when they hang there.
  hang(row, fine, dates) {
    const objects = dates.map((date) => this.rows[row.index].dates[date]).filter(Boolean);
    return Promise.all(objects.map((one) => one.hang(fine, () => this.shows("photos"))));
  }

  // Mark elements, and the frame of the place between them that is meant.
  mark(elements, place = null) {
    this.markedNow = [elements, place];
    this.marked.children.slice().forEach(dispose);
    for (const date of ["new", "old"]) {
      const ofDate = elements.filter((one) => one.date === date);
      const positions = ofDate.flatMap((one) => linesOf(one).flatMap((end) => toSite(one.row, end)));
      if (date === "new" && place) positions.push(...frameOf(place.box).flatMap((end) => toSite(elements[0].row, end)));
      if (positions.length) this.marked.add(Object.assign(fatLines(positions, shades.selected, 4), { name: date }));
    }
  }

  drawRule(points) {
    const [ink, edge] = shades.rule;
    this.ruled = points;
    this.rule.children.slice().forEach(dispose);
    if (points.length === 2) this.rule.add(fatLines(points.flat(), edge, 6), fatLines(points.flat(), ink, 2.5));
    if (points.length) this.rule.add(dots(points, edge, 13), dots(points, ink, 9));
  }

  // Where the panorama that is shown was taken; null for nowhere.
  drawPlace(place) {
    this.placed = place;
    this.place.children.slice().forEach(dispose);
    if (place) this.place.add(dots([place], shades.selected, 11));
    for (const dot of this.place.children) dot.layers.set(MODEL);
  }
}
