//! Wavefront OBJ, read line by line so that an error can name its line.
//!
//! Only geometry is read: `v`, `f` (fans, in the order of the file) and the
//! count of `p` and `l`. Texture coordinates, normals and materials play no
//! part. The index buffer of the file is kept, so that neighbours share
//! vertices also across groups. tobj is the peer in the tests.

use std::borrow::Cow;
use std::path::Path;

use glam::Vec3;

use super::error::{Place, SceneError};
use super::mesh::{Limits, Mesh, check_vertex};

/// Every statement of the OBJ specification that is no `v`, `f`, `p` or `l`.
const OTHER_STATEMENTS: &[&str] = &[
    "vt",
    "vn",
    "vp",
    "cstype",
    "deg",
    "bmat",
    "step",
    "curv",
    "curv2",
    "surf",
    "parm",
    "trim",
    "hole",
    "scrv",
    "sp",
    "end",
    "con",
    "g",
    "s",
    "mg",
    "o",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "usemtl",
    "mtllib",
    "usemap",
    "maplib",
    "shadow_obj",
    "trace_obj",
    "ctech",
    "stech",
    "call",
    "csh",
    "bsp",
    "bzp",
    "cdc",
    "cdp",
    "res",
];

/// Parses the bytes of an OBJ file; `path` only serves the messages.
pub(super) fn parse(path: &Path, bytes: &[u8], limits: &Limits) -> Result<Mesh, SceneError> {
    let mut mesh = Mesh::default();
    // Positive indices beyond the vertices read so far: the vertex may follow.
    let mut forward: Vec<(usize, u32)> = Vec::new();
    let mut corners: Vec<u32> = Vec::new();

    for (line, text) in Statements::new(bytes) {
        let broken = |problem: String, mend: &'static str| SceneError::BrokenObj {
            at: Place::line(path, line),
            problem,
            mend,
        };
        let mut tokens = text
            .split(|b| b.is_ascii_whitespace())
            .filter(|t| !t.is_empty());
        let Some(keyword) = tokens.next() else {
            continue;
        };
        match keyword {
            b"v" => {
                if mesh.positions.len() >= limits.vertices {
                    return Err(too_large(path, line, "vertices", limits.vertices));
                }
                let mut p = [0.0f32; 3];
                for (axis, slot) in p.iter_mut().enumerate() {
                    let token = tokens.next().ok_or_else(|| {
                        broken(
                            format!("a vertex with {axis} of 3 coordinates"),
                            "write `v x y z`",
                        )
                    })?;
                    *slot = std::str::from_utf8(token)
                        .ok()
                        .and_then(|t| t.parse().ok())
                        .ok_or_else(|| {
                            broken(
                                format!("`{}` is not a number", excerpt(token)),
                                "write the coordinate as a decimal number",
                            )
                        })?;
                }
                let p = Vec3::from_array(p);
                check_vertex(|| Place::line(path, line), mesh.positions.len(), p)?;
                mesh.positions.push(p);
            }
            // `fo` is what the format called a face before version 3.0.
            b"f" | b"fo" => {
                corners.clear();
                for token in tokens {
                    let index = corner_index(token).ok_or_else(|| {
                        broken(
                            format!("`{}` is not a face corner", excerpt(token)),
                            "write v, v/vt, v//vn or v/vt/vn with whole numbers",
                        )
                    })?;
                    let vertices = mesh.positions.len();
                    let out_of_range = || SceneError::IndexOutOfRange {
                        at: Place::line(path, line),
                        index,
                        vertices,
                        base: "count from 1, negative ones from the last vertex read",
                    };
                    let resolved = if index > 0 {
                        index - 1
                    } else if index < 0 {
                        // i64::MIN cannot wrap: the count of vertices is positive.
                        vertices as i64 + index
                    } else {
                        return Err(out_of_range());
                    };
                    let resolved = u32::try_from(resolved).map_err(|_| out_of_range())?;
                    if resolved as usize >= vertices {
                        forward.push((line, resolved));
                    }
                    corners.push(resolved);
                }
                let [first, rest @ ..] = corners.as_slice() else {
                    return Err(broken("a face with 0 vertices".into(), FACE_MEND));
                };
                if rest.len() < 2 {
                    let n = corners.len();
                    return Err(broken(format!("a face with {n} of 3 vertices"), FACE_MEND));
                }
                if mesh.indices.len() + rest.len() - 1 > limits.triangles {
                    return Err(too_large(path, line, "triangles", limits.triangles));
                }
                mesh.indices
                    .extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
            }
            b"p" | b"l" => mesh.skipped += 1,
            word if word.starts_with(b"#") => {}
            word if OTHER_STATEMENTS.iter().any(|s| s.as_bytes() == word) => {}
            word => {
                return Err(broken(
                    format!("`{}` is no statement of the format", excerpt(word)),
                    "remove the line, or check that the file is an OBJ",
                ));
            }
        }
    }

    let vertices = mesh.positions.len();
    if let Some(&(line, index)) = forward.iter().find(|(_, i)| *i as usize >= vertices) {
        return Err(SceneError::IndexOutOfRange {
            at: Place::line(path, line),
            index: i64::from(index) + 1,
            vertices,
            base: "count from 1",
        });
    }
    if mesh.indices.is_empty() {
        return Err(SceneError::EmptyMesh {
            path: path.to_owned(),
            vertices,
            skipped: mesh.skipped,
        });
    }
    Ok(mesh)
}

