//! A stack of layers: the pair and its contract.

pub use raytwin_cpu::brdf::layered::*;

/// The WGSL twin, without what it requires and without its number of layers.
pub const WGSL: &str = raytwin_wgsl::brdf::LAYERED;

#[cfg(feature = "contract")]
crate::value_struct!(LayeredLayer {
    reflectance: glam::Vec3,
    eta: f32,
    depth: glam::Vec3,
    alpha: glam::Vec2,
});

#[cfg(feature = "contract")]
crate::value_struct!([const N: usize] LayeredStack = LayeredStack<N> {
    layers: [LayeredLayer; N],
    diffuse: glam::Vec3,
});

#[cfg(feature = "contract")]
crate::value_struct!([const N: usize] LayeredPmf = LayeredPmf<N> {
    layers: [f32; N],
    diffuse: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!(LayeredSample {
    direction: glam::Vec3,
    pdf: f32,
    weight: glam::Vec3,
    lobe: u32,
});

/// The model in double precision, from the formulas and in another form than
/// the twins: slopes for the distribution, angles for refraction.
#[cfg(feature = "contract")]
mod exact {
    use crate::brdf::ggx::exact as ggx;
    use crate::brdf::ggx_bounded::exact as bounded;
    use crate::brdf::ggx_visible::exact as caps;
    use glam::{DVec2, DVec3};
    use std::f64::consts::{FRAC_PI_4, PI};

    /// Reflectance, eta, depth, alpha.
    pub type Layer = (DVec3, f64, DVec3, DVec2);
    /// A stack of any height.
    pub struct Stack<'a> {
        pub layers: &'a [Layer],
        pub diffuse: DVec3,
    }

    pub fn luminance(c: DVec3) -> f64 {
        c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
    }

    pub fn grazing(cos: f64, alpha: DVec2) -> f64 {
        let a = (alpha.x * alpha.y).sqrt();
        let x = 1.0 - cos;
        x.powi(5) / ((1.0 + 8.0 * a).powi(-2) + 19.0 * a * x * x)
    }

    pub fn reflectance(layer: &Layer, cos: f64) -> DVec3 {
        let g = grazing(cos, layer.3);
        layer.0 * (1.0 - g) + g
    }

    pub fn refract(w: DVec3, eta: f64) -> DVec3 {
        let side = w.truncate() / eta;
        // The length may differ from one by rounding: keep Snell's z.
        side.extend(((eta * eta - 1.0 + w.z * w.z) / (eta * eta)).sqrt())
    }

    pub fn diffuse(albedo: DVec3, layer: &Layer) -> DVec3 {
        let a = (layer.3.x * layer.3.y).sqrt();
        let b = 1.0 / (21.0 + 175.0 * a);
        let outside = (DVec3::ONE - layer.0) * (1.0 - b);
        let r = DVec3::ONE - outside / (layer.1 * layer.1);
        albedo / (DVec3::ONE - albedo * r)
    }

    /// D · V of one interface.
    fn lobe(o: DVec3, i: DVec3, a: DVec2) -> f64 {
        ggx::d(ggx::half(o, i), a) * ggx::g2(o, i, a) / (4.0 * o.z * i.z)
    }

    /// The value by lobe: each interface's, then the base's.
    pub fn lobes(stack: &Stack, wo: DVec3, wi: DVec3) -> Vec<DVec3> {
        let (mut o, mut i, mut through) = (wo, wi, DVec3::ONE);
        let mut out = Vec::new();
        for layer in stack.layers {
            let f = layer.0 + (DVec3::ONE - layer.0) * (1.0 - 0.5 * (o + i).length()).powi(5);
            out.push(through * f * lobe(o, i, layer.3));
            let (bo, bi) = (refract(o, layer.1), refract(i, layer.1));
            let path = 1.0 / bo.z + 1.0 / bi.z;
            let t = (DVec3::ONE - reflectance(layer, o.z)) * (DVec3::ONE - reflectance(layer, i.z));
            through *= t * (layer.2 * -path).exp() / (layer.1 * layer.1);
            (o, i) = (bo, bi);
        }
        out.push(through * stack.diffuse / PI);
        out
    }

    pub fn pmf(stack: &Stack, wo: DVec3) -> Vec<f64> {
        let (mut o, mut through) = (wo, DVec3::ONE);
        let mut weights = Vec::new();
        for layer in stack.layers {
            let r = reflectance(layer, o.z);
            weights.push(luminance(through * r));
            o = refract(o, layer.1);
            let t = (layer.2 * (-2.0 / o.z)).exp();
            through *= (DVec3::ONE - r) * t / (layer.1 * layer.1);
        }
        weights.push(luminance(through * stack.diffuse));
        let total: f64 = weights.iter().sum();
        weights.iter().map(|w| w / total).collect()
    }

    /// The density by lobe, each times its probability.
    pub fn densities(stack: &Stack, wo: DVec3, wi: DVec3) -> Vec<f64> {
        let pmf = pmf(stack, wo);
        let (mut o, mut i, mut jacobian) = (wo, wi, 1.0);
        let mut out = Vec::new();
        for (layer, p) in stack.layers.iter().zip(&pmf) {
            out.push(p * jacobian * bounded::direction_pdf(o, i, layer.3));
            let below = refract(i, layer.1);
            jacobian *= i.z / (layer.1 * layer.1 * below.z);
            o = refract(o, layer.1);
            i = below;
        }
        out.push(pmf[stack.layers.len()] * wi.z / PI);
        out
    }

    /// By how much an error of a direction grows in each lobe: the
    /// distribution's slope, `4 |tan θ| / α² / (1 + tan² θ / α²) ≤ 2 / α`, once
    /// for each of the two directions that were rounded on the way down.
    pub fn condition(stack: &Stack) -> Vec<f64> {
        stack
            .layers
            .iter()
            .map(|l| 1.0 + 4.0 / l.3.min_element())
            .chain([1.0])
            .collect()
    }

    /// Shirley and Chiu's disk, lifted.
    fn cosine(u: DVec2) -> DVec3 {
        let v = u * 2.0 - 1.0;
        let r = v.abs().max_element();
        let angle = if r == 0.0 {
            0.0
        } else if v.x.abs() > v.y.abs() {
            FRAC_PI_4 * v.y / v.x + if v.x < 0.0 { PI } else { 0.0 }
        } else {
            PI / 2.0 - FRAC_PI_4 * v.x / v.y + if v.y < 0.0 { PI } else { 0.0 }
        };
        (DVec2::from_angle(angle) * r).extend(((1.0 - r) * (1.0 + r)).sqrt())
    }

    /// How far the drawn normal's roundings go, and where a direction leaves
    /// through interfaces near the edge of total reflection.
    pub fn spread(stack: &Stack, wo: DVec3, u: DVec3) -> f64 {
        let (_, lobe, margin) = sample(stack, wo, u);
        let lobe = lobe as usize;
        if lobe == stack.layers.len() {
            return 1.0;
        }
        let o = stack.layers[..lobe].iter().fold(wo, |o, l| refract(o, l.1));
        let a = stack.layers[lobe].3;
        let normal = caps::condition(u.truncate(), o, a, bounded::depth(o, a));
        let out: f64 = stack.layers[..lobe].iter().map(|l| l.1 * l.1).product();
        (1.0 + normal) * out / margin.clamp(1e-3, 1.0)
    }

    /// Direction and lobe, none if dropped; and how close a choice was.
    pub fn sample(stack: &Stack, wo: DVec3, u: DVec3) -> (Option<DVec3>, u32, f64) {
        let mut margin = f64::INFINITY;
        let mut below = 0.0;
        let mut lobe = 0;
        for p in &pmf(stack, wo)[..stack.layers.len()] {
            below += p;
            margin = margin.min((u.z - below).abs());
            lobe += usize::from(u.z >= below);
        }
        if lobe == stack.layers.len() {
            let i = cosine(u.truncate());
            return ((i.z > 0.0).then_some(i), lobe as u32, margin.min(i.z));
        }
        let o = stack.layers[..lobe].iter().fold(wo, |o, l| refract(o, l.1));
        let a = stack.layers[lobe].3;
        let h = caps::sample(DVec2::new(u.x, u.y), o, a, bounded::depth(o, a));
        let mut i = ggx::reflect(o, h);
        margin = margin.min(i.z.abs());
        for layer in stack.layers[..lobe].iter().rev() {
            if i.z <= 0.0 {
                return (None, lobe as u32, margin);
            }
            let square = 1.0 - layer.1 * layer.1 * (1.0 - i.z * i.z);
            margin = margin.min(square.abs());
            if square <= 0.0 {
                return (None, lobe as u32, margin);
            }
            i = (i.truncate() * layer.1).extend(square.sqrt());
        }
        ((i.z > 0.0).then_some(i), lobe as u32, margin)
    }
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    kernels::<3>()
}

/// One function, as a renderer has it, with the built-in functions.
#[cfg(feature = "contract")]
const BY_HAND: &str = "
fn baseline(stack: LayeredStack, wo: vec3f, wi: vec3f) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    let y = vec3f(0.2126, 0.7152, 0.0722);
    var sum = 0.0;
    var total = 0.0;
    var through = vec3f(1.0);
    var o = wo;
    var i = wi;
    var jacobian = 1.0;
    for (var k = 0u; k < LAYERED_COUNT; k++) {
        let l = stack.layers[k];
        // Probability of the layer.
        let x = 1.0 - o.z;
        let a = sqrt(l.alpha.x * l.alpha.y);
        let q = (1.0 + 8.0 * a) * (1.0 + 8.0 * a);
        let g = x * x * x * x * x * q / (1.0 + 19.0 * a * x * x * q);
        let r = l.reflectance + (1.0 - l.reflectance) * g;
        let w = dot(through * r, y);
        total += w;
        // Its density.
        let h = normalize(o + i);
        let t = vec3f(h.xy / l.alpha, h.z);
        let p = dot(t, t);
        let d = 1.0 / (3.14159265 * l.alpha.x * l.alpha.y * p * p);
        let least = min(min(l.alpha.x, l.alpha.y), 1.0);
        let s = 1.0 + length(o.xy);
        let kept = (1.0 - least * least) * s * s / (s * s + least * least * o.z * o.z);
        let area = 2.0 * (kept * o.z + length(vec3f(l.alpha * o.xy, o.z)));
        sum += w * jacobian * d / area;
        // Into the next.
        let below_o = vec3f(o.xy, sqrt(l.eta * l.eta - 1.0 + o.z * o.z)) / l.eta;
        let below_i = vec3f(i.xy, sqrt(l.eta * l.eta - 1.0 + i.z * i.z)) / l.eta;
        through *= (1.0 - r) * exp(-2.0 * l.depth / below_o.z) / (l.eta * l.eta);
        jacobian *= i.z / (l.eta * l.eta * below_i.z);
        o = below_o;
        i = below_i;
    }
    let base = dot(through * stack.diffuse, y);
    return (sum + base * wi.z * 0.31830987) / (total + base);
}";

