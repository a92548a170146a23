//! A module may use only modules declared above it in `lib.rs`.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use syn::visit::{self, Visit};

/// The modules of the crate that a file names.
struct Uses {
    /// Names from the root of the crate to the module that is being read.
    place: Vec<String>,
    found: BTreeSet<String>,
}

impl Uses {
    /// Notes the module at the root that a path leads to, if it leaves the module that it stands in.
    fn take(&mut self, path: &[String]) {
        let up = path.iter().take_while(|name| *name == "super").count();
        let rest = match path.first().map(String::as_str) {
            Some("crate") => &path[1..],
            Some("super") if up == self.place.len() => &path[up..],
            _ => return,
        };
        self.found.extend(rest.first().cloned());
    }

    /// All paths of a tree of uses.
    fn take_tree(&mut self, before: &[String], tree: &syn::UseTree) {
        let with = |name: &syn::Ident| [before, &[name.to_string()]].concat();
        match tree {
            syn::UseTree::Path(path) => self.take_tree(&with(&path.ident), &path.tree),
            syn::UseTree::Name(name) => self.take(&with(&name.ident)),
            syn::UseTree::Rename(name) => self.take(&with(&name.ident)),
            syn::UseTree::Glob(_) => self.take(before),
            syn::UseTree::Group(group) => {
                group.items.iter().for_each(|tree| self.take_tree(before, tree));
            }
        }
    }
}

impl<'ast> Visit<'ast> for Uses {
    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        self.take_tree(&[], &item.tree);
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let names: Vec<String> = path.segments.iter().map(|s| s.ident.to_string()).collect();
        self.take(&names);
        visit::visit_path(self, path);
    }

    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        self.place.push(module.ident.to_string());
        visit::visit_item_mod(self, module);
        self.place.pop();
    }

    /// What is handed to a macro is no syntax yet: it must not hide a path.
    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        let tokens = call.tokens.to_string();
        let paths = tokens.split("crate ::").skip(1);
        self.found.extend(paths.filter_map(|after| {
            let name =
                after.trim_start().split(|c: char| !c.is_alphanumeric() && c != '_').next()?;
            Some(name.to_owned())
        }));
    }
}

/// What a file, or all files of a folder, use; `place` is the module that it is.
fn uses(path: &Path, place: &[String]) -> BTreeSet<String> {
    if path.is_dir() {
        let entries = fs::read_dir(path).expect("module folder");
        let paths = entries.map(|entry| entry.expect("folder entry").path());
        let of = |path: std::path::PathBuf| {
            let stem = path.file_stem().expect("a name").to_string_lossy().into_owned();
            let is_root = stem == "mod";
            uses(&path, &[place, if is_root { &[] } else { core::slice::from_ref(&stem) }].concat())
        };
        return paths.flat_map(of).collect();
    }
    let text = fs::read_to_string(path).expect("module file");
    let file = syn::parse_file(&text).expect("Rust source");
    let mut uses = Uses { place: place.to_vec(), found: BTreeSet::new() };
    uses.visit_file(&file);
    uses.found
}

#[test]
fn modules_use_only_modules_above_them() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let lib = syn::parse_file(&fs::read_to_string(src.join("lib.rs")).expect("lib.rs"));
    let order: Vec<String> = lib
        .expect("Rust source")
        .items
        .iter()
        .filter_map(|item| match item {
            syn::Item::Mod(module) => Some(module.ident.to_string()),
            _ => None,
        })
        .collect();
    assert!(order.len() >= 5, "lib.rs declares the modules");

    for (position, module) in order.iter().enumerate() {
        let place = [module.clone()];
        let parts = [src.join(format!("{module}.rs")), src.join(module)];
        let used: BTreeSet<String> =
            parts.iter().filter(|part| part.exists()).flat_map(|part| uses(part, &place)).collect();
        for name in used {
            let found = order.iter().position(|other| *other == name);
            let found = found.unwrap_or_else(|| panic!("{module} uses {name}, which is no module"));
            assert!(found <= position, "{module} uses {name}, which stands below it");
        }
    }
}

/// The test itself: what it takes for a use, and what it does not.
#[test]
fn uses_are_found_in_every_form() {
    let of = |text: &str| {
        let file = syn::parse_file(text).expect("Rust source");
        let mut uses = Uses { place: vec!["engine".into(), "fix".into()], found: BTreeSet::new() };
        uses.visit_file(&file);
        uses.found.into_iter().collect::<Vec<_>>().join(" ")
    };
    assert_eq!(of("use crate::{sky::{self, Horizon}, time as t, signal::*};"), "signal sky time");
    assert_eq!(
        of("use super::row; fn f() { super::super::point::solve(); super::fix(); }"),
        "point"
    );
    assert_eq!(
        of("fn f() -> crate::frames::Body { assert!(crate::array::new()); }"),
        "array frames"
    );
    assert_eq!(of("mod tests { use super::super::super::baseline::B; use super::x; }"), "baseline");
    assert_eq!(of("//! crate::engine\n/// [`crate::trajectory`]\nfn f() { sky::at(); }"), "");
}
