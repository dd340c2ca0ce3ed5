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
//! define ([`Module::callbacks`]); ready bindings lie beside it, over storage
//! buffers ([`Module::bindings`]) and for filters over textures
//! ([`Module::textures`]). [`link_pass`] adds the entry points of a filter and
//! gives a whole program.

use std::fmt;

/// One WGSL text and what it stands on.
///
/// ```
/// let cone = raytwin_wgsl::module("sample/cone").unwrap();
/// assert_eq!(cone.requires, ["math/trig"]);
/// assert!(cone.source.contains("fn cone_sample("));
/// // It reads nothing, so the program defines nothing for it.
/// assert!(cone.callbacks.is_empty() && cone.bindings.is_none());
/// ```
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
    /// Ready bindings that define those functions over storage buffers. For a
    /// filter also what its pass reads and writes besides.
    pub bindings: Option<&'static str>,
    /// The same over textures.
    pub textures: Option<Textures>,
}

/// Ready bindings over textures. Storage textures are written `rgba16float`;
/// [`Images::Textures32`] makes them `rgba32float`.
///
/// ```
/// // A filter that can read its images from textures.
/// let taa = raytwin_wgsl::module("temporal/taa").unwrap();
/// let textures = taa.textures.unwrap();
/// assert!(textures.source.contains("texture_2d<f32>"));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Textures {
    /// The text.
    pub source: &'static str,
    /// Modules that it uses besides those that the filter requires.
    pub requires: &'static [&'static str],
}

/// Compute entry points of a filter, over any of its ready bindings.
///
/// ```
/// let pass = raytwin_wgsl::find_pass("temporal/taa").unwrap();
/// assert_eq!(pass.module, "temporal/taa");
/// assert!(pass.source.contains("@compute"));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pass {
    /// What [`link_pass`] knows it by.
    pub name: &'static str,
    /// The module that it runs.
    pub module: &'static str,
    /// Modules that it uses besides.
    pub requires: &'static [&'static str],
    /// The text: a uniform and entry points.
    pub source: &'static str,
    /// Whether it needs subgroup operations. (Browsers want `enable subgroups;`
    /// before the program; naga 30 does not take that line.)
    pub subgroups: bool,
}

/// Where the images of a pass are.
///
/// ```
/// use raytwin_wgsl::{Images, link_pass};
/// // The same filter, over buffers and over textures.
/// let buffers = link_pass("temporal/taa", Images::Buffers)?;
/// let textures = link_pass("temporal/taa", Images::Textures16)?;
/// assert!(buffers.contains("var<storage") && textures.contains("rgba16float"));
/// # Ok::<(), raytwin_wgsl::LinkError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Images {
    /// In storage buffers, row by row, 32 bits a number.
    Buffers,
    /// In textures; results of several channels in `rgba16float`.
    Textures16,
    /// In textures; results of several channels in `rgba32float`.
    Textures32,
}

/// Compute passes over whole images: entry points with their bindings, to be
/// appended to the linked module of the same name. Those in [`PASSES`] have
/// their images bound by [`link_pass`].
pub mod pass {
    /// After `gi/surfel_irradiance` and `gi/surfel_grid`: a pool of surfels that
    /// follows what the camera sees.
    pub const SURFEL: &str = include_str!("gi/surfel.pass.wgsl");
    /// `gi/surfel_grid`: the lists of all cells.
    pub const SURFEL_GRID: &str = include_str!("gi/surfel_grid.pass.wgsl");
    /// After `gi/surfel_irradiance`, `gi/surfel_grid` and
    /// `temporal/multiscale_mean`: the light of that pool. The program defines
    /// `surfel_irradiance_trace` and `surfel_irradiance_direct`.
    pub const SURFEL_IRRADIANCE: &str = include_str!("gi/surfel_irradiance.pass.wgsl");
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
///
/// ```
/// let error = raytwin_wgsl::link(&["sample/cnoe"]).unwrap_err();
/// assert_eq!((error.module.as_str(), error.required_by), ("sample/cnoe", None));
/// assert!(error.to_string().contains("`sample/cnoe`"));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkError {
    /// The name that no module has.
    pub module: String,
    /// The module that asked for it, or `None` if the caller did.
    pub required_by: Option<&'static str>,
}

