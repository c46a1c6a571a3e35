// Buttons that copy a text.
import { element } from "./dom.js";
import { text } from "../text.js";

const TOLD_MS = 1500;

export function copyButton(label, said) {
  const button = element("button", { type: "button", onclick: () => act() }, label);
  const act = async () => {
    button.textContent = (await copied(said())) ? text.copied : text.notCopied;
    setTimeout(() => (button.textContent = label), TOLD_MS);
  };
  return button;
}

// Pages from a disk may have no clipboard of the newer kind.
async function copied(said) {
  try {
    await navigator.clipboard.writeText(said);
    return true;
  } catch {
    const field = element("textarea", { value: said, className: "unseen" });
    document.body.append(field);
    field.select();
    const done = document.execCommand("copy");
    field.remove();
    return done;
  }
}
