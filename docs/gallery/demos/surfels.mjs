// Surfels that spawn where too few cover a ball and a floor.

import { bind, dispatch, pipeline, read, storage } from "../gpu.mjs";
import { Controls, canvas, element, show } from "../ui.mjs";

const SIDE = 256;
const TILES = SIDE / 16;
const MOST = 1024;
const MAIN = `
struct Settings {
    count: u32,
    frame: u32,
    radius: f32,
    goal: f32,
    rate: f32,
    view: u32,
    turn: vec2f,
}

@group(0) @binding(0) var<storage, read> values: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> image: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> keys: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> born: array<vec4f>;
@group(0) @binding(4) var<uniform> settings: Settings;

fn surfel_read(entry: u32) -> Surfel {
    let place = values[2u * entry];
    let shape = values[2u * entry + 1u];
    return Surfel(place.xyz, place.w, shape.xyz, 0u);
}

// A colour of its own for each.
fn surfel_read_irradiance(entry: u32) -> vec3f {
    let bits = pcg3d(vec3u(entry, 1u, 2u));
    return 0.15 + 0.85 * vec3f(pcg_unit(bits.x), pcg_unit(bits.y), pcg_unit(bits.z));
}

fn view() -> Camera {
    // settings.turn is the sine and cosine of the eye's angle.
    let back = vec3f(settings.turn.x * 0.93, 0.36, settings.turn.y * 0.93);
    let right = vec3f(settings.turn.y, 0.0, -settings.turn.x);
    let up = vec3_cross(back, right);
    return Camera(
        back * 4.5 + vec3f(0.0, 0.6, 0.0), 0.6 * right, 0.6 * up, -1.0 * back,
        vec2f(1.0 / ${SIDE}.0),
    );
}

struct Seen {
    point: vec3f,
    depth: f32,
    normal: vec3f,
    cosine: f32,
}

fn seen(pixel: vec2u) -> Seen {
    let camera = view();
    let ray = camera_ray(vec2f(pixel) + 0.5, camera);
    let ball = sphere_intersect(Ray(ray.origin, ray.direction, 0.0, 1e6), vec3f(0.0, 0.8, 0.0), 0.8);
    var t = 0.0;
    var normal = vec3f(0.0, 1.0, 0.0);
    if ball.hit != 0u {
        t = ball.t;
        normal = vec3_normalize(ray.origin + t * ray.direction - vec3f(0.0, 0.8, 0.0));
    } else if ray.direction.y < -1e-3 {
        t = -ray.origin.y / ray.direction.y;
    }
    if t <= 0.0 || t > 12.0 {
        return Seen(vec3f(0.0), 0.0, normal, 0.0);
    }
    let unit = vec3_normalize(ray.direction);
    let ahead = vec3_dot(unit, camera.forward);
    let depth = t * vec3_dot(ray.direction, camera.forward);
    let cosine = -vec3_dot(normal, unit) * ahead;
    return Seen(ray.origin + t * ray.direction, depth, normal, max(cosine, 0.0));
}

@compute @workgroup_size(8, 8)
fn cover(@builtin(global_invocation_id) id: vec3u) {
    let index = id.y * ${SIDE}u + id.x;
    let here = seen(id.xy);
    if here.depth <= 0.0 {
        image[index] = vec4f(0.02, 0.02, 0.03, 1.0);
        return;
    }
    let list = vec2u(0u, settings.count);
    let coverage = surfel_coverage(here.point, here.normal, list);
    let in_tile = (id.y % 16u) * 16u + id.x % 16u;
    let tile = id.y / 16u * ${TILES}u + id.x / 16u;
    atomicMin(&keys[tile], surfel_tile_key(coverage, in_tile));
    let shade = 0.25 + 0.75 * max(vec3_dot(here.normal, vec3f(0.48, 0.8, 0.36)), 0.0);
    if settings.view == 0u {
        let found = surfel_gather(here.point, here.normal, list);
        image[index] = vec4f(select(vec3f(0.02), found.irradiance * shade, found.weight > 0.0), 1.0);
    } else {
        let part = clamp(coverage / settings.goal, 0.0, 1.0);
        image[index] = vec4f(vec3f(1.0 - part, part, 0.1) * shade, 1.0);
    }
}

@compute @workgroup_size(8, 8)
fn spawn(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= ${TILES}u || id.y >= ${TILES}u {
        return;
    }
    let tile = id.y * ${TILES}u + id.x;
    born[2u * tile] = vec4f(0.0);
    born[2u * tile + 1u] = vec4f(0.0);
    let key = atomicLoad(&keys[tile]);
    if key == 0xffffffffu {
        return;
    }
    let in_tile = surfel_tile_index(key);
    let pixel = id.xy * 16u + vec2u(in_tile % 16u, in_tile / 16u);
    let here = seen(pixel);
    let area = surfel_pixel_area(here.depth, here.cosine, view());
    let chance = surfel_spawn_chance(
        surfel_tile_coverage(key), settings.goal, area, 256.0, settings.radius, settings.rate,
    );
    if surfel_spawns(pixel, settings.frame, chance) != 0u {
        born[2u * tile] = vec4f(here.point, settings.radius);
        born[2u * tile + 1u] = vec4f(here.normal, 0.0);
    }
}`;

