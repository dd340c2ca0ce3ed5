//! What `--only` chooses from.

use super::error::ReportError;

/// A filter by substring over the names of everything that is measured.
#[derive(Clone, Debug, Default)]
pub(super) struct Only(Option<String>);

impl Only {
    /// Checks the filter against all names.
    ///
    /// # Errors
    /// If it matches none.
    pub fn new(wanted: Option<&str>, all: &[String]) -> Result<Self, ReportError> {
        let Some(wanted) = wanted else {
            return Ok(Self(None));
        };
        let only = Self(Some(wanted.to_lowercase()));
        if all.iter().any(|name| only.takes(name)) {
            return Ok(only);
        }
        // A few from each kind: the first of each head.
        let mut some: Vec<&str> = Vec::new();
        let mut heads: Vec<&str> = Vec::new();
        for name in all {
            let head = name.split('/').next().unwrap_or_default();
            if !heads.contains(&head) {
                heads.push(head);
                some.push(name);
            }
        }
        Err(ReportError::Nothing {
            wanted: wanted.into(),
            some: some.join(", "),
        })
    }

    /// Whether a name is to be measured.
    pub fn takes(&self, name: &str) -> bool {
        self.0
            .as_ref()
            .is_none_or(|wanted| name.to_lowercase().contains(wanted))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filter() {
        let all = ["math/trig::sincos_turn", "bvh/kitchen", "bvh/toy"].map(String::from);
        let only = Only::new(Some("BVH/k"), &all).unwrap();
        assert!(only.takes("bvh/kitchen") && !only.takes("bvh/toy"));
        assert!(Only::new(None, &all).unwrap().takes("anything"));
        let error = Only::new(Some("nothing"), &all).unwrap_err().to_string();
        assert!(error.contains("nothing") && error.contains("math/trig::sincos_turn"));
        assert!(error.contains("bvh/kitchen") && !error.contains("bvh/toy"));
    }
}
