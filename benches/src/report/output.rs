//! Files that appear all at once.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

use super::error::ReportError;
use super::schema::Report;

/// The name of the machine-readable half.
pub(super) const JSON: &str = "report.json";
/// The name of the readable half.
pub(super) const PAGE: &str = "index.html";
/// The file with tables for a page of text.
pub(super) const TABLES: &str = "measured.md";

/// An output folder that can be written to, with a hidden folder beside it in
/// which the report grows. Dropping it removes that.
pub(super) struct Output {
    folder: PathBuf,
    growing: tempfile::TempDir,
}

impl Output {
    /// Checks the folder before any work is done.
    pub fn prepare(folder: &Path) -> Result<Self, ReportError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |source| ReportError::Output { path, source }
        };
        if folder.is_file() {
            return Err(ReportError::NotAFolder {
                path: folder.to_owned(),
            });
        }
        let absolute = std::path::absolute(folder).map_err(failed(folder))?;
        let parent = absolute.parent().unwrap_or(&absolute);
        fs::create_dir_all(parent).map_err(failed(folder))?;
        let growing = tempfile::Builder::new()
            .prefix(".raytwin-report-")
            .tempdir_in(parent)
            .map_err(failed(folder))?;
        if folder.is_dir() {
            // Renaming into a folder needs the right to write there.
            tempfile::tempfile_in(folder).map_err(failed(folder))?;
        }
        Ok(Self {
            folder: absolute,
            growing,
        })
    }

    /// Writes all files, by path relative to the folder, and puts them in
    /// place; files of the report that was there before go.
    pub fn write(self, files: &BTreeMap<String, Vec<u8>>) -> Result<PathBuf, ReportError> {
        let failed = |name: &str| {
            let path = self.folder.join(name);
            move |source| ReportError::Output { path, source }
        };
        for (name, contents) in files {
            let path = self.growing.path().join(name);
            if let Some(parent) = path.parent() {
                fs::create_dir_all(parent).map_err(failed(name))?;
            }
            fs::write(&path, contents).map_err(failed(name))?;
        }
        let before = old_files(&self.folder);
        // The page and the numbers come last: what they name is there by then.
        let is_last = |name: &str| name == PAGE || name == JSON;
        let mut names: Vec<&String> = files.keys().collect();
        names.sort_by_key(|name| (is_last(name), (*name).clone()));
        for name in names {
            let target = self.folder.join(name);
            if let Some(parent) = target.parent() {
                fs::create_dir_all(parent).map_err(failed(name))?;
            }
            fs::rename(self.growing.path().join(name), &target).map_err(failed(name))?;
        }
        for name in before.iter().filter(|name| !files.contains_key(*name)) {
            match fs::remove_file(self.folder.join(name)) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(failed(name)(e)),
                _ => {}
            }
        }
        Ok(self.folder)
    }
}

/// Files that an earlier report says it wrote, inside its folder.
fn old_files(folder: &Path) -> Vec<String> {
    let Some(report) = fs::read(folder.join(JSON))
        .ok()
        .and_then(|bytes| serde_json::from_slice::<Report>(&bytes).ok())
    else {
        return Vec::new();
    };
    let inside = |name: &String| {
        Path::new(name)
            .components()
            .all(|c| matches!(c, Component::Normal(_)))
    };
    report.files.into_iter().filter(inside).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(names: &[&str], report: &Report) -> BTreeMap<String, Vec<u8>> {
        let mut out: BTreeMap<_, _> = names
            .iter()
            .map(|n| ((*n).to_owned(), n.as_bytes().to_vec()))
            .collect();
        out.insert(JSON.into(), serde_json::to_vec(report).unwrap());
        out
    }

    #[test]
    fn a_second_report_replaces_the_first() {
        let temp = tempfile::tempdir().unwrap();
        let folder = temp.path().join("deep/report");
        let report = |names: &[&str]| Report {
            files: names.iter().map(|n| (*n).to_owned()).collect(),
            ..Report::default()
        };
        let write = |names: &[&str], listed: &[&str]| {
            Output::prepare(&folder)
                .unwrap()
                .write(&files(names, &report(listed)))
                .unwrap();
        };
        write(&["p/a.png", "p/b.png"], &["p/a.png", "p/b.png", "../kept"]);
        fs::write(folder.join("p/mine"), "mine").unwrap();
        fs::write(folder.parent().unwrap().join("kept"), "kept").unwrap();
        write(&["p/b.png"], &["p/b.png"]);
        assert!(!folder.join("p/a.png").exists(), "stale");
        assert!(folder.join("p/b.png").exists());
        assert!(folder.join("p/mine").exists(), "not ours");
        assert!(folder.parent().unwrap().join("kept").exists(), "outside");
        let left: Vec<_> = fs::read_dir(folder.parent().unwrap()).unwrap().collect();
        assert_eq!(left.len(), 2, "nothing hidden is left: {left:?}");
    }

    #[test]
    fn bad_folders() {
        let temp = tempfile::tempdir().unwrap();
        let file = temp.path().join("file");
        fs::write(&file, "x").unwrap();
        assert!(matches!(
            Output::prepare(&file),
            Err(ReportError::NotAFolder { .. })
        ));
        let below = file.join("report");
        let error = Output::prepare(&below).err().unwrap();
        assert!(error.to_string().contains("file/report"), "{error}");
        assert_eq!(error.exit_code(), 2);
    }
}
