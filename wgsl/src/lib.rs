//! The GPU half of raytwin: plain WGSL that anybody can import.
//!
//! Every module is a text of declarations only: no bindings, no entry points,
//! no directives, names prefixed so that they are unique in any program. Take
//! one constant (`raytwin_wgsl::sample::CONE`) when you assemble sources
//! yourself, or let [`link`] bring a module with everything that it needs:
//!
//! ```
//! let mut source = raytwin_wgsl::link(&["sample/cone", "random/pcg"])?;
//! source += "
//!     @compute @workgroup_size(64) fn main() {
//!         let d = cone_sample(vec2f(0.5, 0.5), 1e-5);
//!     }";
//! # Ok::<(), raytwin_wgsl::LinkError>(())
//! ```
//!
//! A module that reads scene data does so through small functions which you
//! define ([`Module::callbacks`]); ready storage-buffer bindings lie beside it
//! ([`Module::bindings`]).

use std::fmt;

/// One WGSL text and what it stands on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Module {
    /// Path of the technique, `group/name`, the same as on the CPU side.
    pub name: &'static str,
    /// The text: declarations only.
    pub source: &'static str,
    /// Modules whose declarations it uses.
    pub requires: &'static [&'static str],
    /// Functions that the program must define for it, as WGSL signatures.
    pub callbacks: &'static [&'static str],
    /// Ready bindings that define those functions over storage buffers.
    pub bindings: Option<&'static str>,
}

/// Compute passes over whole images: entry points with their bindings, to be
/// appended to the linked module of the same name.
pub mod pass {
    /// `gi/surfel_grid`: the lists of all cells.
    pub const SURFEL_GRID: &str = include_str!("gi/surfel_grid.pass.wgsl");
    /// `filter/svgf` for colours.
    pub const SVGF_COLOR: &str = include_str!("filter/svgf.pass_color.wgsl");
    /// `filter/svgf` for scalars.
    pub const SVGF_SCALAR: &str = include_str!("filter/svgf.pass_scalar.wgsl");
    /// After one of these: `filter/svgf` over a list of `filter/tiles`, with the
    /// bindings of that module.
    pub const SVGF_TILES: &str = include_str!("filter/svgf.pass_tiles.wgsl");
    /// `temporal/multiscale_mean` for colours, in the robust form.
    pub const MULTISCALE_MEAN_COLOR: &str =
        include_str!("temporal/multiscale_mean.pass_color.wgsl");
}

/// Why [`link`] could not put a program together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkError {
    /// The name that no module has.
    pub module: String,
    /// The module that asked for it, or `None` if the caller did.
    pub required_by: Option<&'static str>,
}

impl fmt::Display for LinkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no WGSL module is named `{}`", self.module)?;
        if let Some(by) = self.required_by {
            write!(f, ", which `{by}` requires")?;
        }
        write!(f, "; raytwin_wgsl::MODULES lists those that exist")
    }
}

impl std::error::Error for LinkError {}

/// The module of this name (`"sample/cone"`), if there is one.
#[must_use]
pub fn module(name: &str) -> Option<&'static Module> {
    MODULES.iter().find(|m| m.name == name)
}

/// The named modules and everything that they require, each once,
/// dependencies first.
///
/// # Errors
/// If a name is not in [`MODULES`].
pub fn linked(names: &[&str]) -> Result<Vec<&'static Module>, LinkError> {
    fn visit(
        name: &str,
        required_by: Option<&'static str>,
        out: &mut Vec<&'static Module>,
    ) -> Result<(), LinkError> {
        if out.iter().any(|m| m.name == name) {
            return Ok(());
        }
        let module = module(name).ok_or_else(|| LinkError {
            module: name.into(),
            required_by,
        })?;
        for need in module.requires {
            visit(need, Some(module.name), out)?;
        }
        out.push(module);
        Ok(())
    }

    let mut out = Vec::new();
    for name in names {
        visit(name, None, &mut out)?;
    }
    Ok(out)
}

/// One WGSL source with the named modules and everything that they require,
/// each once, dependencies first.
///
/// # Errors
/// If a name is not in [`MODULES`].
pub fn link(names: &[&str]) -> Result<String, LinkError> {
    Ok(linked(names)?
        .iter()
        .map(|m| m.source)
        .collect::<Vec<_>>()
        .join("\n"))
}

