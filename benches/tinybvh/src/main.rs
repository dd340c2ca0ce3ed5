//! Builds trees with tinybvh and traces rays, as asked on the standard input.
//!
//! All numbers are little-endian. At first it says its version, three `u32`.
//! A request is a byte and what belongs to it:
//!
//! - `M`, a mesh: `u32` 1 for the better and slower build, `u32` vertices, `u32`
//!   triangles, three `f32` a vertex, three `u32` a triangle. Answer: `f64`
//!   milliseconds.
//! - `T`, rays: `u32` 1 for any hit, `u32` 1 to list the hits, `u32` threads, `u32`
//!   rays, eight
//!   `f32` a ray (origin, direction, `t_min`, which is taken as 0, and `t_max`).
//!   Answer: `f64` seconds, `u32` hits, and if listed `f32` t (NaN for none)
//!   and `u32` triangle for each ray.
//!
//! It ends with its input.

use std::ffi::c_void;
use std::hint::black_box;
use std::io::{Error, ErrorKind, Read, Result, Write};
use std::time::Instant;

unsafe extern "C" {
    fn raytwin_tinybvh_version(out: *mut u32);
    fn raytwin_tinybvh_build(
        vertices: *const f32,
        count: u32,
        indices: *const u32,
        triangles: u32,
        high: bool,
        milliseconds: *mut f64,
    ) -> *mut c_void;
    fn raytwin_tinybvh_free(tree: *mut c_void);
    fn raytwin_tinybvh_closest(
        tree: *const c_void,
        ray: *const f32,
        t: *mut f32,
        primitive: *mut u32,
    ) -> bool;
    fn raytwin_tinybvh_occluded(tree: *const c_void, ray: *const f32) -> bool;
}

/// tinybvh loads vertices with aligned instructions.
#[repr(align(16))]
struct Vertex(#[expect(dead_code, reason = "tinybvh reads it")] [f32; 4]);

struct Tree {
    tree: *mut c_void,
    // The tree points to both.
    _vertices: Vec<Vertex>,
    _indices: Vec<u32>,
}

impl Tree {
    fn new(vertices: Vec<Vertex>, indices: Vec<u32>, high: bool) -> Result<(Self, f64)> {
        if indices.is_empty() || indices.iter().any(|&i| i as usize >= vertices.len()) {
            return Err(bad("no triangle, or an index without its vertex"));
        }
        let mut milliseconds = 0.0;
        // SAFETY: the indices are within the vertices, and both live in the
        // vectors' own memory for as long as the tree does.
        let tree = unsafe {
            raytwin_tinybvh_build(
                vertices.as_ptr().cast(),
                vertices.len() as u32,
                indices.as_ptr(),
                (indices.len() / 3) as u32,
                high,
                &raw mut milliseconds,
            )
        };
        let tree = Self {
            tree,
            _vertices: vertices,
            _indices: indices,
        };
        Ok((tree, milliseconds))
    }

    #[inline]
    fn closest(&self, ray: &[f32; 8]) -> Option<(f32, u32)> {
        let (mut t, mut primitive) = (0.0, 0);
        // SAFETY: the tree is alive, the ray has eight numbers.
        let hit = unsafe {
            raytwin_tinybvh_closest(self.tree, ray.as_ptr(), &raw mut t, &raw mut primitive)
        };
        hit.then_some((t, primitive))
    }

    #[inline]
    fn any(&self, ray: &[f32; 8]) -> bool {
        // SAFETY: as above.
        unsafe { raytwin_tinybvh_occluded(self.tree, ray.as_ptr()) }
    }
}

// SAFETY: queries change nothing in a tree.
unsafe impl Sync for Tree {}

impl Drop for Tree {
    fn drop(&mut self) {
        // SAFETY: made by `new`, and freed once.
        unsafe { raytwin_tinybvh_free(self.tree) }
    }
}

fn bad(what: &str) -> Error {
    Error::new(ErrorKind::InvalidData, what)
}

fn numbers<const N: usize, T>(input: &mut impl Read, f: fn([u8; 4]) -> T) -> Result<[T; N]> {
    let mut out = Vec::with_capacity(N);
    for _ in 0..N {
        let mut bytes = [0; 4];
        input.read_exact(&mut bytes)?;
        out.push(f(bytes));
    }
    out.try_into().map_err(|_| bad("too few numbers"))
}

fn rows<T>(count: u32, mut row: impl FnMut() -> Result<T>) -> Result<Vec<T>> {
    (0..count).map(|_| row()).collect()
}

fn mesh(input: &mut impl Read) -> Result<(Tree, f64)> {
    let [high, vertices, triangles] = numbers(input, u32::from_le_bytes)?;
    let vertices = rows(vertices, || {
        let [x, y, z] = numbers(input, f32::from_le_bytes)?;
        Ok(Vertex([x, y, z, 0.0]))
    })?;
    let indices = rows(triangles, || numbers::<3, _>(input, u32::from_le_bytes))?;
    Tree::new(vertices, indices.concat(), high != 0)
}

fn trace(input: &mut impl Read, output: &mut impl Write, tree: &Tree) -> Result<()> {
    let [any, listed, threads, count] = numbers(input, u32::from_le_bytes)?;
    let rays = rows(count, || numbers::<8, _>(input, f32::from_le_bytes))?;
    let start = Instant::now();
    let rays = black_box(&rays);
    let count = |rays: &[[f32; 8]]| {
        if any != 0 {
            rays.iter().filter(|r| tree.any(r)).count()
        } else {
            rays.iter().filter(|r| tree.closest(r).is_some()).count()
        }
    };
    let hits = if threads <= 1 {
        count(rays)
    } else {
        let part = rays.len().div_ceil(threads as usize).max(1);
        std::thread::scope(|scope| {
            let parts: Vec<_> = rays
                .chunks(part)
                .map(|rays| scope.spawn(|| count(rays)))
                .collect();
            parts.into_iter().map(|p| p.join().unwrap_or(0)).sum()
        })
    };
    let seconds = start.elapsed().as_secs_f64();
    output.write_all(&seconds.to_le_bytes())?;
    output.write_all(&(black_box(hits) as u32).to_le_bytes())?;
    if listed != 0 {
        for ray in rays {
            let (t, primitive) = tree.closest(ray).unwrap_or((f32::NAN, u32::MAX));
            output.write_all(&t.to_le_bytes())?;
            output.write_all(&primitive.to_le_bytes())?;
        }
    }
    Ok(())
}

fn main() -> Result<()> {
    let mut input = std::io::BufReader::with_capacity(1 << 20, std::io::stdin().lock());
    let mut output = std::io::BufWriter::with_capacity(1 << 20, std::io::stdout().lock());
    let mut version = [0; 3];
    // SAFETY: three numbers are written.
    unsafe { raytwin_tinybvh_version(version.as_mut_ptr()) };
    for number in version {
        output.write_all(&number.to_le_bytes())?;
    }
    output.flush()?;
    let mut tree = None;
    let mut request = [0];
    while input.read(&mut request)? == 1 {
        match (request[0], &tree) {
            (b'M', _) => {
                let (new, milliseconds) = mesh(&mut input)?;
                tree = Some(new);
                output.write_all(&milliseconds.to_le_bytes())?;
            }
            (b'T', Some(tree)) => trace(&mut input, &mut output, tree)?,
            _ => return Err(bad("no such request, or rays before a mesh")),
        }
        output.flush()?;
    }
    Ok(())
}
