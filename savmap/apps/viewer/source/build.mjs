// Bundles the viewer's modules and three.js into ../viewer.js: `npm ci && npm run build`. `npm run build -- --check` writes nothing and
// fails where the committed bundle differs from what the sources give.
import { createHash } from "node:crypto";
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const bundle = new URL("../viewer.js", import.meta.url);
const licence = readFileSync(new URL("node_modules/three/LICENSE", import.meta.url), "utf8").trim();
const names = readdirSync(new URL(".", import.meta.url), { recursive: true })
  .filter((name) => /\.(m?js|json)$/.test(name) && !name.startsWith("node_modules"))
  .sort();
const sources = createHash("sha256");
for (const name of names) sources.update(readFileSync(new URL(name, import.meta.url)));
const result = await build({
  entryPoints: [new URL("main.js", import.meta.url).pathname],
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "ascii",
  legalComments: "none",
  write: false,
  banner: {
    js: `/*! savmap viewer, Apache-2.0, of sources ${sources.digest("hex")}. With three.js:\n${licence}\n*/`,
  },
});
const made = result.outputFiles[0].text.replaceAll("</", "<\\/").replaceAll("<!--", "<\\!--");
if (process.argv.includes("--check")) {
  if (readFileSync(bundle, "utf8") !== made) {
    console.error("viewer.js is not what its sources give: run `npm run build` and commit it");
    process.exit(1);
  }
} else {
  writeFileSync(bundle, made);
}
