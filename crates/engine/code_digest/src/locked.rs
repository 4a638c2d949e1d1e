//! The locked versions of a crate's dependencies.

use std::collections::{BTreeMap, BTreeSet};

use blake3::Hasher;
use toml_edit::{DocumentMut, Item};

use crate::member::short;

/// The packages of a `Cargo.lock`.
#[derive(Debug)]
pub(crate) struct Lock {
    /// `name version checksum` and the dependencies' keys, by `name version`.
    packages: BTreeMap<(String, String), Package>,
}

#[derive(Debug)]
struct Package {
    checksum: String,
    dependencies: Vec<String>,
}

impl Lock {
    pub(crate) fn parse(document: &DocumentMut) -> Self {
        let mut packages = BTreeMap::new();
        let tables = document.get("package").and_then(Item::as_array_of_tables);
        for table in tables.into_iter().flatten() {
            let text = |key: &str| {
                let value = table.get(key).and_then(Item::as_str);
                value.unwrap_or_default().to_owned()
            };
            let dependencies = table
                .get("dependencies")
                .and_then(Item::as_array)
                .into_iter()
                .flatten()
                .filter_map(|value| value.as_str().map(str::to_owned))
                .collect();
            packages.insert(
                (text("name"), text("version")),
                Package {
                    checksum: text("checksum"),
                    dependencies,
                },
            );
        }
        Self { packages }
    }

    /// Digests the versions and checksums of these packages and of all that they depend on.
    pub(crate) fn digest(&self, roots: &BTreeSet<String>) -> String {
        let mut open: Vec<&str> = roots.iter().map(String::as_str).collect();
        let mut closure = BTreeSet::new();
        while let Some(reference) = open.pop() {
            for key in self.resolve(reference) {
                if closure.insert(key)
                    && let Some(package) = self.packages.get(key)
                {
                    open.extend(package.dependencies.iter().map(String::as_str));
                }
            }
        }
        let mut hasher = Hasher::new();
        for key in closure {
            let checksum = self
                .packages
                .get(key)
                .map_or("", |package| &package.checksum);
            hasher.update(format!("{} {} {checksum}\n", key.0, key.1).as_bytes());
        }
        short(&hasher)
    }

    /// Finds the packages that `name` or `name version` refers to: a bare name of several locked
    /// versions means all of them.
    fn resolve(&self, reference: &str) -> Vec<&(String, String)> {
        let mut words = reference.split(' ');
        let name = words.next().unwrap_or_default();
        let version = words.next();
        self.packages
            .keys()
            .filter(|key| key.0 == name && version.is_none_or(|version| key.1 == version))
            .collect()
    }
}
