//! glTF 2.0 and GLB: triangles of the default scene, with the transforms of
//! its nodes applied.
//!
//! The gltf crate (1.4.1) parses and validates the JSON. Three of its parts
//! are not used because they panic on bad input: the GLB splitter (header
//! length below 12), the reader of buffer files (a URI whose percent escapes
//! are no UTF-8) and the accessor iterators; and the positions' indices are
//! checked before its validator, which indexes with them.
//!
//! Left out: skins and morph targets (the mesh stays in its rest pose).
//! Refused by name: sparse accessors, strips and fans, positions that are not
//! f32, extensions that are required.

use std::io;
use std::path::{Component, Path, PathBuf};

use glam::{DMat3, DMat4, DQuat, DVec3, Vec3};
use gltf::json;
use json::accessor::{ComponentType, Type};
use json::mesh::{Mode, Semantic};
use json::validation::Checked;

use super::error::{Place, SceneError};
use super::files::{ReadFailure, read_limited};
use super::mesh::{Limits, MAX_NODES, Mesh, check_vertex};

/// Parses the bytes of a glTF or GLB file; buffer files are looked up beside
/// `path`.
pub(super) fn parse(path: &Path, bytes: &[u8], limits: &Limits) -> Result<Mesh, SceneError> {
    let (json, blob) = split(path, bytes)?;
    let root: json::Root =
        json::deserialize::from_slice(json).map_err(|e| SceneError::BrokenGltf {
            path: path.to_owned(),
            problem: e.to_string(),
        })?;
    let root = validated(path, root)?;
    let mut reader = Reader {
        path,
        root: &root,
        blob,
        limits,
        budget: limits.file_bytes.saturating_sub(bytes.len() as u64),
        buffers: vec![None; root.buffers.len()],
        mesh: Mesh::default(),
    };
    reader.scene()?;
    let mesh = reader.mesh;
    if mesh.indices.is_empty() {
        return Err(SceneError::EmptyMesh {
            path: path.to_owned(),
            vertices: mesh.positions.len(),
            skipped: mesh.skipped,
        });
    }
    Ok(mesh)
}

fn broken(path: &Path, problem: impl Into<String>) -> SceneError {
    SceneError::BrokenGltf {
        path: path.to_owned(),
        problem: problem.into(),
    }
}

/// JSON and binary part of a GLB; a file without GLB's magic is all JSON.
fn split<'a>(path: &Path, bytes: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>), SceneError> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let (Some(version), Some(length)) = (word_at(bytes, 4), word_at(bytes, 8)) else {
        return Err(broken(path, "the GLB header is cut off"));
    };
    if version != 2 {
        return Err(broken(path, format!("GLB version {version} instead of 2")));
    }
    let length = length as usize;
    if length < 12 || length > bytes.len() {
        let have = bytes.len();
        return Err(broken(
            path,
            format!("the GLB header says {length} bytes, the file has {have}"),
        ));
    }
    // What follows the declared length is no part of the container.
    let bytes = &bytes[..length];

    let mut json = None;
    let mut blob = None;
    let mut at = 12;
    while at < length {
        let (Some(size), Some(kind)) = (word_at(bytes, at), word_at(bytes, at + 4)) else {
            return Err(broken(
                path,
                format!("the GLB chunk at byte {at} is cut off"),
            ));
        };
        let start = at + 8;
        let Some(end) = start.checked_add(size as usize).filter(|&e| e <= length) else {
            return Err(broken(
                path,
                format!("the GLB chunk at byte {at} says {size} bytes and passes the end"),
            ));
        };
        let data = &bytes[start..end];
        match (json, &kind.to_le_bytes()) {
            (None, b"JSON") => json = Some(data),
            (None, _) => return Err(broken(path, "the first GLB chunk is not JSON")),
            (Some(_), b"BIN\0") if blob.is_none() => blob = Some(data),
            // The format asks to ignore chunks of other kinds.
            _ => {}
        }
        at = end;
    }
    match json {
        Some(json) => Ok((json, blob)),
        None => Err(broken(path, "the GLB has no JSON chunk")),
    }
}

/// Four bytes, little-endian, where there are four.
fn word_at(bytes: &[u8], at: usize) -> Option<u32> {
    let four = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes(four.try_into().ok()?))
}

