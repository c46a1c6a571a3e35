// The frame in which places are told in the panels, and its axes over the view.
import { byId, element, fill } from "./dom.js";
import { placeText } from "./figures.js";
import { drawCompass } from "../scene/compass.js";
import { axesIn, frameOf, framesOf, sigmaIn } from "../site/frames.js";
import { millimetres } from "../site/measure.js";
import { text } from "../text.js";

export class Frame {
  constructor(viewer) {
    this.viewer = viewer;
    const frames = framesOf(viewer.site),
      picker = byId("frame");
    this.asked = frames.includes("world") ? "world" : "row";
    fill(picker, ...frames.map((frame) => element("option", { value: frame }, text.frames[frame])));
    picker.setAttribute("aria-label", text.frame);
    picker.hidden = frames.length < 2;
    picker.value = this.asked;
    picker.addEventListener("change", () => this.tellIn(picker.value));
  }

  tellIn(frame) {
    const { selection, ruler } = this.viewer;
    this.asked = frame;
    selection.show();
    ruler.show();
    this.viewer.redraw();
  }

  of(row) {
    return frameOf(row, this.asked);
  }

  name(row) {
    return `${text.frames[this.of(row)]}${this.of(row) === "row" ? ` ${row.name}` : ""}`;
  }

  // What its axes are.
  axes(row) {
    return text.axesOf[this.of(row)];
  }

  // Where an element is, and how sure that is.
  lines(one) {
    const { site } = this.viewer,
      frame = this.of(one.row);
    const whose = frame === this.asked ? [] : [[text.frame, text.frames[frame]]];
    return [
      ...whose,
      [frame === "earth" ? text.onEarth : text.centre, this.text(one.row, one.centre), "wide"],
      [text.largestSigma, millimetres(sigmaIn(site, one, frame))],
    ];
  }

  text(row, point) {
    return placeText(this.viewer.site, row, this.of(row), point);
  }

  // Draw the axes, of the row at hand where the frame is a row's own.
  draw(camera) {
    const { site, row } = this.viewer;
    drawCompass(byId("compass"), axesIn(site, row, this.of(row)), camera);
  }
}
