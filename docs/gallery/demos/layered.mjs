// A ball with a coat over metal or paint.

import { numbers } from "../gpu.mjs";
import { Controls, canvas, element, show } from "../ui.mjs";

const SIDE = 256;
const SAMPLES = 32;
const MAIN = `
const LAYERED_COUNT: u32 = 2u;

fn stack_of() -> LayeredStack {
    let metal = settings[0].x > 0.5;
    let tint = settings[2].xyz;
    let coat = LayeredLayer(
        vec3f(0.04), 1.5, settings[1].xyz * settings[0].w, ggx_alpha(settings[0].y, 0.0),
    );
    var base = LayeredLayer(tint, 1.0, vec3f(0.0), ggx_alpha(settings[0].z, 0.0));
    if !metal {
        base.reflectance = vec3f(0.04);
        base.eta = 1.5;
    }
    let diffuse = select(layered_diffuse(tint, base), vec3f(0.0), metal);
    return LayeredStack(array(coat, base), diffuse);
}

// A floor, a sky that is lighter above, and a lamp with a soft rim.
fn room(d: vec3f) -> vec3f {
    let turn = settings[3].x;
    let lamp = vec3_normalize(vec3f(0.8 * sin(turn), 0.6, 0.8 * cos(turn)));
    let near = clamp((vec3_dot(d, lamp) - 0.9) * 20.0, 0.0, 1.0);
    let sky = select(vec3f(0.12, 0.1, 0.09), vec3f(0.3, 0.36, 0.45) + 0.5 * d.y, d.y > 0.0);
    return sky + vec3f(settings[3].y * near);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&result) {
        return;
    }
    let pixel = vec2f(f32(id.x % ${SIDE}u), f32(id.x / ${SIDE}u)) + 0.5;
    let p = (pixel / ${SIDE}.0 * 2.0 - 1.0) * vec2f(1.12, -1.12);
    let square = vec3_dot(vec3f(p, 0.0), vec3f(p, 0.0));
    if square > 1.0 {
        result[id.x] = vec4f(vec3f(0.05 + 0.05 * (p.y + 1.0)), 1.0);
        return;
    }
    let n = vec3f(p, sqrt(1.0 - square));
    let frame = basis_from_normal(n);
    let wo = basis_to_local(frame, n, vec3f(0.0, 0.0, 1.0));
    let stack = stack_of();
    let spin = pcg2d(id.x * vec2u(1u, 7u) + vec2u(3u, 5u));
    var sum = vec3f(0.0);
    for (var i = 0u; i < ${SAMPLES}u; i++) {
        let u = vec3f(
            halton_rotate(halton_radical_inverse(2u, i), pcg_unit(spin.x)),
            halton_rotate(halton_radical_inverse(3u, i), pcg_unit(spin.y)),
            halton_rotate(halton_radical_inverse(5u, i), pcg_unit(spin.x ^ spin.y)),
        );
        let found = layered_sample(stack, wo, u);
        if found.pdf > 0.0 {
            sum += found.weight * room(basis_to_world(frame, n, found.direction));
        }
    }
    sum = sum / ${SAMPLES}.0;
    result[id.x] = vec4f(sum / (1.0 + 0.25 * sum), 1.0);
}`;

const TINTS = {
  gold: [1, 0.71, 0.29],
  copper: [0.95, 0.6, 0.5],
  "red paint": [0.65, 0.06, 0.05],
  "blue paint": [0.05, 0.16, 0.6],
  white: [0.9, 0.9, 0.9],
};

export async function start(gpu, libraries, host) {
  // The demonstration says how many layers there are, in its own text.
  const run = await numbers(gpu, libraries.layered, MAIN, SIDE * SIDE);
  const on = canvas(SIDE, SIDE, "A coated ball");
  const box = element("div", { className: "controls" });
  host.append(element("h2", {}, "A coated ball"), on, box);
  const update = async () => {
    const { base, tint, coat, rough, depth, turn, key } = controls.values;
    const metal = base === "metal" ? 1 : 0;
    // What the coat takes out: more of blue than of red.
    const taken = [0.15, 0.6, 1.4];
    const found = await run([
      metal, coat, rough, depth, ...taken, 0, ...TINTS[tint], 0, (turn * Math.PI) / 180, key, 0, 0,
    ]);
    show(on, found, SIDE, SIDE);
  };
  const controls = new Controls(box, update);
  controls.choice("base", "Base", ["metal", "paint"]);
  controls.choice("tint", "Tint", Object.keys(TINTS));
  controls.slider("coat", "Coat roughness", { min: 0.05, max: 1, value: 0.15 });
  controls.slider("rough", "Base roughness", { min: 0.1, max: 1, value: 0.5 });
  controls.slider("depth", "Coat's absorption", { min: 0, max: 2, value: 0.3 });
  controls.slider("turn", "Light's angle", { min: -170, max: 170, value: 40, step: 1 });
  controls.slider("key", "Light", { min: 0, max: 12, value: 5 });
  await update();
}
