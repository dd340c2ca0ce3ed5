//! Refraction through an interface, from either side.

use glam::Vec3;

use crate::math::vector::vec3_dot;

/// Stands in for a zero that something divides by.
const TINY: f32 = 1e-30;

/// Where light goes at an interface.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::refract::refract_snell;
///
/// // Straight through: the direction does not change.
/// let through = refract_snell(Vec3::Z, Vec3::Z, 1.5);
/// assert_eq!(through.direction, Vec3::NEG_Z);
/// assert_eq!((through.cos_transmitted, through.total), (1.0, 0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Refraction {
    /// Away from the interface: the refracted direction, or the mirrored one
    /// at total internal reflection; unit.
    pub direction: Vec3,
    /// Cosine between the refracted direction and the normal on its side; 0
    /// at total internal reflection.
    pub cos_transmitted: f32,
    /// 1 at total internal reflection, else 0.
    pub total: u32,
}

/// Snell's law for light that arrives from `wi`.
///
/// `wi` is a unit vector away from the interface, toward where the light (or
/// the path) comes from; `n` is the unit normal; `eta` is the refractive index
/// of the medium that `n` points away from over that of the medium it points
/// into, positive. The side is found from `wi · n`, so a front face and a back
/// face take the same call: from behind, `eta` is inverted.
///
/// Source: Snell's law in vector form.
///
/// Error analysis: with `e` the index on the near side over that on the far
/// side, the square of the far cosine is `(1 - e²) + (e cos)²`. From the front
/// `1 - e²` is taken as `(η - 1)(η + 1)/η²`, which keeps its relative accuracy
/// near `η = 1`, and the far cosine with it at grazing angles. The part along
/// the normal, `cos_t - e cos`, is the quotient `(1 - e²)/(cos_t + e cos)`: it
/// does not cancel, and for `eta = 1` it is 0 and the direction exactly `-wi`.
/// What remains is the edge of total reflection, where the far cosine is the
/// root of a small difference.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::refract::refract_snell;
///
/// // Into glass: the sine is divided by 1.5.
/// let wi = Vec3::new(0.6, 0.0, 0.8);
/// let inside = refract_snell(wi, Vec3::Z, 1.5).direction;
/// assert!((inside.x + 0.4).abs() < 1e-6 && inside.z < 0.0);
/// // The way back, out of it, with the same call.
/// let outside = refract_snell(inside, Vec3::Z, 1.5).direction;
/// assert!((outside - wi).length() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn refract_snell(wi: Vec3, n: Vec3, eta: f32) -> Refraction {
    let c = vec3_dot(wi, n);
    let front = c >= 0.0;
    let e = if front { 1.0 / eta } else { eta };
    let step = (eta - 1.0) * (eta + 1.0);
    let rest = if front { step * (e * e) } else { -step };
    let ec = e * c.abs();
    let square = rest + ec * ec;
    if square < 0.0 {
        let k = 2.0 * c;
        return Refraction {
            direction: Vec3::new(k * n.x - wi.x, k * n.y - wi.y, k * n.z - wi.z),
            cos_transmitted: 0.0,
            total: 1,
        };
    }
    let t = square.sqrt();
    let gain = rest / (t + ec).max(TINY);
    let along = if front { -gain } else { gain };
    Refraction {
        direction: Vec3::new(
            along * n.x - e * wi.x,
            along * n.y - e * wi.y,
            along * n.z - e * wi.z,
        ),
        cos_transmitted: t,
        total: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unit vectors over the sphere, rounded.
    fn directions() -> Vec<Vec3> {
        (0..400)
            .map(|i| {
                let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / 400.0;
                let a = 2.399_963 * f64::from(i);
                let r = (1.0 - z * z).sqrt();
                Vec3::new((r * a.cos()) as f32, (r * a.sin()) as f32, z as f32)
            })
            .collect()
    }

    #[test]
    fn straight_on_and_total() {
        let through = refract_snell(Vec3::Z, Vec3::Z, 1.5);
        assert_eq!((through.direction, through.total), (-Vec3::Z, 0));
        assert_eq!(through.cos_transmitted, 1.0);
        // Inside glass at 53 degrees: the mirror direction, not a zero vector.
        let inside = refract_snell(Vec3::new(0.8, 0.0, -0.6), Vec3::Z, 1.5);
        assert_eq!((inside.total, inside.cos_transmitted), (1, 0.0));
        assert!((inside.direction - Vec3::new(-0.8, 0.0, -0.6)).length() < 1e-6);
        // From above at the same angle it gets in.
        assert_eq!(
            refract_snell(Vec3::new(0.8, 0.0, 0.6), Vec3::Z, 1.5).total,
            0
        );
    }

    #[test]
    fn equal_indices_leave_the_direction_alone() {
        for wi in directions() {
            for n in [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::X] {
                let r = refract_snell(wi, n, 1.0);
                assert_eq!((r.direction, r.total), (-wi, 0));
            }
        }
        let along = refract_snell(Vec3::X, Vec3::Z, 1.0);
        assert_eq!((along.direction, along.total), (-Vec3::X, 0));
    }

    #[test]
    fn snells_law_holds_from_both_sides() {
        let n = Vec3::new(0.36, 0.48, 0.8);
        for eta in [0.5f32, 0.9, 1.1, 1.5, 2.4] {
            for wi in directions() {
                let r = refract_snell(wi, n, eta);
                let c = wi.dot(n);
                let ratio = if c >= 0.0 { eta } else { 1.0 / eta };
                assert!((r.direction.length() - 1.0).abs() < 1e-6, "{wi} {eta}");
                let sin_in = wi.cross(n).length();
                let sin_out = r.direction.cross(n).length();
                if r.total == 1 {
                    assert!(sin_in > ratio - 1e-6);
                    assert!((sin_out - sin_in).abs() < 1e-6);
                    assert!(r.direction.dot(n) * c >= 0.0);
                } else {
                    // sin_out · n_out = sin_in · n_in, on the other side, in
                    // the plane of incidence, against the incoming tangent.
                    assert!((sin_out * ratio - sin_in).abs() < 1e-6, "{wi} {eta}");
                    assert!(r.direction.dot(n) * c <= 0.0);
                    assert!(r.direction.dot(wi.cross(n)).abs() < 1e-6);
                    // At grazing exit the cosine is a root of rounding errors.
                    let cosine = r.direction.dot(n).abs();
                    assert!((cosine - r.cos_transmitted).abs() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn the_way_back_is_the_same() {
        for wi in directions() {
            let there = refract_snell(wi, Vec3::Z, 1.5);
            if there.total == 1 || wi.z.abs() < 0.05 {
                continue;
            }
            let back = refract_snell(there.direction, Vec3::Z, 1.5);
            assert_eq!(back.total, 0);
            assert!((back.direction - wi).length() < 1e-6 / wi.z.abs(), "{wi}");
        }
    }

    #[test]
    fn reflected_and_transmitted_light_share_all_of_it() {
        // The beam that gets through is as wide as n cos_t over cos_i; with the
        // amplitudes of Fresnel's equations it carries 1 - F.
        use crate::brdf::fresnel::fresnel_dielectric;
        for eta in [1.5f32, 0.8, 2.4] {
            for i in 1..100 {
                let cos = i as f32 / 100.0;
                let wi = Vec3::new(((1.0 - cos) * (1.0 + cos)).sqrt(), 0.0, cos);
                let r = refract_snell(wi, Vec3::Z, eta);
                let f = fresnel_dielectric(cos, eta);
                if r.total == 1 {
                    assert!(f > 1.0 - 1e-3);
                    continue;
                }
                let g = eta * r.cos_transmitted;
                let (ts, tp) = (
                    2.0 * cos / (cos + g),
                    2.0 * eta * cos / (eta * eta * cos + g),
                );
                // At the critical angle both are steep in the far cosine.
                let through = (g / cos) * 0.5 * (ts * ts + tp * tp);
                assert!(
                    (f + through - 1.0).abs() < 2e-6 / r.cos_transmitted.max(1e-3),
                    "{eta} {cos}: {f} {through}"
                );
            }
        }
    }
}