const FACE_MEND: &str = "give the face 3 vertices or more, or remove the line";

fn too_large(path: &Path, line: usize, what: &'static str, limit: usize) -> SceneError {
    SceneError::TooLarge {
        at: Place::line(path, line),
        what,
        limit,
    }
}

/// The vertex index of `v`, `v/vt`, `v//vn` or `v/vt/vn`; `None` where the
/// token is none of them.
fn corner_index(token: &[u8]) -> Option<i64> {
    let mut parts = std::str::from_utf8(token).ok()?.split('/');
    let index = parts.next()?.parse().ok()?;
    let mut others = 0;
    for part in parts {
        others += 1;
        if others > 2 || !(part.is_empty() || part.parse::<i64>().is_ok()) {
            return None;
        }
    }
    Some(index)
}

/// The start of a token, printable, for a message.
fn excerpt(token: &[u8]) -> String {
    let cut = &token[..token.len().min(40)];
    let text: String = String::from_utf8_lossy(cut).escape_debug().collect();
    if cut.len() < token.len() {
        format!("{text}...")
    } else {
        text
    }
}

/// Logical lines (a trailing backslash joins the next one) with the number of
/// their first line, counted from 1.
struct Statements<'a> {
    rest: Option<&'a [u8]>,
    line: usize,
}

impl<'a> Statements<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        // A byte order mark would hide the first keyword.
        let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
        Self {
            rest: Some(bytes),
            line: 0,
        }
    }

    fn physical(&mut self) -> Option<&'a [u8]> {
        let rest = self.rest?;
        self.line += 1;
        let (text, rest) = match rest.iter().position(|&b| b == b'\n') {
            Some(end) => (&rest[..end], Some(&rest[end + 1..])),
            None => (rest, None),
        };
        self.rest = rest;
        Some(text.strip_suffix(b"\r").unwrap_or(text))
    }
}

impl<'a> Iterator for Statements<'a> {
    type Item = (usize, Cow<'a, [u8]>);

    fn next(&mut self) -> Option<Self::Item> {
        let text = self.physical()?;
        let line = self.line;
        let Some(head) = text.strip_suffix(b"\\") else {
            return Some((line, Cow::Borrowed(text)));
        };
        let mut joined = head.to_vec();
        while let Some(next) = self.physical() {
            joined.push(b' ');
            match next.strip_suffix(b"\\") {
                Some(head) => joined.extend_from_slice(head),
                None => {
                    joined.extend_from_slice(next);
                    break;
                }
            }
        }
        Some((line, Cow::Owned(joined)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Mesh, SceneError> {
        parse(Path::new("t.obj"), text.as_bytes(), &Limits::default())
    }

    #[test]
    fn fans_forms_of_corners_and_continuation() {
        let mesh = read(
            "\u{feff}# c\r\nv 0 0 0\r\nv 1 0 0 1.0\nv 1 1 0 .5 .5 .5\nv 0 1 0\n\
             vt 0 0\nvn 0 0 1\nf 1/1/1 2//1 3/1 \\\n -1\nl 1 2\np 3\nf -4 -3 -2\n",
        )
        .expect("a valid file");
        assert_eq!(mesh.positions.len(), 4);
        assert_eq!(mesh.indices, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
        assert_eq!(mesh.skipped, 2);
    }

    #[test]
    fn faces_may_stand_before_their_vertices() {
        let mesh = read("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n").expect("a valid file");
        assert_eq!(mesh.indices, [[0, 1, 2]]);
    }

    #[test]
    fn a_line_number_counts_continued_lines() {
        let error = read("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 \\\n2 \\\n3\nf 1 2 4\n")
            .expect_err("vertex 4 does not exist");
        assert!(error.to_string().starts_with("t.obj:7: "), "{error}");
    }
}