export async function start(gpu, libraries, host) {
  const source = libraries.surfels + MAIN;
  const cover = await pipeline(gpu, source, "cover");
  const spawn = await pipeline(gpu, source, "spawn");
  const values = storage(gpu, 32 * MOST);
  const image = storage(gpu, 16 * SIDE * SIDE);
  const keys = storage(gpu, 4 * TILES * TILES);
  const born = storage(gpu, 32 * TILES * TILES);
  const settings = gpu.createBuffer({ size: 32, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
  const covered = bind(gpu, cover, 0, { 0: values, 1: image, 2: keys, 4: settings });
  const spawned = bind(gpu, spawn, 0, { 2: keys, 3: born, 4: settings });
  const on = canvas(SIDE, SIDE, "Surfels over a ball and a floor");
  on.style.width = "384px";
  const box = element("div", { className: "controls" });
  const note = element("p", { className: "note", ariaLive: "polite" });
  host.append(element("h2", {}, "Surfels spawning"), on, box, note);
  let count = 0;
  let frame = 0;
  const render = async () => {
    const v = controls.values;
    const bytes = new ArrayBuffer(32);
    const [floats, whole] = [new Float32Array(bytes), new Uint32Array(bytes)];
    whole.set([count, frame]);
    floats.set([v.radius, v.goal, v.rate], 2);
    whole[5] = v.view === "surfels" ? 0 : 1;
    const turn = (v.turn * Math.PI) / 180;
    floats.set([Math.sin(turn), Math.cos(turn)], 6);
    gpu.queue.writeBuffer(settings, 0, bytes);
    gpu.queue.writeBuffer(keys, 0, new Uint32Array(TILES * TILES).fill(0xffffffff));
    const tiles = Math.ceil(TILES / 8);
    dispatch(gpu, [cover, { 0: covered }, SIDE / 8, SIDE / 8], [spawn, { 0: spawned }, tiles, tiles]);
    const found = new Float32Array(await read(gpu, born));
    for (let i = 0; i < TILES * TILES && count < MOST; i++) {
      if (found[8 * i + 3] > 0) gpu.queue.writeBuffer(values, 32 * count++, found.slice(8 * i, 8 * i + 8));
    }
    show(on, new Float32Array(await read(gpu, image)), SIDE, SIDE);
    note.textContent = `${count} surfels after ${frame + 1} frames${count === MOST ? ": all that there is room for" : ""}.`;
    frame += 1;
  };
  let running = false;
  const loop = async () => {
    if (running) return;
    running = true;
    while (host.isConnected) {
      await render();
      await new Promise((next) => setTimeout(next, 50));
    }
    running = false;
  };
  const forget = () => {
    count = 0;
    frame = 0;
  };
  const controls = new Controls(box, () => {});
  controls.choice("view", "Show", ["surfels", "coverage"]);
  controls.slider("radius", "Radius", { min: 0.08, max: 0.6, value: 0.22, log: true });
  controls.slider("goal", "Wanted coverage", { min: 0.25, max: 3, value: 1 });
  controls.slider("rate", "Rate", { min: 0.01, max: 1, value: 0.2, log: true });
  controls.slider("turn", "View's angle", { min: -180, max: 180, value: 25, step: 1 });
  controls.button("Start again", forget);
  await render();
  loop();
}
