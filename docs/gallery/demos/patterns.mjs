// Points filling in: Halton, PCG, and Halton rotated for another pixel.

import { numbers } from "../gpu.mjs";
import { Controls, canvas, drawn, element, palette } from "../ui.mjs";

const MOST = 4096;
const MAIN = `
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let i = id.x;
    if 2u * i + 1u >= arrayLength(&result) {
        return;
    }
    let seed = u32(settings[0].x);
    let base = vec2u(u32(settings[0].y), u32(settings[0].z));
    let halton = vec2f(halton_radical_inverse(base.x, i), halton_radical_inverse(base.y, i));
    let first = pcg_next(pcg_seed(vec2u(i, seed), 0u));
    let second = pcg_next(first.state);
    let shift = pcg2d(vec2u(seed, 7u));
    let rotated = vec2f(
        halton_rotate(halton.x, pcg_unit(shift.x)), halton_rotate(halton.y, pcg_unit(shift.y)),
    );
    result[2u * i] = vec4f(halton, pcg_unit(first.value), pcg_unit(second.value));
    result[2u * i + 1u] = vec4f(rotated, 0.0, 0.0);
}`;

export async function start(gpu, libraries, host) {
  const run = await numbers(gpu, libraries.patterns, MAIN, 2 * MOST);
  const names = ["Halton", "PCG", "Halton, rotated"];
  const views = names.map((name) => canvas(280, 280, `Points by ${name}`));
  const figures = names.map((name, i) => element("figure", {}, views[i], element("figcaption", {}, name)));
  const box = element("div", { className: "controls" });
  host.append(element("h2", {}, "Points filling in"), element("div", { className: "row" }, ...figures), box);
  let points = new Float32Array();
  let shown = 0;
  let timer = 0;
  const draw = () => {
    const colors = palette();
    views.forEach((on, v) => {
      const context = on.getContext("2d");
      context.fillStyle = colors.paper;
      context.fillRect(0, 0, on.width, on.height);
      context.fillStyle = [colors.one, colors.two, colors.three][v];
      for (let i = 0; i < shown; i++) {
        const from = 8 * i + [0, 2, 4][v];
        context.fillRect(points[from] * on.width - 1, (1 - points[from + 1]) * on.height - 1, 2.5, 2.5);
      }
      drawn(on);
    });
  };
  const grow = () => {
    const goal = Math.round(controls.values.count);
    shown = Math.min(goal, shown + Math.max(1, Math.round(goal / 60)));
    draw();
    timer = shown < goal ? requestAnimationFrame(grow) : 0;
  };
  const update = async () => {
    const { seed, bases } = controls.values;
    const [x, y] = bases.split(" and ").map(Number);
    points = await run([Math.round(seed), x, y, 0]);
    cancelAnimationFrame(timer);
    shown = 0;
    grow();
  };
  const controls = new Controls(box, update);
  controls.slider("count", "Points", { min: 16, max: MOST, value: 512, log: true });
  controls.slider("seed", "Seed", { min: 0, max: 63, value: 1, step: 1 });
  controls.choice("bases", "Bases", ["2 and 3", "5 and 7", "11 and 13", "29 and 31"]);
  controls.button("Again", update);
  await update();
}
