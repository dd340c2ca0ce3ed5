// The page: a list of techniques, and the one that the address names.

import { explore } from "./explorer.mjs";
import { device } from "./gpu.mjs";
import { element, short } from "./ui.mjs";

const DEMOS = {
  "random/halton": "patterns",
  "random/pcg": "patterns",
  "brdf/ggx": "lobes",
  "brdf/ggx_bounded": "lobes",
  "brdf/cook_torrance": "lobes",
  "brdf/layered": "layered",
  "filter/svgf": "svgf",
  "temporal/accumulate": "svgf",
  "temporal/variance_clamp": "svgf",
  "temporal/multiscale_mean": "mean",
  "gi/surfel": "surfels",
};

const read = async (path) => {
  const found = await fetch(path);
  if (!found.ok) throw new Error(`${path}: ${found.status}; \`cargo xtask gallery\` writes it`);
  return found.json();
};

const host = document.querySelector("main");
const list = document.querySelector("nav ul");
const plain = (text) => text.replace(/\[([^\]]*)\]\([^)]*\)/g, "$1");

/** Source text with a button that copies it. */
function code(language, path, text) {
  const copy = element("button", { type: "button" }, "Copy");
  copy.setAttribute("aria-label", `Copy the ${language} source`);
  copy.addEventListener("click", async () => {
    await navigator.clipboard.writeText(text);
    copy.textContent = "Copied";
    setTimeout(() => (copy.textContent = "Copy"), 1500);
  });
  const head = element("header", {}, element("b", {}, language), ` ${path} `, copy);
  const body = element("pre", { tabIndex: 0 }, element("code", {}, text));
  body.setAttribute("aria-label", `${language} source`);
  return element("section", { className: "code" }, head, body);
}

function contract(technique) {
  const head = ["kernel", "class", "bound CPU / GPU / between", "CPU ns", "CPU error", "GPU ns", "GPU error", "from"];
  const ulp = (x) => (x == null ? "" : short(x));
  const rows = technique.kernels.map((k) => {
    const bound = k.class === "A" ? "exact" : k.bounds.map(short).join(" / ");
    const m = k.measured ?? {};
    const cells = [k.class, bound, ulp(m.cpu_ns), ulp(m.cpu_error), ulp(m.gpu_ns), ulp(m.gpu_error), k.source];
    return element("tr", {}, element("th", { scope: "row" }, element("code", {}, k.name)), ...cells.map((c) => element("td", {}, c)));
  });
  const header = element("tr", {}, ...head.map((h) => element("th", { scope: "col" }, h)));
  const table = element("table", {}, element("thead", {}, header), element("tbody", {}, ...rows));
  return element("div", { className: "wide", tabIndex: 0 }, table);
}

/** Speed against error, as the last report has them: its plot of the kernel, or
 * the kernels of the technique beside each other. */
function plot(technique, kernel) {
  const file = kernel.measured?.plot;
  if (file) return element("img", { src: `report/${file}`, alt: `${kernel.name}: speed against error, of the last report`, loading: "lazy" });
  if (!kernel.measured) return element("p", { className: "note" }, "Not in the last report: cargo xtask report measures it.");
  const points = technique.kernels.flatMap(({ name, measured }) =>
    measured ? [[name, "CPU", measured.cpu_ns, measured.cpu_error], [name, "GPU", measured.gpu_ns, measured.gpu_error]] : [],
  ).filter((p) => p[2] > 0);
  const [width, height, margin] = [480, 300, 48];
  const span = (values) => [Math.floor(Math.log10(Math.min(...values))), Math.ceil(Math.log10(Math.max(...values)) + 1e-9)];
  // What is exact lies on the lowest line.
  const least = 0.1;
  const [x0, x1] = span(points.map((p) => p[2]));
  const [y0, y1] = span(points.map((p) => Math.max(p[3] ?? 0, least)));
  const x = (v) => margin + ((Math.log10(v) - x0) / (x1 - x0 || 1)) * (width - margin - 12);
  const y = (v) => height - margin - ((Math.log10(Math.max(v ?? 0, least)) - y0) / (y1 - y0 || 1)) * (height - margin - 24);
  const make = (tag, attributes, text) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text) made.textContent = text;
    return made;
  };
  const svg = make("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "Speed against error, of the last report" });
  for (let d = x0; d <= x1; d++) {
    svg.append(make("line", { x1: x(10 ** d), x2: x(10 ** d), y1: 24, y2: height - margin, class: "grid" }));
    svg.append(make("text", { x: x(10 ** d), y: height - margin + 16, "text-anchor": "middle" }, short(10 ** d)));
  }
  for (let d = y0; d <= y1; d++) {
    svg.append(make("line", { x1: margin, x2: width - 12, y1: y(10 ** d), y2: y(10 ** d), class: "grid" }));
    svg.append(make("text", { x: margin - 6, y: y(10 ** d) + 4, "text-anchor": "end" }, d === y0 && y0 <= -1 ? "0" : short(10 ** d)));
  }
  svg.append(make("text", { x: width / 2, y: height - 10, "text-anchor": "middle" }, "ns an element"));
  svg.append(make("text", { x: 4, y: 14 }, "error, ULP"));
  for (const [name, backend, ns, error] of points) {
    const mine = name === kernel.name;
    const dot = make("circle", { cx: x(ns), cy: y(error), r: mine ? 6 : 3.5, class: `${backend}${mine ? " mine" : ""}` });
    dot.append(make("title", {}, `${name}, ${backend}: ${short(ns)} ns, ${short(error ?? 0)} ULP`));
    svg.append(dot);
  }
  const note = element("figcaption", {}, "Blue: CPU, orange: GPU; large: this kernel, small: the technique's others. From the last report.");
  return element("figure", { className: "scatter" }, svg, note);
}

