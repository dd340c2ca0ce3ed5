//! Scenes: meshes from OBJ, glTF and GLB files, the kitchen that ships with
//! obvhs, a toy room assembled in code, and for each a camera, a light and a
//! distance for ambient occlusion.

mod error;
mod files;
mod gltf_file;
mod mesh;
mod obj;
mod toy;

use std::path::Path;

use glam::{Vec3, vec3};

pub use error::{Place, SceneError};
pub use files::{kitchen, kitchen_path, load_path, load_path_with, sponza_path};
pub use mesh::{
    Bounds, Limits, MAX_COORDINATE, MAX_FILE_BYTES, MAX_NODES, MAX_TRIANGLES, MAX_VERTICES, Mesh,
};
pub use toy::toy_room;

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it stands.
    pub eye: Vec3,
    /// What it looks at; differs from `eye`.
    pub target: Vec3,
    /// Which way is up, of length 1 and not along the view.
    pub up: Vec3,
    /// Vertical field of view in degrees.
    pub fov_degrees: f32,
}

/// A distant light of round shape, like the Sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Unit vector from the scene to the middle of the light.
    pub direction: Vec3,
    /// Half of the angle under which the light is seen, in radians. The Sun's
    /// is [`SUN_ANGULAR_RADIUS`].
    pub angular_radius: f32,
}

/// Half of the angle under which the Sun is seen, in radians.
pub const SUN_ANGULAR_RADIUS: f32 = 0.00465;

/// The default: four times as wide as the Sun, so that the penumbras in a
/// room span more than a pixel.
pub const SOFT_ANGULAR_RADIUS: f32 = 0.0186;

impl Light {
    /// A light in this direction, of any length but zero, as wide as
    /// [`SOFT_ANGULAR_RADIUS`].
    pub fn towards(direction: Vec3) -> Self {
        Self {
            direction: direction.as_dvec3().normalize().as_vec3(),
            angular_radius: SOFT_ANGULAR_RADIUS,
        }
    }
}

/// A mesh and how to look at it.
#[derive(Clone, Debug)]
pub struct Scene {
    /// A short name: `kitchen`, `toy`, `sponza`, or the file's.
    pub name: String,
    /// The triangles.
    pub mesh: Mesh,
    /// The camera.
    pub camera: Camera,
    /// The light.
    pub light: Light,
    /// How far ambient occlusion looks, in the units of the mesh.
    pub ao_distance: f32,
}

impl Scene {
    /// The toy room, seen from where its fourth wall would be; the light comes
    /// through the blind and over the wall.
    pub fn toy_room() -> Self {
        Self {
            name: "toy".into(),
            mesh: toy_room(),
            camera: Camera {
                eye: vec3(3.3, 1.75, 6.6),
                target: vec3(3.0, 0.95, 0.8),
                up: Vec3::Y,
                fov_degrees: 40.0,
            },
            light: Light::towards(vec3(-0.8, 0.5, 0.3)),
            ao_distance: 0.8,
        }
    }

    /// The kitchen that ships with obvhs; see [`kitchen`].
    ///
    /// # Errors
    /// Those of [`kitchen`].
    pub fn kitchen() -> Result<Self, SceneError> {
        Ok(Self {
            name: "kitchen".into(),
            mesh: kitchen()?,
            camera: Camera {
                eye: vec3(2.2, 1.5, 1.2),
                target: vec3(-1.5, 0.95, -1.0),
                up: Vec3::Y,
                fov_degrees: 50.0,
            },
            // The room is closed but for the window: low enough to come in.
            light: Light::towards(vec3(0.55, 0.28, -1.0)),
            ao_distance: 0.5,
        })
    }

    /// Any file that [`load_path`] takes. A file whose name holds `sponza`
    /// gets the view along the atrium, in fractions of its bounds since copies
    /// differ in scale; others are seen whole, from the front, the right and
    /// above.
    ///
    /// # Errors
    /// Those of [`load_path`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let path = path.as_ref();
        let mesh = load_path(path)?;
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        Ok(if stem.to_ascii_lowercase().contains("sponza") {
            Self::atrium("sponza".into(), mesh)
        } else {
            Self::seen_whole(stem.into_owned(), mesh)
        })
    }

    /// A mesh without a known view: the camera sees all of it from the front,
    /// the right and above (y is up).
    pub fn seen_whole(name: String, mesh: Mesh) -> Self {
        let bounds = bounds_or_unit(&mesh);
        let diagonal = positive(bounds.diagonal());
        let fov_degrees = 40.0f32;
        // The sphere around the box just fits the picture's height.
        let distance = 0.5 * diagonal / (0.5 * fov_degrees.to_radians()).sin();
        let direction = vec3(0.48, 0.36, 0.8);
        let target = bounds.center();
        Self {
            name,
            mesh,
            camera: Camera {
                eye: target + direction * distance,
                target,
                up: Vec3::Y,
                fov_degrees,
            },
            light: Light::towards(vec3(-0.4, 0.8, 0.45)),
            ao_distance: 0.1 * diagonal,
        }
    }

    fn atrium(name: String, mesh: Mesh) -> Self {
        let bounds = bounds_or_unit(&mesh);
        Self {
            name,
            camera: Camera {
                eye: bounds.at(vec3(0.14, 0.14, 0.53)),
                target: bounds.at(vec3(0.6, 0.3, 0.47)),
                up: Vec3::Y,
                fov_degrees: 60.0,
            },
            light: Light::towards(vec3(0.5, 1.0, 0.12)),
            ao_distance: 0.05 * positive(bounds.diagonal()),
            mesh,
        }
    }
}

fn bounds_or_unit(mesh: &Mesh) -> Bounds {
    mesh.bounds().unwrap_or(Bounds {
        min: Vec3::ZERO,
        max: Vec3::ONE,
    })
}

/// A size to divide by: a mesh of one point still needs a camera.
fn positive(size: f32) -> f32 {
    if size > 0.0 { size } else { 1.0 }
}

#[cfg(test)]
mod tests;
