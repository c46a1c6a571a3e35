// The three.js objects of a row in its own frame: those of either date, and the camera's path.
import { Group } from "three";
import { picture } from "../site/pictures.js";
import {
  coloursOf,
  dispose,
  ellipsoids,
  pathLine,
  photoPlane,
  segmentsOf,
  solids,
  textureOf,
  thickLines,
  thinLines,
} from "./shapes.js";

export class RowObjects {
  constructor(row) {
    this.row = row;
    this.group = new Group();
    this.group.matrixAutoUpdate = false;
    this.group.matrix.set(...row.siteFromRow);
    this.path = pathLine(row);
    this.group.add(this.path);
    this.dates = { new: new DateObjects(row, "new", row.face) };
    if (row.before) this.dates.old = new DateObjects(row, "old", row.before.face);
    for (const date of this.each) this.group.add(date.group);
  }

  get each() {
    return Object.values(this.dates);
  }

  colourPath(colour) {
    for (const part of this.path.children) part.material.color.set(colour);
  }

  // Of both dates, solids, orthophotos and ellipsoids are those of the new one: the old ones' would lie in them.
  showDates(which) {
    for (const [name, date] of Object.entries(this.dates)) {
      date.group.visible = which === "both" || which === name;
      date.inner.visible = which === name || name === "new";
    }
  }
}

// What is drawn of a row's elements of one date.
class DateObjects {
  constructor(row, date, face) {
    this.elements = row.elements.filter((one) => one.date === date);
    this.face = face;
    const { segments, coarse } = segmentsOf(this.elements);
    this.ends = new Float32Array(segments.flatMap(({ from, to }) => [...from, ...to]));
    this.owners = segments.map(({ one }) => one);
    this.coarse = coarse;
    this.under = date === "old";
    this.group = new Group();
    this.inner = new Group();
    this.group.add(this.inner);
    Object.assign(this, { lines: [], solids: null, photo: null, photoSize: -1, ellipsoids: null });
  }

  colour(of) {
    this.of = of;
    this.colours = coloursOf(this.owners, of);
    if (this.solids) this.drawSolids();
  }

  drawLines(thick) {
    for (const old of this.lines.splice(0)) dispose(old);
    if (!this.ends.length) return;
    this.lines.push(...(thick ? thickLines(this) : [thinLines(this)]));
    if (this.under) for (const line of this.lines) layUnder(line);
    this.group.add(...this.lines);
  }

  // Of thin lines only the longest of each element.
  setCoarse(coarse) {
    if (this.lines.length === 1) this.lines[0].geometry.setDrawRange(0, coarse ? 2 * this.coarse : Infinity);
  }

  // Over panoramas.
  drawOver(shown) {
    for (const line of this.lines.slice(1)) line.visible = shown;
  }

  drawSolids() {
    if (this.solids) dispose(this.solids);
    this.solids = solids(this.elements, this.of);
    this.inner.add(this.solids);
  }

  // What is heavy is made when it is first shown.
  update({ showSolids, showPhotos, exaggeration }) {
    if (showSolids && !this.solids) this.drawSolids();
    if (this.solids) this.solids.visible = showSolids;
    if (this.photo) this.photo.visible = showPhotos;
    if (this.ellipsoids) dispose(this.ellipsoids);
    this.ellipsoids = exaggeration ? ellipsoids(this.elements, exaggeration) : null;
    if (this.ellipsoids) this.inner.add(this.ellipsoids);
  }

  // The orthophoto in the size that is wanted; resolves when it hangs there.
  async hang(fine, shown) {
    const { face } = this;
    if (!face) return;
    const wanted = fine ? face.pictures.length - 1 : 0;
    if (this.photoSize >= wanted) return;
    this.photoSize = wanted;
    const image = await picture(face.pictures[wanted]);
    if (this.photoSize !== wanted) return;
    if (!this.photo) {
      this.photo = photoPlane(face);
      this.inner.add(this.photo);
    }
    this.photo.material.map?.dispose();
    this.photo.material.map = textureOf(image);
    this.photo.material.needsUpdate = true;
    this.photo.visible = shown();
  }
}

function layUnder(line) {
  line.renderOrder -= 0.5;
  line.material.depthWrite = false;
}
