// The viewer of a map: its parts put together, and what all of them share: the row at hand, the view, the colours.
import { buildBanner, toCheck } from "./page/banner.js";
import { buildBar, showKind } from "./page/bar.js";
import { Dates } from "./page/dates.js";
import { byId } from "./page/dom.js";
import { Finder } from "./page/finder.js";
import { Frame } from "./page/frame.js";
import { listenToKeys } from "./page/keys.js";
import { Lookout } from "./page/lookout.js";
import { showWarnings, showLegend } from "./page/panels.js";
import { Pointer } from "./page/pointer.js";
import { Ruler } from "./page/ruler.js";
import { Selection } from "./page/selection.js";
import { Sheet } from "./page/sheet.js";
import { Side } from "./page/side.js";
import { Theme } from "./page/theme.js";
import { Tree } from "./page/tree.js";
import { colouring, modesOf } from "./scene/colours.js";
import { PanoramaView } from "./scene/panorama.js";
import { Model } from "./scene/scene.js";
import { Stage } from "./scene/stage.js";
import { ModelView, boxInSite, planInSite } from "./scene/views.js";
import { readSite } from "./site/data.js";
import { cameraOf } from "./site/dates.js";
import { text } from "./text.js";

const MOST_PHOTO_ROWS = 6,
  WIDE_PX = 820; // of a page that has room for the panorama from the first

class Viewer {
  constructor(site) {
    this.site = site;
    this.row = toCheck(site) ?? site.rows[0];
    this.theme = new Theme(() => this.recolourAll());
    this.modes = modesOf(site);
    this.model = new Model(site);
    this.stage = new Stage(this);
    this.view = new ModelView(byId("view"), () => this.redraw());
    this.panorama = new PanoramaView(byId("pano-area"), this.model.scene, (row) => cameraOf(row, site.showing), () => this.redraw());
    this.frame = new Frame(this);
    this.ruler = new Ruler(this);
    this.finder = new Finder(this);
    this.selection = new Selection(this);
    this.lookout = new Lookout(this);
    this.side = new Side(this);
    this.dates = new Dates(this);
    this.tree = new Tree(this);
    this.sheet = new Sheet(this);
    this.pointer = new Pointer(this);
  }

  start() {
    buildBar(this);
    buildBanner(this);
    listenToKeys(this);
    this.stage.start();
    const warned = this.site.rows.some((row) => row.warnings.length);
    this.setMode(this.site.dates ? "change" : warned ? "verdict" : "label");
    this.setRow(this.row);
    this.setKind(this.row.face ?? this.row.before?.face ? "face" : "model");
    this.dates.show("both");
    if (innerWidth > WIDE_PX && cameraOf(this.row, this.site.showing).stills.length) this.lookout.toggle(true);
    this.selection.select([]);
    this.selection.followAddress();
    this.stage.draw();
    document.documentElement.dataset.ready = "yes";
  }

  redraw() {
    this.stage.redraw();
  }

  get rowsInView() {
    return this.view.kind === "face" ? [this.row] : this.site.rows;
  }

  setMode(mode) {
    this.mode = byId("mode").value = mode;
    this.recolour();
  }

  recolour() {
    const colours = colouring(this.site, this.mode, this.site.showing === "both" && !this.dates.parted);
    this.model.colour(colours.of);
    showLegend(colours);
    this.redraw();
  }

  // After a change of the theme.
  recolourAll() {
    if (!this.mode) return;
    this.model.recolour();
    this.recolour();
    this.selection.show();
    this.dates.refresh();
  }

  get modeName() {
    return text.modes[this.mode];
  }

  setRow(row) {
    this.row = row;
    byId("row").value = String(row.index);
    this.model.focus(row);
    showWarnings(row, this.site.rows, (warning) => this.selection.openWarning(warning));
    this.stage.resize();
    this.hangPhotos();
    this.lookout.follow(row);
    if (this.view.kind === "face" && this.view.row !== row) this.setKind("face");
    this.dates.refresh();
    this.redraw();
  }

  goToRow(row) {
    if (!row) return;
    this.setRow(row);
    this.dates.uncover(row.elements);
    if (this.view.kind !== "face") this.view.fly(boxInSite(row));
  }

  stepRow(by) {
    const { rows } = this.site;
    this.goToRow(rows[(this.row.index + by + rows.length) % rows.length]);
  }

  setKind(kind) {
    showKind(kind);
    this.pointer.forget();
    const whole =
      kind === "face" ? boxInSite(this.row) : this.site.rows.flatMap(kind === "plan" ? planInSite : boxInSite);
    this.model.update(kind);
    this.view.look(kind, whole, this.row, this.site.rows.length);
    this.side.tell();
    this.hangPhotos();
    this.dates.refresh();
  }

  hangPhotos() {
    if (!this.model.shows("photos")) return;
    const { rows } = this.site;
    for (const row of rows.length <= MOST_PHOTO_ROWS ? rows : [this.row]) {
      const fine = row === this.row && this.view.kind === "face";
      this.model.hang(row, fine, this.dates.pictured).then(
        () => this.redraw(),
        () => {},
      );
    }
  }
}

async function start() {
  const site = await readSite();
  if (!site.rows.length) throw new Error(text.empty);
  if (!document.createElement("canvas").getContext("webgl2")) throw new Error(text.noWebgl);
  const viewer = new Viewer(site);
  window.savmapViewer = viewer;
  viewer.start();
}

start().catch((error) => {
  byId("failure").hidden = false;
  const known = [text.noWebgl, text.empty].includes(error.message);
  byId("failure").textContent = known ? error.message : `${text.damaged} (${error.message})`;
  if (!known) throw error;
});
