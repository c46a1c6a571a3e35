// Clicks and hovering on the model and on the panorama.
import { byId } from "./dom.js";
import { pick, pickPlace, pickVertex } from "../scene/picking.js";
import { elementOfVertex } from "../site/data.js";

const CLICK_PX = 5;

export class Pointer {
  constructor(viewer) {
    Object.assign(this, { viewer, over: null });
    const { view, panorama } = viewer;
    this.listen(byId("view"), ([x]) => {
      viewer.dates.aim(x);
      return [view.camera, view.width, view.height, viewer.rowsInView];
    });
    this.listen(byId("pano-area"), () => {
      const { camera, width, height, centre, row } = panorama;
      return [camera, width, height, centre ? [row] : []];
    });
  }

  // On a part of the stage; `seen` gives its camera, size and the rows under a pixel.
  listen(area, seen) {
    let down = null;
    const place = (event) => {
      const box = area.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    area.addEventListener(
      "pointerdown",
      (event) => {
        down = [event.clientX, event.clientY];
        this.forget();
        this.viewer.view.flight = null;
      },
      true,
    );
    area.addEventListener("pointerup", (event) => {
      if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > CLICK_PX) return;
      down = null;
      if (event.button === 0) this.click(seen(place(event)), place(event), event.pointerType === "touch");
    });
    area.addEventListener("pointermove", (event) => {
      if (event.buttons || event.pointerType === "touch") return;
      const waiting = this.over;
      this.over = { area, at: place(event), seen };
      if (!waiting) requestAnimationFrame(() => this.hover());
    });
    for (const kind of ["pointerleave", "wheel"])
      area.addEventListener(kind, () => this.forget(), { passive: true });
  }

  // What was under the pointer is there no more, or has been dealt with: it is told again when the pointer moves.
  forget() {
    this.over = null;
    byId("tip").hidden = true;
  }

  click([camera, width, height, rows], at, coarse) {
    const { ruler, model, view, selection, lookout } = this.viewer;
    if (ruler.on) {
      const vertex = pickVertex(rows, camera, width, height, ...at, coarse ? 30 : 18);
      if (vertex) ruler.add(vertex);
      return;
    }
    const found = pick(rows, camera, width, height, ...at, coarse ? 16 : 8);
    const onPath = model.shown.path && camera === view.camera && view.kind !== "face",
      place = onPath && pickPlace(rows, camera, width, height, ...at);
    // a path that runs through an element yields to the element's edge
    const onEdge = () => pick([found.row], camera, width, height, ...at, 3, false) !== null;
    if (place && !(found && onEdge())) return lookout.goTo(place);
    selection.select(found ? [found] : [], found?.key);
  }

  hover() {
    if (!this.over) return;
    const { area, at, seen } = this.over,
      [camera, width, height, rows] = seen(at),
      { ruler } = this.viewer;
    this.over = null;
    const tip = byId("tip"),
      vertex = ruler.on && pickVertex(rows, camera, width, height, ...at);
    const one = vertex ? elementOfVertex(vertex.row, vertex.vertex) : pick(rows, camera, width, height, ...at);
    tip.hidden = !one || (ruler.on && !vertex);
    area.classList.toggle("over", !tip.hidden);
    if (tip.hidden) return;
    tip.textContent = vertex
      ? one.vertexLabels[vertex.vertex - one.first]
      : [one.written[0], one.id].filter(Boolean).join(": ");
    const box = area.getBoundingClientRect(),
      stage = byId("stage").getBoundingClientRect();
    tip.style.transform = `translate(${box.left - stage.left + at[0] + 14}px, ${box.top - stage.top + at[1] + 14}px)`;
  }
}
