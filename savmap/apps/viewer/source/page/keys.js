// What keys do, beside what the browser does with them.
import { byId } from "./dom.js";
import { showHelp } from "./panels.js";

const OWN = "input:not([type=checkbox]):not([type=range]), select, textarea, dialog";

export function listenToKeys(viewer) {
  const acts = actsOf(viewer);
  addEventListener("keydown", (event) => {
    if (event.target.closest?.(OWN) || event.ctrlKey || event.metaKey || event.altKey) {
      if (event.key === "Escape") event.target.blur?.();
    } else if (Object.hasOwn(acts, event.key)) {
      event.preventDefault();
      acts[event.key]();
    }
  });
}

function actsOf(viewer) {
  const { selection, lookout, ruler, side, dates } = viewer;
  return {
    1: () => viewer.setKind("model"),
    2: () => viewer.setKind("plan"),
    3: () => viewer.setKind("face"),
    4: () => lookout.toggle(),
    p: () => lookout.toggle(),
    ",": () => lookout.go(-1),
    ".": () => lookout.go(1),
    "/": () => byId("search").focus(),
    m: () => ruler.turn(!ruler.on),
    f: () => viewer.setKind(viewer.view.kind),
    "[": () => viewer.stepRow(-1),
    "]": () => viewer.stepRow(1),
    ArrowLeft: () => selection.step(-1),
    ArrowRight: () => selection.step(1),
    s: () => side.toggle("solids"),
    o: () => side.toggle("photos"),
    c: () => side.toggle("path"),
    n: () => side.toggle("labels"),
    u: () => side.toggle("ellipsoids"),
    d: () => dates.next(),
    l: () => viewer.theme.turn(),
    k: () => viewer.setMode(viewer.modes[(viewer.modes.indexOf(viewer.mode) + 1) % viewer.modes.length]),
    Escape: () => (ruler.on ? ruler.turn(false) : selection.select([])),
    "?": showHelp,
  };
}
