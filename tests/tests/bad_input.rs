//! What the mesh loaders do with files that are missing, broken, absurd or
//! random: a typed error that names the file (and line) and the mend, or a
//! valid mesh; never a panic, and never memory out of proportion to the file.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fs;
use std::path::{Path, PathBuf};

use glam::{Vec3, vec3};
use proptest::prelude::*;
use raytwin_tests::scene::{
    Limits, MAX_COORDINATE, Mesh, Place, SceneError, load_path, load_path_with,
};

/// Notes the largest single allocation of each thread, so that a count of
/// 4e9 in a file of a few hundred bytes cannot reserve gigabytes unseen.
struct Watching;

thread_local! {
    static LARGEST: Cell<usize> = const { Cell::new(0) };
}

fn note(size: usize) {
    // Fails only while a thread is torn down.
    let _ = LARGEST.try_with(|l| l.set(l.get().max(size)));
}

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Watching {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(ptr, layout) }
    }
    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note(size);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.realloc(ptr, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Watching = Watching;

/// Bytes that loading one of the small files here may take in one piece.
const SMALL_FILE_ALLOCATION: usize = 1 << 20;

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, bytes).expect("a temporary file");
        path
    }
}

/// Loads a file that must be refused; the message must name the file and hold
/// each of `words`.
fn refused(path: &Path, words: &[&str]) -> SceneError {
    let error = load_path(path).expect_err("the file must be refused");
    assert_message(&error, path, words);
    error
}

fn assert_message(error: &SceneError, path: &Path, words: &[&str]) {
    let message = error.to_string();
    let file = path.display().to_string();
    assert!(message.contains(&file), "`{message}` does not name {file}");
    for word in words {
        assert!(message.contains(word), "`{message}` lacks `{word}`");
    }
}