#[cfg(feature = "contract")]
fn by_hand<const N: usize>(stack: LayeredStack<N>, wo: glam::Vec3, wi: glam::Vec3) -> f32 {
    use glam::{Vec3, Vec3Swizzles};
    use std::f32::consts::PI;
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    let y = Vec3::new(0.2126, 0.7152, 0.0722);
    let (mut sum, mut total, mut jacobian) = (0.0, 0.0, 1.0);
    let (mut through, mut o, mut i) = (Vec3::ONE, wo, wi);
    for l in stack.layers {
        let x = 1.0 - o.z;
        let a = (l.alpha.x * l.alpha.y).sqrt();
        let q = (1.0 + 8.0 * a) * (1.0 + 8.0 * a);
        let g = x * x * x * x * x * q / (1.0 + 19.0 * a * x * x * q);
        let r = l.reflectance + (1.0 - l.reflectance) * g;
        let w = (through * r).dot(y);
        total += w;
        let h = (o + i).normalize();
        let p = (h.xy() / l.alpha).extend(h.z).length_squared();
        let d = 1.0 / (PI * l.alpha.x * l.alpha.y * p * p);
        let least = l.alpha.min_element().min(1.0);
        let s = 1.0 + o.xy().length();
        let kept = (1.0 - least * least) * s * s / (s * s + least * least * o.z * o.z);
        let area = 2.0 * (kept * o.z + (l.alpha * o.xy()).extend(o.z).length());
        sum += w * jacobian * d / area;
        let below = |w: Vec3| w.xy().extend((l.eta * l.eta - 1.0 + w.z * w.z).sqrt()) / l.eta;
        let (below_o, below_i) = (below(o), below(i));
        let passed = (-2.0 * l.depth / below_o.z).exp();
        through *= (1.0 - r) * passed / (l.eta * l.eta);
        jacobian *= i.z / (l.eta * l.eta * below_i.z);
        (o, i) = (below_o, below_i);
    }
    let base = (through * stack.diffuse).dot(y);
    (sum + base * wi.z / PI) / (total + base)
}

