//! Every technique, a line each.

use crate::contract::Technique;

macro_rules! registry {
    ($($group:ident / $name:ident;)*) => {
        /// Every technique with its contract. Tests, benches, the report and
        /// the tables in the docs walk this list and know nothing else.
        #[must_use]
        pub fn registry() -> Vec<Technique> {
            vec![$(Technique {
                name: concat!(stringify!($group), "/", stringify!($name)),
                kernels: crate::$group::$name::contract(),
            }),*]
        }
    };
}

registry! {
    brdf / compensation;
    brdf / cook_torrance;
    brdf / fresnel;
    brdf / ggx;
    brdf / ggx_bounded;
    brdf / ggx_ndf;
    brdf / ggx_visible;
    brdf / lambert;
    brdf / layered;
    brdf / medium;
    brdf / reflection;
    brdf / refract;
    filter / bilateral_upsample;
    filter / bilateral_variance;
    filter / firefly;
    filter / packed_visibility;
    filter / separable_blur;
    filter / spatial_reconstruct;
    filter / svgf;
    filter / tiles;
    gi / surfel;
    gi / surfel_grid;
    gi / surfel_irradiance;
    math / exponent;
    math / luminance;
    math / octahedral;
    math / sanitize;
    math / trig;
    math / vector;
    random / halton;
    random / pcg;
    ray / aabb;
    ray / bvh;
    ray / bvh_filter;
    ray / camera;
    ray / instance;
    ray / plane;
    ray / ray;
    ray / sphere;
    ray / triangle;
    sample / basis;
    sample / cone;
    sample / disk;
    sample / hemisphere;
    sample / sphere;
    temporal / accumulate;
    temporal / multiscale_mean;
    temporal / reproject;
    temporal / taa;
    temporal / variance_clamp;
    temporal / visibility_clamp;
}