fn refused_obj(text: &str, words: &[&str]) -> SceneError {
    let folder = Folder::new();
    refused(&folder.write("bad.obj", text), words)
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

#[test]
fn missing_file() {
    let folder = Folder::new();
    for name in ["none.obj", "none.gltf", "none.glb", "none.xyz", "none"] {
        let error = refused(
            &folder.0.path().join(name),
            &["no such file", "check the path"],
        );
        assert!(matches!(error, SceneError::Missing { .. }), "{error:?}");
    }
}

#[test]
fn a_folder_and_a_device() {
    let folder = Folder::new();
    let path = folder.0.path().join("folder.obj");
    fs::create_dir(&path).expect("a folder");
    let error = refused(&path, &["not a regular file", ".glb file"]);
    assert!(matches!(error, SceneError::NotAFile { .. }), "{error:?}");

    #[cfg(unix)]
    {
        // Endless: must be refused without being read.
        let path = folder.0.path().join("zero.obj");
        std::os::unix::fs::symlink("/dev/zero", &path).expect("a link");
        let error = refused(&path, &["not a regular file"]);
        assert!(matches!(error, SceneError::NotAFile { .. }), "{error:?}");
    }
}

/// A name that the system itself refuses, since the super-user may read a
/// file without permissions.
#[cfg(unix)]
#[test]
fn unreadable_file() {
    let folder = Folder::new();
    let path = folder.0.path().join("a.obj");
    std::os::unix::fs::symlink(&path, &path).expect("a link to itself");
    let error = refused(&path, &["cannot be read", "check its permissions"]);
    assert!(matches!(error, SceneError::Unreadable { .. }), "{error:?}");
}

#[test]
fn unknown_extension() {
    let folder = Folder::new();
    for (name, extension) in [("a.stl", "`stl`"), ("a", "``"), ("obj", "``")] {
        let error = refused(
            &folder.write(name, SQUARE),
            &[extension, "convert the mesh"],
        );
        assert!(
            matches!(error, SceneError::UnknownExtension { .. }),
            "{error:?}"
        );
    }
    let path = folder.write("UPPER.OBJ", format!("{SQUARE}f 1 2 3 4\n"));
    assert_eq!(load_path(&path).expect("the case is free").indices.len(), 2);
}

#[test]
fn broken_obj_names_the_line() {
    for (line, text, words) in [
        (1, "v 0 0\n", ["2 of 3 coordinates", "write `v x y z`"]),
        (
            2,
            "v 0 0 0\nv 0 zero 0\n",
            ["`zero` is not a number", "decimal"],
        ),
        (
            5,
            &format!("{SQUARE}f 1 2 x\n"),
            ["`x` is not a face corner", "v/vt/vn"],
        ),
        (
            5,
            &format!("{SQUARE}f 1 2 3.0\n"),
            ["`3.0`", "whole numbers"],
        ),
        (
            5,
            &format!("{SQUARE}f 1/2/3/4 2 3\n"),
            ["`1/2/3/4`", "v/vt/vn"],
        ),
        (
            5,
            &format!("{SQUARE}f\n"),
            ["0 vertices", "3 vertices or more"],
        ),
        (
            6,
            &format!("{SQUARE}f 1 2 3\nf 1 2\n"),
            ["2 of 3 vertices", "3 vertices or more"],
        ),
        (
            2,
            "v 0 0 0\nvertex 0 0 0\n",
            ["`vertex` is no statement", "remove the line"],
        ),
        (
            1,
            "\u{0}\u{1}ELF\n",
            ["no statement", "check that the file is an OBJ"],
        ),
        (
            5,
            &format!("{SQUARE}f 1 2 99999999999999999999\n"),
            ["is not a face corner", "whole numbers"],
        ),
    ] {
        let error = refused_obj(text, &words);
        assert!(
            error.to_string().contains(&format!("bad.obj:{line}: ")),
            "{error}"
        );
        assert!(matches!(error, SceneError::BrokenObj { .. }), "{error:?}");
    }
}

#[test]
fn obj_indices_out_of_range() {
    for (line, face, index) in [
        (6, "f 1 2 3\nf 1 2 5", 5),
        (5, "f 0 1 2", 0),
        (5, "f 1 -5 2", -5),
        (5, "f 1 2 4294967296", 4_294_967_296),
        (5, "f 1 2 4294967295", 4_294_967_295),
        (5, "f 1 2 9223372036854775807", i64::MAX),
        (5, "f 1 2 -9223372036854775808", i64::MIN),
    ] {
        let words = [
            &*format!("index {index} is out of range"),
            "4 vertices",
            "repair the face",
        ];
        let error = refused_obj(&format!("{SQUARE}{face}\n"), &words);
        assert!(
            error.to_string().contains(&format!("bad.obj:{line}: ")),
            "{error}"
        );
        assert!(
            matches!(&error, SceneError::IndexOutOfRange { index: i, vertices: 4, .. } if *i == index),
            "{error:?}"
        );
    }
}

#[test]
fn obj_vertices_that_are_not_finite_or_too_far() {
    for value in ["nan", "NaN", "inf", "-infinity", "1e39"] {
        let text = format!("v 0 0 0\nv 0 1 {value}\n");
        let error = refused_obj(
            &text,
            &["vertex 1", "NaN or infinite", "export the mesh again"],
        );
        assert!(error.to_string().contains("bad.obj:2: "), "{error}");
        assert!(
            matches!(error, SceneError::NonFinite { vertex: 1, .. }),
            "{error:?}"
        );
    }
    let error = refused_obj("v 0 0 0\nv 0 -2e12 0\n", &["1e12", "scale the mesh down"]);
    let SceneError::TooFar { at, vertex: 1, .. } = &error else {
        panic!("{error:?}");
    };
    assert_eq!(at.line, Some(2));
    let folder = Folder::new();
    let path = folder.write("far.obj", "v 0 0 0\nv 1e12 0 0\nv 0 -1e12 0\nf 1 2 3\n");
    assert!(load_path(&path).is_ok(), "the limit itself is allowed");
}

#[test]
fn empty_meshes() {
    for text in ["", "# nothing\n", SQUARE, &format!("{SQUARE}l 1 2\np 3\n")] {
        let error = refused_obj(text, &["no triangles", "export it with faces"]);
        assert!(matches!(error, SceneError::EmptyMesh { .. }), "{error:?}");
    }
    let folder = Folder::new();
    let path = folder.write("empty.gltf", r#"{"asset":{"version":"2.0"}}"#);
    let error = refused(&path, &["no triangles"]);
    assert!(matches!(error, SceneError::EmptyMesh { .. }), "{error:?}");
}

#[test]
fn meshes_above_the_limits() {
    let folder = Folder::new();
    let path = folder.write("big.obj", format!("{SQUARE}f 1 2 3\nf 1 2 3 4\n"));
    let with = |limits: Limits| load_path_with(&path, &limits);
    let fits = Limits {
        triangles: 3,
        vertices: 4,
        file_bytes: fs::metadata(&path).expect("written").len(),
    };
    assert_eq!(with(fits).expect("at the limits").indices.len(), 3);

    let error = with(Limits {
        triangles: 2,
        ..fits
    })
    .expect_err("3 triangles");
    assert_message(
        &error,
        &path,
        &["big.obj:6: ", "limit of 2 triangles", "simplify"],
    );
    let error = with(Limits {
        vertices: 3,
        ..fits
    })
    .expect_err("4 vertices");
    assert_message(
        &error,
        &path,
        &["big.obj:4: ", "limit of 3 vertices", "simplify"],
    );
    let file_bytes = fits.file_bytes - 1;
    let error = with(Limits { file_bytes, ..fits }).expect_err("a byte too many");
    assert_message(
        &error,
        &path,
        &[&format!("limit of {file_bytes} bytes"), "split"],
    );
    assert!(
        matches!(error, SceneError::FileTooLarge { .. }),
        "{error:?}"
    );
}

/// Three gigabytes without a block on the disk: refused by size, unread.
#[test]
fn a_file_above_two_gigabytes() {
    let folder = Folder::new();
    for name in ["huge.obj", "huge.glb"] {
        let path = folder.write(name, "");
        let file = fs::File::options().write(true).open(&path).expect("opens");
        file.set_len(3 << 30).expect("a sparse file");
        LARGEST.set(0);
        let error = refused(&path, &["limit of 2147483648 bytes", "split"]);
        assert!(
            matches!(error, SceneError::FileTooLarge { .. }),
            "{error:?}"
        );
        assert!(LARGEST.get() < SMALL_FILE_ALLOCATION);
    }
}

// ---------------------------------------------------------------- glTF

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::new();
    for chunk in bytes.chunks(3) {
        let at = |i: usize| u32::from(*chunk.get(i).unwrap_or(&0));
        let word = at(0) << 16 | at(1) << 8 | at(2);
        for k in 0..4 {
            out.push(if k <= chunk.len() {
                DIGITS[(word >> (18 - 6 * k) & 63) as usize] as char
            } else {
                '='
            });
        }
    }
    out
}

/// A unit square: 4 positions (48 bytes), then 6 indices of 16 bits (12).
fn square_buffer() -> Vec<u8> {
    let mut bytes = Vec::new();
    for p in [
        [0.0f32, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
    ] {
        bytes.extend(p.iter().flat_map(|c| c.to_le_bytes()));
    }
    bytes.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    bytes
}

/// A glTF with the square placed by two nodes, a parent that moves and a child
/// that mirrors. `buffer` is the buffer's URI member with its comma, or empty.
fn square_json(buffer: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
"nodes":[{{"children":[1,2],"translation":[0,0,5]}},
 {{"mesh":0,"scale":[2,2,2],"rotation":[0,0,0.70710678,0.70710678]}},
 {{"mesh":0,"matrix":[-1,0,0,0, 0,1,0,0, 0,0,1,0, 3,0,0,1]}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}},
 {{"attributes":{{"POSITION":0}},"mode":0}}]}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
 {{"bufferView":1,"byteOffset":0,"componentType":5123,"count":6,"type":"SCALAR"}}],
"bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":12}}],
"buffers":[{{{buffer}"byteLength":60}}]}}"#
    )
}

fn embedded(bytes: &[u8]) -> String {
    let data = base64(bytes);
    square_json(&format!(
        r#""uri":"data:application/octet-stream;base64,{data}","#
    ))
}

fn glb(json: impl AsRef<[u8]>, blob: &[u8]) -> Vec<u8> {
    let mut json = json.as_ref().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut blob = blob.to_vec();
    blob.resize(blob.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    let total = 12 + 8 + json.len() + 8 + blob.len();
    out.extend(2u32.to_le_bytes());
    out.extend((total as u32).to_le_bytes());
    for (kind, data) in [(b"JSON", &json), (b"BIN\0", &blob)] {
        out.extend((data.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(data);
    }
    out
}

fn assert_square(mesh: &Mesh) {
    assert_eq!(mesh.indices, [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]]);
    assert_eq!(mesh.skipped, 2, "the points, once for each node");
    let expected = [
        vec3(0.0, 0.0, 5.0),
        vec3(0.0, 2.0, 5.0),
        vec3(-2.0, 2.0, 5.0),
        vec3(-2.0, 0.0, 5.0),
        vec3(3.0, 0.0, 5.0),
        vec3(2.0, 0.0, 5.0),
        vec3(2.0, 1.0, 5.0),
        vec3(3.0, 1.0, 5.0),
    ];
    assert_eq!(mesh.positions.len(), expected.len());
    for (p, e) in mesh.positions.iter().zip(expected) {
        assert!((*p - e).abs().max_element() < 1e-6, "{p} instead of {e}");
    }
    // The mirrored copy keeps its face towards +z.
    for t in 0..4 {
        let n = mesh.geometric_normal(t).expect("no degenerate triangle");
        assert!((n - Vec3::Z).length() < 1e-6, "triangle {t}: {n}");
    }
}

#[test]
fn gltf_embedded_beside_and_binary_agree() {
    let folder = Folder::new();
    let path = folder.write("a.gltf", embedded(&square_buffer()));
    assert_square(&load_path(&path).expect("embedded"));

    folder.write("a b.bin", square_buffer());
    let path = folder.write("b.gltf", square_json(r#""uri":"a%20b.bin","#));
    assert_square(&load_path(&path).expect("beside"));

    let path = folder.write("c.glb", glb(square_json(""), &square_buffer()));
    assert_square(&load_path(&path).expect("binary"));
}

#[test]
fn broken_gltf_names_the_element() {
    let good = embedded(&square_buffer());
    let folder = Folder::new();
    let cases: &[(&str, &str, &str)] = &[
        ("\"asset\"", "asset", "line 1"),
        ("\"POSITION\":0}", "\"POSITION\":9}", "accessor 9 of 2"),
        ("\"indices\":1", "\"indices\":9", "indices"),
        (
            "\"indices\":1",
            "\"indices\":0",
            "accessor 0 is not of type Scalar",
        ),
        ("\"mesh\":0", "\"mesh\":7", "nodes[1].mesh"),
        ("\"mode\":0", "\"mode\":77", "mode"),
        ("[1,2]", "[1,9]", "children"),
        ("[1,2]", "[1,0]", "node 0 is reached twice"),
        ("[1,2]", "[1,1]", "node 1 is reached twice"),
        (
            "\"count\":4",
            "\"count\":4000000000",
            "passes the end of its buffer view",
        ),
        (
            "\"count\":6",
            "\"count\":18446744073709551615",
            "passes the end",
        ),
        ("\"count\":6", "\"count\":5", "no multiple of 3"),
        (
            "\"byteOffset\":0",
            "\"byteOffset\":18446744073709551615",
            "passes the end",
        ),
        (
            "\"byteOffset\":48",
            "\"byteOffset\":18446744073709551615",
            "passes the end of buffer 0",
        ),
        (
            "\"byteLength\":48",
            "\"byteLength\":4800,\"byteStride\":4",
            "passes the end",
        ),
        (
            "\"byteLength\":60",
            "\"byteLength\":6000",
            "should have 6000 bytes",
        ),
        ("base64,AA", "base64,A!", "data URI of buffer 0"),
        (";base64,", ";base32,", "not base64"),
        (
            "[0,0,0.70710678,0.70710678]",
            "[0,0,0,0]",
            "rotation is no quaternion",
        ),
        ("5123", "5122", "indices of a signed type"),
        ("5123", "1", "componentType"),
    ];
    for (from, to, word) in cases {
        assert!(good.contains(from), "{from}");
        let path = folder.write("bad.gltf", good.replacen(from, to, 1));
        LARGEST.set(0);
        let error = refused(&path, &[word, "export the file again"]);
        assert!(matches!(error, SceneError::BrokenGltf { .. }), "{error:?}");
        assert!(LARGEST.get() < SMALL_FILE_ALLOCATION, "{error}");
    }
}

#[test]
fn unsupported_gltf_says_how_to_export() {
    let good = embedded(&square_buffer());
    let folder = Folder::new();
    let required = r#""extensionsRequired":["KHR_draco_mesh_compression"],"asset""#;
    let sparse = r#""sparse":{"count":1,"indices":{"bufferView":1,"componentType":5123},"values":{"bufferView":0}},"count":4"#;
    let uri = format!(
        "data:application/octet-stream;base64,{}",
        base64(&square_buffer())
    );
    for (from, to, word) in [
        ("\"asset\"", required, "without compression"),
        (
            "\"indices\":1",
            "\"indices\":1,\"mode\":5",
            "plain triangles",
        ),
        ("\"count\":4", sparse, "without sparse accessors"),
        ("5126", "5122", "without quantization"),
        (
            uri.as_str(),
            "http://example.com/a.bin",
            "put the buffer beside",
        ),
        (uri.as_str(), "/etc/passwd", "put the buffer beside"),
        (uri.as_str(), "file:///etc/passwd", "put the buffer beside"),
    ] {
        let path = folder.write("bad.gltf", good.replacen(from, to, 1));
        let error = refused(&path, &[word]);
        assert!(
            matches!(error, SceneError::UnsupportedGltf { .. }),
            "{error:?}"
        );
    }
}

#[test]
fn gltf_buffer_files() {
    let folder = Folder::new();
    let path = folder.write("a.gltf", square_json(r#""uri":"none.bin","#));
    let error = refused(&path, &["none.bin", "put it beside the glTF"]);
    assert!(matches!(error, SceneError::Buffer { .. }), "{error:?}");

    // A buffer that would burst the budget is refused by its size.
    let path = folder.write("b.gltf", square_json(r#""uri":"huge.bin","#));
    let huge = fs::File::create(folder.0.path().join("huge.bin")).expect("a file");
    huge.set_len(3 << 30).expect("a sparse file");
    LARGEST.set(0);
    let error = refused(&path, &["limit of 2147483648 bytes"]);
    assert!(
        matches!(error, SceneError::FileTooLarge { .. }),
        "{error:?}"
    );
    assert!(LARGEST.get() < SMALL_FILE_ALLOCATION);

    // Percent escapes that are no UTF-8.
    let path = folder.write("c.gltf", square_json(r#""uri":"%ff.bin","#));
    refused(&path, &["bad percent escape"]);

    // No data at all: a buffer without URI outside a GLB.
    let path = folder.write("d.gltf", square_json(""));
    refused(&path, &["buffer 0 has no data"]);
}

#[test]
fn gltf_vertices_and_indices() {
    let folder = Folder::new();
    let mut buffer = square_buffer();
    buffer[12..16].copy_from_slice(&f32::NAN.to_le_bytes());
    let path = folder.write("nan.glb", glb(square_json(""), &buffer));
    let error = refused(
        &path,
        &["vertex 1", "NaN or infinite", "export the mesh again"],
    );
    assert!(
        matches!(error, SceneError::NonFinite { vertex: 1, .. }),
        "{error:?}"
    );

    buffer[12..16].copy_from_slice(&9e12f32.to_le_bytes());
    let path = folder.write("far.glb", glb(square_json(""), &buffer));
    let error = refused(&path, &["vertex 1", "scale the mesh down"]);
    assert!(
        matches!(error, SceneError::TooFar { vertex: 1, .. }),
        "{error:?}"
    );

    // Finite in the file, too far once its node has placed it.
    let far = square_json("").replacen("[2,2,2]", "[3e38,2,2]", 1);
    let path = folder.write("scaled.glb", glb(&far, &square_buffer()));
    refused(&path, &["vertex 1", "scale the mesh down"]);

    let mut buffer = square_buffer();
    buffer[50..52].copy_from_slice(&4u16.to_le_bytes());
    let path = folder.write("index.glb", glb(square_json(""), &buffer));
    let error = refused(
        &path,
        &["index 4 is out of range", "4 vertices", "repair the face"],
    );
    assert!(
        matches!(error, SceneError::IndexOutOfRange { index: 4, .. }),
        "{error:?}"
    );
}

#[test]
fn broken_glb_containers() {
    let folder = Folder::new();
    let good = glb(square_json(""), &square_buffer());
    let with = |at: usize, word: u32| {
        let mut bytes = good.clone();
        bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
        bytes
    };
    for (bytes, word) in [
        (good[..9].to_vec(), "header is cut off"),
        (with(4, 1), "version 1"),
        // The gltf crate computes `length - 12` unchecked.
        (with(8, 11), "header says 11 bytes"),
        (with(8, u32::MAX), "header says 4294967295 bytes"),
        (with(8, 16), "chunk at byte 12 is cut off"),
        (
            with(12, u32::MAX),
            "says 4294967295 bytes and passes the end",
        ),
        (with(16, 0), "first GLB chunk is not JSON"),
        (with(8, 12), "no JSON chunk"),
    ] {
        let error = refused(
            &folder.write("bad.glb", bytes),
            &[word, "export the file again"],
        );
        assert!(matches!(error, SceneError::BrokenGltf { .. }), "{error:?}");
    }
}

/// A few hundred bytes that place one mesh many times: the limits count what
/// comes out, not what is in the file.
#[test]
fn instancing_counts_against_the_limits() {
    let folder = Folder::new();
    let path = folder.write("a.glb", glb(square_json(""), &square_buffer()));
    let limits = Limits::default();
    for limits in [
        Limits {
            triangles: 3,
            ..limits
        },
        Limits {
            vertices: 7,
            ..limits
        },
    ] {
        let error = load_path_with(&path, &limits).expect_err("two copies are too many");
        assert_message(&error, &path, &["more than the limit of", "simplify"]);
        assert!(matches!(error, SceneError::TooLarge { .. }), "{error:?}");
    }
    assert!(
        load_path_with(
            &path,
            &Limits {
                triangles: 4,
                vertices: 8,
                ..limits
            }
        )
        .is_ok()
    );
}

/// A chain of nodes as deep as the file is long must not use up the stack.
#[test]
fn a_deep_chain_of_nodes() {
    let depth = 20_000;
    let mut nodes: Vec<String> = (1..depth)
        .map(|child| format!(r#"{{"children":[{child}]}}"#))
        .collect();
    nodes.push(r#"{"mesh":0}"#.into());
    let mut json = square_json("");
    let (start, end) = (
        json.find("\"nodes\":[{").expect("nodes") + 9,
        json.find("],\n\"meshes\"").expect("meshes"),
    );
    json.replace_range(start..end, &nodes.join(","));
    let folder = Folder::new();
    let path = folder.write("deep.glb", glb(&json, &square_buffer()));
    assert_eq!(load_path(&path).expect("a valid file").indices.len(), 2);
    // JSON itself, nested too deep.
    let path = folder.write("nest.gltf", "[".repeat(1 << 20));
    refused(&path, &["broken glTF"]);
}

// ---------------------------------------------------------------- fuzz

/// One change to a file. Positions are fractions of the length.
#[derive(Clone, Debug)]
enum Mutation {
    Flip(f64, u8),
    Truncate(f64),
    Insert(f64, Vec<u8>),
    Remove(f64, usize),
    DuplicateLine(f64, f64),
    RemoveLine(f64),
    Number(f64, &'static str),
    Word(f64, u32),
}

/// What a number is replaced by.
const NUMBERS: &[&str] = &[
    "nan",
    "inf",
    "-inf",
    "1e39",
    "-1e30",
    "1e-50",
    "0",
    "-0",
    "-1",
    "1",
    "2",
    "3",
    "5",
    "7",
    "4000000000",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "99999999999999999999999",
    "null",
    "[]",
    "\"x\"",
    "",
];

fn mutation() -> impl Strategy<Value = Mutation> {
    use Mutation::*;
    let at = || 0.0..1.0f64;
    prop_oneof![
        2 => (at(), 1..=255u8).prop_map(|(a, x)| Flip(a, x)),
        1 => at().prop_map(Truncate),
        2 => (at(), proptest::collection::vec(any::<u8>(), 1..8)).prop_map(|(a, b)| Insert(a, b)),
        2 => (at(), 1..16usize).prop_map(|(a, n)| Remove(a, n)),
        2 => (at(), at()).prop_map(|(a, b)| DuplicateLine(a, b)),
        2 => at().prop_map(RemoveLine),
        8 => (at(), 0..NUMBERS.len()).prop_map(|(a, n)| Number(a, NUMBERS[n])),
        2 => (at(), word()).prop_map(|(a, w)| Word(a, w)),
    ]
}

/// Four bytes that a length, an index or a float could be.
fn word() -> impl Strategy<Value = u32> {
    prop_oneof![
        any::<u32>(),
        Just(0),
        Just(u32::MAX),
        Just(f32::NAN.to_bits()),
        0..100u32
    ]
}

fn place(fraction: f64, len: usize) -> usize {
    ((fraction * len as f64) as usize).min(len.saturating_sub(1))
}

fn line_around(bytes: &[u8], at: usize) -> std::ops::Range<usize> {
    let at = at.min(bytes.len());
    let start = bytes[..at]
        .iter()
        .rposition(|b| *b == b'\n')
        .map_or(0, |p| p + 1);
    let end = bytes[at..]
        .iter()
        .position(|b| *b == b'\n')
        .map_or(bytes.len(), |p| at + p + 1);
    start..end
}

fn numbers(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
    let mut out: Vec<std::ops::Range<usize>> = Vec::new();
    for (i, b) in bytes.iter().enumerate() {
        if b.is_ascii_digit() || matches!(b, b'-' | b'.') {
            match out.last_mut() {
                Some(last) if last.end == i => last.end = i + 1,
                _ => out.push(i..i + 1),
            }
        }
    }
    out
}

fn mutate(bytes: &mut Vec<u8>, mutation: &Mutation) {
    let len = bytes.len();
    if len == 0 {
        return;
    }
    match mutation {
        Mutation::Flip(a, x) => bytes[place(*a, len)] ^= x,
        Mutation::Truncate(a) => bytes.truncate(place(*a, len)),
        Mutation::Insert(a, b) => {
            let at = place(*a, len);
            bytes.splice(at..at, b.iter().copied());
        }
        Mutation::Remove(a, n) => {
            let at = place(*a, len);
            bytes.drain(at..(at + n).min(len));
        }
        Mutation::DuplicateLine(a, b) => {
            let line = bytes[line_around(bytes, place(*a, len))].to_vec();
            let at = line_around(bytes, place(*b, len)).start;
            bytes.splice(at..at, line);
        }
        Mutation::RemoveLine(a) => {
            let line = line_around(bytes, place(*a, len));
            bytes.drain(line);
        }
        Mutation::Number(a, text) => {
            let found = numbers(bytes);
            if !found.is_empty() {
                let range = found[place(*a, found.len())].clone();
                bytes.splice(range, text.bytes());
            }
        }
        Mutation::Word(a, w) => {
            let at = place(*a, len) & !3;
            if at + 4 <= len {
                bytes[at..at + 4].copy_from_slice(&w.to_le_bytes());
            }
        }
    }
}

/// Loads the bytes under this name: a valid mesh, or an error that names the
/// file. Returns whether it was a mesh.
fn survives(folder: &Folder, name: &str, bytes: &[u8]) -> Result<bool, TestCaseError> {
    let path = folder.write(name, bytes);
    LARGEST.set(0);
    let result = load_path(&path);
    let largest = LARGEST.get();
    prop_assert!(
        largest < SMALL_FILE_ALLOCATION,
        "{largest} bytes were allocated at once"
    );
    match result {
        Ok(mesh) => {
            prop_assert!(!mesh.indices.is_empty());
            let vertices = mesh.positions.len();
            for t in &mesh.indices {
                prop_assert!(
                    t.iter().all(|i| (*i as usize) < vertices),
                    "{t:?} of {vertices}"
                );
            }
            for p in &mesh.positions {
                let fits = p.to_array().iter().all(|c| c.abs() <= MAX_COORDINATE);
                prop_assert!(fits, "{p}");
            }
            Ok(true)
        }
        Err(error) => {
            let file = Place::file(&path).to_string();
            prop_assert!(error.to_string().contains(&file), "{error}");
            Ok(false)
        }
    }
}

const OBJ: &str = "# a house\nmtllib none.mtl\no walls\n\
v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv -1 1.5e0 -1 1.0\nv 1 1.5 -1\nv 1 1.5 1\nv -1 1.5 1\n\
vt 0 0\nvn 0 -1 0\ng sides\nusemtl a\ns off\nf 1/1/1 2/1/1 6 5\nf 2//1 3//1 7//1 6//1\n\
f 3 4 8 7\nf 4/1 1/1 5/1 8/1\nl 1 2 3\np 4\no roof\nv 0 2.5 0\nf -5 -4 -1\nf -4 -3 -1\n\
f -3 -2 \\\n -1\nf -2 -5 -1\n";

/// Mutates one valid file `cases` times and demands that both kinds of outcome
/// occurred: a fuzz that only ever meets one of them tests too little.
fn fuzz(name: &str, valid: &[u8], cases: u32) {
    let folder = Folder::new();
    assert!(
        survives(&folder, name, valid).expect("valid"),
        "the unchanged file loads"
    );
    let (loaded, refused) = (Cell::new(0), Cell::new(0));
    let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig {
        cases,
        failure_persistence: None,
        ..ProptestConfig::default()
    });
    let strategy = proptest::collection::vec(mutation(), 1..5);
    let outcome = runner.run(&strategy, |mutations| {
        let mut bytes = valid.to_vec();
        for m in &mutations {
            mutate(&mut bytes, m);
        }
        let counter = if survives(&folder, name, &bytes)? {
            &loaded
        } else {
            &refused
        };
        counter.set(counter.get() + 1);
        Ok(())
    });
    outcome.unwrap_or_else(|e| panic!("{name}: {e}"));
    println!("{name}: {} loaded, {} refused", loaded.get(), refused.get());
    assert!(loaded.get() > cases / 400 && refused.get() > cases / 400);
}

const CASES: u32 = 2000;

#[test]
fn fuzz_obj() {
    fuzz("fuzz.obj", OBJ.as_bytes(), CASES);
}

#[test]
fn fuzz_gltf() {
    fuzz("fuzz.gltf", embedded(&square_buffer()).as_bytes(), CASES);
}

#[test]
fn fuzz_gltf_with_a_buffer_file() {
    // The buffer keeps its name and content; the JSON around it changes.
    let folder = Folder::new();
    folder.write("a.bin", square_buffer());
    let valid = square_json(r#""uri":"a.bin","#);
    let strategy = proptest::collection::vec(mutation(), 1..5);
    proptest!(ProptestConfig { cases: CASES, failure_persistence: None, ..ProptestConfig::default() },
    |(mutations in strategy)| {
        let mut bytes = valid.clone().into_bytes();
        for m in &mutations {
            mutate(&mut bytes, m);
        }
        survives(&folder, "fuzz.gltf", &bytes)?;
    });
}

#[test]
fn fuzz_glb() {
    fuzz("fuzz.glb", &glb(square_json(""), &square_buffer()), CASES);
}

/// The container stays whole, what it holds changes.
#[test]
fn fuzz_glb_parts() {
    let folder = Folder::new();
    let (json, blob) = (square_json("").into_bytes(), square_buffer());
    let strategy = (
        proptest::collection::vec(mutation(), 0..3),
        proptest::collection::vec(mutation(), 0..3),
    );
    proptest!(ProptestConfig { cases: CASES, failure_persistence: None, ..ProptestConfig::default() },
    |((in_json, in_blob) in strategy)| {
        let (mut json, mut blob) = (json.clone(), blob.clone());
        in_json.iter().for_each(|m| mutate(&mut json, m));
        in_blob.iter().for_each(|m| mutate(&mut blob, m));
        survives(&folder, "fuzz.glb", &glb(json, &blob))?;
    });
}

#[test]
fn random_bytes_of_any_extension() {
    let folder = Folder::new();
    proptest!(ProptestConfig { cases: CASES, failure_persistence: None, ..ProptestConfig::default() },
    |(bytes in proptest::collection::vec(any::<u8>(), 0..200), magic in any::<bool>())| {
        for name in ["r.obj", "r.gltf", "r.glb"] {
            let mut all = if magic { b"glTF\x02\0\0\0".to_vec() } else { Vec::new() };
            all.extend(&bytes);
            survives(&folder, name, &all)?;
        }
    });
}
