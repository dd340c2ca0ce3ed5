//! Types that can cross between Rust and WGSL as flat 32-bit words.

use std::fmt::Debug;

use glam::{DVec2, DVec3, DVec4, UVec2, UVec3, UVec4, Vec2, Vec3, Vec4};

/// A 32-bit scalar type that both languages share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    /// IEEE 754 binary32.
    F32,
    /// Unsigned integer; also a flag as 0 or 1.
    U32,
}

/// The shape of a value, enough to write WGSL that takes it apart.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TypeInfo {
    /// One word.
    Scalar(Scalar),
    /// Two to four words of one scalar type.
    Vector(Scalar, usize),
    /// A WGSL array: element and length.
    Array(Box<TypeInfo>, usize),
    /// A named WGSL structure: its members in order.
    Struct(&'static str, Vec<(&'static str, TypeInfo)>),
}

impl TypeInfo {
    /// Number of 32-bit words.
    #[must_use]
    pub fn words(&self) -> usize {
        match self {
            Self::Scalar(_) => 1,
            Self::Vector(_, n) => *n,
            Self::Array(element, n) => element.words() * n,
            Self::Struct(_, members) => members.iter().map(|m| m.1.words()).sum(),
        }
    }

    /// The type as WGSL spells it.
    #[must_use]
    pub fn wgsl(&self) -> String {
        let letter = |s: &Scalar| match s {
            Scalar::F32 => "f",
            Scalar::U32 => "u",
        };
        match self {
            Self::Scalar(Scalar::F32) => "f32".into(),
            Self::Scalar(Scalar::U32) => "u32".into(),
            Self::Vector(s, n) => format!("vec{n}{}", letter(s)),
            Self::Array(element, n) => format!("array<{}, {n}>", element.wgsl()),
            Self::Struct(name, _) => (*name).into(),
        }
    }

    /// Each word's path below `prefix` (`.x`, `.normal.y`, …) and its type.
    #[must_use]
    pub fn lanes(&self, prefix: &str) -> Vec<(String, Scalar)> {
        match self {
            Self::Scalar(s) => vec![(prefix.into(), *s)],
            Self::Vector(s, n) => ["x", "y", "z", "w"][..*n]
                .iter()
                .map(|c| (format!("{prefix}.{c}"), *s))
                .collect(),
            Self::Array(element, n) => (0..*n)
                .flat_map(|i| element.lanes(&format!("{prefix}[{i}]")))
                .collect(),
            Self::Struct(_, members) => members
                .iter()
                .flat_map(|(name, ty)| ty.lanes(&format!("{prefix}.{name}")))
                .collect(),
        }
    }

    /// A WGSL expression that builds the value from words; `word(i)` gives the
    /// WGSL expression of the `i`-th word as `u32`, and `next` counts them.
    pub fn construct(&self, word: &dyn Fn(usize) -> String, next: &mut usize) -> String {
        let mut scalar = |s: &Scalar| {
            let w = word(*next);
            *next += 1;
            match s {
                Scalar::F32 => format!("bitcast<f32>({w})"),
                Scalar::U32 => w,
            }
        };
        match self {
            Self::Scalar(s) => scalar(s),
            Self::Vector(s, n) => {
                let parts: Vec<_> = (0..*n).map(|_| scalar(s)).collect();
                format!("{}({})", self.wgsl(), parts.join(", "))
            }
            Self::Array(element, n) => {
                let parts: Vec<_> = (0..*n).map(|_| element.construct(word, next)).collect();
                format!("{}({})", self.wgsl(), parts.join(", "))
            }
            Self::Struct(name, members) => {
                let parts: Vec<_> = members
                    .iter()
                    .map(|(_, ty)| ty.construct(word, next))
                    .collect();
                format!("{name}({})", parts.join(", "))
            }
        }
    }
}

/// A type that a kernel may take or return.
pub trait Value: Copy + Debug + 'static {
    /// The same value in double precision, for the truth. Integers stay as
    /// they are.
    type Wide: Copy + Debug;
    /// Number of 32-bit words.
    const WORDS: usize;

    /// Its shape.
    fn info() -> TypeInfo;
    /// From [`TypeInfo::words`] words.
    fn read(words: &[u32]) -> Self;
    /// To [`TypeInfo::words`] words.
    fn write(self, words: &mut [u32]);
    /// Widened, exactly.
    fn widen(self) -> Self::Wide;
    /// One `f64` for each word (integers are exact in it).
    fn lanes(wide: Self::Wide, out: &mut Vec<f64>);
}

impl Value for f32 {
    type Wide = f64;
    const WORDS: usize = 1;
    fn info() -> TypeInfo {
        TypeInfo::Scalar(Scalar::F32)
    }
    #[inline]
    fn read(words: &[u32]) -> Self {
        f32::from_bits(words[0])
    }
    #[inline]
    fn write(self, words: &mut [u32]) {
        words[0] = self.to_bits();
    }
    fn widen(self) -> f64 {
        f64::from(self)
    }
    fn lanes(wide: f64, out: &mut Vec<f64>) {
        out.push(wide);
    }
}