/// The registry: `NAME "file" [requires]`, and for a module that calls back
/// `{ signatures } "bindings file"`.
macro_rules! modules {
    ($($(#[$doc:meta])* $group:ident { $(
        $const:ident $name:literal [$($need:literal),*]
        $({ $($callback:literal),+ } $bindings:literal)?;
    )* })*) => {
        $(
            $(#[$doc])*
            pub mod $group {
                $(
                    #[doc = concat!("The text of `", stringify!($group), "/", $name, "`, without what it requires.")]
                    pub const $const: &str = include_str!(concat!(stringify!($group), "/", $name, ".wgsl"));
                )*
            }
        )*
        /// Every module, as static data.
        pub static MODULES: &[Module] = &[$($(Module {
            name: concat!(stringify!($group), "/", $name),
            source: $group::$const,
            requires: &[$($need),*],
            callbacks: &[$($($callback),+)?],
            bindings: modules!(@bindings $($group $bindings)?),
        }),*),*];
    };
    (@bindings) => { None };
    (@bindings $group:ident $file:literal) => {
        Some(include_str!(concat!(stringify!($group), "/", $file)))
    };
}

modules! {
    /// How surfaces reflect and refract.
    brdf {
        COMPENSATION "compensation" [];
        COOK_TORRANCE "cook_torrance" ["brdf/fresnel", "brdf/ggx_bounded"];
        FRESNEL "fresnel" [];
        GGX "ggx" ["math/vector"];
        GGX_BOUNDED "ggx_bounded" ["brdf/ggx_visible"];
        GGX_NDF "ggx_ndf" ["brdf/ggx", "math/trig"];
        GGX_VISIBLE "ggx_visible" ["brdf/ggx", "math/trig", "sample/disk"];
        LAMBERT "lambert" ["sample/hemisphere"];
        LAYERED "layered" [
            "brdf/fresnel", "brdf/ggx_bounded", "brdf/medium", "math/luminance",
            "sample/hemisphere"
        ] { "const LAYERED_COUNT: u32" } "layered.bindings.wgsl";
        MEDIUM "medium" ["math/exponent"];
        REFLECTION "reflection" ["brdf/ggx_ndf", "brdf/ggx_visible"];
        REFRACT "refract" ["math/vector"];
    }
    /// Filters over neighbouring pixels.
    filter {
        BILATERAL_UPSAMPLE "bilateral_upsample" ["math/exponent", "math/sanitize", "math/vector"]
            {
                "fn bilateral_upsample_read_surface(pixel: vec2u) -> BilateralUpsampleSurface",
                "fn bilateral_upsample_read_tap(at: vec2u) -> BilateralUpsampleTap"
            } "bilateral_upsample.bindings.wgsl";
        BILATERAL_VARIANCE "bilateral_variance" ["math/exponent", "math/trig", "math/vector"]
            {
                "fn bilateral_variance_read(at: vec2u) -> BilateralVariancePixel"
            } "bilateral_variance.bindings.wgsl";
        FIREFLY "firefly" ["math/sanitize"]
            {
                "fn firefly_read(at: vec2u) -> vec3f"
            } "firefly.bindings.wgsl";
        PACKED_VISIBILITY "packed_visibility" []
            {
                "fn packed_visibility_read(block: vec2u) -> u32",
                "fn packed_visibility_read_row(pixel: vec2u) -> u32"
            } "packed_visibility.bindings.wgsl";
        SEPARABLE_BLUR "separable_blur" ["math/exponent", "math/sanitize", "math/vector"]
            {
                "fn separable_blur_read(at: vec2u) -> SeparableBlurPixel"
            } "separable_blur.bindings.wgsl";
        SPATIAL_RECONSTRUCT "spatial_reconstruct" ["math/trig", "math/vector"]
            {
                "fn spatial_reconstruct_read_hit(at: vec2u) -> SpatialReconstructHit",
                "fn spatial_reconstruct_weight(pixel: vec2u, at: vec2u, hit: SpatialReconstructHit) -> f32"
            } "spatial_reconstruct.bindings.wgsl";
        SVGF "svgf" ["math/exponent", "math/luminance", "math/vector"]
            {
                "fn svgf_read_surface(at: vec2u) -> SvgfSurface",
                "fn svgf_read_color(at: vec2u) -> SvgfColor",
                "fn svgf_read_scalar(at: vec2u) -> SvgfScalar"
            } "svgf.bindings.wgsl";
        TILES "tiles" []
            {
                "fn tiles_read_pixel(at: vec2u) -> u32",
                "fn tiles_read(tile: vec2u) -> u32",
                "fn tiles_read_row(tile: vec2u) -> u32"
            } "tiles.bindings.wgsl";
    }
    /// Global illumination.
    gi {
        SURFEL "surfel" ["math/vector", "random/pcg", "ray/camera"]
            {
                "fn surfel_read(entry: u32) -> Surfel",
                "fn surfel_read_irradiance(entry: u32) -> vec3f"
            } "surfel.bindings.wgsl";
        SURFEL_GRID "surfel_grid" ["gi/surfel", "random/pcg"];
    }
    /// Numeric building blocks.
    math {
        EXPONENT "exponent" [];
        LUMINANCE "luminance" [];
        OCTAHEDRAL "octahedral" ["math/vector"];
        SANITIZE "sanitize" [];
        TRIG "trig" [];
        VECTOR "vector" [];
    }
    /// Random and quasi-random numbers.
    random {
        HALTON "halton" [];
        PCG "pcg" [];
    }
    /// Rays, shapes and traversal.
    ray {
        AABB "aabb" ["ray/ray"];
        BVH "bvh" ["ray/triangle"]
            {
                "fn bvh_read_node(index: u32) -> BvhNode",
                "fn bvh_read_triangle(index: u32) -> BvhTriangle"
            } "bvh.bindings.wgsl";
        CAMERA "camera" ["math/vector", "ray/ray"];
        PLANE "plane" ["math/vector", "ray/ray"];
        RAY "ray" [];
        SPHERE "sphere" ["math/vector", "ray/ray"];
        TRIANGLE "triangle" ["math/vector", "ray/ray", "ray/aabb", "ray/plane"];
    }
    /// Warps from the unit square.
    sample {
        BASIS "basis" [];
        CONE "cone" ["math/trig"];
        DISK "disk" ["math/trig"];
        HEMISPHERE "hemisphere" ["sample/disk", "math/trig"];
        SPHERE "sphere" ["math/trig"];
    }
    /// Filters over time.
    temporal {
        ACCUMULATE "accumulate" ["math/luminance"];
        MULTISCALE_MEAN "multiscale_mean" [];
        REPROJECT "reproject" [
            "math/exponent", "math/luminance", "math/sanitize", "math/vector", "ray/camera"
        ] {
                "alias ReprojectValue = f32",
                "fn reproject_read_surface(at: vec2u) -> ReprojectSurface",
                "fn reproject_read_prior(at: vec2u) -> ReprojectSurface",
                "fn reproject_read_history(at: vec2u) -> ReprojectHistory"
            } "reproject.bindings.wgsl";
        TAA "taa" ["math/sanitize"]
            {
                "fn taa_read(at: vec2u) -> vec3f"
            } "taa.bindings.wgsl";
        VARIANCE_CLAMP "variance_clamp" []
            {
                "fn variance_clamp_read(at: vec2u) -> vec3f"
            } "variance_clamp.bindings.wgsl";
        VISIBILITY_CLAMP "visibility_clamp" ["filter/packed_visibility"];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_module_appears_once_after_what_it_requires() {
        let all = linked(&["sample/hemisphere", "sample/cone", "sample/hemisphere"]).unwrap();
        let names: Vec<_> = all.iter().map(|m| m.name).collect();
        assert_eq!(
            names,
            [
                "math/trig",
                "sample/disk",
                "sample/hemisphere",
                "sample/cone"
            ]
        );
    }

    #[test]
    fn an_unknown_name_is_named() {
        let error = link(&["sample/cones"]).unwrap_err();
        assert!(error.to_string().contains("`sample/cones`"));
    }

    #[test]
    fn every_requirement_exists() {
        for m in MODULES {
            linked(&[m.name]).unwrap();
        }
    }
}