fn validated(path: &Path, root: json::Root) -> Result<json::Root, SceneError> {
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            for index in primitive.attributes.values() {
                if index.value() >= root.accessors.len() {
                    let (i, n) = (index.value(), root.accessors.len());
                    return Err(broken(
                        path,
                        format!("meshes[{m}].primitives[{p}] names accessor {i} of {n}"),
                    ));
                }
            }
        }
    }
    match gltf::Document::from_json(root) {
        Ok(document) => Ok(document.into_json()),
        Err(gltf::Error::Validation(errors)) => {
            use json::validation::Error::Unsupported;
            if let Some((place, _)) = errors.iter().find(|(_, e)| *e == Unsupported) {
                return Err(SceneError::UnsupportedGltf {
                    path: path.to_owned(),
                    problem: format!("{place} names an extension this loader lacks"),
                    mend: "export without compression and without required extensions",
                });
            }
            let shown: Vec<String> = errors
                .iter()
                .take(3)
                .map(|(place, error)| format!("{place}: {error}"))
                .collect();
            let more = errors.len() - shown.len();
            let tail = if more > 0 {
                format!(" (and {more} more)")
            } else {
                String::new()
            };
            Err(broken(path, format!("{}{tail}", shown.join(", "))))
        }
        Err(error) => Err(broken(path, error.to_string())),
    }
}

struct Reader<'a> {
    path: &'a Path,
    root: &'a json::Root,
    blob: Option<&'a [u8]>,
    limits: &'a Limits,
    /// Bytes that buffers may still take.
    budget: u64,
    buffers: Vec<Option<Vec<u8>>>,
    mesh: Mesh,
}

/// The bytes of one accessor: `count` elements, `stride` bytes apart.
struct Elements {
    buffer: usize,
    start: usize,
    stride: usize,
    count: usize,
    kind: ComponentType,
}

