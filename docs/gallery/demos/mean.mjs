// The multiscale mean beside an exponential average, on a signal that you draw.

import { numbers } from "../gpu.mjs";
import { Controls, canvas, drawn, element, palette, short } from "../ui.mjs";

const FRAMES = 512;
const MAIN = `
@compute @workgroup_size(1)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x > 0u {
        return;
    }
    let noise = settings[0].x;
    let seed = u32(settings[0].y);
    let window = settings[0].z;
    var robust = MULTISCALE_MEAN_ROBUST_EMPTY;
    var printed = MULTISCALE_MEAN_EMPTY;
    var plain = 0.0;
    for (var i = 0u; i < ${FRAMES}u; i++) {
        // The signal comes in the result's last lane.
        let signal = result[i].w;
        let u = pcg_unit(pcg_hash(i ^ pcg_hash(seed)));
        let value = max(signal * (1.0 + noise * (2.0 * u - 1.0)), 0.0);
        robust = multiscale_mean_robust_step(robust, value, MULTISCALE_MEAN_SHORT_BLEND, MULTISCALE_MEAN_LONGEST);
        printed = multiscale_mean_step(printed, value, MULTISCALE_MEAN_SHORT_BLEND);
        plain = plain + (value - plain) / min(f32(i + 1u), window);
        result[i] = vec4f(value, multiscale_mean_robust_value(robust), plain, printed.mean);
    }
}`;

const SIGNALS = {
  step: (t) => (t < 0.35 ? 0.25 : 0.8),
  "step down": (t) => (t < 0.35 ? 0.8 : 0.2),
  ramp: (t) => 0.15 + 0.7 * Math.min(Math.max((t - 0.25) * 2, 0), 1),
  pulse: (t) => (t > 0.4 && t < 0.5 ? 0.85 : 0.25),
  still: () => 0.5,
};

export async function start(gpu, libraries, host) {
  const on = canvas(768, 300, "A signal over frames and what each average makes of it; draw to change it");
  on.style.touchAction = "none";
  const box = element("div", { className: "controls" });
  const note = element("p", { className: "note", ariaLive: "polite" });
  host.append(element("h2", {}, "Draw a signal"), on, box, note);
  const signal = Float32Array.from({ length: FRAMES }, (_, i) => SIGNALS.step(i / FRAMES));
  const run = await withSignal(gpu, libraries.mean);
  let busy = false;
  let again = false;
  const update = async () => {
    if (busy) {
      again = true;
      return;
    }
    busy = true;
    const { noise, seed, window } = controls.values;
    const found = await run([noise, seed, Math.round(window), 0], signal);
    const colors = palette();
    const context = on.getContext("2d");
    const place = (y) => on.height * (1 - 0.9 * Math.min(y, 1.1));
    context.fillStyle = colors.paper;
    context.fillRect(0, 0, on.width, on.height);
    context.fillStyle = colors.ink;
    context.globalAlpha = 0.35;
    for (let i = 0; i < FRAMES; i++) context.fillRect((i / FRAMES) * on.width, place(found[4 * i]), 2, 2);
    context.globalAlpha = 1;
    const errors = [0, 0, 0];
    const line = (get, color, width, dash = []) => {
      context.setLineDash(dash);
      context.strokeStyle = color;
      context.lineWidth = width;
      context.beginPath();
      for (let i = 0; i < FRAMES; i++) context.lineTo((i / FRAMES) * on.width, place(get(i)));
      context.stroke();
    };
    line((i) => signal[i], colors.ink, 1, [4, 4]);
    line((i) => found[4 * i + 3], colors.three, 1.5);
    line((i) => found[4 * i + 2], colors.two, 2);
    line((i) => found[4 * i + 1], colors.one, 2.5);
    context.setLineDash([]);
    for (let i = 0; i < FRAMES; i++) {
      [1, 2, 3].forEach((lane, e) => (errors[e] += (found[4 * i + lane] - signal[i]) ** 2));
    }
    const [robust, plain, printed] = errors.map((sum) => short(Math.sqrt(sum / FRAMES)));
    note.textContent =
      `Root mean squared error: multiscale mean (blue) ${robust}, exponential average (orange) ${plain}, ` +
      `the multiscale mean as printed (green) ${printed}. Dots: what comes in. Dashes: the signal.`;
    drawn(on);
    busy = false;
    if (again) {
      again = false;
      update();
    }
  };
  const controls = new Controls(box, update);
  controls.slider("noise", "Noise", { min: 0, max: 1, value: 0.6 });
  controls.slider("window", "Frames of the exponential average", { min: 2, max: 256, value: 32, log: true });
  controls.slider("seed", "Seed", { min: 0, max: 31, value: 1, step: 1 });
  for (const [name, shape] of Object.entries(SIGNALS)) {
    controls.button(name, () => {
      signal.forEach((_, i) => (signal[i] = shape(i / FRAMES)));
      update();
    });
  }
  let last = null;
  const draw = (event) => {
    const box = on.getBoundingClientRect();
    const x = Math.round(((event.clientX - box.left) / box.width) * FRAMES);
    const y = Math.max((1 - (event.clientY - box.top) / box.height) / 0.9, 0);
    const [from, to] = last ? [last, { x, y }].sort((a, b) => a.x - b.x) : [{ x, y }, { x, y }];
    for (let i = Math.max(from.x, 0); i <= Math.min(to.x, FRAMES - 1); i++) {
      signal[i] = to.x > from.x ? from.y + ((to.y - from.y) * (i - from.x)) / (to.x - from.x) : y;
    }
    last = { x, y };
    update();
  };
  on.addEventListener("pointerdown", (event) => {
    on.setPointerCapture(event.pointerId);
    last = null;
    draw(event);
  });
  on.addEventListener("pointermove", (event) => event.buttons && draw(event));
  await update();
}

/** As `numbers`, with the signal written before each run. */
async function withSignal(gpu, library) {
  const { bind, dispatch, pipeline, read, storage } = await import("../gpu.mjs");
  const source = `${library}
@group(0) @binding(0) var<storage, read_write> result: array<vec4f>;
@group(0) @binding(1) var<storage, read> settings: array<vec4f>;
${MAIN}`;
  const made = await pipeline(gpu, source, "main");
  const result = storage(gpu, 16 * FRAMES);
  const settings = storage(gpu, 64);
  const bound = bind(gpu, made, 0, { 0: result, 1: settings });
  return async (values, signal) => {
    const filled = new Float32Array(4 * FRAMES);
    signal.forEach((value, i) => (filled[4 * i + 3] = value));
    gpu.queue.writeBuffer(result, 0, filled);
    gpu.queue.writeBuffer(settings, 0, new Float32Array(values));
    dispatch(gpu, [made, { 0: bound }, 1]);
    return new Float32Array(await read(gpu, result));
  };
}
