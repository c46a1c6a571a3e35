// Measuring: two corners are picked, the distance is told beside its line and in the panel.
import { byId } from "./dom.js";
import { distanceText, showMeasure } from "./panels.js";
import { elementOfVertex, toSite, vertexOf } from "../site/data.js";
import { comparable, measured, withJoint } from "../site/measure.js";
import { text } from "../text.js";

export class Ruler {
  constructor(viewer) {
    Object.assign(this, { viewer, points: null, result: null }); // points: picked corners while measuring
  }

  get on() {
    return this.points !== null;
  }

  turn(on) {
    this.points = on ? [] : null;
    this.result = null;
    this.viewer.pointer.forget();
    byId("measure").setAttribute("aria-pressed", String(on));
    byId("stage").classList.toggle("measuring", on);
    this.viewer.model.drawRule([]);
    this.show();
    this.viewer.redraw();
  }

  add({ row, vertex }) {
    const one = elementOfVertex(row, vertex),
      label = one.vertexLabels[vertex - one.first];
    const own = label.startsWith(one.id) ? label : `${one.id} / ${label}`;
    if (this.points.length === 2) this.points = [];
    this.points.push({ row, vertex, label: this.viewer.site.rows.length > 1 ? `${row.name}: ${own}` : own });
    this.result = null;
    this.viewer.pointer.forget();
    this.viewer.model.drawRule(this.points.map((point) => toSite(point.row, vertexOf(point.row, point.vertex))));
    this.show();
    if (this.points.length === 2) this.measure(this.points);
    this.viewer.redraw();
  }

  async measure(points) {
    if (!comparable(...points)) return this.show(text.notComparable);
    if (points[0].row === points[1].row) await withJoint(points[0].row).catch(() => {});
    if (points !== this.points || points.length !== 2) return;
    this.result = measured(...points);
    byId("rule").textContent = distanceText(this.result);
    this.show();
    this.viewer.redraw();
  }

  show(remark = null) {
    const at = ({ row, vertex }) => this.viewer.frame.text(row, vertexOf(row, vertex));
    const points = this.points?.map((point) => ({ ...point, at: at(point) })) ?? null;
    showMeasure(points, this.result, remark);
  }

  // Show the distance beside its line; the boxes (left, top, right, bottom) that it takes of the view.
  place() {
    const shown = byId("rule");
    shown.hidden = !this.result;
    if (!this.result) return [];
    const [a, b] = this.points.map((one) => this.viewer.stage.pixelOf(one.row, one.vertex));
    // beside an upright line, over a level one
    const upright = Math.abs(a[1] - b[1]) > Math.abs(a[0] - b[0]);
    const aside = upright ? "translate(14px, -50%)" : "translate(-50%, -140%)";
    shown.style.transform = `${aside} translate(${(a[0] + b[0]) / 2}px, ${(a[1] + b[1]) / 2}px)`;
    const box = shown.getBoundingClientRect(),
      view = byId("view").getBoundingClientRect();
    return [[box.left - view.left, box.top - view.top, box.right - view.left, box.bottom - view.top]];
  }
}
