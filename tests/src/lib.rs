//! The proofs: what the tests, the benches and the report share.
//!
//! - [`gpu`] runs any kernel on any adapter, from its description alone.
//! - [`measure`] says how far results are from the truth and from each other.
//! - [`mod@derive`] and [`interval`] say how far WGSL lets them be.
//! - [`rays`] has the exact intersector, the generated meshes and the hard
//!   rays; [`embree`] the peer.
//! - [`twin`] runs either side of a kernel by its path.
//! - [`scene`] loads meshes.

pub mod crosscheck;
pub mod derive;
pub mod docs;
pub mod embree;
pub mod golden;
pub mod gpu;
pub mod interval;
pub mod measure;
pub mod rays;
pub mod scene;
pub mod statistics;
pub mod twin;

/// The README's Rust code compiles and runs.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;

/// The pages' Rust code compiles and runs.
#[cfg(doctest)]
#[doc = include_str!("../../docs/brdf/compensation.md")]
#[doc = include_str!("../../docs/brdf/cook_torrance.md")]
#[doc = include_str!("../../docs/brdf/fresnel.md")]
#[doc = include_str!("../../docs/brdf/ggx.md")]
#[doc = include_str!("../../docs/brdf/ggx_bounded.md")]
#[doc = include_str!("../../docs/brdf/ggx_ndf.md")]
#[doc = include_str!("../../docs/brdf/ggx_visible.md")]
#[doc = include_str!("../../docs/brdf/lambert.md")]
#[doc = include_str!("../../docs/brdf/layered.md")]
#[doc = include_str!("../../docs/brdf/medium.md")]
#[doc = include_str!("../../docs/brdf/reflection.md")]
#[doc = include_str!("../../docs/brdf/refract.md")]
#[doc = include_str!("../../docs/filter/bilateral_upsample.md")]
#[doc = include_str!("../../docs/filter/bilateral_variance.md")]
#[doc = include_str!("../../docs/filter/firefly.md")]
#[doc = include_str!("../../docs/filter/packed_visibility.md")]
#[doc = include_str!("../../docs/filter/separable_blur.md")]
#[doc = include_str!("../../docs/filter/spatial_reconstruct.md")]
#[doc = include_str!("../../docs/filter/svgf.md")]
#[doc = include_str!("../../docs/filter/tiles.md")]
#[doc = include_str!("../../docs/gi/surfel.md")]
#[doc = include_str!("../../docs/gi/surfel_grid.md")]
#[doc = include_str!("../../docs/gi/surfel_irradiance.md")]
#[doc = include_str!("../../docs/math/exponent.md")]
#[doc = include_str!("../../docs/math/luminance.md")]
#[doc = include_str!("../../docs/math/octahedral.md")]
#[doc = include_str!("../../docs/math/sanitize.md")]
#[doc = include_str!("../../docs/math/trig.md")]
#[doc = include_str!("../../docs/math/vector.md")]
#[doc = include_str!("../../docs/pass/bvh8.md")]
#[doc = include_str!("../../docs/pass/image.md")]
#[doc = include_str!("../../docs/random/halton.md")]
#[doc = include_str!("../../docs/random/pcg.md")]
#[doc = include_str!("../../docs/ray/aabb.md")]
#[doc = include_str!("../../docs/ray/bvh.md")]
#[doc = include_str!("../../docs/ray/bvh_filter.md")]
#[doc = include_str!("../../docs/ray/camera.md")]
#[doc = include_str!("../../docs/ray/instance.md")]
#[doc = include_str!("../../docs/ray/plane.md")]
#[doc = include_str!("../../docs/ray/ray.md")]
#[doc = include_str!("../../docs/ray/sphere.md")]
#[doc = include_str!("../../docs/ray/triangle.md")]
#[doc = include_str!("../../docs/sample/basis.md")]
#[doc = include_str!("../../docs/sample/cone.md")]
#[doc = include_str!("../../docs/sample/disk.md")]
#[doc = include_str!("../../docs/sample/hemisphere.md")]
#[doc = include_str!("../../docs/sample/sphere.md")]
#[doc = include_str!("../../docs/temporal/accumulate.md")]
#[doc = include_str!("../../docs/temporal/reproject.md")]
#[doc = include_str!("../../docs/temporal/multiscale_mean.md")]
#[doc = include_str!("../../docs/temporal/taa.md")]
#[doc = include_str!("../../docs/temporal/variance_clamp.md")]
#[doc = include_str!("../../docs/temporal/visibility_clamp.md")]
#[doc = include_str!("../../docs/web.md")]
pub struct Pages;
