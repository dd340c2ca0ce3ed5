// SVGF on a noisy sequence: a ball over a floor under a disc-like light, one
// shadow ray a pixel and frame.

import { bind, dispatch, pipeline, read, storage } from "../gpu.mjs";
import { Controls, canvas, element, show } from "../ui.mjs";

const SIDE = 256;
const GROUPS = SIDE / 8;
const NOISE = `
struct Frame {
    ball: vec3f,
    frame: u32,
    light: vec3f,
    light_radius: f32,
    cap: f32,
    gamma: f32,
    clamped: u32,
    restart: u32,
}

@group(0) @binding(0) var<storage, read_write> surfaces: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> noisy: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> states: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> colors: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> histories: array<f32>;
@group(0) @binding(5) var<uniform> frame: Frame;

fn variance_clamp_read(at: vec2u) -> vec3f {
    return noisy[at.y * ${SIDE}u + at.x].xyz;
}

@compute @workgroup_size(8, 8)
fn trace(@builtin(global_invocation_id) id: vec3u) {
    let index = id.y * ${SIDE}u + id.x;
    let place = (vec2f(id.xy) + 0.5) / ${SIDE}.0 * 2.0 - 1.0;
    let eye = vec3f(0.0, 1.6, 4.2);
    let ray = Ray(eye, vec3_normalize(vec3f(0.62 * place.x, -0.30 - 0.62 * place.y, -1.0)), 0.0, 1e6);
    let ball = sphere_intersect(ray, frame.ball, 0.75);
    var t = 0.0;
    var normal = vec3f(0.0, 1.0, 0.0);
    var albedo = vec3f(0.75, 0.72, 0.68);
    if ball.hit != 0u {
        t = ball.t;
        normal = vec3_normalize(eye + t * ray.direction - frame.ball);
        albedo = vec3f(0.85, 0.35, 0.2);
    } else if ray.direction.y < -1e-3 {
        t = -eye.y / ray.direction.y;
    }
    if t <= 0.0 || t > 30.0 {
        // No surface: nothing to filter.
        surfaces[2u * index] = vec4f(0.0);
        surfaces[2u * index + 1u] = vec4f(0.0, 0.0, 1.0, 0.0);
        noisy[index] = vec4f(0.35, 0.5, 0.7, 0.0);
        return;
    }
    let point = eye + t * ray.direction;
    surfaces[2u * index] = vec4f(point, 0.02 * t);
    surfaces[2u * index + 1u] = vec4f(normal, 0.0);
    // A point of the light: a disc that faces down.
    let first = pcg_next(pcg_seed(id.xy, frame.frame));
    let second = pcg_next(first.state);
    let disc = disk_concentric_sample(vec2f(pcg_unit(first.value), pcg_unit(second.value)));
    let lamp = frame.light + frame.light_radius * vec3f(disc.x, 0.0, disc.y);
    let to = lamp - point;
    let square = vec3_dot(to, to);
    let wi = to / sqrt(square);
    let shadow = sphere_intersect(Ray(point + 1e-3 * normal, wi, 0.0, sqrt(square)), frame.ball, 0.75);
    var light = 0.06;
    if shadow.hit == 0u {
        light += max(vec3_dot(normal, wi), 0.0) * max(wi.y, 0.0) * 12.0 / square;
    }
    noisy[index] = vec4f(albedo * light, 0.0);
}

@compute @workgroup_size(8, 8)
fn gather(@builtin(global_invocation_id) id: vec3u) {
    let index = id.y * ${SIDE}u + id.x;
    let first = states[2u * index];
    let second = states[2u * index + 1u];
    var state = TemporalAccumulateRgbState(first.xyz, second.x, first.w, second.y);
    if frame.restart != 0u {
        state = TEMPORAL_ACCUMULATE_RGB_EMPTY;
    }
    if frame.clamped != 0u {
        state.color = variance_clamp_pixel(
            id.xy, vec2u(${SIDE}u), VARIANCE_CLAMP_RADIUS, state.color, frame.gamma, VARIANCE_CLAMP_YCOCG,
        );
    }
    state = temporal_accumulate_rgb_step(state, noisy[index].xyz, frame.cap, frame.cap);
    states[2u * index] = vec4f(state.color, state.variance);
    states[2u * index + 1u] = vec4f(state.mean_luminance, state.history, 0.0, 0.0);
    colors[index] = vec4f(state.color, state.variance);
    histories[index] = state.history;
}`;

