//! References take minutes: each is kept in a file of the build folder.
//!
//! A file's name is a hash of everything that the picture depends on; the
//! program itself counts through a few pixels that it renders. A file that is
//! not whole counts as missing, and without a folder to write to nothing is
//! kept.

use std::io::Write;
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"raytwref";

/// FNV-1a, which is the same on every machine and compiler.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fingerprint(u64);

impl Fingerprint {
    pub fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    pub fn bytes(mut self, bytes: &[u8]) -> Self {
        for b in bytes {
            self.0 = (self.0 ^ u64::from(*b)).wrapping_mul(0x0000_0100_0000_01b3);
        }
        self
    }

    pub fn floats(self, values: &[f32]) -> Self {
        values
            .iter()
            .fold(self, |f, v| f.bytes(&v.to_bits().to_le_bytes()))
    }

    pub fn numbers(self, values: &[u32]) -> Self {
        values.iter().fold(self, |f, v| f.bytes(&v.to_le_bytes()))
    }
}

/// The folder of the references: beside what cargo builds.
pub(crate) fn folder() -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../target"),
        PathBuf::from,
    );
    target.join("references")
}

fn file(folder: &Path, key: Fingerprint) -> PathBuf {
    folder.join(format!("{:016x}.bin", key.0))
}

/// The numbers that were kept under this key, if there are `count`.
pub(crate) fn load(folder: &Path, key: Fingerprint, count: usize) -> Option<Vec<f32>> {
    let bytes = std::fs::read(file(folder, key)).ok()?;
    let (head, rest) = bytes.split_at_checked(16)?;
    let (magic, sum) = head.split_at(8);
    let whole = magic == MAGIC
        && rest.len() == 4 * count
        && Fingerprint::new().bytes(rest).0.to_le_bytes() == sum;
    whole.then(|| {
        rest.chunks_exact(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect()
    })
}

/// Keeps numbers under a key.
pub(crate) fn store(folder: &Path, key: Fingerprint, values: &[f32]) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let rest: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    // Whole or not at all, also if two reports run at once.
    let mut temporary = tempfile::NamedTempFile::new_in(folder)?;
    temporary.write_all(MAGIC)?;
    temporary.write_all(&Fingerprint::new().bytes(&rest).0.to_le_bytes())?;
    temporary.write_all(&rest)?;
    temporary.persist(file(folder, key))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_comes_back_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let key = Fingerprint::new().numbers(&[1, 2]).floats(&[3.0]);
        assert!(load(folder, key, 3).is_none());
        let values = [1.0, -0.0, f32::MIN_POSITIVE];
        store(folder, key, &values).unwrap();
        let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&load(folder, key, 3).unwrap()), bits(&values));
        assert!(load(folder, key, 2).is_none());
        assert!(load(folder, key.numbers(&[0]), 3).is_none());
        // Cut off, and changed.
        let path = file(folder, key);
        let whole = std::fs::read(&path).unwrap();
        for n in 0..whole.len() {
            std::fs::write(&path, &whole[..n]).unwrap();
            assert!(load(folder, key, 3).is_none(), "{n} bytes");
            let mut changed = whole.clone();
            changed[n] ^= 4;
            std::fs::write(&path, changed).unwrap();
            assert!(load(folder, key, 3).is_none(), "byte {n}");
        }
    }
}
