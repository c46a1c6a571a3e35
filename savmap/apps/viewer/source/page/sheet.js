// The page on paper: the views as they are on the screen, with their names and scale, as one picture, for lines over a canvas would not keep their
// places on a sheet of another size.
import { byId } from "./dom.js";
import { text } from "../text.js";

const RATIO = 2; // pixels of the picture by pixels of the page

export class Sheet {
  constructor(viewer) {
    this.viewer = viewer;
    addEventListener("beforeprint", () => this.begin());
    addEventListener("afterprint", () => viewer.theme.paper(false));
  }

  begin() {
    const { viewer } = this,
      { stage } = viewer;
    viewer.theme.paper(true);
    byId("sheet").textContent = this.title();
    stage.drawSharp(RATIO);
    const from = byId("canvas"),
      whole = byId("stage").getBoundingClientRect(),
      bar = byId("pano").hidden ? 0 : byId("pano-bar").offsetHeight;
    // finished pixels: what is drawn on a canvas of the page itself, browsers draw again on paper, in another size
    const sheet = new OffscreenCanvas(from.width, Math.round((from.height * (whole.height - bar)) / whole.height)),
      brush = sheet.getContext("2d");
    brush.drawImage(from, 0, 0);
    brush.scale(from.width / whole.width, from.height / whole.height);
    brush.translate(-whole.left, -whole.top);
    for (const name of document.querySelectorAll("#names .name, #rule:not([hidden])")) write(brush, name);
    if (!byId("scale").hidden) drawBar(brush, byId("scale"));
    drawLines(brush, byId("compass"));
    Object.assign(byId("printed"), { width: sheet.width, height: sheet.height });
    byId("printed").getContext("bitmaprenderer").transferFromImageBitmap(sheet.transferToImageBitmap());
    stage.redraw();
  }

  title() {
    const { site, row, view, modeName } = this.viewer;
    const shown = view.kind === "face" || site.rows.length === 1 ? `${text.views[view.kind]}, ${text.row(row.name)}` : text.views[view.kind];
    const [, digest] = document.querySelector("meta[name=savmap-view]").content.match(/map=(\w*)/);
    const date = new Date().toLocaleDateString("en-GB", { day: "numeric", month: "long", year: "numeric" });
    return [shown, text.colouredBy(modeName), text.printed(date), digest && text.ofMap(digest.slice(0, 12))].filter(Boolean).join(" \u00b7 ");
  }
}

// A text where it is on the page, on its ground.
function write(brush, said) {
  const box = said.getBoundingClientRect(),
    style = getComputedStyle(said);
  brush.fillStyle = style.backgroundColor;
  brush.fillRect(box.left, box.top, box.width, box.height);
  brush.fillStyle = style.color;
  brush.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
  brush.textAlign = "center";
  brush.textBaseline = "middle";
  brush.fillText(said.textContent, (box.left + box.right) / 2, (box.top + box.bottom) / 2);
}

function drawBar(brush, bar) {
  const [said, line] = bar.children,
    box = line.getBoundingClientRect(),
    whole = bar.getBoundingClientRect();
  brush.fillStyle = getComputedStyle(bar).backgroundColor;
  brush.fillRect(whole.left, whole.top, whole.width, whole.height);
  write(brush, said);
  brush.fillStyle = getComputedStyle(line).borderBottomColor;
  brush.fillRect(box.left, box.bottom - 2, box.width, 2);
  for (const x of [box.left, box.right - 2]) brush.fillRect(x, box.top, 2, box.height);
}

function drawLines(brush, drawing) {
  const box = drawing.getBoundingClientRect(),
    at = (node, name) => Number(node.getAttribute(name));
  brush.save();
  Object.assign(brush, { shadowBlur: 8, shadowColor: "#ffffff" });
  brush.translate((box.left + box.right) / 2, (box.top + box.bottom) / 2);
  for (const node of drawing.children) {
    const style = getComputedStyle(node);
    if (node.tagName === "line") {
      Object.assign(brush, { strokeStyle: style.stroke, lineWidth: 2 });
      brush.beginPath();
      brush.moveTo(at(node, "x1"), at(node, "y1"));
      brush.lineTo(at(node, "x2"), at(node, "y2"));
      brush.stroke();
    } else {
      Object.assign(brush, { fillStyle: style.fill, font: `600 12px ${style.fontFamily}`, textAlign: "center", textBaseline: "middle" });
      brush.fillText(node.textContent, at(node, "x"), at(node, "y"));
    }
  }
  brush.restore();
}