impl Reader<'_> {
    fn broken(&self, problem: impl Into<String>) -> SceneError {
        broken(self.path, problem)
    }

    fn unsupported(&self, problem: String, mend: &'static str) -> SceneError {
        SceneError::UnsupportedGltf {
            path: self.path.to_owned(),
            problem,
            mend,
        }
    }

    /// Places every node of the default scene; without scenes, every node that
    /// is no node's child.
    fn scene(&mut self) -> Result<(), SceneError> {
        let root = self.root;
        let count = root.nodes.len();
        if count > MAX_NODES {
            return Err(SceneError::TooLarge {
                at: Place::file(self.path),
                what: "nodes",
                limit: MAX_NODES,
            });
        }
        let scene = match root.scene {
            Some(index) => Some(
                root.get(index)
                    .ok_or_else(|| self.broken("`scene` names a scene that does not exist"))?,
            ),
            None => root.scenes.first(),
        };
        let tops: Vec<usize> = match scene {
            Some(scene) => scene.nodes.iter().map(|n| n.value()).collect(),
            None => {
                let mut child = vec![false; count];
                let children = root.nodes.iter().flat_map(|n| n.children.iter().flatten());
                for index in children {
                    if let Some(flag) = child.get_mut(index.value()) {
                        *flag = true;
                    }
                }
                (0..count).filter(|&n| !child[n]).collect()
            }
        };

        // A node has one parent at most, so a second visit means a cycle or a
        // shared child: both are against the format, the first never ends.
        let mut visited = vec![false; count];
        let mut stack: Vec<(usize, DMat4)> =
            tops.iter().rev().map(|&n| (n, DMat4::IDENTITY)).collect();
        while let Some((index, parent)) = stack.pop() {
            let node = root
                .nodes
                .get(index)
                .ok_or_else(|| self.broken(format!("node {index} of {count} is referred to")))?;
            if std::mem::replace(&mut visited[index], true) {
                return Err(self.broken(format!("node {index} is reached twice (a cycle?)")));
            }
            let world = parent * self.local(index, node)?;
            if let Some(mesh) = node.mesh {
                let at = mesh.value();
                let mesh = root
                    .get(mesh)
                    .ok_or_else(|| self.broken(format!("node {index} names mesh {at}")))?;
                for (p, primitive) in mesh.primitives.iter().enumerate() {
                    self.primitive(&format!("meshes[{at}].primitives[{p}]"), primitive, world)?;
                }
            }
            if let Some(children) = &node.children {
                stack.extend(children.iter().rev().map(|c| (c.value(), world)));
            }
        }
        Ok(())
    }

    fn local(&self, index: usize, node: &json::Node) -> Result<DMat4, SceneError> {
        if let Some(m) = node.matrix {
            return Ok(DMat4::from_cols_array(&m.map(f64::from)));
        }
        let three = |v: Option<[f32; 3]>, or: f64| {
            v.map_or(DVec3::splat(or), |v| DVec3::from_array(v.map(f64::from)))
        };
        let rotation = match node.rotation {
            None => DMat3::IDENTITY,
            Some(q) => {
                // Exporters round the quaternion; f64 mends its length.
                let q = DQuat::from_array(q.0.map(f64::from));
                let length = q.length();
                if !(length.is_finite() && length > 1e-6) {
                    return Err(self.broken(format!("nodes[{index}].rotation is no quaternion")));
                }
                DMat3::from_quat(DQuat::from_array(q.to_array().map(|c| c / length)))
            }
        };
        let scale = three(node.scale, 1.0);
        let linear = DMat3::from_cols(
            rotation.x_axis * scale.x,
            rotation.y_axis * scale.y,
            rotation.z_axis * scale.z,
        );
        let mut local = DMat4::from_mat3(linear);
        local.w_axis = three(node.translation, 0.0).extend(1.0);
        Ok(local)
    }

    fn primitive(
        &mut self,
        name: &str,
        primitive: &json::mesh::Primitive,
        world: DMat4,
    ) -> Result<(), SceneError> {
        match primitive.mode {
            Checked::Valid(Mode::Triangles) => {}
            Checked::Valid(Mode::TriangleStrip | Mode::TriangleFan) => {
                return Err(self.unsupported(
                    format!("{name} is a strip or fan"),
                    "export as plain triangles",
                ));
            }
            Checked::Valid(_) => {
                self.mesh.skipped += 1;
                return Ok(());
            }
            Checked::Invalid => return Err(self.broken(format!("{name} has an unknown mode"))),
        }
        let Some(position) = primitive
            .attributes
            .get(&Checked::Valid(Semantic::Positions))
        else {
            return Err(self.broken(format!("{name} has no POSITION")));
        };
        let positions = self.elements(name, position.value(), Type::Vec3)?;
        if positions.kind != ComponentType::F32 {
            return Err(self.unsupported(
                format!("{name} has positions that are not f32"),
                "export without quantization",
            ));
        }
        let indices = match primitive.indices {
            None => None,
            Some(index) => Some(self.elements(name, index.value(), Type::Scalar)?),
        };

        let corners = indices.as_ref().map_or(positions.count, |i| i.count);
        if corners % 3 != 0 {
            return Err(self.broken(format!("{name} has {corners} corners, no multiple of 3")));
        }
        // Both counts are checked before anything is reserved; instancing
        // multiplies what a small file holds.
        let too_large = |what, limit| SceneError::TooLarge {
            at: Place::file(self.path),
            what,
            limit,
        };
        let base = self.mesh.positions.len();
        let max_vertices = self.limits.vertices.min(u32::MAX as usize);
        if positions.count > max_vertices.saturating_sub(base) {
            return Err(too_large("vertices", max_vertices));
        }
        let room = self
            .limits
            .triangles
            .saturating_sub(self.mesh.indices.len());
        if corners / 3 > room {
            return Err(too_large("triangles", self.limits.triangles));
        }

        let data = self.buffer(positions.buffer)?;
        let mut placed = Vec::with_capacity(positions.count);
        for vertex in 0..positions.count {
            let at = positions.start + vertex * positions.stride;
            let p = Vec3::from_array([0, 4, 8].map(|o| f32::from_bits(word(data, at + o))));
            check_vertex(|| Place::file(self.path), vertex, p)?;
            let p = world.transform_point3(p.as_dvec3()).as_vec3();
            check_vertex(|| Place::file(self.path), vertex, p)?;
            placed.push(p);
        }

        let mut triangles = Vec::with_capacity(corners / 3);
        if let Some(indices) = indices {
            let data = self.buffer(indices.buffer)?;
            let index = |corner: usize| -> Result<u32, SceneError> {
                let at = indices.start + corner * indices.stride;
                let index = match indices.kind {
                    ComponentType::U8 => u32::from(data[at]),
                    ComponentType::U16 => u32::from(u16::from_le_bytes([data[at], data[at + 1]])),
                    ComponentType::U32 => word(data, at),
                    _ => {
                        return Err(self.broken(format!("{name} has indices of a signed type")));
                    }
                };
                if index as usize >= positions.count {
                    return Err(SceneError::IndexOutOfRange {
                        at: Place::file(self.path),
                        index: i64::from(index),
                        vertices: positions.count,
                        base: "count from 0 within a primitive",
                    });
                }
                Ok(index + base as u32)
            };
            for first in (0..corners).step_by(3) {
                triangles.push([index(first)?, index(first + 1)?, index(first + 2)?]);
            }
        } else {
            let first = base as u32;
            triangles.extend((0..corners as u32 / 3).map(|t| [0, 1, 2].map(|k| first + 3 * t + k)));
        }
        if DMat3::from_mat4(world).determinant() < 0.0 {
            // A mirror turns triangles inside out.
            for t in &mut triangles {
                t.swap(1, 2);
            }
        }
        self.mesh.positions.append(&mut placed);
        self.mesh.indices.append(&mut triangles);
        Ok(())
    }

    /// Resolves accessor `index` of primitive `name` and loads its buffer:
    /// every element then lies within the buffer.
    fn elements(&mut self, name: &str, index: usize, shape: Type) -> Result<Elements, SceneError> {
        let root = self.root;
        let what = format!("{name}, accessor {index}");
        let Some(accessor) = root.accessors.get(index) else {
            return Err(self.broken(format!("{what} does not exist")));
        };
        if accessor.sparse.is_some() {
            return Err(self.unsupported(
                format!("{what} is sparse"),
                "export without sparse accessors",
            ));
        }
        if accessor.type_ != Checked::Valid(shape) {
            return Err(self.broken(format!("{what} is not of type {shape:?}")));
        }
        let Checked::Valid(kind) = accessor.component_type else {
            return Err(self.broken(format!("{what} has an unknown component type")));
        };
        let kind = kind.0;
        let Some(view) = accessor.buffer_view.and_then(|v| root.get(v)) else {
            return Err(self.broken(format!("{what} has no buffer view")));
        };

        let size = kind.size() * shape.multiplicity();
        let stride = view.byte_stride.map_or(size, |s| s.0);
        let buffer = view.buffer.value();
        let Some(declared) = root.buffers.get(buffer).map(|b| b.byte_length.0) else {
            return Err(self.broken(format!("{what} lies in buffer {buffer}")));
        };
        let outside = || {
            format!(
                "{what} passes the end of its buffer view ({} elements of {size} bytes, {stride} apart)",
                accessor.count.0
            )
        };
        // Checked u64 arithmetic: the numbers come from the file.
        let offset = accessor.byte_offset.unwrap_or_default().0;
        let view_start = view.byte_offset.unwrap_or_default().0;
        let span = match accessor.count.0 {
            0 => Some(0),
            n => (n - 1)
                .checked_mul(stride as u64)
                .and_then(|s| s.checked_add(size as u64)),
        };
        let end = span.and_then(|s| s.checked_add(offset));
        if stride < size || end.is_none_or(|e| e > view.byte_length.0) {
            return Err(self.broken(outside()));
        }
        let view_end = view_start.checked_add(view.byte_length.0);
        if view_end.is_none_or(|e| e > declared) {
            return Err(self.broken(format!(
                "the buffer view of {what} passes the end of buffer {buffer} ({declared} bytes)"
            )));
        }
        self.load(buffer)?;
        // Both sums are below the buffer's length, which fits in memory.
        Ok(Elements {
            buffer,
            start: (view_start + offset) as usize,
            stride,
            count: accessor.count.0 as usize,
            kind,
        })
    }

    fn buffer(&self, index: usize) -> Result<&[u8], SceneError> {
        let buffer = &self.root.buffers[index];
        match (&self.buffers[index], self.blob) {
            (Some(data), _) => Ok(data),
            (None, Some(blob)) if index == 0 && buffer.uri.is_none() => Ok(blob),
            _ => Err(self.broken(format!("buffer {index} has no data"))),
        }
    }

    /// Makes [`Reader::buffer`] return at least the declared number of bytes.
    fn load(&mut self, index: usize) -> Result<(), SceneError> {
        let buffer = &self.root.buffers[index];
        let declared = buffer.byte_length.0;
        if self.buffers[index].is_none()
            && let Some(uri) = &buffer.uri
        {
            // What is read is bounded by the budget, whatever the JSON declares.
            if declared > self.budget {
                return Err(SceneError::FileTooLarge {
                    path: self.path.to_owned(),
                    limit: self.limits.file_bytes,
                });
            }
            let data = if uri.starts_with("data:") {
                self.data_uri(index, uri)?
            } else {
                self.buffer_file(uri)?
            };
            self.budget = self.budget.saturating_sub(data.len() as u64);
            self.buffers[index] = Some(data);
        }
        let have = self.buffer(index)?.len() as u64;
        if have < declared {
            return Err(self.broken(format!(
                "buffer {index} should have {declared} bytes and has {have}"
            )));
        }
        Ok(())
    }

    fn data_uri(&self, index: usize, uri: &str) -> Result<Vec<u8>, SceneError> {
        if !uri.contains(";base64,") {
            return Err(self.broken(format!("the data URI of buffer {index} is not base64")));
        }
        match gltf::buffer::Data::from_source(gltf::buffer::Source::Uri(uri), None) {
            Ok(data) => Ok(data.0),
            Err(e) => Err(self.broken(format!("the data URI of buffer {index}: {e}"))),
        }
    }

    fn buffer_file(&self, uri: &str) -> Result<Vec<u8>, SceneError> {
        let decoded = percent_decode(uri)
            .ok_or_else(|| self.broken(format!("`{uri}` has a bad percent escape")))?;
        let relative = PathBuf::from(&decoded);
        let plain = relative.components().all(|c| {
            matches!(
                c,
                Component::Normal(_) | Component::CurDir | Component::ParentDir
            )
        });
        if decoded.contains(':') || decoded.contains('\0') || !plain {
            return Err(self.unsupported(
                format!("buffer `{uri}` is no relative path"),
                "put the buffer beside the glTF, or export as .glb",
            ));
        }
        let file = match self.path.parent() {
            Some(folder) => folder.join(relative),
            None => relative,
        };
        read_limited(&file, self.budget).map_err(|failure| match failure {
            ReadFailure::TooLarge => SceneError::FileTooLarge {
                path: self.path.to_owned(),
                limit: self.limits.file_bytes,
            },
            ReadFailure::NotAFile => SceneError::Buffer {
                path: self.path.to_owned(),
                uri: uri.to_owned(),
                source: io::Error::new(io::ErrorKind::InvalidInput, "not a regular file"),
            },
            ReadFailure::Io(source) => SceneError::Buffer {
                path: self.path.to_owned(),
                uri: uri.to_owned(),
                source,
            },
        })
    }
}

/// Four bytes, little-endian, at an offset that [`Reader::elements`] checked.
fn word(data: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([data[at], data[at + 1], data[at + 2], data[at + 3]])
}

/// Resolves `%XX`; `None` where an escape is cut off, is no hexadecimal, or
/// gives bytes that are no UTF-8.
fn percent_decode(uri: &str) -> Option<String> {
    let mut bytes = uri.bytes();
    let mut out = Vec::with_capacity(uri.len());
    while let Some(b) = bytes.next() {
        if b == b'%' {
            let mut digit = || (bytes.next()? as char).to_digit(16);
            let (high, low) = (digit()?, digit()?);
            out.push((high * 16 + low) as u8);
        } else {
            out.push(b);
        }
    }
    String::from_utf8(out).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percent_escapes() {
        assert_eq!(percent_decode("a%20b.bin").as_deref(), Some("a b.bin"));
        assert_eq!(percent_decode("%C3%A9").as_deref(), Some("\u{e9}"));
        for bad in ["%", "%4", "%zz", "%ff"] {
            assert_eq!(percent_decode(bad), None, "{bad}");
        }
    }
}