/// The contract for stacks of `N` layers, 1 to 4. The registry has that of 3;
/// tests run the others too.
#[cfg(feature = "contract")]
#[must_use]
pub fn kernels<const N: usize>() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};
    use exact::Stack;
    use glam::{DVec2, DVec3, Vec2, Vec3};

    const MODULE: &str = "brdf/layered";
    const PAPER: &str = "Weidlich and Wilkie 2007, GRAPHITE; solid angle put right";
    const OWN: &str = "own fit to quadrature of Trowbridge-Reitz with Schlick's term";
    let count = [
        "const LAYERED_COUNT: u32 = 1u;",
        "const LAYERED_COUNT: u32 = 2u;",
        "const LAYERED_COUNT: u32 = 3u;",
        "const LAYERED_COUNT: u32 = 4u;",
    ][N - 1];

    type Wide<const N: usize> = ([exact::Layer; N], DVec3);

    fn eval<const N: usize>(stack: LayeredStack<N>, wo: Vec3, wi: Vec3) -> Vec3 {
        layered_eval(&stack, wo, wi)
    }
    fn pmf<const N: usize>(stack: LayeredStack<N>, wo: Vec3) -> LayeredPmf<N> {
        layered_pmf(&stack, wo)
    }
    fn pdf<const N: usize>(stack: LayeredStack<N>, wo: Vec3, wi: Vec3) -> f32 {
        layered_pdf(&stack, wo, wi)
    }
    fn sample<const N: usize>(stack: LayeredStack<N>, wo: Vec3, u: Vec3) -> LayeredSample {
        layered_sample(&stack, wo, u)
    }
    fn view<const N: usize>((layers, diffuse): &Wide<N>) -> Stack<'_> {
        Stack {
            layers,
            diffuse: *diffuse,
        }
    }
    fn sum(parts: &[DVec3]) -> DVec3 {
        parts.iter().copied().sum()
    }
    /// Each lobe's value times its condition.
    fn eval_scale(stack: &Stack, wo: DVec3, wi: DVec3) -> f64 {
        exact::lobes(stack, wo, wi)
            .iter()
            .zip(exact::condition(stack))
            .map(|(v, c)| v.max_element() * c)
            .sum()
    }
    fn pdf_scale(stack: &Stack, wo: DVec3, wi: DVec3) -> f64 {
        exact::densities(stack, wo, wi)
            .iter()
            .zip(exact::condition(stack))
            .map(|(v, c)| v * c)
            .sum()
    }

    let layer: Domain<LayeredLayer> = domains::vec3(domains::range(0.02, 0.95))
        .and(domains::range(1.0, 2.0))
        // Half a degree above the horizon a depth of 0.1 counts twentyfold for
        // each layer that does not refract: more would underflow.
        .and(domains::vec3(domains::range(0.0, 0.1)))
        .and(domains::log_range(0.05, 1.0))
        .and(domains::log_range(0.05, 1.0))
        .map(|((((reflectance, eta), depth), x), y)| LayeredLayer {
            reflectance,
            eta,
            depth,
            alpha: Vec2::new(x, y),
        });
    let words = layer.words();
    let one = layer.clone();
    let layers = Domain::new(N * words, move |w: &[u32]| {
        std::array::from_fn(|k| one.make(&w[k * words..(k + 1) * words]))
    });
    let stack: Domain<LayeredStack<N>> = layers
        .and(domains::vec3(domains::range(0.0, 1.0)))
        .map(|(layers, diffuse)| LayeredStack { layers, diffuse });
    // Above the horizon, down to half a degree.
    let upper: Domain<Vec3> = domains::range(0.01, 1.0)
        .and(domains::unit())
        .map(|(z, turn)| {
            let (s, c) = (f64::from(turn) * std::f64::consts::TAU).sin_cos();
            let r = ((1.0 - f64::from(z)) * (1.0 + f64::from(z))).sqrt();
            Vec3::new((r * c) as f32, (r * s) as f32, z)
        });
    let cos = domains::range(0.0, 1.0);

    let coat = LayeredLayer {
        reflectance: Vec3::splat(0.04),
        eta: 1.5,
        depth: Vec3::ZERO,
        alpha: Vec2::splat(0.05),
    };
    let gold = LayeredLayer {
        reflectance: Vec3::new(1.0, 0.78, 0.34),
        eta: 1.0,
        depth: Vec3::ZERO,
        alpha: Vec2::new(0.3, 0.1),
    };
    // Between equal media, of the roughest kind: only its edge shines.
    let veil = LayeredLayer {
        reflectance: Vec3::ZERO,
        eta: 1.0,
        depth: Vec3::ZERO,
        alpha: Vec2::ONE,
    };
    let hard_stacks: [LayeredStack<N>; 3] = [
        LayeredStack {
            layers: std::array::from_fn(|k| if k + 1 == N { gold } else { coat }),
            diffuse: Vec3::ZERO,
        },
        LayeredStack {
            layers: [veil; N],
            diffuse: Vec3::ONE,
        },
        LayeredStack {
            layers: [coat; N],
            diffuse: Vec3::new(0.8, 0.0, 0.2),
        },
    ];
    let grazing = Vec3::new(0.99999994, 0.0, 1.745e-4);
    let hard_w = [
        Vec3::Z,
        Vec3::new(0.6, 0.0, 0.8),
        Vec3::new(0.0, 0.9998477, 0.017452406),
        grazing,
    ];
    let pairs = || {
        let mut out = Vec::new();
        for s in hard_stacks {
            for o in hard_w {
                out.extend(hard_w.map(|i| (s, o, i)));
            }
        }
        out
    };
    let below = [
        (hard_stacks[0], Vec3::Z, Vec3::new(0.6, 0.0, -0.8)),
        (hard_stacks[0], Vec3::new(0.6, 0.0, -0.8), Vec3::Z),
        (hard_stacks[2], Vec3::X, Vec3::Z),
    ];
    // The widest interval of many drawn.
    let glossy = |reflectance: [f32; 3], eta, depth: [f32; 3], alpha: [f32; 2]| LayeredLayer {
        reflectance: reflectance.into(),
        eta,
        depth: depth.into(),
        alpha: alpha.into(),
    };
    let layers = [
        glossy(
            [0.7345413, 0.90420675, 0.73727804],
            1.9474094,
            [0.029473796, 0.053620514, 0.054420326],
            [1.0, 0.9236952],
        ),
        glossy(
            [0.02, 0.07683171, 0.1851142],
            1.1106552,
            [0.028207298, 0.038390175, 0.033265565],
            [0.21511583, 0.44992554],
        ),
        glossy(
            [0.9170665, 0.26673985, 0.6117275],
            1.5166819,
            [0.021102794, 0.054666307, 0.02313508],
            [0.8994276, 0.19991581],
        ),
    ];
    let worst = (
        LayeredStack {
            layers: std::array::from_fn(|k| layers[k.min(2)]),
            diffuse: Vec3::new(0.26180145, 1.0, 0.5239354),
        },
        Vec3::new(0.4484648, -0.089312404, 0.88932705),
        Vec3::new(0.042594492, 0.7770149, 0.18179357),
    );
    let on_top = |o: DVec3, i: DVec3| o.z > 0.0 && i.z > 0.0;

    vec![
        Kernel::new(
            MODULE,
            "layered_grazing",
            ["cos", "alpha"],
            layered_grazing,
            exact::grazing,
            cos.clone()
                .and(domains::log_range(1e-4, 1.0))
                .and(domains::log_range(1e-4, 1.0))
                .map(|((c, x), y)| (c, Vec2::new(x, y))),
        )
        .scale_by(|c: f64, a: DVec2| exact::grazing(c, a) * 5.0 / (1.0 - c).max(1e-6))
        .few_ulp(1.5, 9.0)
        .hard([
            (0.0, Vec2::splat(1e-4)),
            (1.0, Vec2::splat(1e-4)),
            (1.0, Vec2::ONE),
            (0.99999994, Vec2::splat(0.5)),
        ])
        .source(OWN)
        .fixture(count, vec![])
        .build(),
        Kernel::new(
            MODULE,
            "layered_reflectance",
            ["layer", "cos"],
            layered_reflectance,
            |l: exact::Layer, c: f64| exact::reflectance(&l, c),
            layer.clone().and(cos).map(|(l, c)| (l, c)),
        )
        .few_ulp(6.75, 39.0)
        .hard([
            (coat, 0.0),
            (coat, 1.0),
            (gold, 1.0),
            (gold, 0.0),
            (veil, 0.5),
        ])
        .source(OWN)
        .fixture(count, vec![])
        .build(),
        Kernel::new(
            MODULE,
            "layered_refract",
            ["w", "eta"],
            layered_refract,
            exact::refract,
            upper
                .clone()
                .and(domains::range(1.0, 2.5))
                .map(|(w, e)| (w, e)),
        )
        .few_ulp(2.75, 11.0)
        .hard(
            hard_w
                .iter()
                .flat_map(|&w| [1.0, 1.0000001, 1.5, 2.5].map(|e| (w, e))),
        )
        .source("Snell's law about the normal")
        .fixture(count, vec![])
        .build(),
        Kernel::new(
            MODULE,
            "layered_diffuse",
            ["albedo", "layer"],
            layered_diffuse,
            |albedo: DVec3, l: exact::Layer| exact::diffuse(albedo, &l),
            domains::vec3(domains::range(0.0, 1.0))
                .and(layer)
                .map(|(a, l)| (a, l)),
        )
        // 1 - ρ r is as small as the part of the light that gets out.
        .scale_by(|albedo: DVec3, l: exact::Layer| {
            let d = exact::diffuse(albedo, &l);
            d.max_element().powi(2)
        })
        .few_ulp(3.25, 9.0)
        .hard([
            (Vec3::ONE, coat),
            (Vec3::ZERO, coat),
            (Vec3::ONE, veil),
            (Vec3::splat(0.5), coat),
        ])
        .source("geometric series of internal reflections; own bound of the mean")
        .fixture(count, vec![])
        .build(),
        Kernel::new(
            MODULE,
            "layered_eval",
            ["stack", "wo", "wi"],
            eval::<N>,
            move |s: Wide<N>, o: DVec3, i: DVec3| {
                if on_top(o, i) {
                    sum(&exact::lobes(&view(&s), o, i))
                } else {
                    DVec3::ZERO
                }
            },
            stack
                .clone()
                .and(upper.clone())
                .and(upper.clone())
                .map(|((s, o), i)| (s, o, i)),
        )
        .scale_by(move |s: Wide<N>, o: DVec3, i: DVec3| {
            if on_top(o, i) {
                eval_scale(&view(&s), o, i)
            } else {
                1.0
            }
        })
        .few_ulp(2.75, 31.0)
        .hard(pairs().into_iter().chain(below))
        .source(PAPER)
        .fixture(count, vec![])
        .build(),
        Kernel::new(
            MODULE,
            "layered_pmf",
            ["stack", "wo"],
            pmf::<N>,
            |s: Wide<N>, o: DVec3| {
                let p = exact::pmf(&view(&s), o);
                (std::array::from_fn(|k| p[k]), p[N])
            },
            stack.clone().and(upper.clone()).map(|(s, o)| (s, o)),
        )
        .scale(0.25)
        .few_ulp(5.75, 85.0)
        .hard(
            hard_stacks
                .iter()
                .flat_map(|&s| hard_w.iter().map(move |&o| (s, o))),
        )
        .source("the chapter's approximate visibility, as luminance")
        .fixture(count, vec![])
        .build(),
        Kernel::new(
            MODULE,
            "layered_pdf",
            ["stack", "wo", "wi"],
            pdf::<N>,
            move |s: Wide<N>, o: DVec3, i: DVec3| {
                if on_top(o, i) {
                    exact::densities(&view(&s), o, i).iter().sum::<f64>()
                } else {
                    0.0
                }
            },
            stack
                .clone()
                .and(upper.clone())
                .and(upper.clone())
                .map(|((s, o), i)| (s, o, i)),
        )
        .scale_by(move |s: Wide<N>, o: DVec3, i: DVec3| {
            if on_top(o, i) {
                pdf_scale(&view(&s), o, i)
            } else {
                1.0
            }
        })
        .few_ulp(3.0, 44.0)
        .hard(pairs().into_iter().chain(below))
        .source(PAPER)
        .baseline("by hand", BY_HAND, by_hand::<N>)
        .fixture(count, vec![])
        .build(),
        Kernel::new(
            MODULE,
            "layered_sample",
            ["stack", "wo", "u"],
            sample::<N>,
            |s: Wide<N>, o: DVec3, u: DVec3| {
                let stack = view(&s);
                let (direction, lobe, _) = exact::sample(&stack, o, u);
                let Some(i) = direction else {
                    return (DVec3::Z, 0.0, DVec3::ZERO, lobe);
                };
                let pdf: f64 = exact::densities(&stack, o, i).iter().sum();
                let value = sum(&exact::lobes(&stack, o, i));
                (i, pdf, value * (i.z / pdf), lobe)
            },
            stack
                .and(upper)
                .and(domains::vec3(domains::unit()))
                .map(|((s, o), u)| (s, o, u)),
        )
        // The direction's roundings move the density by its slope.
        .scale_by(|s: Wide<N>, o: DVec3, u: DVec3| {
            let stack = view(&s);
            let (direction, ..) = exact::sample(&stack, o, u);
            direction.map_or(1.0, |i| {
                let weight = sum(&exact::lobes(&stack, o, i)) * i.z;
                let pdf: f64 = exact::densities(&stack, o, i).iter().sum();
                let slope = pdf_scale(&stack, o, i);
                let value = eval_scale(&stack, o, i) * i.z / pdf;
                let ratio = weight.max_element() / pdf * slope / pdf;
                1.0 + slope + value + ratio
            }) * exact::spread(&stack, o, u)
        })
        .undecided(|s: Wide<N>, o: DVec3, u: DVec3| exact::sample(&view(&s), o, u).2 < 1e-3)
        .few_ulp(1.0, 70.0)
        .hard(
            hard_stacks
                .iter()
                .flat_map(|&s| {
                    hard_w.iter().flat_map(move |&o| {
                        [
                            Vec3::ZERO,
                            Vec3::splat(0.4),
                            Vec3::new(0.9, 0.3, 0.99999994),
                            Vec3::new(0.99999994, 0.5, 0.0),
                        ]
                        .map(move |u| (s, o, u))
                    })
                })
                .chain([worst]),
        )
        .source("the chapter: one layer by its visibility, the density of all")
        .fixture(count, vec![])
        .build(),
    ]
}
