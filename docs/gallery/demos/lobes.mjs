// The lobe that GGX reflects into, in the plane of incidence, and directions
// drawn from bounded visible normals.

import { numbers } from "../gpu.mjs";
import { Controls, canvas, drawn, element, palette, short } from "../ui.mjs";

const STEPS = 721;
const DRAWN = 256;
const MAIN = `
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let i = id.x;
    if i >= arrayLength(&result) {
        return;
    }
    let alpha = ggx_alpha(settings[0].x, settings[0].z);
    let angle = settings[0].y;
    let wo = vec3f(-sin(angle), 0.0, cos(angle));
    if i < ${STEPS}u {
        let t = (f32(i) / ${STEPS - 1}.0 - 0.5) * 3.1415925;
        let wi = vec3f(sin(t), 0.0, cos(t));
        let value = cook_torrance_eval(wo, wi, alpha, vec3f(settings[0].w)) * max(wi.z, 0.0);
        result[i] = vec4f(value.x, ggx_bounded_direction_pdf(wo, wi, alpha), t, 0.0);
        return;
    }
    let u = vec2f(halton_radical_inverse(2u, i), halton_radical_inverse(3u, i));
    let found = ggx_bounded_direction_sample(u, wo, alpha);
    result[i] = vec4f(found.direction, found.pdf);
}`;

export async function start(gpu, libraries, host) {
  const run = await numbers(gpu, libraries.lobes, MAIN, STEPS + DRAWN);
  const on = canvas(640, 340, "A polar plot of the reflected light");
  const box = element("div", { className: "controls" });
  const note = element("p", { className: "note", ariaLive: "polite" });
  host.append(element("h2", {}, "The lobe"), on, box, note);
  const update = async () => {
    const { roughness, degrees, anisotropy, f0 } = controls.values;
    const found = await run([roughness, (degrees * Math.PI) / 180, anisotropy, f0]);
    const colors = palette();
    const context = on.getContext("2d");
    const [x, y, radius] = [320, 320, 300];
    context.fillStyle = colors.paper;
    context.fillRect(0, 0, on.width, on.height);
    context.strokeStyle = colors.faint;
    context.lineWidth = 1;
    context.beginPath();
    context.arc(x, y, radius, Math.PI, 2 * Math.PI);
    context.moveTo(0, y);
    context.lineTo(640, y);
    context.stroke();
    // The density's scale; values beside it.
    const curves = [0, 1].map((c) => Array.from({ length: STEPS }, (_, i) => found[4 * i + c]));
    curves.forEach((curve, c) => {
      const most = Math.max(...curve, 1e-20);
      context.strokeStyle = [colors.one, colors.two][c];
      context.lineWidth = 2;
      context.beginPath();
      curve.forEach((value, i) => {
        const t = found[4 * i + 2];
        const r = (value / most) * radius * 0.95;
        context.lineTo(x + r * Math.sin(t), y - r * Math.cos(t));
      });
      context.stroke();
    });
    // Directions, seen from the side.
    context.fillStyle = colors.three;
    for (let i = STEPS; i < STEPS + DRAWN; i++) {
      const [dx, dz, pdf] = [found[4 * i], found[4 * i + 2], found[4 * i + 3]];
      if (pdf > 0) context.fillRect(x + dx * radius - 1.5, y - dz * radius - 1.5, 3, 3);
    }
    const t = (degrees * Math.PI) / 180;
    context.strokeStyle = colors.ink;
    context.beginPath();
    context.moveTo(x - radius * Math.sin(t), y - radius * Math.cos(t));
    context.lineTo(x, y);
    context.stroke();
    drawn(on);
    note.textContent =
      `Blue: light reflected times cosine, largest ${short(Math.max(...curves[0]))}. ` +
      `Orange: density of the sampler, largest ${short(Math.max(...curves[1]))}. ` +
      `Green: ${DRAWN} drawn directions, from the side. Each curve has its own scale.`;
  };
  const controls = new Controls(box, update);
  controls.slider("roughness", "Roughness", { min: 0.1, max: 1, value: 0.45 });
  controls.slider("degrees", "Angle", { min: 0, max: 89, value: 50, step: 0.5 });
  controls.slider("anisotropy", "Anisotropy", { min: 0, max: 0.95, value: 0 });
  controls.slider("f0", "Reflectance", { min: 0.02, max: 1, value: 0.9 });
  await update();
}
