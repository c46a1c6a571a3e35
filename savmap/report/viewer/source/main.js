// The viewer of a map: the page's parts put together.
import { WebGLRenderer, Color } from "three";
import { colouring, modesOf } from "./colours.js";
import { elementOfVertex, readSite, toSite, vertexOf } from "./data.js";
import { byId, element, fill } from "./dom.js";
import { drawNames, namesOf } from "./labels.js";
import { comparable, measured, withJoint } from "./measure.js";
import { Notes } from "./notes.js";
import { PanoramaView } from "./panorama.js";
import {
  distanceText,
  link,
  showDoubts,
  showHelp,
  showLegend,
  showMeasure,
  showNotes,
  showSelection,
} from "./panels.js";
import { Model } from "./scene.js";
import { named, search, searchIndex } from "./search.js";
import { text } from "./text.js";
import { ModelView, frontInSite, planInSite, pick, pickPlace, pickVertex, pointsOf, projected } from "./views.js";

const GROUND = new Color("#fbfcfd"),
  NIGHT = new Color("#eef1f4"),
  CLICK_PX = 5,
  MOST_PHOTO_ROWS = 6,
  MOVING_MS = 300,
  SLOW_MS = 45;

class Viewer {
  constructor(site) {
    this.site = site;
    this.renderer = new WebGLRenderer({ canvas: byId("canvas"), antialias: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setScissorTest(true);
    this.model = new Model(site);
    this.view = new ModelView(byId("view"), () => this.redraw());
    this.panorama = new PanoramaView(byId("pano-area"), this.model.scene, () => this.redraw());
    this.names = namesOf(site);
    this.index = searchIndex(site);
    this.notes = new Notes();
    this.selected = [];
    this.points = null; // picked corners while measuring
    this.labels = true;
    Object.assign(this, { drawn: 0, pace: 0, slow: false });
    this.row = site.rows[0];
    this.modes = modesOf(site);
  }

  start() {
    this.buildBar();
    this.buildSide();
    this.listen();
    new ResizeObserver(() => this.resize()).observe(byId("stage"));
    this.resize();
    this.setMode(this.site.rows.some((row) => row.doubts.length) ? "verdict" : "label");
    this.setRow(this.row);
    this.setKind("model");
    this.select([]);
    this.followAddress();
    this.draw();
    document.documentElement.dataset.ready = "yes";
  }

  // ---- drawing -------------------------------------------------------------------------------------------------------------------

  // Frames a second while the model turns around once, and milliseconds of each that this script takes.
  async spin(frames = 60) {
    let own = 0;
    const begin = performance.now(),
      { target } = this.view.controls,
      camera = this.view.camera;
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

  redraw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.asked = false;
    this.keepPace();
    const panorama = !byId("pano").hidden;
    for (const { row, lines } of this.model.rows)
      for (const line of lines.slice(1)) line.visible = row === this.panorama.row;
    this.drawOn(byId("view"), this.view.camera, GROUND);
    const taken = this.placeDistance();
    if (this.labels)
      drawNames(
        byId("names"),
        this.view.kind === "face" ? this.names.filter((name) => name.row === this.row) : this.names,
        this.view.camera,
        this.view.width,
        this.view.height,
        this.row,
        taken,
      );
    if (panorama) this.drawOn(byId("pano-area"), this.panorama.camera, NIGHT);
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
    this.model.setCoarse(moving);
    clearTimeout(this.rest);
    if (moving) this.rest = setTimeout(() => this.redraw(), MOVING_MS + 50);
  }

  drawOn(area, camera, ground) {
    const part = area.getBoundingClientRect(),
      stage = byId("stage").getBoundingClientRect();
    const frame = [part.left - stage.left, stage.bottom - part.bottom, part.width, part.height];
    this.renderer.setViewport(...frame);
    this.renderer.setScissor(...frame);
    this.renderer.setClearColor(ground);
    if (camera === this.panorama.camera && !this.panorama.centre) this.renderer.clear();
    else this.renderer.render(this.model.scene, camera);
  }

  resize() {
    const stage = byId("stage").getBoundingClientRect(),
      size = `${stage.width} ${stage.height} ${byId("pano").hidden}`;
    if (size === this.size) return;
    this.size = size;
    this.renderer.setSize(stage.width, stage.height, false);
    for (const [part, area] of [
      [this.view, byId("view")],
      [this.panorama, byId("pano-area")],
    ])
      if (area.clientWidth && area.clientHeight) part.resize(area.clientWidth, area.clientHeight);
    if (this.mode) this.draw(); // at once, for a canvas of a new size is empty
  }

  // Show the distance beside its line; the boxes (left, top, right, bottom) that it takes of the view.
  placeDistance() {
    const shown = byId("rule");
    shown.hidden = !this.result;
    if (!this.result) return [];
    const [a, b] = this.points.map((one) => this.pixelOf(one.row, one.vertex));
    // beside an upright line, over a level one
    const upright = Math.abs(a[1] - b[1]) > Math.abs(a[0] - b[0]);
    const aside = upright ? "translate(14px, -50%)" : "translate(-50%, -140%)";
    shown.style.transform = `${aside} translate(${(a[0] + b[0]) / 2}px, ${(a[1] + b[1]) / 2}px)`;
    const box = shown.getBoundingClientRect(),
      view = byId("view").getBoundingClientRect();
    return [[box.left - view.left, box.top - view.top, box.right - view.left, box.bottom - view.top]];
  }

  get rowsInView() {
    return this.view.kind === "face" ? [this.row] : this.site.rows;
  }

  pixelOf(row, vertex) {
    const pixels = projected(row, this.view.camera, this.view.width, this.view.height);
    return [pixels[3 * vertex], pixels[3 * vertex + 1]];
  }

  // ---- what is shown -------------------------------------------------------------------------------------------------------------

  setMode(mode) {
    this.mode = mode;
    const colours = colouring(this.site, mode);
    this.model.colour(colours.of);
    byId("mode").value = mode;
    showLegend(colours);
    this.redraw();
  }

  setRow(row) {
    this.row = row;
    byId("row").value = String(row.index);
    this.model.focus(row);
    showDoubts(row, (doubt) => this.openDoubt(doubt));
    this.hangPhotos();
    if (!byId("pano").hidden && this.panorama.row !== row)
      this.lookFrom(Math.floor(this.panorama.placesOf(row).length / 2), row);
    if (this.view.kind === "face" && this.view.row !== row) this.setKind("face");
    this.redraw();
  }

  setKind(kind) {
    for (const button of document.querySelectorAll("[data-kind]"))
      button.setAttribute("aria-pressed", String(button.dataset.kind === kind));
    this.model.floor.visible = kind !== "face";
    const whole =
      kind === "face" ? frontInSite(this.row) : this.site.rows.flatMap(kind === "plan" ? planInSite : frontInSite);
    this.view.look(kind, whole, this.row, this.site.rows.length);
    this.model.update(kind);
    this.hangPhotos();
  }

  hangPhotos() {
    if (!this.model.shown.photos) return;
    const all = this.site.rows.length <= MOST_PHOTO_ROWS ? this.site.rows : [this.row];
    for (const row of all) {
      const fine = row === this.row && this.view.kind === "face";
      this.model.hang(row, fine).then(
        () => this.redraw(),
        () => {},
      );
    }
  }

  toggle(name) {
    if (name === "labels") {
      this.labels = !this.labels;
      byId("names").replaceChildren();
    } else this.model.shown[name] = !this.model.shown[name];
    byId(`show-${name}`).checked = name === "labels" ? this.labels : this.model.shown[name];
    this.model.update();
    this.hangPhotos();
    this.redraw();
  }

  togglePanorama(open = byId("pano").hidden) {
    byId("pano").hidden = !open;
    byId("stage").classList.toggle("split", open);
    byId("panorama").setAttribute("aria-pressed", String(open));
    if (open) {
      this.resize();
      if (this.selected.length) this.visit(this.selected);
      else this.lookFrom(Math.floor(this.panorama.placesOf(this.row).length / 2), this.row);
    } else this.model.drawPlace(null);
    this.resize();
    if (this.selected.length) this.view.fly(pointsOf(this.selected), 0.6);
    else this.setKind(this.view.kind);
  }

  lookFrom(place, row = this.panorama.row ?? this.row) {
    const first = this.panorama.row !== row;
    this.panorama.show(row, place);
    if (first && this.panorama.centre) {
      const ahead = toSite(row, [0, 0, -1]).map((value, k) => value - toSite(row, [0, 0, 0])[k]);
      this.panorama.face(this.panorama.centre.map((value, k) => value + ahead[k]));
    }
    this.tellPlace();
  }

  visit(elements) {
    if (elements[0].row !== this.row) this.setRow(elements[0].row);
    this.panorama.visit(elements[0].row, pointsOf(elements));
    this.tellPlace();
  }

  tellPlace() {
    const { places, place, row, centre } = this.panorama;
    this.model.drawPlace(centre);
    if (!centre) {
      Object.assign(byId("place"), { max: "0", value: "0" });
      byId("pano-what").textContent = "";
      return;
    }
    const { index, path } = places[place],
      { passes, pass, stamp } = row.path;
    Object.assign(byId("place"), { max: String(places.length - 1), value: String(place) });
    byId("pano-what").textContent =
      `${this.site.rows.length > 1 ? `${text.row(row.name)}, ` : ""}${text.still(passes[pass[index]], stamp[index])}${path ? "" : `. ${text.noStill}`}`;
    this.redraw();
  }

  // ---- selection, search, addresses ----------------------------------------------------------------------------------------------

  select(elements, address = null, name = "") {
    this.selected = elements;
    this.model.mark(elements);
    showSelection(elements, name, (found, key) => this.open(found, key));
    byId("note").disabled = byId("add-note").disabled = !elements.length;
    this.address = address;
    if (elements.length) {
      if (elements[0].row !== this.row) this.setRow(elements[0].row);
      if (!byId("pano").hidden) this.visit(elements);
      const hash = `#${encodeURI(address ?? elements[0].key)}`;
      if (location.hash !== hash) location.replace(hash);
      this.written = location.hash; // its event comes later, when something else may be selected
    }
    this.redraw();
  }

  // Select and fly there.
  open(elements, address, name) {
    this.select(elements, address, name);
    if (elements.length) this.view.fly(pointsOf(elements), elements.length > 1 ? 0.8 : 0.45);
  }

  openAddress(address) {
    const found = named(this.index, address);
    if (found) this.open(found.elements, address, found.shown);
    return Boolean(found);
  }

  followAddress() {
    if (location.hash === this.written) return;
    this.written = location.hash;
    let address = location.hash.slice(1);
    try {
      address = decodeURIComponent(address);
    } catch {
      return;
    }
    if (address) this.openAddress(address);
  }

  openDoubt(doubt) {
    const named = new Set(doubt.structures),
      elements = this.row.elements.filter((one) => named.has(one.id));
    if (elements.length) this.open(elements, elements[0].key, doubt.kind);
    else if (doubt.place) {
      const [x, y, z] = doubt.place;
      this.view.fly(
        [-0.8, 0.8].map((by) => toSite(this.row, [x + by, y + by, z])),
        0.8,
      );
    } else this.view.fly(frontInSite(this.row));
    if (doubt.frame !== null && !byId("pano").hidden) {
      const places = this.panorama.placesOf(this.row),
        apart = ({ index }) => Math.abs(this.row.path.number[index] - doubt.frame);
      const best = places.reduce((least, place, k) => (apart(place) < apart(places[least]) ? k : least), 0);
      this.lookFrom(best, this.row);
      if (elements.length) this.panorama.face(pointsOf(elements)[0]);
    }
  }

  showResults() {
    const query = byId("search").value,
      found = search(this.index, query);
    const lines = found.map((one) =>
      element(
        "li",
        {},
        link("", () => this.choose(one)),
      ),
    );
    lines.forEach((line, k) => {
      const one = found[k],
        kind = text.kinds[one.kind] ?? one.kind;
      line.firstChild.append(
        element("b", {}, one.shown),
        element(
          "span",
          {},
          `${kind}, ${text.row(one.row.name)}${one.elements.length > 1 ? `, ${text.elements(one.elements.length)}` : ""}`,
        ),
      );
    });
    const none = query.trim() && !found.length ? element("li", { className: "hint" }, text.noResult) : null;
    fill(byId("results"), ...lines, none);
    byId("results").hidden = !query.trim();
    return found;
  }

  choose(entry) {
    byId("search").blur();
    byId("tip").hidden = true;
    byId("results").hidden = true;
    this.open(entry.elements, entry.key, entry.shown);
  }

  step(by) {
    const all = this.row.elements,
      at = this.selected.length ? all.indexOf(this.selected[0]) : by > 0 ? -1 : 0;
    const next = all[(at + by + all.length) % all.length];
    if (next) this.open([next], next.key);
  }

  // ---- measuring -----------------------------------------------------------------------------------------------------------------

  setMeasuring(on) {
    byId("tip").hidden = true;
    this.points = on ? [] : null;
    this.result = null;
    byId("measure").setAttribute("aria-pressed", String(on));
    byId("stage").classList.toggle("measuring", on);
    this.model.drawRule([]);
    showMeasure(this.points, null);
    this.redraw();
  }

  addPoint({ row, vertex }) {
    const one = elementOfVertex(row, vertex),
      label = one.vertexLabels[vertex - one.first];
    const own = label.startsWith(one.id) ? label : `${one.id} / ${label}`;
    if (this.points.length === 2) this.points = [];
    this.points.push({ row, vertex, label: this.site.rows.length > 1 ? `${row.name}: ${own}` : own });
    this.result = null;
    this.model.drawRule(this.points.map((point) => toSite(point.row, vertexOf(point.row, point.vertex))));
    showMeasure(this.points, null);
    if (this.points.length === 2) this.measure(this.points);
    this.redraw();
  }

  async measure(points) {
    if (!comparable(...points)) return showMeasure(points, null, text.notComparable);
    if (points[0].row === points[1].row) await withJoint(points[0].row).catch(() => {});
    if (points !== this.points || points.length !== 2) return;
    this.result = measured(...points);
    byId("rule").textContent = distanceText(this.result);
    showMeasure(points, this.result);
    this.redraw();
  }

  // ---- the page's parts ----------------------------------------------------------------------------------------------------------

  buildBar() {
    document.title = byId("title").textContent = this.site.title;
    byId("search").placeholder = text.search;
    byId("search").setAttribute("aria-label", text.search);
    const kinds = Object.entries(text.views).map(([kind, label]) =>
      element("button", { type: "button", "data-kind": kind, onclick: () => this.setKind(kind) }, label),
    );
    fill(byId("kinds"), ...kinds);
    const buttons = {
      panorama: () => this.togglePanorama(),
      measure: () => this.setMeasuring(this.points === null),
      fit: () => this.setKind(this.view.kind),
      print: () => print(),
    };
    for (const [id, act] of Object.entries(buttons)) {
      byId(id).textContent = text[id];
      byId(id).addEventListener("click", act);
    }
    byId("help-button").textContent = "?";
    byId("help-button").setAttribute("aria-label", text.help);
    byId("help-button").addEventListener("click", showHelp);
    const picker = byId("row");
    fill(
      picker,
      ...this.site.rows.map((row) =>
        element("option", { value: String(row.index) }, `${text.row(row.name)}${row.doubts.length ? " !" : ""}`),
      ),
    );
    picker.hidden = this.site.rows.length < 2;
    picker.setAttribute("aria-label", text.rows);
    picker.addEventListener("change", () => this.goToRow(this.site.rows[Number(picker.value)]));
  }

  goToRow(row) {
    if (!row) return;
    this.setRow(row);
    if (this.view.kind !== "face") this.view.fly(frontInSite(row));
  }

  buildSide() {
    for (const [id, title] of [
      ["h-colour", text.colour],
      ["h-show", text.show],
      ["h-selection", text.selection],
      ["h-doubts", text.doubts],
      ["h-notes", text.notes],
    ])
      byId(id).textContent = title;
    fill(byId("mode"), ...this.modes.map((mode) => element("option", { value: mode }, text.modes[mode])));
    byId("mode").setAttribute("aria-label", text.colour);
    byId("mode").addEventListener("change", () => this.setMode(byId("mode").value));
    const on = { labels: true, path: true };
    const has = {
      photos: this.site.rows.some((row) => row.face),
      solids: this.site.elements.some((one) => one.solid),
    };
    const boxes = Object.entries(text.showing)
      .filter(([name]) => has[name] ?? true)
      .map(([name, label]) => {
        const box = element("input", {
          type: "checkbox",
          id: `show-${name}`,
          checked: on[name] ?? false,
          onchange: () => this.toggle(name),
        });
        return element("label", {}, box, label);
      });
    fill(byId("showing"), ...boxes);
    const times = element("input", { type: "range", min: "0", max: "7", value: "3", id: "times" });
    const said = element("output", {}, text.exaggerated(this.model.exaggeration));
    times.addEventListener("input", () => {
      this.model.exaggeration = [1, 2, 5, 10, 20, 50, 100, 200][Number(times.value)];
      said.textContent = text.exaggerated(this.model.exaggeration);
      this.model.update();
      this.redraw();
    });
    byId("showing").append(element("label", { className: "slider" }, times, said));
    const unplaced = this.site.rows.filter((row) => !row.known).map((row) => row.name);
    if (this.site.rows.length > 1 && unplaced.length) byId("remark").textContent = text.unplaced(unplaced);
    this.buildNotes();
    this.buildPanoramaBar();
  }

  buildNotes() {
    const show = () =>
      showNotes(
        this.notes,
        (place) => this.openAddress(place),
        (note) => {
          this.notes.remove(note);
          show();
        },
      );
    byId("note").placeholder = text.noteHint;
    byId("note").setAttribute("aria-label", text.noteHint);
    byId("add-note").textContent = text.addNote;
    byId("save-notes").textContent = text.saveNotes;
    byId("load-notes-label").textContent = text.loadNotes;
    byId("note-form").addEventListener("submit", (event) => {
      event.preventDefault();
      const said = byId("note").value.trim();
      if (!said || !this.selected.length) return;
      this.notes.add(this.address ?? this.selected[0].key, said);
      byId("note").value = "";
      show();
    });
    byId("save-notes").addEventListener("click", () => {
      this.notes.save(this.site.title);
      show();
    });
    byId("load-notes").addEventListener("change", async (event) => {
      const [file] = event.target.files;
      await this.notes.load(file).then(show, () => (byId("notes-state").textContent = text.badNotes));
      event.target.value = "";
    });
    addEventListener("beforeunload", (event) => this.notes.unsaved && event.preventDefault());
  }

  buildPanoramaBar() {
    for (const [id, by, label] of [
      ["before", -1, text.previous],
      ["after", 1, text.next],
    ]) {
      Object.assign(byId(id), { title: label });
      byId(id).addEventListener("click", () => this.lookFrom(this.panorama.place + by));
    }
    byId("place").setAttribute("aria-label", text.panorama);
    byId("place").addEventListener("input", () => this.lookFrom(Number(byId("place").value)));
    byId("pano-close").title = text.close;
    byId("pano-close").addEventListener("click", () => this.togglePanorama(false));
  }

  listen() {
    addEventListener("hashchange", () => this.followAddress());
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("beforeprint", () => {
      this.draw();
      byId("printed").src = byId("canvas").toDataURL("image/png");
    });
    byId("search").addEventListener("input", () => this.showResults());
    byId("search").addEventListener("focus", () => this.showResults());
    byId("search").addEventListener("keydown", (event) => {
      if (event.key === "Enter")
        this.showResults()
          .slice(0, 1)
          .forEach((one) => this.choose(one));
      if (event.key === "ArrowDown") byId("results").querySelector("button")?.focus();
    });
    addEventListener("pointerdown", (event) => {
      if (!event.target.closest?.("#finder")) byId("results").hidden = true;
    });
    this.listenOn(byId("view"), () => [this.view.camera, this.view.width, this.view.height, this.rowsInView]);
    this.listenOn(byId("pano-area"), () => [
      this.panorama.camera,
      this.panorama.width,
      this.panorama.height,
      this.panorama.centre ? [this.panorama.row] : [],
    ]);
  }

  // Clicks and hovering on a part of the stage; `seen` gives its camera, size and the rows in it.
  listenOn(area, seen) {
    let down = null,
      over = null;
    const place = (event) => {
      const box = area.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    area.addEventListener(
      "pointerdown",
      (event) => {
        down = [event.clientX, event.clientY];
        this.view.flight = null;
      },
      true,
    );
    area.addEventListener("pointerup", (event) => {
      if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > CLICK_PX) return;
      down = null;
      if (event.button === 0) this.click(seen(), place(event), event.pointerType === "touch");
    });
    area.addEventListener("pointermove", (event) => {
      if (event.buttons || event.pointerType === "touch") return;
      if (!over)
        requestAnimationFrame(() => {
          this.hover(area, seen(), over);
          over = null;
        });
      over = place(event);
    });
    area.addEventListener("pointerleave", () => (byId("tip").hidden = true));
  }

  click([camera, width, height, rows], at, coarse) {
    if (this.points) {
      const vertex = pickVertex(rows, camera, width, height, ...at, coarse ? 30 : 18);
      if (vertex) this.addPoint(vertex);
      return;
    }
    const found = pick(rows, camera, width, height, ...at, coarse ? 16 : 8);
    const place =
      this.model.shown.path &&
      camera === this.view.camera &&
      this.view.kind !== "face" &&
      pickPlace(rows, camera, width, height, ...at);
    if (place && !(found && this.near(found, camera, width, height, at))) return this.goToPlace(place);
    this.select(found ? [found] : [], found?.key);
  }

  // Whether the pointer is on an element's edge, not within it.
  near(found, camera, width, height, at) {
    return pick([found.row], camera, width, height, ...at, 3, false) !== null;
  }

  // Show the panorama from where the camera's path was clicked.
  goToPlace({ row, index }) {
    if (row !== this.row) this.setRow(row);
    if (byId("pano").hidden) this.togglePanorama(true);
    const places = this.panorama.placesOf(row),
      apart = (one) => Math.abs(one.index - index);
    this.lookFrom(
      places.reduce((least, one, k) => (apart(one) < apart(places[least]) ? k : least), 0),
      row,
    );
  }

  hover(area, [camera, width, height, rows], at) {
    const tip = byId("tip"),
      vertex = this.points && pickVertex(rows, camera, width, height, ...at);
    const one = vertex ? elementOfVertex(vertex.row, vertex.vertex) : pick(rows, camera, width, height, ...at);
    tip.hidden = !one || (this.points !== null && !vertex);
    area.classList.toggle("over", !tip.hidden);
    if (tip.hidden) return;
    tip.textContent = vertex
      ? one.vertexLabels[vertex.vertex - one.first]
      : [one.written[0], one.id].filter(Boolean).join(": ");
    const box = area.getBoundingClientRect(),
      stage = byId("stage").getBoundingClientRect();
    tip.style.transform = `translate(${box.left - stage.left + at[0] + 14}px, ${box.top - stage.top + at[1] + 14}px)`;
  }

  key(event) {
    if (
      event.target.closest?.("input:not([type=checkbox]):not([type=range]), select, textarea, dialog") ||
      event.ctrlKey ||
      event.metaKey ||
      event.altKey
    ) {
      if (event.key === "Escape") event.target.blur?.();
      return;
    }
    const rows = this.site.rows,
      next = (by) => this.goToRow(rows[(this.row.index + by + rows.length) % rows.length]);
    const acts = {
      1: () => this.setKind("model"),
      2: () => this.setKind("plan"),
      3: () => this.setKind("face"),
      4: () => this.togglePanorama(),
      p: () => this.togglePanorama(),
      ",": () => this.lookFrom(this.panorama.place - 1),
      ".": () => this.lookFrom(this.panorama.place + 1),
      "/": () => byId("search").focus(),
      m: () => this.setMeasuring(this.points === null),
      f: () => this.setKind(this.view.kind),
      "[": () => next(-1),
      "]": () => next(1),
      ArrowLeft: () => this.step(-1),
      ArrowRight: () => this.step(1),
      s: () => byId("show-solids") && this.toggle("solids"),
      o: () => byId("show-photos") && this.toggle("photos"),
      c: () => this.toggle("path"),
      n: () => this.toggle("labels"),
      u: () => this.toggle("ellipsoids"),
      k: () => this.setMode(this.modes[(this.modes.indexOf(this.mode) + 1) % this.modes.length]),
      Escape: () => (this.points ? this.setMeasuring(false) : this.select([])),
      "?": showHelp,
    };
    if (!Object.hasOwn(acts, event.key)) return;
    event.preventDefault();
    acts[event.key]();
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