/** What was recorded, for browsers without WebGPU. */
function recorded(name) {
  const image = element("img", { src: `recorded/${name}.png`, alt: `${name}, recorded` });
  image.addEventListener("error", () => image.replaceWith(element("p", { className: "note" }, "No picture was recorded of this one.")));
  return image;
}

async function open(name) {
  for (const link of list.querySelectorAll("a")) {
    if (link.hash === `#${name}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  const technique = await read(`data/${name}.json`);
  const gpu = await device();
  const parts = [element("h1", { tabIndex: -1 }, name), element("p", {}, plain(technique.title))];
  const demo = DEMOS[name];
  if (demo) {
    const stage = element("section", { className: "demo" });
    parts.push(stage);
    if (gpu) {
      const { start } = await import(`./demos/${demo}.mjs`);
      const libraries = await read("data/libraries.json");
      start(gpu, libraries, stage, name).catch((error) => stage.append(element("p", { className: "error" }, error.message)));
    } else {
      stage.append(recorded(demo));
    }
  }
  const choice = element("select", {}, ...technique.kernels.map((k) => element("option", {}, k.name)));
  const signature = element("pre", { className: "signature" });
  const stage = element("div", { className: "explorer" });
  const drawing = element("div", { className: "plot" });
  const select = async () => {
    const kernel = technique.kernels[choice.selectedIndex];
    signature.textContent = kernel.signature;
    drawing.replaceChildren(plot(technique, kernel));
    if (!gpu) {
      stage.replaceChildren(recorded(demo ?? "explorer"));
      return;
    }
    try {
      await explore(gpu, technique, kernel, stage);
    } catch (error) {
      stage.replaceChildren(element("p", { className: "error" }, error.message));
    }
  };
  choice.addEventListener("change", select);
  parts.push(
    element("section", {}, element("h2", {}, "Each kernel"), element("label", { className: "control" }, "Kernel", choice), signature, element("div", { className: "pair" }, stage, drawing)),
    element("section", {}, element("h2", {}, "Contract"), element("p", { className: "note" }, "Errors and bounds in ULP of the contract's scale; times and errors from the last report."), contract(technique)),
    element("section", {}, element("h2", {}, "Source"), element("div", { className: "pair" }, code("WGSL", `wgsl/src/${name}.wgsl`, technique.wgsl), code("Rust", `cpu/src/${name}.rs`, technique.rust))),
  );
  host.replaceChildren(...parts);
  await select();
  host.dataset.open = name;
}

const index = await read("data/index.json");
for (const { name, title } of index.techniques) {
  const link = element("a", { href: `#${name}`, title: plain(title) }, name);
  list.append(element("li", {}, link));
}
document.querySelector("#find").addEventListener("input", ({ target }) => {
  for (const item of list.children) item.hidden = !item.textContent.includes(target.value.trim());
});
document.querySelector("#report").textContent = index.report
  ? `Figures from the report of ${index.report[0].replace("T", ", ").replace("Z", "")}.`
  : "No report was made yet: cargo xtask report measures this machine.";
document.querySelector("#without").hidden = (await device()) !== null;

let opened = false;
const follow = () =>
  open(decodeURIComponent(location.hash.slice(1)) || "random/halton")
    .then(() => {
      // After a click the reader goes to the new heading.
      if (opened) host.querySelector("h1")?.focus();
      opened = true;
    })
    .catch((error) => host.replaceChildren(element("p", { className: "error" }, error.message)));
addEventListener("hashchange", follow);
await follow();
