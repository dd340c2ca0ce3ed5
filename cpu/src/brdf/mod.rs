//! How surfaces reflect and refract.

pub mod compensation;
pub mod cook_torrance;
pub mod fresnel;
pub mod ggx;
pub mod ggx_bounded;
pub mod ggx_ndf;
pub mod ggx_visible;
pub mod lambert;
pub mod layered;
pub mod medium;
pub mod reflection;
pub mod refract;
