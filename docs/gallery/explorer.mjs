// Any kernel, live: one or two of its arguments swept over the canvas, the
// others on sliders.

import { bind, dispatch, pipeline, read, storage, toFloat, toWord, words } from "./gpu.mjs";
import { Controls, canvas, drawn, element, palette, short } from "./ui.mjs";

const SIDE = 128;

/** Whether a range is better walked by powers. */
const byPowers = ([low, high]) => low > 0 && high / low > 1000;

/** A place in a lane's range, `t` in [0, 1], as a word. */
function at(lane, t) {
  const [low, high] = lane.range;
  const value = byPowers(lane.range) ? low * (high / low) ** t : low + (high - low) * t;
  return lane.scalar === "u32" ? Math.round(value) >>> 0 : toWord(value);
}

const asNumber = (lane, word) => (lane.scalar === "u32" ? word : toFloat(word));

/** Runs a kernel over many argument lists. */
async function runner(gpu, library, kernel) {
  const made = await pipeline(gpu, library + kernel.entry, "raytwin_main");
  const count = SIDE * SIDE;
  const size = 4 * kernel.outputs.length;
  const input = storage(gpu, 4 * kernel.inputs.length * count);
  const output = storage(gpu, size * count);
  const fixture = storage(gpu, words(kernel.fixture));
  const bound = bind(gpu, made, 0, { 0: input, 1: output, 2: fixture });
  return async (calls, many) => {
    gpu.queue.writeBuffer(input, 0, calls);
    dispatch(gpu, [made, { 0: bound }, Math.ceil(count / 64)]);
    return new Uint32Array(await read(gpu, output, Math.max(size * many, 16)));
  };
}

/** Lowest and highest finite number of a lane of the results. */
function extent(result, lanes, lane) {
  let [low, high] = [Infinity, -Infinity];
  for (let i = lane; i < result.length; i += lanes.length) {
    const x = asNumber({ scalar: lanes[lane][1] }, result[i]);
    if (!Number.isFinite(x)) continue;
    low = Math.min(low, x);
    high = Math.max(high, x);
  }
  return low <= high ? [low, high] : [0, 0];
}

function drawCurves(on, kernel, result, lane, note) {
  const colors = palette();
  const context = on.getContext("2d");
  const [width, height] = [on.width, on.height];
  context.fillStyle = colors.paper;
  context.fillRect(0, 0, width, height);
  const lanes = kernel.outputs;
  const ranges = lanes.map((_, i) => extent(result, lanes, i));
  const low = Math.min(...ranges.map((r) => r[0]));
  const high = Math.max(...ranges.map((r) => r[1]));
  const scale = high > low ? (height - 20) / (high - low) : 0;
  const many = result.length / lanes.length;
  lanes.forEach((of, l) => {
    context.strokeStyle = [colors.one, colors.two, colors.three, colors.ink][l % 4];
    context.lineWidth = 2;
    context.beginPath();
    for (let i = 0; i < many; i++) {
      const y = asNumber({ scalar: of[1] }, result[i * lanes.length + l]);
      if (!Number.isFinite(y)) continue;
      const place = scale ? height - 10 - (y - low) * scale : height / 2;
      context.lineTo((i / (many - 1)) * width, place);
    }
    context.stroke();
  });
  const named = lanes.map(([name], i) => `${name || "result"} ${ranges[i].map(short).join(" to ")}`);
  note.textContent = `Across: ${lane.name}. ${named.join("; ")}.`;
}

