//! Runs functions of naga's IR on intervals, once per combination of decisions.

use std::collections::{HashMap, HashSet};

use naga::{
    BinaryOperator as Bin, Expression, Function, Handle, Literal, MathFunction as Mf, Module,
    RelationalFunction, ScalarKind, Statement, SwitchValue, Type, TypeInner, UnaryOperator,
};

use super::arith::{self, Iv};
use super::{Interval, IntervalError, Limits, Scalar, Table, Tri};

/// Decisions up to this depth are taken where they arise, which keeps later uses
/// consistent; deeper ones only where control flow needs them.
const EAGER_DEPTH: usize = 10;
/// An argument covering up to this many integers is split.
const EAGER_VALUES: u32 = 4;
/// An ambiguous index or selector may cover this many values.
const INDEX_VALUES: i64 = 32;

/// WGSL text ready to be evaluated in interval arithmetic.
pub struct Program {
    module: Module,
    functions: Vec<FunctionInfo>,
    names: HashMap<String, Handle<Function>>,
    /// Named values that are taken at one end of their interval at a time.
    by_ends: HashSet<(Handle<Function>, Handle<Expression>)>,
    /// How much work one [`Program::call`] may take.
    pub limits: Limits,
}

struct FunctionInfo {
    /// Values of the expressions that are constant within the function.
    statics: Vec<Option<Value>>,
    /// Expression index and argument index.
    arguments: Vec<(usize, usize)>,
    /// Expression index and local index.
    locals: Vec<(usize, usize)>,
    /// Initial values of the local variables.
    initial: Vec<Result<Value, String>>,
}

/// One scalar on the way through a function.
///
/// `id` names a value that is not exact, so that `x * x` is known to be a square
/// and a decision on `x` narrows every copy of it; 0 for exact values. Odd ids are
/// products, which a compiler may fuse into a following sum.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Sc {
    F(u32, Iv),
    U(u32, u32),
    I(i32, i32),
    B(Tri),
    /// Bits of a float that is not exact, as `i32` when the flag is set.
    Bits(u32, Iv, bool),
}

#[derive(Clone, Debug)]
enum Value {
    S(Sc),
    V(u8, [Sc; 4]),
    C(Vec<Value>),
    P(Place),
}

/// A local variable, or a part of one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    slot: usize,
    len: u8,
    path: [u32; 6],
}

enum Stop {
    Unsupported(String),
    Bounds { index: i64, length: usize },
    Decisions,
    Steps,
}

type Run<T> = Result<T, Stop>;

fn unsupported<T>(what: impl Into<String>) -> Run<T> {
    Err(Stop::Unsupported(what.into()))
}

enum Flow {
    Next,
    Break,
    Continue,
    Return(Option<Value>),
}

struct Frame<'p> {
    handle: Handle<Function>,
    function: &'p Function,
    info: &'p FunctionInfo,
    values: Vec<Value>,
}

pub(super) struct Machine<'p> {
    program: &'p Program,
    table: Table,
    /// Choice and number of choices of every decision so far.
    trail: Vec<(u32, u32)>,
    at: usize,
    locals: Vec<Value>,
    next_id: u32,
    refined: Vec<(u32, Iv)>,
    steps: u64,
    depth: usize,
    pool: Vec<Vec<Value>>,
    /// The function that was running when an error arose.
    failing: Option<String>,
}

impl Program {
    /// Reads and validates WGSL text.
    ///
    /// # Errors
    /// [`IntervalError::Parse`] when naga rejects the text.
    pub fn parse(wgsl: &str) -> Result<Self, IntervalError> {
        let module = naga::front::wgsl::parse_str(wgsl)
            .map_err(|e| IntervalError::Parse(e.emit_to_string(wgsl)))?;
        naga::valid::Validator::new(
            naga::valid::ValidationFlags::all(),
            // Packing to f16 is core WGSL.
            naga::valid::Capabilities::SHADER_FLOAT16_IN_FLOAT32,
        )
        .validate(&module)
        .map_err(|e| IntervalError::Parse(e.emit_to_string(wgsl)))?;
        let constants = Constants { module: &module };
        let functions = module
            .functions
            .iter()
            .map(|(_, f)| constants.function(f))
            .collect();
        let names = module
            .functions
            .iter()
            .filter_map(|(handle, f)| Some((f.name.clone()?, handle)))
            .collect();
        Ok(Self {
            module,
            functions,
            names,
            by_ends: HashSet::new(),
            limits: Limits::default(),
        })
    }

    /// Takes the variable `name` of `function` at one end of its interval at a
    /// time and joins the results.
    ///
    /// This is what plain intervals cannot see: that a value used twice is the
    /// same value both times. It is sound where the result is monotone in the
    /// variable on either side of zero (which counts as an end), all else
    /// fixed; for instance where it is affine in it, or in its square.
    ///
    /// # Errors
    /// [`IntervalError::UnknownFunction`] or [`IntervalError::UnknownVariable`].
    pub fn take_by_ends(&mut self, function: &str, name: &str) -> Result<(), IntervalError> {
        let Some(&handle) = self.names.get(function) else {
            return Err(IntervalError::UnknownFunction(function.into()));
        };
        let named = &self.module.functions[handle].named_expressions;
        let Some((&expression, _)) = named.iter().find(|(_, n)| *n == name) else {
            return Err(IntervalError::UnknownVariable {
                function: function.into(),
                name: name.into(),
            });
        };
        self.by_ends.insert((handle, expression));
        Ok(())
    }

    /// Number of argument words `function` takes, none if there is no such function
    /// or it takes something other than numbers.
    #[must_use]
    pub fn argument_words(&self, function: &str) -> Option<usize> {
        let function = &self.module.functions[*self.names.get(function)?];
        function
            .arguments
            .iter()
            .map(|a| words_of(&self.module, a.ty))
            .sum()
    }
}

/// Words of a value of type `ty`.
fn words_of(module: &Module, ty: Handle<Type>) -> Option<usize> {
    match &module.types[ty].inner {
        TypeInner::Scalar(_) => Some(1),
        TypeInner::Vector { size, .. } => Some(*size as usize),
        TypeInner::Array {
            base,
            size: naga::ArraySize::Constant(n),
            ..
        } => Some(words_of(module, *base)? * n.get() as usize),
        TypeInner::Struct { members, .. } => members.iter().map(|m| words_of(module, m.ty)).sum(),
        _ => None,
    }
}

/// Evaluation of what does not depend on a call.
struct Constants<'m> {
    module: &'m Module,
}

impl Constants<'_> {
    fn function(&self, f: &Function) -> FunctionInfo {
        let mut statics: Vec<Option<Value>> = Vec::with_capacity(f.expressions.len());
        let mut arguments = Vec::new();
        let mut locals = Vec::new();
        for (handle, expression) in f.expressions.iter() {
            match *expression {
                Expression::FunctionArgument(i) => arguments.push((handle.index(), i as usize)),
                Expression::LocalVariable(l) => locals.push((handle.index(), l.index())),
                _ => {}
            }
            let value = self.expression(expression, &|h| statics[h.index()].clone());
            statics.push(value);
        }
        let initial = f
            .local_variables
            .iter()
            .map(|(_, local)| {
                let value = match local.init {
                    Some(init) => statics[init.index()].clone(),
                    None => self.zero(local.ty),
                };
                value.ok_or_else(|| {
                    format!(
                        "a local variable `{}` of an unusual type",
                        local.name.as_deref().unwrap_or("")
                    )
                })
            })
            .collect();
        FunctionInfo {
            statics,
            arguments,
            locals,
            initial,
        }
    }

    fn expression(
        &self,
        expression: &Expression,
        known: &dyn Fn(Handle<Expression>) -> Option<Value>,
    ) -> Option<Value> {
        match expression {
            Expression::Literal(literal) => literal_value(*literal).map(Value::S),
            Expression::ZeroValue(ty) => self.zero(*ty),
            Expression::Constant(c) => self.global(self.module.constants[*c].init),
            Expression::Compose { ty, components } => {
                let parts = components
                    .iter()
                    .map(|&h| known(h))
                    .collect::<Option<Vec<_>>>()?;
                compose(&self.module.types[*ty].inner, parts)
            }
            Expression::Splat { size, value } => match known(*value)? {
                Value::S(s) => Some(Value::V(*size as u8, [s; 4])),
                _ => None,
            },
            _ => None,
        }
    }

    fn global(&self, handle: Handle<Expression>) -> Option<Value> {
        self.expression(&self.module.global_expressions[handle], &|h| self.global(h))
    }

    fn zero(&self, ty: Handle<Type>) -> Option<Value> {
        self.build(ty, &mut || Some(0))
    }

    /// A value of type `ty` from its words.
    fn build(&self, ty: Handle<Type>, word: &mut dyn FnMut() -> Option<u32>) -> Option<Value> {
        match &self.module.types[ty].inner {
            TypeInner::Scalar(scalar) => word_scalar(*scalar, word()?).map(Value::S),
            TypeInner::Vector { size, scalar } => {
                let mut v = [Sc::B(Tri::False); 4];
                for s in v.iter_mut().take(*size as usize) {
                    *s = word_scalar(*scalar, word()?)?;
                }
                Some(Value::V(*size as u8, v))
            }
            TypeInner::Array {
                base,
                size: naga::ArraySize::Constant(n),
                ..
            } => (0..n.get())
                .map(|_| self.build(*base, word))
                .collect::<Option<_>>()
                .map(Value::C),
            TypeInner::Struct { members, .. } => members
                .iter()
                .map(|m| self.build(m.ty, word))
                .collect::<Option<_>>()
                .map(Value::C),
            _ => None,
        }
    }
}

fn word_scalar(scalar: naga::Scalar, word: u32) -> Option<Sc> {
    match (scalar.kind, scalar.width) {
        (ScalarKind::Float, 4) => Some(Sc::F(0, Iv::point(f32::from_bits(word)))),
        (ScalarKind::Uint, 4) => Some(Sc::U(word, word)),
        (ScalarKind::Sint, 4) => Some(Sc::I(word.cast_signed(), word.cast_signed())),
        (ScalarKind::Bool, _) => Some(Sc::B((word != 0).into())),
        _ => None,
    }
}

fn literal_value(literal: Literal) -> Option<Sc> {
    Some(match literal {
        Literal::F32(x) => Sc::F(0, Iv::point(x)),
        Literal::U32(x) => Sc::U(x, x),
        Literal::I32(x) => Sc::I(x, x),
        Literal::Bool(x) => Sc::B(x.into()),
        _ => return None,
    })
}

