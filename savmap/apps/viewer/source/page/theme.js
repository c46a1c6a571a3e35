// Light or dark: as the system has it, until the button says otherwise; paper is light.
import { byId } from "./dom.js";
import { setShades } from "../scene/colours.js";
import { text } from "../text.js";

const system = matchMedia("(prefers-color-scheme: dark)");

export class Theme {
  constructor(changed) {
    Object.assign(this, { changed, asked: null, onPaper: false });
    byId("theme").addEventListener("click", () => this.turn());
    system.addEventListener("change", () => this.apply());
    this.apply();
  }

  get name() {
    if (this.onPaper) return "light";
    return this.asked ?? (system.matches ? "dark" : "light");
  }

  turn() {
    this.asked = this.name === "dark" ? "light" : "dark";
    this.apply();
  }

  apply() {
    const { name } = this;
    document.documentElement.dataset.theme = name;
    byId("theme").textContent = "\u25d0";
    byId("theme").title = text.themes[name === "dark" ? "light" : "dark"];
    byId("theme").setAttribute("aria-label", byId("theme").title);
    setShades(name);
    this.changed();
  }

  // While it is printed.
  paper(on) {
    this.onPaper = on;
    this.apply();
  }
}
