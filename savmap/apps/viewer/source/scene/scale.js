// A bar of a round length under a view without perspective.
import { element, fill } from "../page/dom.js";

const MOST_PX = 130;

// `metrePx`: pixels of a metre; 0 where lengths differ over the view.
export function drawScale(bar, metrePx) {
  if (bar.dataset.drawn === String(metrePx)) return;
  bar.dataset.drawn = String(metrePx);
  bar.hidden = !metrePx;
  if (!metrePx) return;
  const power = 10 ** Math.floor(Math.log10(MOST_PX / metrePx)),
    length = [5, 2, 1].map((times) => times * power).find((one) => one * metrePx <= MOST_PX);
  const line = element("i", {});
  line.style.width = `${(length * metrePx).toFixed(1)}px`;
  fill(bar, element("span", {}, lengthText(length)), line);
}

const lengthText = (length) =>
  length >= 1 ? `${length}\u00a0m` : length >= 0.01 ? `${Math.round(100 * length)}\u00a0cm` : `${Math.round(1000 * length)}\u00a0mm`;