fn compose(inner: &TypeInner, parts: Vec<Value>) -> Option<Value> {
    match inner {
        TypeInner::Vector { size, .. } => {
            let mut v = [Sc::B(Tri::False); 4];
            let mut n = 0;
            for part in &parts {
                for &s in part.scalars()? {
                    *v.get_mut(n)? = s;
                    n += 1;
                }
            }
            (n == *size as usize).then_some(Value::V(n as u8, v))
        }
        TypeInner::Struct { .. } | TypeInner::Array { .. } => Some(Value::C(parts)),
        _ => None,
    }
}

impl Value {
    fn scalars(&self) -> Option<&[Sc]> {
        match self {
            Self::S(s) => Some(std::slice::from_ref(s)),
            Self::V(n, v) => Some(&v[..*n as usize]),
            _ => None,
        }
    }
}

impl<'p> Machine<'p> {
    pub(super) fn call(
        program: &'p Program,
        name: &str,
        args: &[u32],
        table: Table,
    ) -> Result<Vec<Scalar>, IntervalError> {
        let Some(&handle) = program.names.get(name) else {
            return Err(IntervalError::UnknownFunction(name.into()));
        };
        let function = &program.module.functions[handle];
        let Some(expected) = program.argument_words(name) else {
            return Err(IntervalError::Unsupported {
                function: name.into(),
                what: "a parameter that is not made of 32-bit numbers".into(),
            });
        };
        if expected != args.len() {
            return Err(IntervalError::ArgumentCount {
                function: name.into(),
                expected,
                found: args.len(),
            });
        }
        let constants = Constants {
            module: &program.module,
        };
        let mut words = args.iter().copied();
        let mut arguments = Vec::with_capacity(function.arguments.len());
        for argument in &function.arguments {
            let Some(value) = constants.build(argument.ty, &mut || words.next()) else {
                return Err(IntervalError::Unsupported {
                    function: name.into(),
                    what: "a parameter that is not made of 32-bit numbers".into(),
                });
            };
            arguments.push(value);
        }
        let mut machine = Self {
            program,
            table,
            trail: Vec::new(),
            at: 0,
            locals: Vec::new(),
            next_id: 1,
            refined: Vec::new(),
            steps: program.limits.steps,
            depth: 0,
            pool: Vec::new(),
            failing: None,
        };
        machine.paths(name, handle, &arguments)
    }

    /// Runs every combination of decisions and joins the results.
    fn paths(
        &mut self,
        name: &str,
        handle: Handle<Function>,
        arguments: &[Value],
    ) -> Result<Vec<Scalar>, IntervalError> {
        let limits = self.program.limits;
        let too_ambiguous = || IntervalError::TooAmbiguous {
            function: name.into(),
            paths: limits.paths,
            depth: limits.depth,
        };
        let mut total: Option<Vec<Scalar>> = None;
        for _ in 0..limits.paths {
            self.at = 0;
            self.next_id = 1;
            self.refined.clear();
            self.locals.clear();
            self.depth = 0;
            let value = match self.function(handle, arguments.to_vec()) {
                Ok(value) => value,
                Err(stop) => {
                    let function = self.failing.take().unwrap_or_else(|| name.into());
                    return Err(match stop {
                        Stop::Unsupported(what) => IntervalError::Unsupported { function, what },
                        Stop::Bounds { index, length } => IntervalError::IndexOutOfBounds {
                            function,
                            index,
                            length,
                        },
                        Stop::Decisions => too_ambiguous(),
                        Stop::Steps => IntervalError::TooManySteps {
                            function: name.into(),
                            steps: limits.steps,
                        },
                    });
                }
            };
            let mut result = Vec::new();
            if let Some(value) = &value {
                self.flatten(value, &mut result);
            }
            total = Some(match total {
                None => result,
                Some(mut old) => {
                    for (a, b) in old.iter_mut().zip(result) {
                        *a = a.hull(b);
                    }
                    old
                }
            });
            // The next combination, in the order of counting.
            self.trail.truncate(self.at);
            while let Some(&(choice, count)) = self.trail.last() {
                if choice + 1 < count {
                    break;
                }
                self.trail.pop();
            }
            match self.trail.last_mut() {
                Some((choice, _)) => *choice += 1,
                None => return Ok(total.unwrap_or_default()),
            }
        }
        Err(too_ambiguous())
    }

    fn flatten(&self, value: &Value, result: &mut Vec<Scalar>) {
        match value {
            Value::C(parts) => parts.iter().for_each(|p| self.flatten(p, result)),
            Value::P(_) => {}
            Value::S(_) | Value::V(..) => {
                for s in value.scalars().unwrap_or_default() {
                    result.push(match *s {
                        Sc::F(..) => {
                            let iv = self.float(s);
                            Scalar::F32(Interval {
                                lo: f64::from(iv.lo),
                                hi: f64::from(iv.hi),
                            })
                        }
                        Sc::U(lo, hi) => Scalar::U32 { lo, hi },
                        Sc::I(lo, hi) => Scalar::I32 { lo, hi },
                        Sc::B(b) => Scalar::Bool(b),
                        Sc::Bits(_, _, signed) => match self.plain(*s) {
                            Sc::U(lo, hi) if !signed => Scalar::U32 { lo, hi },
                            Sc::I(lo, hi) => Scalar::I32 { lo, hi },
                            _ => Scalar::U32 {
                                lo: 0,
                                hi: u32::MAX,
                            },
                        },
                    });
                }
            }
        }
    }

    // Decisions.

    fn decide(&mut self, count: u32) -> Run<u32> {
        let choice = match self.trail.get(self.at) {
            Some(&(choice, _)) => choice,
            None => {
                if self.at >= self.program.limits.depth as usize {
                    return Err(Stop::Decisions);
                }
                self.trail.push((0, count));
                0
            }
        };
        self.at += 1;
        Ok(choice)
    }

    /// The lower or the upper end of each float, or zero if that is between.
    fn one_end(&mut self, v: &Value) -> Run<Value> {
        self.map1(v, |m, s| {
            let iv = m.float(&s);
            if !matches!(s, Sc::F(..)) || iv.is_any() || iv.is_point() {
                return Ok(s);
            }
            let straddles = iv.lo < 0.0 && iv.hi > 0.0;
            let end = match m.decide(if straddles { 3 } else { 2 })? {
                0 => iv.lo,
                1 => iv.hi,
                _ => 0.0,
            };
            Ok(Sc::F(0, Iv::point(end)))
        })
    }

    fn eager(&self) -> bool {
        self.at < EAGER_DEPTH
    }

    /// The value a decision settles on, for an ambiguous truth value.
    fn truth(&mut self, s: Sc) -> Run<bool> {
        match s {
            Sc::B(Tri::False) => Ok(false),
            Sc::B(Tri::True) => Ok(true),
            Sc::B(Tri::Either) => Ok(self.decide(2)? == 1),
            _ => unsupported("a condition that is not a bool"),
        }
    }

    /// An exact integer, by decision when it covers few values.
    fn exact(&mut self, s: Sc) -> Run<i64> {
        let (lo, hi) = match self.plain(s) {
            Sc::U(lo, hi) => (i64::from(lo), i64::from(hi)),
            Sc::I(lo, hi) => (i64::from(lo), i64::from(hi)),
            _ => return unsupported("an index that is not an integer"),
        };
        if lo == hi {
            return Ok(lo);
        }
        if hi - lo >= INDEX_VALUES {
            return Err(Stop::Decisions);
        }
        Ok(lo + i64::from(self.decide((hi - lo + 1) as u32)?))
    }

    // Scalars.

    fn new_float(&mut self, iv: Iv) -> Sc {
        self.new_value(iv, 0)
    }

    fn new_value(&mut self, iv: Iv, product: u32) -> Sc {
        if iv.is_point() || iv.is_any() {
            return Sc::F(0, iv);
        }
        self.next_id += 2;
        Sc::F((self.next_id & !1) | product, iv)
    }

    /// The interval of a float, narrowed by the decisions taken on it.
    fn float(&self, s: &Sc) -> Iv {
        match *s {
            Sc::F(id, iv) | Sc::Bits(id, iv, _) => {
                if id != 0 && !self.refined.is_empty() {
                    for (other, narrow) in self.refined.iter().rev() {
                        if *other == id {
                            return *narrow;
                        }
                    }
                }
                iv
            }
            _ => Iv::ANY,
        }
    }

    /// As [`Self::float`], for an addend: a fused product is not the rounded value
    /// that the decision was about.
    fn addend(&self, s: &Sc) -> Iv {
        match *s {
            Sc::F(id, iv) if id & 1 == 1 && self.table == Table::Wgsl => iv,
            _ => self.float(s),
        }
    }

    /// Narrows a value; an empty result only arises from flushing and is ignored.
    fn narrow(&mut self, s: &Sc, lo: f32, hi: f32) {
        if let Sc::F(id, _) = *s
            && id != 0
        {
            let old = self.float(s);
            let new = Iv {
                lo: old.lo.max(lo),
                hi: old.hi.min(hi),
            };
            if new.lo <= new.hi && new != old {
                self.refined.push((id, new));
            }
        }
    }

    /// Integers as ranges: bits of a float become the range they cover.
    fn plain(&self, s: Sc) -> Sc {
        let Sc::Bits(_, _, signed) = s else { return s };
        let iv = self.float(&s);
        let bounded = !iv.is_any();
        let (lo, hi) = if bounded && (iv.lo > 0.0 || (iv.lo.to_bits() == 0 && iv.hi > 0.0)) {
            (iv.lo.to_bits(), iv.hi.to_bits())
        } else if bounded && iv.hi < 0.0 {
            (iv.hi.to_bits(), iv.lo.to_bits())
        } else if signed {
            return Sc::I(i32::MIN, i32::MAX);
        } else {
            return Sc::U(0, u32::MAX);
        };
        if signed {
            Sc::I(lo.cast_signed(), hi.cast_signed())
        } else {
            Sc::U(lo, hi)
        }
    }

    /// Applies an exact step function; splits when few integers are covered.
    /// `range` gives the arguments that map to an integer.
    fn step(&mut self, s: &Sc, f: fn(f32) -> f32, range: fn(f32) -> (f32, f32)) -> Run<Sc> {
        let iv = self.float(s);
        let r = arith::step_fn(self.table, iv, f);
        if r.is_point() || r.is_any() || !self.eager() {
            return Ok(self.new_float(r));
        }
        let count = r.hi - r.lo;
        if count >= EAGER_VALUES as f32 {
            return Ok(self.new_float(r));
        }
        let k = r.lo + self.decide(count as u32 + 1)? as f32;
        let (lo, hi) = range(k);
        self.narrow(s, lo, hi);
        Ok(Sc::F(
            0,
            Iv {
                lo: if k == 0.0 { -0.0 } else { k },
                hi: if k == 0.0 { 0.0 } else { k },
            },
        ))
    }