impl fmt::Display for LinkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no WGSL module or pass is named `{}`", self.module)?;
        if let Some(by) = self.required_by {
            write!(f, ", which `{by}` requires")?;
        }
        write!(
            f,
            "; raytwin_wgsl::MODULES and PASSES list those that exist"
        )
    }
}

impl std::error::Error for LinkError {}

/// The module of this name (`"sample/cone"`), if there is one.
///
/// ```
/// assert!(raytwin_wgsl::module("sample/cone").is_some());
/// assert!(raytwin_wgsl::module("sample/cnoe").is_none());
/// ```
#[must_use]
pub fn module(name: &str) -> Option<&'static Module> {
    MODULES.iter().find(|m| m.name == name)
}

/// The named modules and everything that they require, each once,
/// dependencies first.
///
/// ```
/// // What a module requires comes before it, and once.
/// let names: Vec<_> = raytwin_wgsl::linked(&["sample/cone", "sample/sphere"])?
///     .iter()
///     .map(|m| m.name)
///     .collect();
/// assert_eq!(names, ["math/trig", "sample/cone", "sample/sphere"]);
/// # Ok::<(), raytwin_wgsl::LinkError>(())
/// ```
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
/// ```
/// let source = raytwin_wgsl::link(&["sample/cone", "sample/sphere"])?;
/// assert_eq!(source.matches("fn sincos_turn(").count(), 1);
/// # Ok::<(), raytwin_wgsl::LinkError>(())
/// ```
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

/// The pass of this name, if there is one.
///
/// ```
/// let pass = raytwin_wgsl::find_pass("filter/firefly").unwrap();
/// assert_eq!(pass.name, "filter/firefly");
/// assert!(raytwin_wgsl::find_pass("sample/cone").is_none());
/// ```
#[must_use]
pub fn find_pass(name: &str) -> Option<&'static Pass> {
    PASSES.iter().find(|p| p.name == name)
}

/// A whole program: the pass of this name in [`PASSES`] with its entry points,
/// everything that it requires, and the ready bindings of all that.
///
/// ```
/// use raytwin_wgsl::{Images, link_pass};
/// let source = link_pass("temporal/taa", Images::Textures16)?;
/// assert!(source.contains("fn taa_pass_main("));
/// # Ok::<(), raytwin_wgsl::LinkError>(())
/// ```
///
/// # Errors
/// If there is no pass of that name.
pub fn link_pass(name: &str, images: Images) -> Result<String, LinkError> {
    let pass = find_pass(name).ok_or_else(|| LinkError {
        module: name.into(),
        required_by: None,
    })?;
    let mut names = vec![pass.module];
    names.extend(pass.requires);
    let mut modules = linked(&names)?;
    let mut bindings = String::new();
    for module in modules.clone() {
        match (images, module.textures) {
            (Images::Buffers, _) | (_, None) => bindings += module.bindings.unwrap_or_default(),
            (_, Some(textures)) => {
                bindings += textures.source;
                names.extend(textures.requires);
            }
        }
    }
    if images == Images::Textures32 {
        bindings = bindings
            .replace("rgba16float", "rgba32float")
            .replace("65504.0", "3.4028234e38");
    }
    modules = linked(&names)?;
    let sources = modules.iter().map(|m| m.source);
    Ok(sources
        .chain([bindings.as_str(), pass.source])
        .collect::<Vec<_>>()
        .join("\n"))
}

mod packaging;
#[cfg(feature = "wesl")]
pub mod wesl;

