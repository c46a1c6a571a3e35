// The canvas: the model and the panorama drawn on their parts of it, as often as needed and no oftener than the machine can.
import { Color, WebGLRenderer } from "three";
import { byId } from "../page/dom.js";
import { shades } from "./colours.js";
import { drawNames, namesOf } from "./labels.js";
import { projected } from "./picking.js";
import { drawScale } from "./scale.js";

const PLACES_PX = 46, // the bar under the panorama
  MOVING_MS = 300,
  SLOW_MS = 45,
  MOVING_RATIO = 0.5; // canvas pixels by pixels of the page while something moves on a slow machine

export class Stage {
  constructor(viewer) {
    this.viewer = viewer;
    this.renderer = new WebGLRenderer({ canvas: byId("canvas"), antialias: true });
    this.sharp = Math.min(devicePixelRatio, 2);
    this.renderer.setPixelRatio(this.sharp);
    this.renderer.setScissorTest(true);
    this.names = namesOf(viewer.site);
    this.labels = true;
    Object.assign(this, { drawn: 0, near: {}, pace: 0, slow: false });
  }

  // Begin: as large as the page lets it be, and after each change of that.
  start() {
    new ResizeObserver(() => this.resize()).observe(byId("stage"));
    this.resize();
  }

  // At once, with so many pixels of the canvas by pixels of the page, until it is drawn again.
  drawSharp(ratio) {
    this.renderer.setPixelRatio(ratio);
    this.drawAll();
  }

