// The gallery in headless Chromium: every technique and kernel, the keyboard, a
// phone, a browser without WebGPU. Writes screenshots.
//
// node test.mjs PAGE CHROMIUM SCREENSHOTS

import { createServer } from "node:http";
import { mkdir, mkdtemp, readFile, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join, normalize } from "node:path";
import { chromium } from "playwright-core";

const [folder, executablePath, pictures] = process.argv.slice(2);
const types = { html: "text/html", mjs: "text/javascript", json: "application/json", css: "text/css", svg: "image/svg+xml", png: "image/png" };
const server = createServer(async (request, response) => {
  const path = normalize(decodeURIComponent(new URL(request.url, "http://localhost").pathname)).slice(1);
  try {
    const body = await readFile(join(folder, path || "index.html"));
    response.setHeader("Content-Type", types[(path || "index.html").split(".").pop()] ?? "text/plain");
    response.end(body);
  } catch {
    response.statusCode = 404;
    response.end();
  }
});
await new Promise((listening) => server.listen(0, "127.0.0.1", listening));
const address = `http://127.0.0.1:${server.address().port}/`;
await mkdir(pictures, { recursive: true });

let passed = 0;
const failures = [];
const check = (right, text) => (right ? (passed += 1) : failures.push(text));

async function browse(webgpu, action) {
  const profile = await mkdtemp(join(tmpdir(), "raytwin-gallery-"));
  const gpu = webgpu ? ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"] : ["--disable-gpu", "--disable-features=WebGPU"];
  const root = process.getuid?.() === 0 ? ["--no-sandbox"] : [];
  const quiet = ["--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic", "--no-first-run"];
  const browser = await chromium.launchPersistentContext(profile, {
    executablePath,
    viewport: { width: 1280, height: 900 },
    args: [...gpu, ...quiet, ...root],
  });
  try {
    const page = await browser.newPage();
    const errors = [];
    page.on("pageerror", (error) => errors.push(error.message));
    page.on("console", (message) => {
      if (message.type() === "error" && !message.location().url.includes("/recorded/")) errors.push(message.text());
    });
    await action(page, errors);
  } finally {
    await browser.close();
    await rm(profile, { recursive: true, force: true });
  }
}

const opened = (page, name) =>
  page.waitForFunction((n) => document.querySelector("main").dataset.open === n, name, { timeout: 60_000 });
const go = async (page, name) => {
  await page.evaluate((n) => (location.hash = n), name);
  await opened(page, name);
};
const shot = (page, name) => page.screenshot({ path: join(pictures, `${name}.png`) });
const demos = { "random/halton": "patterns", "brdf/ggx": "lobes", "brdf/layered": "layered", "filter/svgf": "svgf", "temporal/multiscale_mean": "mean", "gi/surfel": "surfels" };

