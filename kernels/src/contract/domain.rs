//! Where a kernel is defined, as a map from random words to inputs.
//!
//! A [`Domain`] turns a few uniform `u32` words into one value. One map serves
//! three users: proptest draws the words and shrinks them (every domain maps
//! small words to simple values, so a shrunk case is a readable one), the bulk
//! tests feed a million words from a hash, and the benches reuse the bulk.
//! One word in sixteen picks an edge of the domain on purpose.

use std::sync::Arc;

use glam::{UVec2, UVec3, UVec4, Vec2, Vec3};

/// A shared function of flat words.
pub(super) type Words<T> = Arc<dyn Fn(&[u32]) -> T + Send + Sync>;

/// A set of values of type `T`, given as a function of `words` uniform words.
#[derive(Clone)]
pub struct Domain<T> {
    words: usize,
    make: Words<T>,
}

impl<T: 'static> Domain<T> {
    /// A domain from a function of `words` uniform words.
    pub fn new(words: usize, make: impl Fn(&[u32]) -> T + Send + Sync + 'static) -> Self {
        Self {
            words,
            make: Arc::new(make),
        }
    }

    /// How many uniform words one value takes.
    #[must_use]
    pub fn words(&self) -> usize {
        self.words
    }

    /// The value that these words stand for.
    #[must_use]
    pub fn make(&self, words: &[u32]) -> T {
        (self.make)(words)
    }

    /// Applies a function to every value.
    pub fn map<U: 'static>(self, f: impl Fn(T) -> U + Send + Sync + 'static) -> Domain<U> {
        Domain::new(self.words, move |w| f(self.make(w)))
    }

    /// Pairs two domains.
    pub fn and<U: 'static>(self, other: Domain<U>) -> Domain<(T, U)> {
        let split = self.words;
        Domain::new(self.words + other.words, move |w| {
            (self.make(&w[..split]), other.make(&w[split..]))
        })
    }
}

/// A tuple of domains: the domain of a kernel's argument list.
pub trait Domains<Args> {
    /// The one domain of the whole list.
    fn joint(self) -> Domain<Args>;
}

impl<Args: 'static> Domains<Args> for Domain<Args> {
    fn joint(self) -> Domain<Args> {
        self
    }
}

macro_rules! tuple_domains {
    ($($t:ident $i:tt),+) => {
        impl<$($t: 'static),+> Domains<($($t,)+)> for ($(Domain<$t>,)+) {
            fn joint(self) -> Domain<($($t,)+)> {
                let words = 0 $(+ self.$i.words)+;
                Domain::new(words, move |w| {
                    let mut at = 0;
                    ($({
                        let value = self.$i.make(&w[at..at + self.$i.words]);
                        at += self.$i.words;
                        let _ = at;
                        value
                    },)+)
                })
            }
        }
    };
}
tuple_domains!(A 0);
tuple_domains!(A 0, B 1);
tuple_domains!(A 0, B 1, C 2);
tuple_domains!(A 0, B 1, C 2, D 3);
tuple_domains!(A 0, B 1, C 2, D 3, E 4);
tuple_domains!(A 0, B 1, C 2, D 3, E 4, F 5);
tuple_domains!(A 0, B 1, C 2, D 3, E 4, F 5, G 6);
tuple_domains!(A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7);

/// The domains that most kernels are made of.
pub mod domains {
    use super::{Domain, UVec2, UVec3, UVec4, Vec2, Vec3};

    const UNIT: f32 = 1.0 / 16_777_216.0;

    /// Picks one of `edges` for one word in sixteen (never for a small word,
    /// so shrinking leads away from edges), else `inside`.
    fn or_edge(word: u32, edges: &[f32], inside: f32) -> f32 {
        if word & 15 == 15 {
            edges[(word >> 4) as usize % edges.len()]
        } else {
            inside
        }
    }

    /// A random number in `[0, 1)`: a multiple of 2^-24.
    #[must_use]
    pub fn unit() -> Domain<f32> {
        const EDGES: [f32; 8] = [0.0, UNIT, 0.125, 0.25, 0.5, 0.75, 0.499_999_97, 1.0 - UNIT];
        Domain::new(1, |w| or_edge(w[0], &EDGES, (w[0] >> 8) as f32 * UNIT))
    }

    /// Two random numbers in `[0, 1)`.
    #[must_use]
    pub fn unit_pair() -> Domain<Vec2> {
        unit().and(unit()).map(|(x, y)| Vec2::new(x, y))
    }

    /// Uniform in `[low, high]`, both ends included.
    #[must_use]
    pub fn range(low: f32, high: f32) -> Domain<f32> {
        assert!(low < high);
        Domain::new(1, move |w| {
            let t = f64::from(w[0] >> 8) / 16_777_215.0;
            let inside = f64::from(low) + t * (f64::from(high) - f64::from(low));
            or_edge(w[0], &[low, high], inside as f32).clamp(low, high)
        })
    }