/// The registry: `NAME "file" [requires]`, for a module that calls back or has
/// a pass `{ signatures } "bindings files"`, and for one that can read textures
/// `textures "files" [what they require]`.
macro_rules! modules {
    ($($(#[$doc:meta])* $group:ident { $(
        $const:ident $name:literal [$($need:literal),*]
        $({ $($callback:literal),* } $($bindings:literal)+)?
        $(textures $($textures:literal)+ [$($texture_need:literal),*])?;
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
            callbacks: &[$($($callback),*)?],
            bindings: modules!(@bindings $($group $($bindings)+)?),
            textures: modules!(@textures $($group [$($texture_need),*] $($textures)+)?),
        }),*),*];
    };
    (@bindings) => { None };
    (@bindings $group:ident $($file:literal)+) => {
        Some(concat!($(include_str!(concat!(stringify!($group), "/", $file))),+))
    };
    (@textures) => { None };
    (@textures $group:ident [$($need:literal),*] $($file:literal)+) => {
        Some(Textures {
            source: concat!($(include_str!(concat!(stringify!($group), "/", $file))),+),
            requires: &[$($need),*],
        })
    };
}

/// The passes: `"name" = "module" [requires] "files"`, with `subgroups`
/// where they are needed.
macro_rules! passes {
    ($($name:literal = $module:literal [$($need:literal),*]
        $($file:literal)+ $(, $subgroups:ident)?;)*) => {
        /// Every pass that runs over any of the ready bindings.
        pub static PASSES: &[Pass] = &[$(Pass {
            name: $name,
            module: $module,
            requires: &[$($need),*],
            source: concat!($(include_str!($file)),+),
            subgroups: passes!(@subgroups $($subgroups)?),
        }),*];
    };
    (@subgroups) => { false };
    (@subgroups subgroups) => { true };
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
            } "bilateral_upsample.bindings.wgsl"
            textures "bilateral_upsample.textures.wgsl" ["math/octahedral", "ray/camera"];
        BILATERAL_VARIANCE "bilateral_variance"
            ["math/exponent", "math/sanitize", "math/trig", "math/vector"]
            {
                "fn bilateral_variance_read(at: vec2u) -> BilateralVariancePixel"
            } "bilateral_variance.bindings.wgsl"
            textures "bilateral_variance.textures.wgsl" ["math/octahedral", "ray/camera"];
        FIREFLY "firefly" ["math/sanitize"]
            {
                "fn firefly_read(at: vec2u) -> vec3f"
            } "firefly.bindings.wgsl"
            textures "firefly.textures.wgsl" [];
        PACKED_VISIBILITY "packed_visibility" []
            {
                "fn packed_visibility_read(block: vec2u) -> u32",
                "fn packed_visibility_read_row(pixel: vec2u) -> u32"
            } "packed_visibility.bindings.wgsl" "packed_visibility.ballot.wgsl"
            textures "packed_visibility.textures.wgsl" "packed_visibility.ballot.wgsl" [];
        SEPARABLE_BLUR "separable_blur" ["math/exponent", "math/sanitize", "math/vector"]
            {
                "fn separable_blur_read(at: vec2u) -> SeparableBlurPixel"
            } "separable_blur.bindings.wgsl"
            textures "separable_blur.textures.wgsl" ["math/octahedral", "ray/camera"];
        SPATIAL_RECONSTRUCT "spatial_reconstruct" ["math/trig", "math/vector"]
            {
                "fn spatial_reconstruct_read_hit(at: vec2u) -> SpatialReconstructHit",
                "fn spatial_reconstruct_weight(pixel: vec2u, at: vec2u, hit: SpatialReconstructHit) -> f32"
            } "spatial_reconstruct.bindings.wgsl" "spatial_reconstruct.weight.wgsl"
            textures "spatial_reconstruct.textures.wgsl" "spatial_reconstruct.weight.wgsl"
                ["math/octahedral", "math/sanitize", "ray/camera"];
        SVGF "svgf" ["math/exponent", "math/luminance", "math/sanitize", "math/vector"]
            {
                "fn svgf_read_surface(at: vec2u) -> SvgfSurface",
                "fn svgf_read_color(at: vec2u) -> SvgfColor",
                "fn svgf_read_scalar(at: vec2u) -> SvgfScalar"
            } "svgf.bindings.wgsl"
            textures "svgf.textures.wgsl" ["math/octahedral", "ray/camera"];
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
        SURFEL_GRID "surfel_grid" ["gi/surfel", "math/sanitize", "random/pcg"];
        SURFEL_IRRADIANCE "surfel_irradiance"
            ["gi/surfel", "math/vector", "random/pcg", "sample/basis", "sample/hemisphere"];
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
        BVH_FILTER "bvh_filter" ["ray/bvh"]
            { "fn bvh_read_mask(primitive: u32) -> u32" } "bvh_filter.bindings.wgsl";
        CAMERA "camera" ["math/vector", "ray/ray"];
        INSTANCE "instance" ["ray/bvh", "math/vector"]
            { "fn instance_read(index: u32) -> Instance" } "instance.bindings.wgsl";
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
        ACCUMULATE "accumulate" ["math/luminance"] { } "accumulate.bindings.wgsl"
            textures "accumulate.textures.wgsl" [];
        MULTISCALE_MEAN "multiscale_mean" [];
        REPROJECT "reproject" [
            "math/exponent", "math/luminance", "math/sanitize", "math/vector", "ray/camera"
        ] {
                "alias ReprojectValue = f32",
                "fn reproject_read_surface(at: vec2u) -> ReprojectSurface",
                "fn reproject_read_prior(at: vec2u) -> ReprojectSurface",
                "fn reproject_read_history(at: vec2u) -> ReprojectHistory"
            } "reproject.bindings.wgsl"
            textures "reproject.textures.wgsl" ["math/octahedral"];
        TAA "taa" ["math/sanitize"]
            {
                "fn taa_read(at: vec2u) -> vec3f"
            } "taa.bindings.wgsl"
            textures "taa.textures.wgsl" [];
        VARIANCE_CLAMP "variance_clamp" []
            {
                "fn variance_clamp_read(at: vec2u) -> vec3f"
            } "variance_clamp.bindings.wgsl"
            textures "variance_clamp.textures.wgsl" [];
        VISIBILITY_CLAMP "visibility_clamp" ["filter/packed_visibility"]
            { } "visibility_clamp.bindings.wgsl"
            textures "visibility_clamp.textures.wgsl" [];
    }
}

