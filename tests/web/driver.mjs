// Serves this folder on loopback, opens it in headless Chromium and prints what
// the page found, in the words of cargo's test runner.
//
// node driver.mjs DATA CHROMIUM

import { createServer } from "node:http";
import { mkdtemp, readFile, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join, normalize } from "node:path";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";

const [data, executablePath] = process.argv.slice(2);
const here = fileURLToPath(new URL(".", import.meta.url));
const types = { html: "text/html", mjs: "text/javascript", json: "application/json" };

const server = createServer(async (request, response) => {
  const path = normalize(new URL(request.url, "http://localhost").pathname).slice(1);
  const file = path.startsWith("data/") ? join(data, path.slice(5)) : join(here, path);
  try {
    const body = await readFile(file);
    response.setHeader("Content-Type", types[file.split(".").pop()] ?? "text/plain");
    response.end(body);
  } catch {
    response.statusCode = 404;
    response.end();
  }
});
await new Promise((ready) => server.listen(0, "127.0.0.1", ready));

const profile = await mkdtemp(join(tmpdir(), "raytwin-chromium-"));
const browser = await chromium.launchPersistentContext(profile, {
  executablePath,
  args: [
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
    "--no-first-run",
    ...(process.getuid?.() === 0 ? ["--no-sandbox"] : []),
  ],
});
let failed = 1;
try {
  console.log(`Chromium ${browser.browser()?.version() ?? ""}`);
  const page = await browser.newPage();
  page.on("console", (message) => {
    if (message.type() === "log") console.log(`  ${message.text()}`);
  });
  page.on("pageerror", (error) => console.log(`  ${error.message}`));
  await page.goto(`http://127.0.0.1:${server.address().port}/page.html`);
  await page.waitForFunction(() => globalThis.check);
  page.setDefaultTimeout(0);
  const report = await page.evaluate(() => globalThis.check());
  console.log(`  on ${report.adapter}: ${report.compared} numbers compared`);
  for (const text of report.skipped) console.log(`  SKIPPED: ${text}`);
  for (const text of report.failures) console.log(`FAILED ${text}`);
  // A run that compares nothing proves nothing.
  failed = report.failures.length + (report.compared > 10_000 ? 0 : 1);
  console.log(
    `test result: ${failed ? "FAILED" : "ok"}. ${report.passed} passed; ` +
      `${failed} failed; ${report.skipped.length} ignored;`,
  );
} finally {
  await browser.close();
  server.close();
  await rm(profile, { recursive: true, force: true });
}
process.exit(failed ? 1 : 0);