    /// Uniform in the logarithm over `[low, high]`, `0 < low`.
    #[must_use]
    pub fn log_range(low: f32, high: f32) -> Domain<f32> {
        assert!(0.0 < low && low < high);
        Domain::new(1, move |w| {
            let t = f64::from(w[0] >> 8) / 16_777_215.0;
            let (a, b) = (f64::from(low).ln(), f64::from(high).ln());
            let inside = (a + t * (b - a)).exp() as f32;
            or_edge(w[0], &[low, high], inside).clamp(low, high)
        })
    }

    /// Either sign of a value drawn from `log_range`, or zero.
    #[must_use]
    pub fn signed_log_range(low: f32, high: f32) -> Domain<f32> {
        log_range(low, high)
            .and(Domain::new(1, |w: &[u32]| w[0]))
            .map(|(x, s)| match s >> 27 {
                31 => 0.0,
                _ if s & 1 == 1 => -x,
                _ => x,
            })
    }

    /// A unit vector, rounded to `f32`; edges are the axes, the eight diagonal
    /// corners and vectors next to the poles, -0 among their components.
    #[must_use]
    pub fn unit_vector() -> Domain<Vec3> {
        Domain::new(2, |w| {
            if w[0] & 15 == 15 {
                return unit_vector_edge(w[0] >> 4, w[1]);
            }
            let z = 1.0 - 2.0 * f64::from(w[0] >> 8) * f64::from(UNIT);
            let phi = f64::from(w[1] >> 8) * f64::from(UNIT) * std::f64::consts::TAU;
            let r = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
            Vec3::new((r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32)
        })
    }

    fn unit_vector_edge(kind: u32, word: u32) -> Vec3 {
        let sign = |bit: u32| if word >> bit & 1 == 1 { -1.0f32 } else { 1.0 };
        let zero = |bit: u32| if word >> bit & 1 == 1 { -0.0f32 } else { 0.0 };
        match kind % 4 {
            0 => {
                let mut v = [zero(3), zero(4), zero(5)];
                v[(word >> 8) as usize % 3] = sign(0);
                Vec3::from_array(v)
            }
            1 => {
                let c = (1.0f64 / 3.0).sqrt() as f32;
                Vec3::new(sign(0) * c, sign(1) * c, sign(2) * c)
            }
            2 => {
                // Next to a pole: from 1e-7 to 0.1 rad away from it.
                let t = 10f64.powf(-7.0 + 6.0 * f64::from(word >> 8) * f64::from(UNIT));
                let phi = f64::from(word.wrapping_mul(0x9e37_79b9) >> 8)
                    * f64::from(UNIT)
                    * std::f64::consts::TAU;
                Vec3::new(
                    (t.sin() * phi.cos()) as f32,
                    (t.sin() * phi.sin()) as f32,
                    (t.cos() as f32) * sign(0),
                )
            }
            _ => {
                // On the equator, where z is a zero of either sign.
                let phi = f64::from(word >> 8) * f64::from(UNIT) * std::f64::consts::TAU;
                Vec3::new(phi.cos() as f32, phi.sin() as f32, zero(0))
            }
        }
    }

    /// A vector with each component drawn from `component`.
    #[must_use]
    pub fn vec3(component: Domain<f32>) -> Domain<Vec3> {
        let [x, y, z] = [component.clone(), component.clone(), component];
        x.and(y).and(z).map(|((x, y), z)| Vec3::new(x, y, z))
    }

    /// Any 32 bits; edges are the ends and the sign bit.
    #[must_use]
    pub fn any_u32() -> Domain<u32> {
        const EDGES: [u32; 6] = [0, 1, 0xffff_ffff, 0x8000_0000, 0x7fff_ffff, 0xffff];
        Domain::new(1, |w| {
            if w[0] & 15 == 15 {
                EDGES[(w[0] >> 4) as usize % EDGES.len()]
            } else {
                w[0]
            }
        })
    }

    /// Any two words.
    #[must_use]
    pub fn any_uvec2() -> Domain<UVec2> {
        any_u32().and(any_u32()).map(|(x, y)| UVec2::new(x, y))
    }

    /// Any three words.
    #[must_use]
    pub fn any_uvec3() -> Domain<UVec3> {
        any_uvec2()
            .and(any_u32())
            .map(|(v, z)| UVec3::new(v.x, v.y, z))
    }

    /// Any four words.
    #[must_use]
    pub fn any_uvec4() -> Domain<UVec4> {
        any_uvec2()
            .and(any_uvec2())
            .map(|(v, w)| UVec4::new(v.x, v.y, w.x, w.y))
    }

    /// An integer below `end`.
    #[must_use]
    pub fn below(end: u32) -> Domain<u32> {
        assert!(end > 0);
        Domain::new(1, move |w| {
            if w[0] & 15 == 15 {
                end - 1
            } else {
                (w[0] >> 4) % end
            }
        })
    }
}
