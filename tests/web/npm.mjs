// As a user in an empty folder: installs the packed npm package, links every
// module with wesl-js and with the package's own `link`, and writes the results
// for the browser to compile.
//
// node npm.mjs PACKAGE DATA

import { execFileSync } from "node:child_process";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { link as weslLink } from "wesl";

const [folder, data] = process.argv.slice(2).map((path) => resolve(path));
const calls = JSON.parse(await readFile(join(data, "calls.json"), "utf8"));
const user = await mkdtemp(join(tmpdir(), "raytwin-npm-"));
const npm = (...words) =>
  execFileSync("npm", words, { cwd: user, encoding: "utf8", stdio: ["ignore", "pipe", "inherit"] });

const programs = [];
const failures = [];
try {
  await writeFile(join(user, "package.json"), '{ "private": true, "type": "module" }\n');
  const packed = npm("pack", folder, "--silent", "--pack-destination", user).trim().split("\n").pop();
  npm("install", "--silent", "--no-audit", "--no-fund", "--ignore-scripts", join(user, packed));
  const installed = createRequire(join(user, "main.mjs"));
  const load = (name) => import(pathToFileURL(installed.resolve(name)).href);
  const kit = await load("raytwin");
  // What the package's page shows, as it stands there but for the imports.
  const page = await readFile(join(user, "node_modules", "raytwin", "README.md"), "utf8");
  const blocks = page.split("```js\n").slice(1).map((text) => text.split("```")[0]);
  const code = blocks.map((text) => text.replace(/^(import .* from|const module) .*$/gm, ""));
  const AsyncFunction = (async () => {}).constructor;
  const first = await new AsyncFunction("link", `${code[0]}; return code;`)(kit.link);
  const cone = (await load("raytwin/sample/cone")).default;
  const second = await new AsyncFunction("link", "cone", `${code[1]}; return linked.dest;`)(weslLink, cone);
  programs.push({ name: "the page's first example", source: first, subgroups: false });
  programs.push({ name: "the page's second example", source: second, subgroups: false });
  for (const { name, main, imports, source } of calls) {
    try {
      const { default: bundle } = await load(`raytwin/${name}`);
      const head = imports.map(([path, names]) => `import ${path}::{${names.join(", ")}};\n`);
      const weslSrc = { "main.wesl": head.join("") + main };
      const { dest } = await weslLink({ weslSrc, libs: [bundle] });
      programs.push({ name: `${name} by wesl-js`, source: dest, subgroups: false });

      const plain = await readFile(installed.resolve(`raytwin/wgsl/${name}.wgsl`), "utf8");
      if (plain !== kit.module(name).source) throw new Error("the plain file differs");
      const whole = await readFile(installed.resolve(`raytwin/wgsl/${name}.linked.wgsl`), "utf8");
      if (kit.link([name]) !== whole) throw new Error("`link` does not give the linked file");
      if (whole !== source) throw new Error("the linked file is not what Rust links");
      const bindings = kit.linked([name]).map((m) => m.bindings ?? "").join("");
      const text = whole + bindings + main;
      programs.push({ name: `${name} by link`, source: text, subgroups: false });
    } catch (error) {
      failures.push(`${name}: ${error.message}`);
    }
  }
} finally {
  await rm(user, { recursive: true, force: true });
}
await writeFile(join(data, "npm.json"), JSON.stringify(programs));
for (const text of failures) console.log(`FAILED ${text}`);
const passed = programs.length;
const failed = failures.length + (passed === 0 ? 1 : 0);
console.log(
  `test result: ${failed ? "FAILED" : "ok"}. ${passed} passed; ${failed} failed; 0 ignored;`,
);
process.exit(failed ? 1 : 0);