    fn compare(&mut self, op: Bin, a: Sc, b: Sc) -> Run<Sc> {
        let tri = match (a, b) {
            (Sc::F(ida, _), Sc::F(idb, _)) => {
                let (x, y) = (self.float(&a), self.float(&b));
                return self.compare_floats(op, a, b, x, y, ida != 0 && ida == idb);
            }
            (Sc::B(x), Sc::B(y)) => {
                let eq = match (x, y) {
                    (Tri::Either, _) | (_, Tri::Either) => Tri::Either,
                    _ => (x == y).into(),
                };
                match op {
                    Bin::Equal => eq,
                    Bin::NotEqual => not(eq),
                    _ => return unsupported("an ordering of bools"),
                }
            }
            _ => {
                let (al, ah, bl, bh) = match (self.plain(a), self.plain(b)) {
                    (Sc::U(al, ah), Sc::U(bl, bh)) => {
                        (i64::from(al), i64::from(ah), i64::from(bl), i64::from(bh))
                    }
                    (Sc::I(al, ah), Sc::I(bl, bh)) => {
                        (i64::from(al), i64::from(ah), i64::from(bl), i64::from(bh))
                    }
                    _ => return unsupported("a comparison of different types"),
                };
                order(op, al, ah, bl, bh)
            }
        };
        if tri == Tri::Either && self.eager() {
            return Ok(Sc::B((self.decide(2)? == 1).into()));
        }
        Ok(Sc::B(tri))
    }

    fn compare_floats(&mut self, op: Bin, a: Sc, b: Sc, x: Iv, y: Iv, same: bool) -> Run<Sc> {
        if x.is_any() || y.is_any() {
            let tri = if self.eager() {
                (self.decide(2)? == 1).into()
            } else {
                Tri::Either
            };
            return Ok(Sc::B(tri));
        }
        if same {
            return Ok(Sc::B(
                matches!(op, Bin::Equal | Bin::LessEqual | Bin::GreaterEqual).into(),
            ));
        }
        let exact = arith::step_fn(self.table, x, |v| v);
        let other = arith::step_fn(self.table, y, |v| v);
        let tri = order(op, exact.lo, exact.hi, other.lo, other.hi);
        if tri != Tri::Either || !self.eager() {
            return Ok(Sc::B(tri));
        }
        let outcome = self.decide(2)? == 1;
        // What the outcome says about both sides.
        let relation = match (op, outcome) {
            (Bin::Less, true) | (Bin::GreaterEqual, false) => Bin::Less,
            (Bin::LessEqual, true) | (Bin::Greater, false) => Bin::LessEqual,
            (Bin::Greater, true) | (Bin::LessEqual, false) => Bin::Greater,
            (Bin::GreaterEqual, true) | (Bin::Less, false) => Bin::GreaterEqual,
            (Bin::Equal, true) | (Bin::NotEqual, false) => Bin::Equal,
            _ => Bin::NotEqual,
        };
        let (inf, ninf) = (f32::INFINITY, f32::NEG_INFINITY);
        match relation {
            Bin::Less => {
                self.narrow(&a, ninf, y.hi.next_down());
                self.narrow(&b, x.lo.next_up(), inf);
            }
            Bin::LessEqual => {
                self.narrow(&a, ninf, y.hi);
                self.narrow(&b, x.lo, inf);
            }
            Bin::Greater => {
                self.narrow(&a, y.lo.next_up(), inf);
                self.narrow(&b, ninf, x.hi.next_down());
            }
            Bin::GreaterEqual => {
                self.narrow(&a, y.lo, inf);
                self.narrow(&b, ninf, x.hi);
            }
            Bin::Equal => {
                self.narrow(&a, y.lo, y.hi);
                self.narrow(&b, x.lo, x.hi);
            }
            _ => {}
        }
        Ok(Sc::B(outcome.into()))
    }

    // Functions and statements.

    fn function(&mut self, handle: Handle<Function>, arguments: Vec<Value>) -> Run<Option<Value>> {
        let program = self.program;
        let function = &program.module.functions[handle];
        let info = &program.functions[handle.index()];
        if self.depth > 64 {
            return unsupported("calls nested more than 64 deep");
        }
        self.depth += 1;
        let mut values = self.pool.pop().unwrap_or_default();
        let needed = function.expressions.len();
        if values.len() < needed {
            values.resize(needed, Value::S(Sc::B(Tri::False)));
        }
        let base = self.locals.len();
        for initial in &info.initial {
            match initial {
                Ok(value) => self.locals.push(value.clone()),
                Err(what) => return unsupported(what.clone()),
            }
        }
        for &(expression, local) in &info.locals {
            values[expression] = Value::P(Place {
                slot: base + local,
                len: 0,
                path: [0; 6],
            });
        }
        for &(expression, argument) in &info.arguments {
            values[expression] = arguments[argument].clone();
        }
        let mut frame = Frame {
            handle,
            function,
            info,
            values,
        };
        let flow = self.block(&mut frame, &function.body);
        if flow.is_err() && self.failing.is_none() {
            self.failing.clone_from(&function.name);
        }
        self.pool.push(frame.values);
        self.locals.truncate(base);
        self.depth -= 1;
        match flow? {
            Flow::Return(value) => Ok(value),
            _ => Ok(None),
        }
    }

    fn tick(&mut self, n: u64) -> Run<()> {
        match self.steps.checked_sub(n) {
            Some(left) => {
                self.steps = left;
                Ok(())
            }
            None => Err(Stop::Steps),
        }
    }

    fn block(&mut self, frame: &mut Frame<'p>, block: &'p naga::Block) -> Run<Flow> {
        for statement in block.iter() {
            match self.statement(frame, statement)? {
                Flow::Next => {}
                flow => return Ok(flow),
            }
        }
        Ok(Flow::Next)
    }

    fn statement(&mut self, frame: &mut Frame<'p>, statement: &'p Statement) -> Run<Flow> {
        self.tick(1)?;
        match statement {
            Statement::Emit(range) => {
                for handle in range.clone() {
                    if frame.info.statics[handle.index()].is_none() {
                        self.tick(1)?;
                        let mut value = self.expression(frame, handle)?;
                        if self.program.by_ends.contains(&(frame.handle, handle)) {
                            value = self.one_end(&value)?;
                        }
                        frame.values[handle.index()] = value;
                    }
                }
                Ok(Flow::Next)
            }
            Statement::Block(block) => self.block(frame, block),
            Statement::If {
                condition,
                accept,
                reject,
            } => {
                let condition = scalar(value(frame, *condition))?;
                if self.truth(condition)? {
                    self.block(frame, accept)
                } else {
                    self.block(frame, reject)
                }
            }
            Statement::Switch { selector, cases } => {
                let selector = scalar(value(frame, *selector))?;
                let chosen = self.exact(selector)?;
                let matches = |v: &SwitchValue| match *v {
                    SwitchValue::I32(x) => i64::from(x) == chosen,
                    SwitchValue::U32(x) => i64::from(x) == chosen,
                    SwitchValue::Default => false,
                };
                let start = cases
                    .iter()
                    .position(|c| matches(&c.value))
                    .or_else(|| cases.iter().position(|c| c.value == SwitchValue::Default));
                for case in &cases[start.unwrap_or(cases.len())..] {
                    match self.block(frame, &case.body)? {
                        Flow::Next if case.fall_through => {}
                        Flow::Next | Flow::Break => break,
                        flow => return Ok(flow),
                    }
                }
                Ok(Flow::Next)
            }
            Statement::Loop {
                body,
                continuing,
                break_if,
            } => loop {
                self.tick(1)?;
                match self.block(frame, body)? {
                    Flow::Next | Flow::Continue => {}
                    Flow::Break => return Ok(Flow::Next),
                    flow @ Flow::Return(_) => return Ok(flow),
                }
                self.block(frame, continuing)?;
                if let Some(condition) = break_if {
                    let condition = scalar(value(frame, *condition))?;
                    if self.truth(condition)? {
                        return Ok(Flow::Next);
                    }
                }
            },
            Statement::Break => Ok(Flow::Break),
            Statement::Continue => Ok(Flow::Continue),
            Statement::Return { value: result } => {
                Ok(Flow::Return(result.map(|h| value(frame, h).clone())))
            }
            Statement::Store {
                pointer,
                value: stored,
            } => {
                let stored = value(frame, *stored).clone();
                let Value::P(place) = *value(frame, *pointer) else {
                    return unsupported("a store that is not to a local variable");
                };
                self.store(place, stored)?;
                Ok(Flow::Next)
            }
            Statement::Call {
                function,
                arguments,
                result,
            } => {
                let arguments = arguments.iter().map(|&h| value(frame, h).clone()).collect();
                let returned = self.function(*function, arguments)?;
                if let (Some(result), Some(returned)) = (result, returned) {
                    frame.values[result.index()] = returned;
                }
                Ok(Flow::Next)
            }
            _ => unsupported("a statement other than assignment, call and control flow"),
        }
    }

    fn load(&self, place: Place) -> Run<Value> {
        let mut at = &self.locals[place.slot];
        for &index in &place.path[..place.len as usize] {
            match at {
                Value::C(parts) => at = part(parts, index)?,
                Value::V(n, v) => return Ok(Value::S(*part(&v[..*n as usize], index)?)),
                _ => return unsupported("a pointer into a scalar"),
            }
        }
        Ok(at.clone())
    }

    fn store(&mut self, place: Place, stored: Value) -> Run<()> {
        let mut at = &mut self.locals[place.slot];
        for &index in &place.path[..place.len as usize] {
            match at {
                Value::C(parts) => {
                    let length = parts.len();
                    let bounds = Stop::Bounds {
                        index: i64::from(index),
                        length,
                    };
                    at = parts.get_mut(index as usize).ok_or(bounds)?;
                }
                Value::V(n, v) => {
                    let length = *n as usize;
                    let bounds = Stop::Bounds {
                        index: i64::from(index),
                        length,
                    };
                    *v[..length].get_mut(index as usize).ok_or(bounds)? = scalar(&stored)?;
                    return Ok(());
                }
                _ => return unsupported("a pointer into a scalar"),
            }
        }
        *at = stored;
        Ok(())
    }