  redraw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.asked = false;
    if (!this.slow) this.setRatio(this.sharp);
    this.keepPace();
    this.drawAll();
  }

  drawAll() {
    const { view, panorama, model, row } = this.viewer;
    model.drawOver(panorama.row);
    this.drawModel(view.camera);
    this.viewer.frame.draw(view.camera);
    drawScale(byId("scale"), view.metrePx);
    const taken = [...this.viewer.ruler.place(), ...this.corners(view)];
    if (!byId("pano").hidden) this.drawOn(byId("pano-area"), panorama.camera, shades.night);
    // last, for what asks where things are on the page after names have moved has all of it laid out again
    if (this.labels)
      drawNames(
        byId("names"),
        this.namesAt(row, view.kind === "face"),
        this.viewer.site.showing,
        view.camera,
        view.width,
        view.height,
        row,
        taken,
      );
  }

  // What the compass and the scale take of the view.
  corners({ width, height }) {
    const scale = byId("scale").hidden ? [] : [[width - 160, height - 46, width, height]];
    return [[0, height - 104, 104, height], ...scale];
  }

  // Of all names those that a look at a row may show: its own, and, unless it is seen alone, the other rows'.
  namesAt(row, alone) {
    const { of } = this.near;
    if (of !== row) {
      const own = this.names.filter((name) => name.row === row);
      this.near = { of: row, own, all: this.names.filter((name) => name.row === row || name.rank === 0) };
    }
    return alone ? this.near.own : this.near.all;
  }

  // What a frame asks of the graphics with all that is shown drawn: draw calls, triangles, lines and points; and the milliseconds
  // that this script takes for it, the graphics having nothing else to do that it would wait for.
  load(frames = 20) {
    const { info } = this.renderer;
    this.viewer.model.setCoarse(false);
    info.autoReset = false; // a frame may be drawn in two or three parts
    info.reset();
    this.drawn = 0; // as at rest
    this.draw();
    const { calls, triangles, lines, points } = info.render;
    info.autoReset = true;
    const gl = this.renderer.getContext(),
      pixel = new Uint8Array(4);
    let own = 0;
    for (let k = 0; k < frames; k++) {
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // waits until all is drawn
      const since = performance.now();
      this.drawn = 0;
      this.draw();
      own += performance.now() - since;
    }
    return [calls, triangles, lines, points, own / frames];
  }

  // Where frames follow one another too slowly, draw less while something moves, and all of it as soon as it rests.
  keepPace() {
    const now = performance.now(),
      gap = now - this.drawn;
    this.drawn = now;
    const moving = gap < MOVING_MS;
    if (moving) this.pace = 0.7 * this.pace + 0.3 * gap;
    this.slow ||= this.pace > SLOW_MS;
    if (!this.slow) return;
    this.viewer.model.setCoarse(moving);
    this.setRatio(moving ? Math.min(MOVING_RATIO, this.sharp) : this.sharp);
    clearTimeout(this.rest);
    if (moving) this.rest = setTimeout(() => this.redraw(), MOVING_MS + 50);
  }

  // Each change makes the canvas anew, empty: only what draws at once may ask for it.
  setRatio(ratio) {
    if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
  }

  // Of two dates whose orthophotos lie beside one another, each is drawn on its hand of the divider.
  drawModel(camera) {
    const { dates, model, site } = this.viewer,
      area = byId("view");
    if (!dates.parted) return this.drawOn(area, camera, shades.ground);
    model.showDates("old");
    this.drawOn(area, camera, shades.ground, [0, dates.share]);
    model.showDates("new");
    this.drawOn(area, camera, shades.ground, [dates.share, 1]);
    model.showDates(site.showing);
  }

  // On an area of the page, from one share of its width to another.
  drawOn(area, camera, ground, [from, to] = [0, 1]) {
    const part = area.getBoundingClientRect(),
      stage = byId("stage").getBoundingClientRect();
    const [left, bottom] = [part.left - stage.left, stage.bottom - part.bottom];
    this.renderer.setViewport(left, bottom, part.width, part.height);
    this.renderer.setScissor(left + from * part.width, bottom, (to - from) * part.width, part.height);
    this.renderer.setClearColor(new Color(ground));
    const { panorama, model } = this.viewer;
    if (camera === panorama.camera && !panorama.centre) this.renderer.clear();
    else this.renderer.render(model.scene, camera);
  }

  resize() {
    const stage = byId("stage").getBoundingClientRect(),
      stacked = this.isStacked(stage),
      size = `${stage.width} ${stage.height} ${byId("pano").hidden} ${stacked}`;
    if (size === this.size || !stage.height) return;
    byId("stage").classList.toggle("stacked", stacked);
    this.size = size;
    this.renderer.setSize(stage.width, stage.height, false);
    for (const [part, area] of [
      [this.viewer.view, byId("view")],
      [this.viewer.panorama, byId("pano-area")],
    ])
      if (area.clientWidth && area.clientHeight) part.resize(area.clientWidth, area.clientHeight);
    if (this.viewer.mode) this.draw(); // at once, for a canvas of a new size is empty
  }

  // Whether a row is seen larger over the panorama than beside it.
  isStacked({ width, height }) {
    const { low, high } = this.viewer.row.box,
      [long, tall] = [high[0] - low[0], high[1] - low[1]];
    const beside = Math.min(width / 2 / long, height / tall),
      over = Math.min(width / long, (height - PLACES_PX) / 2 / tall);
    return over > beside;
  }

  pixelOf(row, vertex) {
    const { camera, width, height } = this.viewer.view;
    const pixels = projected(row, camera, width, height);
    return [pixels[3 * vertex], pixels[3 * vertex + 1]];
  }

  // Frames a second while the model turns around once, and milliseconds of each that this script takes.
  async spin(frames = 60) {
    let own = 0;
    const begin = performance.now(),
      { target } = this.viewer.view.controls,
      camera = this.viewer.view.camera;
    for (let k = 0; k < frames; k++) {
      camera.position
        .sub(target)
        .applyAxisAngle(camera.up, (2 * Math.PI) / frames)
        .add(target);
      camera.lookAt(target);
      await new Promise(requestAnimationFrame);
      const since = performance.now();
      this.draw();
      own += performance.now() - since;
    }
    return [(1000 * frames) / (performance.now() - begin), own / frames];
  }
}
