//! The names and signatures that programs build on, as they stand in a file: whoever changes one sees it in the change.
//!
//! `SQUALL_UPDATE=1 cargo test --release -p squall-tests public_api` writes the files anew.

use quote::ToTokens;
use std::path::{Path, PathBuf};
use syn::{Fields, ImplItem, Item, TraitItem, Visibility};

/// Crates that other programs link: where each one's source and its list lie.
const CRATES: [(&str, &str); 3] =
    [("squall_formats", "formats"), ("squall_transport", "runtime/transport"), ("squall_runtime", "runtime")];

#[test]
fn public_names_and_signatures_are_those_that_were_agreed_on() {
    for (name, folder) in CRATES {
        let mut found = Vec::new();
        let source = crate::root().join(folder).join("src");
        list_file(&source.join("lib.rs"), &source, name, &mut found);
        assert!(found.len() > 20, "{name}: only {} names were found", found.len());
        found.sort();
        let found = found.join("\n") + "\n";
        let file = crate::root().join("tests/snapshots").join(format!("{name}.txt"));
        if std::env::var_os("SQUALL_UPDATE").is_some() {
            std::fs::write(&file, &found).unwrap();
        }
        let known = std::fs::read_to_string(&file).unwrap();
        let gone = known.lines().filter(|line| !found.lines().any(|other| other == *line));
        let new = found.lines().filter(|line| !known.lines().any(|other| other == *line));
        let differences: Vec<String> =
            gone.map(|line| format!("- {line}")).chain(new.map(|line| format!("+ {line}"))).collect();
        assert!(
            differences.is_empty(),
            "the public names changed; if that is meant, say so in CHANGELOG.md and run this test with SQUALL_UPDATE=1:\n{}",
            differences.join("\n")
        );
    }
}

fn list_file(file: &Path, folder: &Path, path: &str, out: &mut Vec<String>) {
    let text = std::fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let parsed = syn::parse_file(&text).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    list_items(&parsed.items, folder, path, out);
}

fn list_items(items: &[Item], folder: &Path, path: &str, out: &mut Vec<String>) {
    for item in items {
        match item {
            Item::Mod(module) if public(&module.vis) => {
                let name = module.ident.to_string();
                let (inner, path) = (folder.join(&name), format!("{path}::{name}"));
                match &module.content {
                    Some((_, items)) => list_items(items, &inner, &path, out),
                    None => list_file(&file_of(folder, &name), &inner, &path, out),
                }
            }
            Item::Impl(block) if block.trait_.is_none() => list_methods(block, path, out),
            Item::Trait(block) if public(&block.vis) => {
                out.push(format!("{path}::trait {}", block.ident));
                for item in &block.items {
                    if let TraitItem::Fn(method) = item {
                        out.push(format!("{path}::{}::{}", block.ident, tokens(&method.sig)));
                    }
                }
            }
            other => list_item(other, path, out),
        }
    }
}

/// A module's file, and beside it the folder of its own modules.
fn file_of(folder: &Path, name: &str) -> PathBuf {
    let beside = folder.join(format!("{name}.rs"));
    if beside.exists() { beside } else { folder.join(name).join("mod.rs") }
}

fn list_item(item: &Item, path: &str, out: &mut Vec<String>) {
    let line = match item {
        Item::Fn(item) if public(&item.vis) => tokens(&item.sig),
        Item::Const(item) if public(&item.vis) => format!("const {}: {}", item.ident, tokens(&item.ty)),
        Item::Type(item) if public(&item.vis) => format!("type {} = {}", item.ident, tokens(&item.ty)),
        Item::Use(item) if public(&item.vis) => tokens(&item.tree),
        Item::Struct(item) if public(&item.vis) => {
            list_fields(&item.fields, &format!("{path}::{}", item.ident), true, out);
            format!("struct {}{}", item.ident, tokens(&item.generics))
        }
        Item::Enum(item) if public(&item.vis) => {
            for variant in &item.variants {
                let name = format!("{path}::{}::{}", item.ident, variant.ident);
                list_fields(&variant.fields, &name, false, out);
                out.push(name);
            }
            let open = item.attrs.iter().any(|attribute| attribute.path().is_ident("non_exhaustive"));
            format!("enum {}{}", item.ident, if open { " (more may come)" } else { "" })
        }
        _ => return,
    };
    out.push(format!("{path}::{line}"));
}

/// Fields of a type; those of an enum's variants are always public.
fn list_fields(fields: &Fields, name: &str, marked: bool, out: &mut Vec<String>) {
    for (number, field) in fields.iter().enumerate() {
        if !marked || public(&field.vis) {
            let field_name = field.ident.as_ref().map_or(number.to_string(), ToString::to_string);
            out.push(format!("{name}.{field_name}: {}", tokens(&field.ty)));
        }
    }
}

fn list_methods(block: &syn::ItemImpl, path: &str, out: &mut Vec<String>) {
    let owner = tokens(&block.self_ty);
    for item in &block.items {
        match item {
            ImplItem::Fn(method) if public(&method.vis) => {
                out.push(format!("{path}::{owner}::{}", tokens(&method.sig)));
            }
            ImplItem::Const(item) if public(&item.vis) => {
                out.push(format!("{path}::{owner}::const {}: {}", item.ident, tokens(&item.ty)));
            }
            _ => {}
        }
    }
}

fn public(visibility: &Visibility) -> bool {
    matches!(visibility, Visibility::Public(_))
}

fn tokens(part: &impl ToTokens) -> String {
    part.to_token_stream().to_string()
}