impl Value for u32 {
    type Wide = u32;
    const WORDS: usize = 1;
    fn info() -> TypeInfo {
        TypeInfo::Scalar(Scalar::U32)
    }
    #[inline]
    fn read(words: &[u32]) -> Self {
        words[0]
    }
    #[inline]
    fn write(self, words: &mut [u32]) {
        words[0] = self;
    }
    fn widen(self) -> u32 {
        self
    }
    fn lanes(wide: u32, out: &mut Vec<f64>) {
        out.push(f64::from(wide));
    }
}

macro_rules! vector_value {
    ($ty:ty, $wide:ty, $scalar:expr, $n:literal, $lane:ty, $widen:expr) => {
        impl Value for $ty {
            type Wide = $wide;
            const WORDS: usize = $n;
            fn info() -> TypeInfo {
                TypeInfo::Vector($scalar, $n)
            }
            #[inline]
            fn read(words: &[u32]) -> Self {
                let mut lanes = [<$lane>::default(); $n];
                for (lane, word) in lanes.iter_mut().zip(words) {
                    *lane = <$lane as Value>::read(std::slice::from_ref(word));
                }
                Self::from_array(lanes)
            }
            #[inline]
            fn write(self, words: &mut [u32]) {
                for (lane, word) in self.to_array().into_iter().zip(words) {
                    lane.write(std::slice::from_mut(word));
                }
            }
            fn widen(self) -> $wide {
                $widen(self)
            }
            fn lanes(wide: $wide, out: &mut Vec<f64>) {
                out.extend(wide.to_array().map(f64::from));
            }
        }
    };
}

vector_value!(Vec2, DVec2, Scalar::F32, 2, f32, |v: Vec2| v.as_dvec2());
vector_value!(Vec3, DVec3, Scalar::F32, 3, f32, |v: Vec3| v.as_dvec3());
vector_value!(Vec4, DVec4, Scalar::F32, 4, f32, |v: Vec4| v.as_dvec4());
vector_value!(UVec2, UVec2, Scalar::U32, 2, u32, std::convert::identity);
vector_value!(UVec3, UVec3, Scalar::U32, 3, u32, std::convert::identity);
vector_value!(UVec4, UVec4, Scalar::U32, 4, u32, std::convert::identity);

impl<T: Value, const N: usize> Value for [T; N] {
    type Wide = [T::Wide; N];
    const WORDS: usize = T::WORDS * N;
    fn info() -> TypeInfo {
        TypeInfo::Array(Box::new(T::info()), N)
    }
    #[inline]
    fn read(words: &[u32]) -> Self {
        std::array::from_fn(|i| T::read(&words[i * T::WORDS..]))
    }
    #[inline]
    fn write(self, words: &mut [u32]) {
        for (i, element) in self.into_iter().enumerate() {
            element.write(&mut words[i * T::WORDS..]);
        }
    }
    fn widen(self) -> Self::Wide {
        self.map(T::widen)
    }
    fn lanes(wide: Self::Wide, out: &mut Vec<f64>) {
        for element in wide {
            T::lanes(element, out);
        }
    }
}

/// Implements [`Value`] for a structure that has a WGSL twin of the same name
/// with the same members in the same order. Its wide form is the tuple of the
/// members' wide forms. `[const N: usize] Name = Type { … }` takes a type with
/// parameters.
#[macro_export]
macro_rules! value_struct {
    ($name:ident { $($members:tt)+ }) => {
        $crate::value_struct!([] $name = $name { $($members)+ });
    };
    ([$($parameter:tt)*] $name:ident = $type:ty { $($member:ident : $ty:ty),+ $(,)? }) => {
        impl<$($parameter)*> $crate::contract::Value for $type {
            type Wide = ($(<$ty as $crate::contract::Value>::Wide,)+);
            const WORDS: usize = 0 $(+ <$ty as $crate::contract::Value>::WORDS)+;
            fn info() -> $crate::contract::TypeInfo {
                $crate::contract::TypeInfo::Struct(
                    stringify!($name),
                    vec![$((stringify!($member), <$ty as $crate::contract::Value>::info())),+],
                )
            }
            #[inline]
            #[allow(unused_assignments)]
            fn read(words: &[u32]) -> Self {
                let mut at = 0;
                $(
                    let $member = <$ty as $crate::contract::Value>::read(&words[at..]);
                    at += <$ty as $crate::contract::Value>::WORDS;
                )+
                Self { $($member),+ }
            }
            #[inline]
            #[allow(unused_assignments)]
            fn write(self, words: &mut [u32]) {
                let mut at = 0;
                $(
                    <$ty as $crate::contract::Value>::write(self.$member, &mut words[at..]);
                    at += <$ty as $crate::contract::Value>::WORDS;
                )+
            }
            fn widen(self) -> Self::Wide {
                ($(<$ty as $crate::contract::Value>::widen(self.$member),)+)
            }
            fn lanes(wide: Self::Wide, out: &mut Vec<f64>) {
                let ($($member,)+) = wide;
                $(<$ty as $crate::contract::Value>::lanes($member, out);)+
            }
        }
    };
}