    // Expressions.

    fn expression(&mut self, frame: &Frame<'p>, handle: Handle<Expression>) -> Run<Value> {
        match &frame.function.expressions[handle] {
            Expression::Compose { ty, components } => {
                let inner = &self.program.module.types[*ty].inner;
                if let TypeInner::Vector { size, .. } = inner {
                    let mut v = [Sc::B(Tri::False); 4];
                    let mut n = 0;
                    for &component in components {
                        for &s in value(frame, component).scalars().unwrap_or_default() {
                            if n < 4 {
                                v[n] = s;
                            }
                            n += 1;
                        }
                    }
                    debug_assert_eq!(n, *size as usize);
                    return Ok(Value::V(*size as u8, v));
                }
                let parts = components
                    .iter()
                    .map(|&h| value(frame, h).clone())
                    .collect();
                compose(inner, parts).map_or_else(|| unsupported("a matrix"), Ok)
            }
            Expression::Access { base, index } => {
                let index = self.exact(scalar(value(frame, *index))?)?;
                self.element(value(frame, *base), index)
            }
            Expression::AccessIndex { base, index } => {
                self.element(value(frame, *base), i64::from(*index))
            }
            Expression::Splat { size, value: v } => {
                Ok(Value::V(*size as u8, [scalar(value(frame, *v))?; 4]))
            }
            Expression::Swizzle {
                size,
                vector,
                pattern,
            } => {
                let Value::V(_, v) = value(frame, *vector) else {
                    return unsupported("a swizzle of something other than a vector");
                };
                let mut r = [v[0]; 4];
                for i in 0..*size as usize {
                    r[i] = v[pattern[i] as usize];
                }
                Ok(Value::V(*size as u8, r))
            }
            Expression::Load { pointer } => match value(frame, *pointer) {
                Value::P(place) => self.load(*place),
                _ => unsupported("a variable that is not local"),
            },
            Expression::Unary { op, expr } => {
                let op = *op;
                self.map1(value(frame, *expr), |m, s| m.unary(op, s))
            }
            Expression::Binary { op, left, right } => {
                let op = *op;
                self.map2(value(frame, *left), value(frame, *right), |m, a, b| {
                    m.binary(op, a, b)
                })
            }
            Expression::Select {
                condition,
                accept,
                reject,
            } => {
                let (accept, reject) = (value(frame, *accept), value(frame, *reject));
                match value(frame, *condition) {
                    Value::S(c) => self.select(*c, accept, reject),
                    Value::V(n, c) => {
                        let (Value::V(_, a), Value::V(_, r)) = (accept, reject) else {
                            return unsupported("a select of mixed shapes");
                        };
                        let mut v = *r;
                        for i in 0..*n as usize {
                            let s = self.select(c[i], &Value::S(a[i]), &Value::S(r[i]))?;
                            v[i] = scalar(&s)?;
                        }
                        Ok(Value::V(*n, v))
                    }
                    _ => unsupported("a select on something other than a bool"),
                }
            }
            Expression::Relational { fun, argument } => {
                let Some(parts) = value(frame, *argument).scalars() else {
                    return unsupported("all() or any() of something other than a vector");
                };
                let mut r = Tri::from(matches!(fun, RelationalFunction::All));
                for s in parts {
                    let Sc::B(b) = *s else {
                        return unsupported("isNan or isInf");
                    };
                    r = match fun {
                        RelationalFunction::All => and(r, b),
                        RelationalFunction::Any => not(and(not(r), not(b))),
                        _ => return unsupported("isNan or isInf"),
                    };
                }
                Ok(Value::S(Sc::B(r)))
            }
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                arg3,
            } => {
                let a = value(frame, *arg);
                let others = [*arg1, *arg2, *arg3].map(|h| h.map(|h| value(frame, h)));
                self.math(*fun, a, others)
            }
            Expression::As {
                expr,
                kind,
                convert,
            } => {
                let (kind, convert) = (*kind, *convert);
                if convert.is_some_and(|width| width != 4 && kind != ScalarKind::Bool) {
                    return unsupported("a type that is not 32 bits wide");
                }
                self.map1(value(frame, *expr), |m, s| {
                    if convert.is_some() {
                        m.convert(kind, s)
                    } else {
                        m.bitcast(kind, s)
                    }
                })
            }
            other => {
                let what = format!("{other:?}");
                let word = what
                    .split([' ', '(', '{'])
                    .next()
                    .unwrap_or_default()
                    .to_owned();
                unsupported(format!("an expression of kind `{word}`"))
            }
        }
    }

    fn element(&self, base: &Value, index: i64) -> Run<Value> {
        let at = u32::try_from(index).unwrap_or(u32::MAX);
        match base {
            Value::V(n, v) => Ok(Value::S(*part(&v[..*n as usize], at)?)),
            Value::C(parts) => Ok(part(parts, at)?.clone()),
            Value::P(place) => {
                let mut place = *place;
                let Some(slot) = place.path.get_mut(place.len as usize) else {
                    return unsupported("types nested more than six deep");
                };
                *slot = at;
                place.len += 1;
                Ok(Value::P(place))
            }
            Value::S(_) => unsupported("an index into a scalar"),
        }
    }

    fn map1(&mut self, a: &Value, mut f: impl FnMut(&mut Self, Sc) -> Run<Sc>) -> Run<Value> {
        match a {
            Value::S(s) => Ok(Value::S(f(self, *s)?)),
            Value::V(n, v) => {
                let mut r = *v;
                for s in r.iter_mut().take(*n as usize) {
                    *s = f(self, *s)?;
                }
                Ok(Value::V(*n, r))
            }
            _ => unsupported("arithmetic on a struct or an array"),
        }
    }

    fn map2(
        &mut self,
        a: &Value,
        b: &Value,
        mut f: impl FnMut(&mut Self, Sc, Sc) -> Run<Sc>,
    ) -> Run<Value> {
        let (n, a, b) = match (a, b) {
            (Value::S(a), Value::S(b)) => return Ok(Value::S(f(self, *a, *b)?)),
            (Value::V(n, a), Value::V(_, b)) => (*n, *a, *b),
            (Value::S(a), Value::V(n, b)) => (*n, [*a; 4], *b),
            (Value::V(n, a), Value::S(b)) => (*n, *a, [*b; 4]),
            _ => return unsupported("arithmetic on a struct, an array or a matrix"),
        };
        let mut r = a;
        for i in 0..n as usize {
            r[i] = f(self, a[i], b[i])?;
        }
        Ok(Value::V(n, r))
    }

    fn select(&mut self, condition: Sc, accept: &Value, reject: &Value) -> Run<Value> {
        if condition == Sc::B(Tri::Either)
            && let (Some(a), Some(r)) = (accept.scalars(), reject.scalars())
            && a.iter().chain(r).all(|s| matches!(s, Sc::F(..)))
        {
            // Past the depth where decisions are taken at once: join instead.
            let mut v = [r[0]; 4];
            for (i, (x, y)) in a.iter().zip(r).enumerate() {
                v[i] = self.new_float(self.float(x).hull(self.float(y)));
            }
            return Ok(if let Value::V(n, _) = accept {
                Value::V(*n, v)
            } else {
                Value::S(v[0])
            });
        }
        Ok(if self.truth(condition)? {
            accept.clone()
        } else {
            reject.clone()
        })
    }

    fn unary(&mut self, op: UnaryOperator, s: Sc) -> Run<Sc> {
        match (op, s) {
            (UnaryOperator::Negate, Sc::F(id, _)) => {
                let iv = arith::neg(self.table, self.addend(&s));
                Ok(self.new_value(iv, id & 1))
            }
            (UnaryOperator::LogicalNot, Sc::B(b)) => Ok(Sc::B(not(b))),
            _ => match (op, self.plain(s)) {
                (UnaryOperator::Negate, Sc::I(lo, hi)) => {
                    if lo == i32::MIN {
                        return Ok(if hi == lo {
                            Sc::I(lo, lo)
                        } else {
                            Sc::I(i32::MIN, i32::MAX)
                        });
                    }
                    Ok(Sc::I(-hi, -lo))
                }
                (UnaryOperator::BitwiseNot, Sc::I(lo, hi)) => Ok(Sc::I(!hi, !lo)),
                (UnaryOperator::BitwiseNot, Sc::U(lo, hi)) => Ok(Sc::U(!hi, !lo)),
                _ => unsupported("a unary operator on this type"),
            },
        }
    }

    fn binary(&mut self, op: Bin, a: Sc, b: Sc) -> Run<Sc> {
        match op {
            Bin::Equal
            | Bin::NotEqual
            | Bin::Less
            | Bin::LessEqual
            | Bin::Greater
            | Bin::GreaterEqual => return self.compare(op, a, b),
            _ => {}
        }
        let t = self.table;
        match (a, b) {
            (Sc::F(ida, _), Sc::F(idb, _)) => {
                let (x, y) = (self.float(&a), self.float(&b));
                let iv = match op {
                    Bin::Add => arith::add(t, self.addend(&a), self.addend(&b)),
                    Bin::Subtract => arith::sub(t, self.addend(&a), self.addend(&b)),
                    Bin::Multiply => {
                        let iv = arith::mul(t, x, y, ida != 0 && ida == idb);
                        return Ok(self.new_value(iv, 1));
                    }
                    Bin::Divide => arith::div(t, x, y),
                    Bin::Modulo => arith::rem(t, x, y),
                    _ => return unsupported("a bit operation on a float"),
                };
                Ok(self.new_float(iv))
            }
            (Sc::B(x), Sc::B(y)) => Ok(Sc::B(match op {
                Bin::And | Bin::LogicalAnd => and(x, y),
                Bin::InclusiveOr | Bin::LogicalOr => not(and(not(x), not(y))),
                Bin::ExclusiveOr => return self.compare(Bin::NotEqual, a, b),
                _ => return unsupported("arithmetic on bools"),
            })),
            _ => self.integers(op, a, b),
        }
    }

    fn integers(&mut self, op: Bin, a: Sc, b: Sc) -> Run<Sc> {
        if let Some(r) = self.float_bits(op, a, b)? {
            return Ok(r);
        }
        let (a, b) = (self.plain(a), self.plain(b));
        // Shifts take an unsigned second operand whatever the first is.
        let amount = match b {
            Sc::U(lo, hi) if lo == hi => Some(lo & 31),
            _ => None,
        };
        match (a, b) {
            (Sc::U(al, ah), Sc::U(bl, bh)) => {
                if al == ah && bl == bh {
                    let r = match op {
                        Bin::Add => al.wrapping_add(bl),
                        Bin::Subtract => al.wrapping_sub(bl),
                        Bin::Multiply => al.wrapping_mul(bl),
                        Bin::Divide => al.checked_div(bl).unwrap_or(al),
                        Bin::Modulo => al.checked_rem(bl).unwrap_or(0),
                        Bin::And => al & bl,
                        Bin::InclusiveOr => al | bl,
                        Bin::ExclusiveOr => al ^ bl,
                        Bin::ShiftLeft => al.wrapping_shl(bl),
                        Bin::ShiftRight => al.wrapping_shr(bl),
                        _ => return unsupported("a logical operator on integers"),
                    };
                    return Ok(Sc::U(r, r));
                }
                let all = (0, u32::MAX);
                let (lo, hi) = match op {
                    Bin::Add => pair(al.checked_add(bl), ah.checked_add(bh)).unwrap_or(all),
                    Bin::Subtract => pair(al.checked_sub(bh), ah.checked_sub(bl)).unwrap_or(all),
                    Bin::Multiply => pair(al.checked_mul(bl), ah.checked_mul(bh)).unwrap_or(all),
                    Bin::Divide if bl > 0 => (al / bh, ah / bl),
                    Bin::Modulo if bl > 0 => (0, (bh - 1).min(ah)),
                    Bin::And => (0, ah.min(bh)),
                    Bin::InclusiveOr | Bin::ExclusiveOr => {
                        // No bit above the highest of either side.
                        let top = (ah | bh)
                            .checked_ilog2()
                            .map_or(0, |n| u32::MAX >> (31 - n));
                        (
                            if op == Bin::InclusiveOr {
                                al.max(bl)
                            } else {
                                0
                            },
                            top,
                        )
                    }
                    Bin::ShiftRight => amount.map_or((0, ah), |n| (al >> n, ah >> n)),
                    Bin::ShiftLeft => amount
                        .and_then(|n| pair(al.checked_mul(1 << n), ah.checked_mul(1 << n)))
                        .unwrap_or(all),
                    _ => all,
                };
                Ok(Sc::U(lo, hi))
            }
            (Sc::I(al, ah), Sc::U(bl, bh)) => {
                if al == ah && bl == bh {
                    let r = match op {
                        Bin::ShiftLeft => al.wrapping_shl(bl),
                        Bin::ShiftRight => al.wrapping_shr(bl),
                        _ => return unsupported("integers of different types"),
                    };
                    return Ok(Sc::I(r, r));
                }
                Ok(match (op, amount) {
                    (Bin::ShiftRight, Some(n)) => Sc::I(al >> n, ah >> n),
                    _ => Sc::I(i32::MIN, i32::MAX),
                })
            }
            (Sc::I(al, ah), Sc::I(bl, bh)) => {
                if al == ah && bl == bh {
                    let r = match op {
                        Bin::Add => al.wrapping_add(bl),
                        Bin::Subtract => al.wrapping_sub(bl),
                        Bin::Multiply => al.wrapping_mul(bl),
                        Bin::Divide => al.checked_div(bl).unwrap_or(al),
                        Bin::Modulo => al.checked_rem(bl).unwrap_or(0),
                        Bin::And => al & bl,
                        Bin::InclusiveOr => al | bl,
                        Bin::ExclusiveOr => al ^ bl,
                        _ => return unsupported("a logical operator on integers"),
                    };
                    return Ok(Sc::I(r, r));
                }
                let all = (i32::MIN, i32::MAX);
                let (lo, hi) = match op {
                    Bin::Add => pair(al.checked_add(bl), ah.checked_add(bh)).unwrap_or(all),
                    Bin::Subtract => pair(al.checked_sub(bh), ah.checked_sub(bl)).unwrap_or(all),
                    Bin::Multiply => {
                        let p = [(al, bl), (al, bh), (ah, bl), (ah, bh)]
                            .map(|(x, y)| i64::from(x) * i64::from(y));
                        let lo = p.iter().min().and_then(|&x| i32::try_from(x).ok());
                        let hi = p.iter().max().and_then(|&x| i32::try_from(x).ok());
                        pair(lo, hi).unwrap_or(all)
                    }
                    Bin::And if bl >= 0 && al >= 0 => (0, ah.min(bh)),
                    Bin::And if bl >= 0 => (0, bh),
                    Bin::And if al >= 0 => (0, ah),
                    Bin::Divide if al >= 0 && bl > 0 => (al / bh, ah / bl),
                    Bin::Modulo if al >= 0 && bl > 0 => (0, (bh - 1).min(ah)),
                    _ => all,
                };
                Ok(Sc::I(lo, hi))
            }
            _ => unsupported("an operator on this pair of types"),
        }
    }

    /// The usual tricks on the bits of a float that is not exact: clear, flip or
    /// keep the sign bit.
    fn float_bits(&mut self, op: Bin, a: Sc, b: Sc) -> Run<Option<Sc>> {
        let (bits, mask) = match (a, b) {
            (Sc::Bits(..), Sc::U(m, n)) if m == n => (a, m),
            (Sc::U(m, n), Sc::Bits(..)) if m == n => (b, m),
            (Sc::Bits(..), Sc::I(m, n)) if m == n => (a, m.cast_unsigned()),
            (Sc::I(m, n), Sc::Bits(..)) if m == n => (b, m.cast_unsigned()),
            _ => return Ok(None),
        };
        let Sc::Bits(id, _, signed) = bits else {
            return Ok(None);
        };
        let iv = self.float(&bits);
        if iv.is_any() {
            return Ok(None);
        }
        const SIGN: u32 = 0x8000_0000;
        // The bits of a subnormal are what they are: nothing is flushed here.
        let absolute = arith::abs(Table::Ieee, iv);
        Ok(match (op, mask) {
            (Bin::And, 0x7fff_ffff) => Some(self.new_bits(absolute, signed)),
            (Bin::ExclusiveOr, SIGN) => Some(self.new_bits(
                Iv {
                    lo: -iv.hi,
                    hi: -iv.lo,
                },
                signed,
            )),
            (Bin::InclusiveOr, SIGN) => Some(self.new_bits(
                Iv {
                    lo: -absolute.hi,
                    hi: -absolute.lo,
                },
                signed,
            )),
            (Bin::And, SIGN) => {
                let negative = if iv.lo > 0.0 {
                    false
                } else if iv.hi < 0.0 {
                    true
                } else {
                    let negative = self.decide(2)? == 1;
                    let float = Sc::F(id, iv);
                    if negative {
                        self.narrow(&float, f32::NEG_INFINITY, 0.0);
                    } else {
                        self.narrow(&float, 0.0, f32::INFINITY);
                    }
                    negative
                };
                let r = if negative { SIGN } else { 0 };
                Some(if signed {
                    Sc::I(r.cast_signed(), r.cast_signed())
                } else {
                    Sc::U(r, r)
                })
            }
            _ => None,
        })
    }

    fn new_bits(&mut self, iv: Iv, signed: bool) -> Sc {
        self.next_id += 2;
        Sc::Bits(self.next_id & !1, iv, signed)
    }

    fn convert(&mut self, kind: ScalarKind, s: Sc) -> Run<Sc> {
        let t = self.table;
        match (kind, s) {
            (ScalarKind::Float, Sc::F(..)) | (ScalarKind::Bool, Sc::B(_)) => return Ok(s),
            (ScalarKind::Bool, Sc::F(..)) => {
                return self.compare(Bin::NotEqual, s, Sc::F(0, Iv::ZERO));
            }
            (_, Sc::B(b)) => {
                let x = u32::from(self.truth(Sc::B(b))?);
                return Ok(match kind {
                    ScalarKind::Uint => Sc::U(x, x),
                    ScalarKind::Sint => Sc::I(x.cast_signed(), x.cast_signed()),
                    _ => Sc::F(0, Iv::point(x as f32)),
                });
            }
            (ScalarKind::Uint | ScalarKind::Sint, Sc::F(..)) => return self.truncate(kind, s),
            _ => {}
        }
        Ok(match (kind, self.plain(s)) {
            (ScalarKind::Float, Sc::U(lo, hi)) => {
                let iv = arith::from_int(t, i64::from(lo), i64::from(hi));
                self.new_float(iv)
            }
            (ScalarKind::Float, Sc::I(lo, hi)) => {
                let iv = arith::from_int(t, i64::from(lo), i64::from(hi));
                self.new_float(iv)
            }
            (ScalarKind::Bool, Sc::U(..)) => return self.compare(Bin::NotEqual, s, Sc::U(0, 0)),
            (ScalarKind::Bool, Sc::I(..)) => return self.compare(Bin::NotEqual, s, Sc::I(0, 0)),
            (ScalarKind::Uint, r @ Sc::U(..)) | (ScalarKind::Sint, r @ Sc::I(..)) => r,
            (ScalarKind::Uint, Sc::I(lo, hi)) => to_unsigned(lo, hi),
            (ScalarKind::Sint, Sc::U(lo, hi)) => to_signed(lo, hi),
            _ => return unsupported("a conversion between these types"),
        })
    }

    /// Float to integer: clamp to the floats within the type, then truncate.
    fn truncate(&mut self, kind: ScalarKind, s: Sc) -> Run<Sc> {
        let any = self.float(&s).is_any();
        if kind == ScalarKind::Uint {
            if any {
                return Ok(Sc::U(0, u32::MAX));
            }
            let Sc::F(_, k) = self.step(
                &s,
                |x| x.trunc().max(0.0),
                |k| {
                    (
                        if k == 0.0 { f32::NEG_INFINITY } else { k },
                        (k + 1.0).next_down(),
                    )
                },
            )?
            else {
                return unsupported("a conversion");
            };
            let max = 4_294_967_040.0_f32;
            return Ok(Sc::U(k.lo.min(max) as u32, k.hi.min(max) as u32));
        }
        if any {
            return Ok(Sc::I(i32::MIN, i32::MAX));
        }
        let Sc::F(_, k) = self.step(&s, f32::trunc, trunc_range)? else {
            return unsupported("a conversion");
        };
        let max = 2_147_483_520.0_f32;
        Ok(Sc::I(k.lo.min(max) as i32, k.hi.min(max) as i32))
    }

    fn bitcast(&mut self, kind: ScalarKind, s: Sc) -> Run<Sc> {
        let t = self.table;
        match (kind, s) {
            (ScalarKind::Float, Sc::F(..)) => Ok(s),
            (ScalarKind::Uint | ScalarKind::Sint, Sc::F(id, _)) => {
                let iv = self.float(&s);
                let signed = kind == ScalarKind::Sint;
                let bits = if iv.lo.to_bits() == iv.hi.to_bits() {
                    let bits = iv.lo.to_bits();
                    if iv.lo.is_subnormal() && t == Table::Wgsl && self.decide(2)? == 1 {
                        bits & 0x8000_0000 // flushed
                    } else {
                        bits
                    }
                } else if iv.is_point() && self.eager() {
                    // A zero of either sign.
                    self.decide(2)? << 31
                } else if iv.is_any() {
                    return Ok(if signed {
                        Sc::I(i32::MIN, i32::MAX)
                    } else {
                        Sc::U(0, u32::MAX)
                    });
                } else {
                    return Ok(Sc::Bits(id, iv, signed));
                };
                Ok(if signed {
                    Sc::I(bits.cast_signed(), bits.cast_signed())
                } else {
                    Sc::U(bits, bits)
                })
            }
            (ScalarKind::Float, Sc::Bits(id, iv, _)) => Ok(Sc::F(id, iv)),
            (ScalarKind::Uint, Sc::Bits(id, iv, _)) => Ok(Sc::Bits(id, iv, false)),
            (ScalarKind::Sint, Sc::Bits(id, iv, _)) => Ok(Sc::Bits(id, iv, true)),
            (ScalarKind::Uint, Sc::U(..)) | (ScalarKind::Sint, Sc::I(..)) => Ok(s),
            (ScalarKind::Uint, Sc::I(lo, hi)) => Ok(to_unsigned(lo, hi)),
            (ScalarKind::Sint, Sc::U(lo, hi)) => Ok(to_signed(lo, hi)),
            (ScalarKind::Float, Sc::U(..) | Sc::I(..)) => {
                let (lo, hi) = match s {
                    Sc::U(lo, hi) => (lo, hi),
                    Sc::I(lo, hi) => match to_unsigned(lo, hi) {
                        Sc::U(lo, hi) => (lo, hi),
                        _ => (0, u32::MAX),
                    },
                    _ => (0, u32::MAX),
                };
                let (a, b) = (f32::from_bits(lo), f32::from_bits(hi));
                let iv = if hi < 0x7f80_0000 {
                    Iv { lo: a, hi: b }
                } else if lo >= 0x8000_0000 && hi < 0xff80_0000 {
                    Iv { lo: b, hi: a }
                } else {
                    Iv::ANY
                };
                // The intermediate value of a bit cast may be flushed. Exact bits
                // that are not subnormal keep the sign of a zero.
                let iv = if a.is_subnormal() || b.is_subnormal() {
                    arith::step_fn(t, iv, |x| x)
                } else {
                    iv
                };
                Ok(self.new_float(iv))
            }
            _ => unsupported("a bit cast between these types"),
        }
    }

    // Built-in functions.

    fn math(&mut self, fun: Mf, a: &Value, others: [Option<&Value>; 3]) -> Run<Value> {
        let t = self.table;
        match fun {
            Mf::Dot
            | Mf::Cross
            | Mf::Length
            | Mf::Distance
            | Mf::Normalize
            | Mf::Reflect
            | Mf::Refract
            | Mf::FaceForward => return self.geometry(fun, a, others),
            Mf::Pack2x16float
            | Mf::Pack2x16unorm
            | Mf::Pack2x16snorm
            | Mf::Pack4x8unorm
            | Mf::Pack4x8snorm => return self.pack(fun, a),
            Mf::Unpack2x16float
            | Mf::Unpack2x16unorm
            | Mf::Unpack2x16snorm
            | Mf::Unpack4x8unorm
            | Mf::Unpack4x8snorm => return self.unpack(fun, a),
            Mf::Modf => {
                let whole = self.map1(a, |m, s| m.math1(Mf::Trunc, s))?;
                let fraction = self.map2(a, &whole, |m, x, y| m.binary(Bin::Subtract, x, y))?;
                return Ok(Value::C(vec![fraction, whole]));
            }
            Mf::Mix => {
                let (Some(b), Some(c)) = (others[0], others[1]) else {
                    return unsupported("mix without three arguments");
                };
                // The weight may be a scalar beside vectors.
                let left = self.map2(a, c, |m, x, z| {
                    let one = arith::sub(t, Iv::ONE, m.float(&z));
                    let iv = arith::mul(t, m.float(&x), one, false);
                    Ok(m.new_value(iv, 1))
                })?;
                let right = self.map2(b, c, |m, y, z| m.binary(Bin::Multiply, y, z))?;
                return self.map2(&left, &right, |m, x, y| m.binary(Bin::Add, x, y));
            }
            _ => {}
        }
        match others {
            [None, ..] => self.map1(a, |m, s| m.math1(fun, s)),
            [Some(b), None, _] => self.map2(a, b, |m, x, y| m.math2(fun, x, y)),
            [Some(b), Some(c), None] => {
                let n = [a, b, c]
                    .iter()
                    .map(|v| v.scalars().map_or(0, <[Sc]>::len))
                    .max();
                let n = n.unwrap_or(1);
                let mut r = [Sc::B(Tri::False); 4];
                for (i, out) in r.iter_mut().enumerate().take(n) {
                    *out = self.math3(fun, lane(a, i)?, lane(b, i)?, lane(c, i)?)?;
                }
                Ok(if matches!(a, Value::V(..)) {
                    Value::V(n as u8, r)
                } else {
                    Value::S(r[0])
                })
            }
            [Some(b), Some(c), Some(d)] => {
                let (Value::S(offset), Value::S(count)) = (c, d) else {
                    return unsupported("insertBits with vector offsets");
                };
                let (offset, count) = (self.exact(*offset)?, self.exact(*count)?);
                self.map2(a, b, |m, x, y| m.insert_bits(x, y, offset, count))
            }
        }
    }

    fn math1(&mut self, fun: Mf, s: Sc) -> Run<Sc> {
        let t = self.table;
        if !matches!(s, Sc::F(..)) {
            return self.integer1(fun, s);
        }
        let iv = self.float(&s);
        let r = match fun {
            Mf::Floor => return self.step(&s, f32::floor, |k| (k, (k + 1.0).next_down())),
            Mf::Ceil => return self.step(&s, f32::ceil, |k| ((k - 1.0).next_up(), k)),
            Mf::Trunc => return self.step(&s, f32::trunc, trunc_range),
            Mf::Round => {
                return self.step(&s, f32::round_ties_even, |k| (k - 0.5, k + 0.5));
            }
            Mf::Sign => {
                return self.step(&s, arith::sign, |k| match k {
                    1.0 => (0.0f32.next_up(), f32::INFINITY),
                    -1.0 => (f32::NEG_INFINITY, 0.0f32.next_down()),
                    _ => (0.0, 0.0),
                });
            }
            Mf::Abs => arith::abs(t, iv),
            Mf::Saturate => arith::clamp(t, iv, Iv::ZERO, Iv::ONE),
            Mf::Fract => arith::fract(t, iv),
            Mf::Sqrt => arith::sqrt(t, iv),
            Mf::InverseSqrt => arith::inverse_sqrt(t, iv),
            Mf::Exp => arith::exp(t, iv),
            Mf::Exp2 => arith::exp2(t, iv),
            Mf::Log => arith::log(t, iv),
            Mf::Log2 => arith::log2(t, iv),
            Mf::Sin => arith::sin(t, iv),
            Mf::Cos => arith::cos(t, iv),
            Mf::Tan => arith::tan(t, iv),
            Mf::Asin => arith::asin(t, iv),
            Mf::Acos => arith::acos(t, iv),
            Mf::Atan => arith::atan(t, iv),
            Mf::Sinh => arith::sinh(t, iv),
            Mf::Cosh => arith::cosh(t, iv),
            Mf::Tanh => arith::tanh(t, iv),
            Mf::Asinh => arith::asinh(t, iv),
            Mf::Acosh => arith::acosh(t, iv),
            Mf::Atanh => arith::atanh(t, iv),
            Mf::Degrees => arith::mul(t, iv, Iv::point(57.295_779_513_082_32_f64 as f32), false),
            Mf::Radians => arith::mul(
                t,
                iv,
                Iv::point(0.017_453_292_519_943_295_f64 as f32),
                false,
            ),
            Mf::QuantizeToF16 => {
                if iv.is_any() {
                    return Ok(s);
                }
                let (Some(lo), Some(hi)) =
                    (arith::f16_neighbours(iv.lo), arith::f16_neighbours(iv.hi))
                else {
                    return Ok(Sc::F(0, Iv::ANY));
                };
                if t == Table::Ieee {
                    let nearest = |x: f32, (a, b): (u16, u16)| nearest_f16(x, a, b);
                    let (lo, hi) = (nearest(iv.lo, lo), nearest(iv.hi, hi));
                    return Ok(self.new_float(Iv {
                        lo: f16(lo),
                        hi: f16(hi),
                    }));
                }
                let mut r = Iv {
                    lo: f16(lo.0).min(f16(lo.1)),
                    hi: f16(hi.0).max(f16(hi.1)),
                };
                // Results below 2^-14 are subnormal f16 numbers and may be flushed.
                let least = 6.103_515_6e-5;
                if r.lo > 0.0 && r.lo < least {
                    r.lo = 0.0;
                }
                if r.hi < 0.0 && r.hi > -least {
                    r.hi = 0.0;
                }
                r
            }
            _ => return unsupported(format!("the built-in {fun:?} on f32")),
        };
        Ok(self.new_float(r))
    }

    fn math2(&mut self, fun: Mf, a: Sc, b: Sc) -> Run<Sc> {
        let t = self.table;
        if let (Mf::Ldexp, Sc::F(..)) = (fun, a) {
            let n = self.exact(b)?;
            let iv = arith::ldexp(t, self.float(&a), n as i32);
            return Ok(self.new_float(iv));
        }
        if !matches!(a, Sc::F(..)) {
            return self.integer2(fun, a, b);
        }
        let (x, y) = (self.float(&a), self.float(&b));
        let r = match fun {
            Mf::Min | Mf::Max => {
                let r = if fun == Mf::Min {
                    arith::min(t, x, y)
                } else {
                    arith::max(t, x, y)
                };
                // One side may win for certain: then keep what is known of it.
                let (less, more) = (x.hi <= y.lo, x.lo >= y.hi);
                let bits = |v: Iv| (v.lo.to_bits(), v.hi.to_bits());
                let (keep_a, keep_b) = if fun == Mf::Min {
                    (less, more)
                } else {
                    (more, less)
                };
                if keep_a && bits(r) == bits(x) {
                    return Ok(a);
                }
                if keep_b && bits(r) == bits(y) {
                    return Ok(b);
                }
                r
            }
            Mf::Pow => arith::pow(t, x, y),
            Mf::Atan2 => arith::atan2(t, x, y),
            Mf::Step => {
                let Sc::B(tri) = self.compare(Bin::LessEqual, a, b)? else {
                    return unsupported("step");
                };
                match tri {
                    Tri::False => Iv::ZERO,
                    Tri::True => Iv::ONE,
                    Tri::Either => Iv { lo: 0.0, hi: 1.0 },
                }
            }
            _ => return unsupported(format!("the built-in {fun:?} on f32")),
        };
        Ok(self.new_float(r))
    }

    fn math3(&mut self, fun: Mf, a: Sc, b: Sc, c: Sc) -> Run<Sc> {
        let t = self.table;
        if !matches!(a, Sc::F(..)) {
            return match fun {
                Mf::Clamp => {
                    let low = self.integer2(Mf::Max, a, b)?;
                    self.integer2(Mf::Min, low, c)
                }
                Mf::ExtractBits => {
                    let (offset, count) = (self.exact(b)?, self.exact(c)?);
                    self.extract_bits(a, offset, count)
                }
                _ => unsupported(format!("the built-in {fun:?} on integers")),
            };
        }
        let (x, y, z) = (self.float(&a), self.float(&b), self.float(&c));
        let r = match fun {
            Mf::Clamp => arith::clamp(t, x, y, z),
            Mf::Fma => arith::fma(t, x, y, self.addend(&c)),
            Mf::Mix => arith::mix(t, x, y, z),
            Mf::SmoothStep => arith::smooth_step(t, x, y, z),
            _ => return unsupported(format!("the built-in {fun:?} on f32")),
        };
        Ok(self.new_float(r))
    }

    fn geometry(&mut self, fun: Mf, a: &Value, others: [Option<&Value>; 3]) -> Run<Value> {
        let t = self.table;
        let second = others[0];
        if let (Some(Value::V(_, _)), Some(x)) = (second, a.scalars())
            && matches!(fun, Mf::Dot)
            && matches!(x[0], Sc::U(..) | Sc::I(..))
        {
            let products = self.map2(a, second.unwrap_or(a), |m, x, y| {
                m.binary(Bin::Multiply, x, y)
            })?;
            let parts = products.scalars().unwrap_or_default().to_vec();
            let mut r = parts[0];
            for s in &parts[1..] {
                r = self.binary(Bin::Add, r, *s)?;
            }
            return Ok(Value::S(r));
        }
        match fun {
            Mf::Dot => {
                let Some(b) = second else {
                    return unsupported("dot");
                };
                let iv = self.dot(a, b)?;
                Ok(Value::S(self.new_float(iv)))
            }
            Mf::Length => {
                let iv = self.length(a)?;
                Ok(Value::S(self.new_float(iv)))
            }
            Mf::Distance => {
                let Some(b) = second else {
                    return unsupported("distance");
                };
                let d = self.map2(a, b, |m, x, y| m.binary(Bin::Subtract, x, y))?;
                let iv = self.length(&d)?;
                Ok(Value::S(self.new_float(iv)))
            }
            Mf::Normalize => {
                let length = self.length(a)?;
                let length = self.new_float(length);
                self.map1(a, |m, s| m.binary(Bin::Divide, s, length))
            }
            Mf::Cross => {
                let (Value::V(3, x), Some(Value::V(3, y))) = (a, second) else {
                    return unsupported("a cross product of two components");
                };
                let mut r = *x;
                for (i, out) in r.iter_mut().enumerate().take(3) {
                    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                    let left = self.binary(Bin::Multiply, x[j], y[k])?;
                    let right = self.binary(Bin::Multiply, x[k], y[j])?;
                    *out = self.binary(Bin::Subtract, left, right)?;
                }
                Ok(Value::V(3, r))
            }
            Mf::Reflect => {
                let Some(n) = second else {
                    return unsupported("reflect");
                };
                let d = self.dot(a, n)?;
                let scale = arith::mul(t, Iv::point(2.0), d, false);
                self.map2(a, n, |m, x, y| {
                    let p = arith::mul(t, scale, m.float(&y), false);
                    let iv = arith::sub(t, m.addend(&x), p);
                    Ok(m.new_float(iv))
                })
            }
            Mf::Refract => {
                let (Some(n), Some(Value::S(eta))) = (second, others[1]) else {
                    return unsupported("refract");
                };
                let d = self.dot(n, a)?;
                let e = self.float(eta);
                let inner = arith::sub(t, Iv::ONE, arith::mul(t, d, d, true));
                let k = arith::sub(
                    t,
                    Iv::ONE,
                    arith::mul(t, arith::mul(t, e, e, true), inner, false),
                );
                let k = self.new_float(k);
                let total = self.compare(Bin::Less, k, Sc::F(0, Iv::ZERO))?;
                if self.truth(total)? {
                    return self.map1(a, |_, _| Ok(Sc::F(0, Iv::ZERO)));
                }
                let root = arith::sqrt(t, self.float(&k));
                let scale = arith::add(t, arith::mul(t, e, d, false), root);
                self.map2(a, n, |m, x, y| {
                    let left = arith::mul(t, e, m.float(&x), false);
                    let right = arith::mul(t, scale, m.float(&y), false);
                    let iv = arith::sub(t, left, right);
                    Ok(m.new_float(iv))
                })
            }
            Mf::FaceForward => {
                let (Some(y), Some(z)) = (second, others[1]) else {
                    return unsupported("faceForward");
                };
                let d = self.dot(z, y)?;
                let d = self.new_float(d);
                let keep = self.compare(Bin::Less, d, Sc::F(0, Iv::ZERO))?;
                if self.truth(keep)? {
                    Ok(a.clone())
                } else {
                    self.map1(a, |m, s| m.unary(UnaryOperator::Negate, s))
                }
            }
            _ => unsupported(format!("the built-in {fun:?}")),
        }
    }

    fn dot(&mut self, a: &Value, b: &Value) -> Run<Iv> {
        let (Some(x), Some(y)) = (a.scalars(), b.scalars()) else {
            return unsupported("a dot product of structs");
        };
        let n = x.len();
        let (mut p, mut q, mut same) = ([Iv::ZERO; 4], [Iv::ZERO; 4], [false; 4]);
        for i in 0..n {
            p[i] = self.float(&x[i]);
            q[i] = self.float(&y[i]);
            if let (Sc::F(g, _), Sc::F(h, _)) = (x[i], y[i]) {
                same[i] = g != 0 && g == h;
            }
        }
        Ok(arith::dot(self.table, &p[..n], &q[..n], &same[..n]))
    }

    fn length(&mut self, a: &Value) -> Run<Iv> {
        let square = self.dot(a, a)?;
        Ok(arith::sqrt(self.table, square))
    }

    fn integer1(&mut self, fun: Mf, s: Sc) -> Run<Sc> {
        let s = self.plain(s);
        let (word, signed) = match s {
            Sc::U(lo, hi) if lo == hi => (lo, false),
            Sc::I(lo, hi) if lo == hi => (lo.cast_unsigned(), true),
            Sc::U(..) if fun == Mf::Abs => return Ok(s),
            Sc::I(lo, hi) if fun == Mf::Abs && lo > i32::MIN => {
                let least = if lo > 0 {
                    lo
                } else if hi < 0 {
                    -hi
                } else {
                    0
                };
                return Ok(Sc::I(least, (-lo).max(hi)));
            }
            Sc::I(lo, hi) if fun == Mf::Sign => return Ok(Sc::I(lo.signum(), hi.signum())),
            Sc::U(..) => return Ok(Sc::U(0, u32::MAX)),
            Sc::I(..) => return Ok(Sc::I(i32::MIN, i32::MAX)),
            _ => return unsupported(format!("the built-in {fun:?} on bool")),
        };
        let int = word.cast_signed();
        let r = match fun {
            Mf::Abs => {
                if signed {
                    int.wrapping_abs().cast_unsigned()
                } else {
                    word
                }
            }
            Mf::Sign => int.signum().cast_unsigned(),
            Mf::CountOneBits => word.count_ones(),
            Mf::CountLeadingZeros => word.leading_zeros(),
            Mf::CountTrailingZeros => word.trailing_zeros(),
            Mf::ReverseBits => word.reverse_bits(),
            Mf::FirstTrailingBit => {
                if word == 0 {
                    u32::MAX
                } else {
                    word.trailing_zeros()
                }
            }
            Mf::FirstLeadingBit => {
                let w = if signed && int < 0 { !word } else { word };
                if w == 0 {
                    u32::MAX
                } else {
                    31 - w.leading_zeros()
                }
            }
            _ => return unsupported(format!("the built-in {fun:?} on integers")),
        };
        Ok(if signed {
            Sc::I(r.cast_signed(), r.cast_signed())
        } else {
            Sc::U(r, r)
        })
    }

    fn integer2(&mut self, fun: Mf, a: Sc, b: Sc) -> Run<Sc> {
        Ok(match (fun, self.plain(a), self.plain(b)) {
            (Mf::Min, Sc::U(al, ah), Sc::U(bl, bh)) => Sc::U(al.min(bl), ah.min(bh)),
            (Mf::Max, Sc::U(al, ah), Sc::U(bl, bh)) => Sc::U(al.max(bl), ah.max(bh)),
            (Mf::Min, Sc::I(al, ah), Sc::I(bl, bh)) => Sc::I(al.min(bl), ah.min(bh)),
            (Mf::Max, Sc::I(al, ah), Sc::I(bl, bh)) => Sc::I(al.max(bl), ah.max(bh)),
            _ => return unsupported(format!("the built-in {fun:?} on integers")),
        })
    }

    fn extract_bits(&mut self, a: Sc, offset: i64, count: i64) -> Run<Sc> {
        let o = offset.clamp(0, 32) as u32;
        let c = (count.max(0) as u32).min(32 - o);
        let shift = 32 - c;
        Ok(match self.plain(a) {
            Sc::U(lo, hi) if lo == hi => {
                let r = if c == 0 {
                    0
                } else {
                    (lo << (shift - o)) >> shift
                };
                Sc::U(r, r)
            }
            Sc::I(lo, hi) if lo == hi => {
                let r = if c == 0 {
                    0
                } else {
                    (lo << (shift - o)) >> shift
                };
                Sc::I(r, r)
            }
            Sc::U(lo, hi) if o + c == 32 && c > 0 => Sc::U(lo >> o, hi >> o),
            Sc::U(..) => Sc::U(0, if c == 0 { 0 } else { u32::MAX >> shift }),
            Sc::I(..) => Sc::I(i32::MIN, i32::MAX),
            _ => return unsupported("extractBits on this type"),
        })
    }

    fn insert_bits(&mut self, a: Sc, b: Sc, offset: i64, count: i64) -> Run<Sc> {
        let o = offset.clamp(0, 32) as u32;
        let c = (count.max(0) as u32).min(32 - o);
        if c == 0 {
            return Ok(a);
        }
        let mask = (u32::MAX >> (32 - c)) << o;
        let insert = |e: u32, n: u32| (e & !mask) | ((n << o) & mask);
        Ok(match (self.plain(a), self.plain(b)) {
            (Sc::U(al, ah), Sc::U(bl, bh)) if al == ah && bl == bh => {
                let r = insert(al, bl);
                Sc::U(r, r)
            }
            (Sc::I(al, ah), Sc::I(bl, bh)) if al == ah && bl == bh => {
                let r = insert(al.cast_unsigned(), bl.cast_unsigned()).cast_signed();
                Sc::I(r, r)
            }
            (Sc::U(..), _) => Sc::U(0, u32::MAX),
            _ => Sc::I(i32::MIN, i32::MAX),
        })
    }

    /// One lane of a packed word may round either way; each lane is decided on its
    /// own.
    fn pack(&mut self, fun: Mf, a: &Value) -> Run<Value> {
        let lanes = a.scalars().unwrap_or_default().to_vec();
        let width = 32 / lanes.len().max(1) as u32;
        let mask = u32::MAX >> (32 - width);
        let mut word = 0;
        for (i, s) in lanes.iter().enumerate() {
            let iv = self.float(s);
            let (lo, hi) = match fun {
                _ if iv.is_any() => return Ok(Value::S(Sc::U(0, u32::MAX))),
                Mf::Pack2x16float => {
                    let ends = (arith::f16_neighbours(iv.lo), arith::f16_neighbours(iv.hi));
                    let (Some(l), Some(h)) = ends else {
                        return Ok(Value::S(Sc::U(0, u32::MAX)));
                    };
                    let key = |x: u16| {
                        let m = i64::from(x & 0x7fff);
                        if x & 0x8000 != 0 { -m } else { m }
                    };
                    let (lo, hi) = if self.table == Table::Ieee {
                        (nearest_f16(iv.lo, l.0, l.1), nearest_f16(iv.hi, h.0, h.1))
                    } else {
                        (
                            if key(l.0) <= key(l.1) { l.0 } else { l.1 },
                            if key(h.0) >= key(h.1) { h.0 } else { h.1 },
                        )
                    };
                    let tiny = |x: u16| x & 0x7fff != 0 && x & 0x7fff < 0x400;
                    if lo == hi && !(tiny(lo) && self.table == Table::Wgsl) {
                        (i64::from(lo), i64::from(lo))
                    } else {
                        // Counted from the lower end through zero.
                        let flushed = self.table == Table::Wgsl && (tiny(lo) || tiny(hi));
                        let (mut l, mut h) = (key(lo), key(hi));
                        if flushed {
                            (l, h) = (l.min(0), h.max(0));
                        }
                        let at = self.exact(Sc::I(l as i32, h as i32))?;
                        let bits = if at < 0 { 0x8000 - at } else { at };
                        (bits, bits)
                    }
                }
                _ => {
                    let snorm = matches!(fun, Mf::Pack2x16snorm | Mf::Pack4x8snorm);
                    let scale = f64::from(if snorm { mask >> 1 } else { mask });
                    let least = if snorm { -1.0 } else { 0.0 };
                    // floor(0.5 + scale * e), where the sum may round either way.
                    let end = |e: f32| 0.5 + scale * f64::from(e).clamp(least, 1.0);
                    let table = self.table;
                    let grid = |x: f64, away: bool| {
                        let y = x as f32;
                        match table {
                            Table::Ieee => y,
                            Table::Wgsl if away && f64::from(y) < x => y.next_up(),
                            Table::Wgsl if !away && f64::from(y) > x => y.next_down(),
                            Table::Wgsl => y,
                        }
                    };
                    (
                        f64::from(grid(end(iv.lo), false)).floor() as i64,
                        f64::from(grid(end(iv.hi), true)).floor() as i64,
                    )
                }
            };
            let chosen = if lo == hi {
                lo
            } else {
                self.exact(Sc::I(lo as i32, hi as i32))?
            };
            word |= (chosen as u32 & mask) << (width * i as u32);
        }
        Ok(Value::S(Sc::U(word, word)))
    }

    fn unpack(&mut self, fun: Mf, a: &Value) -> Run<Value> {
        let t = self.table;
        let count = if matches!(fun, Mf::Unpack4x8unorm | Mf::Unpack4x8snorm) {
            4
        } else {
            2
        };
        let width = 32 / count as u32;
        let Sc::U(word, hi) = self.plain(scalar(a)?) else {
            return unsupported("unpacking something other than a u32");
        };
        let mut r = [Sc::F(0, Iv::ZERO); 4];
        for (i, out) in r.iter_mut().enumerate().take(count) {
            let bits = (word >> (width * i as u32)) & (u32::MAX >> (32 - width));
            let signed = (bits << (32 - width)).cast_signed() >> (32 - width);
            let iv = if word != hi {
                // A range of words: what the format can hold.
                match fun {
                    Mf::Unpack2x16float => Iv::ANY,
                    Mf::Unpack2x16snorm | Mf::Unpack4x8snorm => {
                        arith::near(t, -1.0, 3.0).hull(arith::near(t, 1.0, 3.0))
                    }
                    _ => Iv::ZERO.hull(arith::near(t, 1.0, 3.0)),
                }
            } else {
                let scale = f64::from(u32::MAX >> (32 - width));
                match fun {
                    Mf::Unpack2x16float => match arith::f16_value(bits as u16) {
                        None => Iv::ANY,
                        Some(x) if t == Table::Wgsl && x != 0.0 && x.abs() < 6.103_515_6e-5 => {
                            Iv::point(x).hull(Iv::ZERO)
                        }
                        Some(x) => Iv::point(x),
                    },
                    Mf::Unpack2x16snorm | Mf::Unpack4x8snorm => {
                        let half = f64::from((u32::MAX >> (32 - width)) >> 1);
                        arith::near(t, (f64::from(signed) / half).max(-1.0), 3.0)
                    }
                    _ => arith::near(t, f64::from(bits) / scale, 3.0),
                }
            };
            *out = self.new_float(iv);
        }
        Ok(Value::V(count as u8, r))
    }
}

