//! The same text for other module systems.

use super::{Module, linked};

impl Module {
    /// Names that the module declares, in order: functions, constants,
    /// structures, aliases. All begin with the technique's name, so they are
    /// unique.
    ///
    /// ```
    /// let names = raytwin_wgsl::module("sample/cone").unwrap().declares();
    /// assert!(names.contains(&"cone_sample") && names.contains(&"cone_pdf"));
    /// ```
    #[must_use]
    pub fn declares(&self) -> Vec<&'static str> {
        declared(self.source)
    }

    /// What the module takes from each of the modules that it requires (itself,
    /// or through another one): the module and the names.
    ///
    /// ```
    /// let imports = raytwin_wgsl::module("sample/cone").unwrap().imports();
    /// let (module, names) = &imports[0];
    /// assert_eq!((module.name, names.len()), ("math/trig", 2));
    /// ```
    #[must_use]
    pub fn imports(&self) -> Vec<(&'static Module, Vec<&'static str>)> {
        self.taken(self.source)
    }

    /// The name under which other module systems import it:
    /// `raytwin::sample::cone`.
    ///
    /// ```
    /// let module = raytwin_wgsl::module("temporal/taa").unwrap();
    /// assert_eq!(module.import_path(), "raytwin::temporal::taa");
    /// ```
    #[must_use]
    pub fn import_path(&self) -> String {
        format!("raytwin::{}", self.name.replace('/', "::"))
    }

    /// The module for naga_oil's composer: the plain text under the `#import`s
    /// that it needs. Add those of [`linked`] in order, each with
    /// [`Self::import_path`] as `as_name`.
    ///
    /// A module that calls back comes with its ready bindings: naga_oil knows no
    /// function that the importing program defines.
    ///
    /// ```
    /// let module = raytwin_wgsl::module("sample/cone").unwrap();
    /// let text = module.naga_oil();
    /// assert!(text.starts_with("#import raytwin::math::trig::{sincos_turn, atan2_turn}\n"));
    /// assert_eq!(module.import_path(), "raytwin::sample::cone");
    /// ```
    #[must_use]
    pub fn naga_oil(&self) -> String {
        self.importing("#import ", "\n")
    }

    /// The module for WESL, and so for Bevy from 0.20 on: the plain text under
    /// the `import`s that it needs. A module that calls back comes with its
    /// ready bindings.
    ///
    /// ```
    /// let text = raytwin_wgsl::module("sample/cone").unwrap().wesl();
    /// assert!(text.starts_with("import raytwin::math::trig::{sincos_turn, atan2_turn};\n"));
    /// ```
    #[must_use]
    pub fn wesl(&self) -> String {
        self.importing("import ", ";\n")
    }

    fn importing(&self, head: &str, tail: &str) -> String {
        let text = without_aliases(&self.whole());
        let mut out = String::new();
        for (module, names) in self.taken(&text) {
            let path = module.import_path();
            out += &format!("{head}{path}::{{{}}}{tail}", names.join(", "));
        }
        out + &text
    }

    /// With its bindings.
    fn whole(&self) -> String {
        self.source.to_owned() + self.bindings.unwrap_or_default()
    }

    fn taken(&self, text: &str) -> Vec<(&'static Module, Vec<&'static str>)> {
        let used: Vec<&str> = words(text).collect();
        // A registered module's requirements are registered.
        let needed = linked(&[self.name]).unwrap_or_default();
        needed
            .into_iter()
            .filter(|m| m.name != self.name)
            .map(|m| {
                let mut names = declared(m.source);
                names.extend(declared(m.bindings.unwrap_or_default()));
                names.retain(|n| used.contains(n));
                (m, names)
            })
            .filter(|(_, names): &(_, Vec<_>)| !names.is_empty())
            .collect()
    }
}

/// Identifiers and keywords of a text, comments left out.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.lines()
        .map(|line| line.split_once("//").map_or(line, |l| l.0))
        .flat_map(|line| line.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_')))
        .filter(|word| word.starts_with(|c: char| c.is_ascii_alphabetic()))
}

/// The text with the types that its aliases stand for: naga keeps no alias, and
/// naga_oil cannot rename one.
fn without_aliases(text: &str) -> String {
    let aliases: Vec<(&str, &str)> = text
        .lines()
        .filter_map(|line| {
            line.strip_prefix("alias ")?
                .strip_suffix(';')?
                .split_once(" = ")
        })
        .collect();
    let mut out = String::new();
    for line in text.lines().filter(|line| !line.starts_with("alias ")) {
        let mut rest = line;
        while let Some(start) = rest.find(|c: char| c.is_ascii_alphabetic()) {
            let word = rest[start..].split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
            let word = word.into_iter().next().unwrap_or_default();
            let alias = aliases.iter().find(|a| a.0 == word);
            out += &rest[..start];
            out += alias.map_or(word, |a| a.1);
            rest = &rest[start + word.len()..];
        }
        out += rest;
        out.push('\n');
    }
    out
}

/// Names declared by lines that begin with a keyword: in these files all
/// declarations do, and nothing else does.
fn declared(text: &'static str) -> Vec<&'static str> {
    text.lines()
        .filter_map(|line| {
            // What is bound comes after its place and its kind.
            let line = match line.strip_prefix("@group") {
                Some(place) => place.split_once(" var")?.1,
                None => line,
            };
            if let Some(kind) = line.strip_prefix("var").or(line.strip_prefix('<')) {
                let name = kind.split_once("> ").map_or(kind, |k| k.1);
                return words(name).next();
            }
            let keyword = line.split(' ').next()?;
            let known = ["fn", "const", "struct", "alias"].contains(&keyword);
            words(line).nth(1).filter(|_| known)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use crate::{MODULES, module};

    #[test]
    fn names_and_what_is_taken() {
        let trig = module("math/trig").unwrap();
        assert!(trig.declares().contains(&"sincos_turn"));
        let cone = module("sample/cone").unwrap();
        let taken = cone.imports();
        assert_eq!(taken.len(), 1);
        assert_eq!(
            (taken[0].0.name, &taken[0].1[..]),
            ("math/trig", &["sincos_turn", "atan2_turn"][..])
        );
    }

    #[test]
    fn every_declaration_is_found_once() {
        let mut seen = Vec::new();
        for m in MODULES {
            for name in m.declares() {
                assert!(!seen.contains(&name), "{name} is declared twice");
                seen.push(name);
            }
        }
        assert!(seen.len() > 500);
    }
}
