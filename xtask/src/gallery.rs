//! The gallery: a static page in `target/gallery`, served or tested.

use std::fs;
use std::io::Error;
use std::path::{Path, PathBuf};

use tiny_http::{Header, Response, Server};

use crate::run::{Environment, Failure, Tests};
use crate::web::{Browser, cannot, example};

/// Builds the page; gives its folder.
///
/// # Errors
/// If a file cannot be written.
pub fn build(root: &Path, environment: &Environment) -> Result<PathBuf, Failure> {
    let (folder, fresh) = (root.join("target/gallery"), root.join("target/gallery.new"));
    if fresh.exists() {
        fs::remove_dir_all(&fresh).map_err(|e| cannot(&fresh, &e))?;
    }
    let data = fresh.join("data").display().to_string();
    environment.cargo("gallery", &example("gallery", &[&data]), &[])?;
    copy(&root.join("docs/gallery"), &fresh)?;
    let plots = root.join("target/report/plots");
    if plots.is_dir() {
        copy(&plots, &fresh.join("report/plots"))?;
    }
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(|e| cannot(&folder, &e))?;
    }
    fs::rename(&fresh, &folder).map_err(|e| cannot(&folder, &e))?;
    println!("the gallery is in {}", folder.display());
    Ok(folder)
}

/// Copies a folder, but for the page's test.
fn copy(from: &Path, to: &Path) -> Result<(), Failure> {
    fs::create_dir_all(to).map_err(|e| cannot(to, &e))?;
    let entries = fs::read_dir(from).map_err(|e| cannot(from, &e))?;
    for entry in entries.flatten() {
        let (path, target) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &target)?;
        } else if entry.file_name() != "test.mjs" {
            fs::copy(&path, &target).map_err(|e| cannot(&target, &e))?;
        }
    }
    Ok(())
}

/// Serves the folder on this machine alone, until it is stopped.
///
/// # Errors
/// If the port is taken.
pub fn serve(folder: &Path, port: u16) -> Result<(), Failure> {
    let server = Server::http(("127.0.0.1", port)).map_err(|e| {
        Failure::Setup(format!(
            "cannot listen on port {port}: {e}; `--port` takes another one"
        ))
    })?;
    println!("http://127.0.0.1:{port}/ (stop with Ctrl-C)");
    for request in server.incoming_requests() {
        let answered = match file(folder, request.url()) {
            Ok((file, kind)) => request.respond(Response::from_file(file).with_header(kind)),
            Err(_) => request.respond(Response::from_string("not here").with_status_code(404)),
        };
        if let Err(error) = answered {
            eprintln!("a request was not answered: {error}");
        }
    }
    Ok(())
}

/// The file that a URL asks for, and what it is. Nothing outside the folder.
fn file(folder: &Path, url: &str) -> Result<(fs::File, Header), Error> {
    let path = url.split(['?', '#']).next().unwrap_or_default();
    let path = match path.trim_start_matches('/') {
        "" => "index.html",
        path => path,
    };
    let whole = folder.join(path).canonicalize()?;
    if !whole.starts_with(folder.canonicalize()?) || !whole.is_file() {
        return Err(std::io::ErrorKind::NotFound.into());
    }
    let kind = match whole.extension().and_then(|e| e.to_str()) {
        Some("html") => "text/html; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("mjs") => "text/javascript; charset=utf-8",
        Some("json") => "application/json",
        Some("svg") => "image/svg+xml",
        Some("png") => "image/png",
        _ => "text/plain; charset=utf-8",
    };
    let header = Header::from_bytes("Content-Type", kind);
    Ok((
        fs::File::open(whole)?,
        header.map_err(|()| Error::other("a header"))?,
    ))
}

/// The page in headless Chromium, with screenshots in `target/gallery-shots`.
///
/// # Errors
/// If a step does not run.
pub fn test(root: &Path, environment: &Environment, tests: &mut Tests) -> Result<(), Failure> {
    let Some(browser) = Browser::ready(root, tests)? else {
        return Ok(());
    };
    let folder = build(root, environment)?;
    let script = root.join("target/web/node/gallery.mjs");
    let source = root.join("docs/gallery/test.mjs");
    fs::copy(&source, &script).map_err(|e| cannot(&source, &e))?;
    let shots = root.join("target/gallery-shots");
    browser.node("gallery.mjs", &[&folder, &browser.chromium, &shots], tests)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn serves_what_is_in_the_folder_and_nothing_else() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let folder = root.join("src");
        assert!(file(&folder, "/gallery.rs?x=1").is_ok());
        for url in ["/../Cargo.toml", "/none.html", "/", "//etc/passwd"] {
            assert!(file(&folder, url).is_err(), "{url}");
        }
    }
}