export async function start(gpu, libraries, host) {
  const noise = libraries.noise + NOISE;
  const trace = await pipeline(gpu, noise, "trace");
  const gather = await pipeline(gpu, noise, "gather");
  const variance = await pipeline(gpu, libraries.svgf, "svgf_image_pass_variance_color");
  const atrous = await pipeline(gpu, libraries.svgf, "svgf_image_pass_atrous_color");
  const pixels = SIDE * SIDE;
  const surfaces = storage(gpu, 32 * pixels);
  const noisy = storage(gpu, 16 * pixels);
  const states = storage(gpu, 32 * pixels);
  const images = [storage(gpu, 16 * pixels), storage(gpu, 16 * pixels)];
  const histories = storage(gpu, 4 * pixels);
  const uniform = (size) => gpu.createBuffer({ size, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
  const settings = uniform(48);
  const layout = uniform(16);
  gpu.queue.writeBuffer(layout, 0, new Uint32Array([SIDE, 0, 0, 0]));
  const steps = Array.from({ length: 6 }, () => uniform(64));
  const traced = bind(gpu, trace, 0, { 0: surfaces, 1: noisy, 5: settings });
  const gathered = bind(gpu, gather, 0, { 1: noisy, 2: states, 3: images[0], 4: histories, 5: settings });
  const image = (made, i, step, more = {}) =>
    bind(gpu, made, 2, { 7: surfaces, 8: images[i], 10: layout, 122: images[1 - i], 124: steps[step], ...more });

  const names = ["One sample a pixel", "Accumulated", "Filtered"];
  const views = names.map((name) => canvas(SIDE, SIDE, name));
  const figures = names.map((name, i) => element("figure", {}, views[i], element("figcaption", {}, name)));
  const box = element("div", { className: "controls" });
  host.append(element("h2", {}, "A noisy sequence"), element("div", { className: "row" }, ...figures), box);

  let frame = 0;
  let restart = true;
  let paused = false;
  const render = async () => {
    const v = controls.values;
    const t = v.motion === "ball moves" ? 0.05 * frame : 0.6;
    const bytes = new ArrayBuffer(48);
    const [floats, whole] = [new Float32Array(bytes), new Uint32Array(bytes)];
    floats.set([1.2 * Math.sin(t), 0.75, 0.3 * Math.cos(t)]);
    whole[3] = frame;
    const around = v.motion === "light moves" ? 0.05 * frame : 0.9;
    floats.set([1.8 * Math.sin(around), 3.6, 1.0 * Math.cos(around), v.light], 4);
    floats.set([Math.round(v.frames), v.gamma], 8);
    whole[10] = v.clamp === "off" ? 0 : 1;
    whole[11] = restart ? 1 : 0;
    restart = false;
    gpu.queue.writeBuffer(settings, 0, bytes);
    const passes = Math.round(v.passes);
    steps.forEach((buffer, i) => {
      const pass = new ArrayBuffer(64);
      new Uint32Array(pass).set([SIDE, SIDE, i === 0 ? 1 : 1 << (i - 1), 0]);
      // SvgfSettings: the paper's, but for luminance.
      new Float32Array(pass).set([0.2, 0.2, 4, 1, v.sigma], 4);
      new Uint32Array(pass).set([7, 2, passes, 0], 9);
      gpu.queue.writeBuffer(buffer, 0, pass);
    });
    dispatch(gpu, [trace, { 0: traced }, GROUPS, GROUPS], [gather, { 0: gathered }, GROUPS, GROUPS]);
    const accumulated = await read(gpu, images[0]);
    let at = 0;
    const filters = [[variance, { 2: image(variance, 0, 0, { 121: histories }) }, GROUPS, GROUPS]];
    at = 1;
    for (let i = 1; i <= passes; i++) {
      filters.push([atrous, { 2: image(atrous, at, i) }, GROUPS, GROUPS]);
      at = 1 - at;
    }
    dispatch(gpu, ...filters);
    const filtered = await read(gpu, images[at]);
    const raw = await read(gpu, noisy);
    [raw, accumulated, filtered].forEach((data, i) => show(views[i], new Float32Array(data), SIDE, SIDE));
    frame += 1;
  };
  let running = false;
  const loop = async () => {
    if (running) return;
    running = true;
    while (host.isConnected && !paused) {
      await render();
      await new Promise((next) => requestAnimationFrame(next));
    }
    running = false;
  };
  const controls = new Controls(box, () => paused && render());
  controls.slider("passes", "Passes", { min: 0, max: 5, value: 5, step: 1 });
  controls.slider("sigma", "σ of luminance", { min: 0.5, max: 16, value: 4, log: true });
  controls.slider("frames", "Frames kept", { min: 1, max: 64, value: 16, log: true });
  controls.choice("clamp", "Variance clamp", ["off", "5 × 5"]);
  controls.slider("gamma", "γ of the clamp", { min: 0.25, max: 4, value: 1, log: true });
  controls.slider("light", "Light's radius", { min: 0.05, max: 1.5, value: 0.7 });
  controls.choice("motion", "Motion", ["still", "ball moves", "light moves"]);
  controls.button("Forget", () => {
    restart = true;
    if (paused) render();
  });
  controls.button("Pause or go on", () => {
    paused = !paused;
    loop();
  });
  host.append(element("p", { className: "note" }, "Nothing is reprojected here: with motion, the history is wrong where something moved, which is what the clamp is for."));
  await render();
  loop();
}