await browse(true, async (page, errors) => {
  await page.goto(address);
  await opened(page, "random/halton");
  check(await page.locator("#without").isHidden(), "says that there is no WebGPU where there is");
  const names = await page.$$eval("nav a", (links) => links.map((a) => a.hash.slice(1)));
  console.log(`${names.length} techniques`);
  check(names.length >= 50, `only ${names.length} techniques`);
  for (const name of names) {
    await go(page, name);
    const kernels = await page.$$eval("main section select", (all) => all.at(-1) && [...document.querySelectorAll("label.control select")].find((s) => s.previousSibling?.textContent === "Kernel").length);
    const explored = await page.evaluate(async (count) => {
      const choice = [...document.querySelectorAll("label.control select")].find((s) => s.previousSibling?.textContent === "Kernel");
      const bad = [];
      for (let i = 0; i < count; i++) {
        const before = document.querySelector(".explorer canvas");
        choice.selectedIndex = i;
        choice.dispatchEvent(new Event("change"));
        const from = performance.now();
        for (;;) {
          const on = document.querySelector(".explorer canvas");
          const fresh = on && (on !== before || i === 0) && Number(on.dataset.drawn) > 0;
          if (fresh || document.querySelector(".explorer .error") || performance.now() - from > 20000) break;
          await new Promise((next) => setTimeout(next, 10));
        }
        const error = document.querySelector(".explorer .error")?.textContent;
        const drawn = Number(document.querySelector(".explorer canvas")?.dataset.drawn ?? 0);
        if (error || !drawn) bad.push(`${choice.value}: ${error ?? "nothing drawn"}`);
      }
      return bad;
    }, kernels);
    check(explored.length === 0, `${name}: ${explored.join("; ")}`);
    passed += kernels - explored.length;
    const [wgsl, rust] = await page.$$eval(".code pre", (all) => all.map((pre) => pre.textContent.length));
    check(wgsl > 100 && rust > 100, `${name}: no source`);
    const said = await page.locator("main .error").allTextContents();
    check(said.length === 0, `${name}: ${said}`);
  }
  for (const [name, demo] of Object.entries(demos)) {
    await go(page, name);
    await page.waitForFunction(() => Number(document.querySelector(".demo canvas")?.dataset.drawn) > 0, null, { timeout: 30_000 });
    const looks = () => page.$$eval(".demo canvas", (all) => all.map((on) => on.toDataURL()).join());
    await page.waitForTimeout(demo === "svgf" || demo === "surfels" ? 4000 : 1500);
    const before = await looks();
    await shot(page, demo);
    for (const on of (await page.$$(".demo canvas")).slice(-1)) {
      await on.screenshot({ path: join(pictures, `recorded-${demo}.png`) });
    }
    const colors = await page.$$eval(".demo canvas", (all) => all.map((on) => {
      const data = on.getContext("2d").getImageData(0, 0, on.width, on.height).data;
      const seen = new Set();
      for (let i = 0; i < data.length; i += 4) seen.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
      return seen.size;
    }));
    check(colors.every((n) => n > 1), `${demo}: a canvas has one colour`);
    const slider = page.locator(".demo input[type=range]").first();
    await slider.focus();
    for (let i = 0; i < 20; i++) await page.keyboard.press(demo === "svgf" ? "ArrowLeft" : "ArrowRight");
    await page.waitForTimeout(1500);
    check((await looks()) !== before, `${demo}: a slider changes nothing`);
  }
  await go(page, "brdf/fresnel");
  await shot(page, "explorer");
  await (await page.$(".explorer canvas")).screenshot({ path: join(pictures, "recorded-explorer.png") });
  // By keyboard alone: find, the list, a kernel's choice, copying.
  await page.reload();
  await opened(page, "brdf/fresnel");
  const reached = new Set();
  for (let i = 0; i < 140; i++) {
    await page.keyboard.press("Tab");
    const at = await page.evaluate(() => {
      const on = document.activeElement;
      const ring = getComputedStyle(on).outlineStyle !== "none";
      return [on.id || on.tagName + (on.type ?? "") + (on.tagName === "BUTTON" ? on.textContent : ""), ring];
    });
    reached.add(at[0]);
    if (!at[1] && at[0] !== "BODY") failures.push(`no ring on ${at[0]}`);
  }
  for (const part of ["find", "A", "SELECTselect-one", "BUTTONbuttonCopy", "PRE", "INPUTrange"]) {
    const has = reached.has(part) || (part === "INPUTrange" && (await page.$$(".explorer details")).length > 0);
    check(has, `the keyboard does not reach ${part}: ${[...reached]}`);
  }
  // A phone.
  await page.setViewportSize({ width: 390, height: 844 });
  for (const [name, demo] of [...Object.entries(demos), ["brdf/fresnel", "explorer"]]) {
    await go(page, name);
    await page.waitForTimeout(800);
    const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    check(wide <= 0, `${name}: ${wide} pixels too wide for a phone`);
    await shot(page, `phone-${demo}`);
  }
  check(errors.length === 0, `errors: ${[...new Set(errors)].slice(0, 5).join("; ")}`);
});

await browse(false, async (page, errors) => {
  await page.addInitScript(() => Object.defineProperty(Navigator.prototype, "gpu", { get: () => undefined }));
  await page.goto(address);
  for (const [name, demo] of Object.entries(demos)) {
    await go(page, name);
    await page.waitForTimeout(300);
    check(await page.locator("#without").isVisible(), "does not say that there is no WebGPU");
    const widths = await page.$$eval(".demo img", (all) => all.map((i) => i.naturalWidth));
    check(widths.length > 0 && widths.every((w) => w > 0), `${demo}: no recorded picture`);
  }
  await shot(page, "without");
  check(errors.length === 0, `without WebGPU: ${errors.slice(0, 3).join("; ")}`);
});

server.close();
for (const text of failures) console.log(`FAILED ${text}`);
console.log(`test result: ${failures.length ? "FAILED" : "ok"}. ${passed} passed; ${failures.length} failed; 0 ignored;`);
process.exit(failures.length ? 1 : 0);