fn value<'a>(frame: &'a Frame<'_>, handle: Handle<Expression>) -> &'a Value {
    match &frame.info.statics[handle.index()] {
        Some(value) => value,
        None => &frame.values[handle.index()],
    }
}

fn scalar(value: &Value) -> Run<Sc> {
    match value {
        Value::S(s) => Ok(*s),
        _ => unsupported("a composite where a scalar is expected"),
    }
}

fn lane(value: &Value, i: usize) -> Run<Sc> {
    match value {
        Value::S(s) => Ok(*s),
        Value::V(_, v) => Ok(v[i]),
        _ => unsupported("a built-in function on a struct or an array"),
    }
}

fn part<T>(parts: &[T], index: u32) -> Run<&T> {
    parts.get(index as usize).ok_or(Stop::Bounds {
        index: i64::from(index),
        length: parts.len(),
    })
}

fn pair<T>(lo: Option<T>, hi: Option<T>) -> Option<(T, T)> {
    Some((lo?, hi?))
}

fn not(a: Tri) -> Tri {
    match a {
        Tri::False => Tri::True,
        Tri::True => Tri::False,
        Tri::Either => Tri::Either,
    }
}

fn and(a: Tri, b: Tri) -> Tri {
    match (a, b) {
        (Tri::False, _) | (_, Tri::False) => Tri::False,
        (Tri::True, Tri::True) => Tri::True,
        _ => Tri::Either,
    }
}

