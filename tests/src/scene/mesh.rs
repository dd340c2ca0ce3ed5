//! Indexed triangles and the checks that every loader shares.

use glam::{DVec3, Vec3};

use super::error::{Place, SceneError};

/// Triangles a loader accepts by default.
pub const MAX_TRIANGLES: usize = 50_000_000;

/// Vertices a loader accepts by default (1.8 GB of positions).
pub const MAX_VERTICES: usize = 150_000_000;

/// Bytes a loader reads by default, 2 GiB: the file, or a glTF's JSON and
/// buffers together.
pub const MAX_FILE_BYTES: u64 = 2 << 30;

/// Largest magnitude of a coordinate. Intersection with the plane of a
/// triangle multiplies three coordinate differences: `48 c^3` stays below the
/// largest f32 up to c = 1.9e12.
pub const MAX_COORDINATE: f32 = 1e12;

/// Nodes that a glTF's scene may place.
pub const MAX_NODES: usize = 10_000_000;

/// What a loader refuses. The defaults are [`MAX_TRIANGLES`],
/// [`MAX_VERTICES`] and [`MAX_FILE_BYTES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Most triangles.
    pub triangles: usize,
    /// Most vertices, used or not.
    pub vertices: usize,
    /// Most bytes read, for a glTF with its buffers.
    pub file_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            triangles: MAX_TRIANGLES,
            vertices: MAX_VERTICES,
            file_bytes: MAX_FILE_BYTES,
        }
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min: Vec3,
    /// Largest coordinates.
    pub max: Vec3,
}

impl Bounds {
    /// The middle.
    pub fn center(&self) -> Vec3 {
        self.min * 0.5 + self.max * 0.5
    }

    /// Length of the diagonal.
    pub fn diagonal(&self) -> f32 {
        (self.max.as_dvec3() - self.min.as_dvec3()).length() as f32
    }

    /// The point at these fractions of the extent, 0 at `min` and 1 at `max`.
    pub fn at(&self, fraction: Vec3) -> Vec3 {
        self.min + (self.max - self.min) * fraction
    }
}

/// Indexed triangles, counter-clockwise seen from outside. What a loader
/// returns has at least one triangle, every index in range and every
/// coordinate finite and within [`MAX_COORDINATE`]; triangles of zero area are
/// kept as they are.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions of the vertices, in the units of the file.
    pub positions: Vec<Vec3>,
    /// Three indices into `positions` a triangle.
    pub indices: Vec<[u32; 3]>,
    /// Points and lines of the file, which have no surface and are left out.
    pub skipped: usize,
}

impl Mesh {
    /// The corners of triangle `index`.
    ///
    /// # Panics
    /// When `index` is not below the number of triangles.
    pub fn triangle(&self, index: usize) -> [Vec3; 3] {
        self.indices[index].map(|i| self.positions[i as usize])
    }

    /// All triangles, corner by corner.
    pub fn triangles(&self) -> impl ExactSizeIterator<Item = [Vec3; 3]> + '_ {
        self.indices
            .iter()
            .map(|t| t.map(|i| self.positions[i as usize]))
    }

    /// Unit geometric normal of triangle `index`, computed in f64 and rounded;
    /// `None` where the area is zero.
    ///
    /// # Panics
    /// When `index` is not below the number of triangles.
    pub fn geometric_normal(&self, index: usize) -> Option<Vec3> {
        let [a, b, c] = self.triangle(index).map(Vec3::as_dvec3);
        normal(a, b, c).map(|n| n.as_vec3())
    }

    /// Box around the corners of all triangles; unused vertices do not count.
    /// `None` without triangles.
    pub fn bounds(&self) -> Option<Bounds> {
        self.triangles().flatten().fold(None, |b, p| {
            Some(match b {
                None => Bounds { min: p, max: p },
                Some(b) => Bounds {
                    min: b.min.min(p),
                    max: b.max.max(p),
                },
            })
        })
    }

    /// Appends `other`.
    ///
    /// # Panics
    /// When the vertices together exceed what a u32 counts.
    pub fn append(&mut self, other: &Mesh) {
        let total = self.positions.len() + other.positions.len();
        assert!(u32::try_from(total).is_ok(), "{total} vertices exceed u32");
        let base = self.positions.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.indices
            .extend(other.indices.iter().map(|t| t.map(|i| i + base)));
        self.skipped += other.skipped;
    }
}

fn normal(a: DVec3, b: DVec3, c: DVec3) -> Option<DVec3> {
    let n = (b - a).cross(c - a);
    let length = n.length();
    // f64 neither overflows nor underflows on f32 input within MAX_COORDINATE,
    // except for triangles below 1e-77 units.
    (length > 0.0).then(|| n / length)
}

/// Refuses a vertex that is not finite or too far away.
pub(super) fn check_vertex(
    place: impl FnOnce() -> Place,
    vertex: usize,
    p: Vec3,
) -> Result<(), SceneError> {
    let value = || format!("{} {} {}", p.x, p.y, p.z);
    if !p.is_finite() {
        Err(SceneError::NonFinite {
            at: place(),
            vertex,
            value: value(),
        })
    } else if p.abs().max_element() > MAX_COORDINATE {
        Err(SceneError::TooFar {
            at: place(),
            vertex,
            value: value(),
            limit: MAX_COORDINATE,
        })
    } else {
        Ok(())
    }
}