function drawMap(on, kernel, result, [across, up], note) {
  const lanes = kernel.outputs;
  const shown = lanes.slice(0, 3).map((_, i) => extent(result, lanes, i));
  const image = new ImageData(SIDE, SIDE);
  for (let y = 0; y < SIDE; y++) {
    for (let x = 0; x < SIDE; x++) {
      const from = (y * SIDE + x) * lanes.length;
      const to = 4 * ((SIDE - 1 - y) * SIDE + x);
      const part = shown.map(([low, high], i) => {
        const value = asNumber({ scalar: lanes[i][1] }, result[from + i]);
        return high > low ? (255 * (value - low)) / (high - low) : 128;
      });
      // One number is grey, two leave blue at the middle.
      const [r, g = r, b = part.length === 1 ? r : 128] = part;
      image.data.set([r, g, b, 255], to);
    }
  }
  const small = canvas(SIDE, SIDE, "");
  small.getContext("2d").putImageData(image, 0, 0);
  const context = on.getContext("2d");
  context.imageSmoothingEnabled = false;
  context.drawImage(small, 0, 0, on.width, on.height);
  const named = shown.map((r, i) => `${lanes[i][0] || "result"} ${r.map(short).join(" to ")}`);
  const more = lanes.length > 3 ? `; ${lanes.length - 3} more lanes` : "";
  note.textContent = `Across: ${across.name}; up: ${up.name}. Red, green, blue: ${named.join("; ")}${more}.`;
}

/** A kernel's live canvas with its sliders, in `host`. */
export async function explore(gpu, technique, kernel, host) {
  const run = await runner(gpu, technique.library, kernel);
  const on = canvas(384, 384, `${kernel.name} over its arguments`);
  const note = element("p", { className: "note", ariaLive: "polite" });
  const box = element("div", { className: "controls" });
  host.replaceChildren(on, box, note);
  const { inputs } = kernel;
  const moving = inputs.filter((lane) => lane.range[0] < lane.range[1]);
  const cases = kernel.cases.map(words);
  let base = Array.from(cases[0] ?? []);
  let busy = false;
  let again = false;

  const update = async () => {
    if (busy) {
      again = true;
      return;
    }
    busy = true;
    try {
      const { values } = controls;
      const axes = [values.across, values.up].map((name) => moving.find((l) => l.name === name));
      const [across, up] = axes;
      const many = up ? SIDE * SIDE : 2 * SIDE;
      const calls = new Uint32Array(many * inputs.length);
      for (let i = 0; i < many; i++) {
        calls.set(base, i * inputs.length);
        const x = up ? (i % SIDE) / (SIDE - 1) : i / (many - 1);
        if (across) calls[i * inputs.length + inputs.indexOf(across)] = at(across, x);
        const y = Math.floor(i / SIDE) / (SIDE - 1);
        if (up) calls[i * inputs.length + inputs.indexOf(up)] = at(up, y);
      }
      const result = await run(calls, many);
      const used = result.subarray(0, many * kernel.outputs.length);
      if (up) drawMap(on, kernel, used, axes, note);
      else drawCurves(on, kernel, used, across ?? { name: "nothing to move" }, note);
      drawn(on);
    } catch (error) {
      note.textContent = error.message;
      note.classList.add("error");
    }
    busy = false;
    if (again) {
      again = false;
      update();
    }
  };

  const controls = new Controls(box, update);
  const names = moving.map((lane) => lane.name);
  if (names.length > 0) controls.choice("across", "Across", names);
  if (names.length > 1) controls.choice("up", "Up", ["nothing", ...names.slice(1)], names[1]);
  const sliders = element("details", {}, element("summary", {}, "Other arguments"));
  const inside = element("div", { className: "controls" });
  sliders.append(inside);
  box.append(sliders);
  const others = new Controls(inside, update);
  const fill = () => {
    inside.replaceChildren();
    inputs.forEach((lane, i) => {
      const [min, max] = lane.range;
      if (min >= max) return;
      const value = Math.min(Math.max(asNumber(lane, base[i]), min), max);
      const step = lane.scalar === "u32" ? 1 : undefined;
      others.slider(lane.name, lane.name, { min, max, value, step, log: step ? false : byPowers(lane.range) });
      const input = inside.lastElementChild.querySelector("input");
      input.addEventListener("input", () => {
        const x = others.values[lane.name];
        base[i] = lane.scalar === "u32" ? Math.round(x) >>> 0 : toWord(x);
      }, { capture: true });
    });
  };
  fill();
  let next = 0;
  if (cases.length > 1) {
    controls.button("Other values", () => {
      next = (next + 1) % cases.length;
      base = Array.from(cases[next]);
      fill();
      update();
    });
  }
  await update();
}
