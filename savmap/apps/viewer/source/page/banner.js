// Over the map: which rows must be checked, which leads to the first of them, and what a link did not find.
import { byId } from "./dom.js";
import { text } from "../text.js";

export const toCheck = (site) => site.rows.find((row) => row.grade === "check");

export function buildBanner(viewer) {
  const { site } = viewer,
    banner = byId("banner");
  banner.hidden = !site.banner;
  banner.textContent = site.banner;
  banner.addEventListener("click", () => {
    viewer.goToRow(toCheck(site));
    viewer.setMode("verdict");
    byId("side").scrollTop = byId("warned").offsetTop;
    byId("warnings").querySelector("button")?.focus({ preventScroll: true });
  });
  byId("notice-close").setAttribute("aria-label", text.close);
  byId("notice-close").addEventListener("click", () => tell(""));
}

// Say something over the map; "" takes it away.
export function tell(said) {
  byId("notice").hidden = !said;
  byId("notice-text").textContent = said;
}