/// A comparison of two ranges.
fn order<T: PartialOrd>(op: Bin, al: T, ah: T, bl: T, bh: T) -> Tri {
    let certain = |yes: bool, no: bool| match (yes, no) {
        (true, _) => Tri::True,
        (_, true) => Tri::False,
        _ => Tri::Either,
    };
    let equal = certain(al == ah && bl == bh && al == bl, ah < bl || bh < al);
    match op {
        Bin::Equal => equal,
        Bin::NotEqual => not(equal),
        Bin::Less => certain(ah < bl, al >= bh),
        Bin::LessEqual => certain(ah <= bl, al > bh),
        Bin::Greater => certain(al > bh, ah <= bl),
        _ => certain(al >= bh, ah < bl),
    }
}

/// Arguments that truncate to `k`.
fn trunc_range(k: f32) -> (f32, f32) {
    if k > 0.0 {
        (k, (k + 1.0).next_down())
    } else if k < 0.0 {
        ((k - 1.0).next_up(), k)
    } else {
        ((-1.0f32).next_up(), 1.0f32.next_down())
    }
}

fn to_unsigned(lo: i32, hi: i32) -> Sc {
    let (a, b) = (lo.cast_unsigned(), hi.cast_unsigned());
    if (lo < 0) == (hi < 0) {
        Sc::U(a, b)
    } else {
        Sc::U(0, u32::MAX)
    }
}

fn to_signed(lo: u32, hi: u32) -> Sc {
    let (a, b) = (lo.cast_signed(), hi.cast_signed());
    if (a < 0) == (b < 0) {
        Sc::I(a, b)
    } else {
        Sc::I(i32::MIN, i32::MAX)
    }
}

fn f16(bits: u16) -> f32 {
    arith::f16_value(bits).unwrap_or(f32::INFINITY)
}

/// The nearer of two adjacent `f16`, to even on a tie.
fn nearest_f16(x: f32, a: u16, b: u16) -> u16 {
    let d = |h: u16| (f64::from(f16(h)) - f64::from(x)).abs();
    match d(a).total_cmp(&d(b)) {
        std::cmp::Ordering::Less => a,
        std::cmp::Ordering::Greater => b,
        std::cmp::Ordering::Equal => {
            if a & 1 == 0 {
                a
            } else {
                b
            }
        }
    }
}