passes! {
    "filter/bilateral_upsample" = "filter/bilateral_upsample" []
        "filter/bilateral_upsample.pass.wgsl";
    "filter/bilateral_variance" = "filter/bilateral_variance" ["random/pcg"]
        "filter/bilateral_variance.pass.wgsl";
    "filter/firefly" = "filter/firefly" [] "filter/firefly.pass.wgsl";
    "filter/packed_visibility" = "filter/packed_visibility" []
        "filter/packed_visibility.pass.wgsl";
    "filter/packed_visibility_subgroups" = "filter/packed_visibility" []
        "filter/packed_visibility.pass.wgsl" "filter/packed_visibility.pass_subgroups.wgsl",
        subgroups;
    "filter/separable_blur" = "filter/separable_blur" [] "filter/separable_blur.pass.wgsl";
    "filter/spatial_reconstruct" = "filter/spatial_reconstruct" ["random/pcg"]
        "filter/spatial_reconstruct.pass.wgsl";
    "filter/svgf" = "filter/svgf" [] "filter/svgf.pass.wgsl";
    "temporal/accumulate" = "temporal/accumulate" [] "temporal/accumulate.pass.wgsl";
    "temporal/reproject" = "temporal/reproject" ["temporal/variance_clamp"]
        "temporal/reproject.pass.wgsl";
    "temporal/taa" = "temporal/taa" [] "temporal/taa.pass.wgsl";
    "temporal/variance_clamp" = "temporal/variance_clamp" []
        "temporal/variance_clamp.pass.wgsl";
    "temporal/visibility_clamp" = "temporal/visibility_clamp" []
        "temporal/visibility_clamp.pass.wgsl";
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
