//! What an asset is made from: the tool, the recipe and every input, with hashes; and whether an asset still is what those make.

use crate::error::BakeError;
use crate::input::Fingerprint;
use crate::recipe::Recipe;
use squall_formats::section::provenance::{InputRecord, ProvenanceSection};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Name and version of this tool, as assets keep it.
pub fn tool() -> String {
    format!("squall {}", env!("CARGO_PKG_VERSION"))
}

/// BLAKE3 of the recipe's text.
pub fn recipe_hash(recipe: &Recipe) -> [u8; 32] {
    *blake3::hash(recipe.text.as_bytes()).as_bytes()
}

/// A file, as it was when it was read, under the name that the recipe gives it.
pub fn input_record(recipe: &Recipe, input: &Fingerprint) -> InputRecord {
    let folder = recipe.file.parent().unwrap_or(Path::new(""));
    let name = input.path.strip_prefix(folder).unwrap_or(&input.path).display().to_string();
    InputRecord { name, bytes: input.bytes, hash: input.hash }
}

/// Every file that the recipe names, as it is now; the recipe itself is not among them.
///
/// Errors: a file that cannot be read, a pipe or a device, which cannot be read twice.
pub fn input_records(recipe: &Recipe) -> Result<Vec<InputRecord>, BakeError> {
    let files = recipe.inputs()?;
    let named = files.iter().filter(|path| **path != recipe.file);
    named.map(|path| Ok(input_record(recipe, &fingerprint(path)?))).collect()
}

/// A file's length and hash, without keeping its bytes. Errors: a file that cannot be read, a folder, a pipe or a device.
pub fn fingerprint(path: &Path) -> Result<Fingerprint, BakeError> {
    let mut file = File::open(path).map_err(BakeError::io(path, "open"))?;
    if !file.metadata().map_err(BakeError::io(path, "read"))?.is_file() {
        return Err(BakeError::input(
            path,
            "input",
            "a file, which can be read twice",
            "a folder, pipe or device",
        ));
    }
    let (mut hasher, mut buffer, mut bytes) = (blake3::Hasher::new(), vec![0; 1 << 20], 0);
    loop {
        let read = file.read(&mut buffer).map_err(BakeError::io(path, "read"))?;
        if read == 0 {
            break;
        }
        hasher.update(&buffer[..read]);
        bytes += read as u64;
    }
    Ok(Fingerprint { path: path.to_owned(), bytes, hash: *hasher.finalize().as_bytes() })
}

/// In what the asset that has this provenance differs from what a bake would read now, in words; nothing where it does not, so that a
/// bake would give the same bytes.
///
/// Errors: as [`input_records`].
pub fn changes(recipe: &Recipe, asset: &ProvenanceSection) -> Result<Vec<String>, BakeError> {
    let mut found = Vec::new();
    if asset.tool != tool() {
        found.push(format!("it was baked by {}, this is {}", asset.tool, tool()));
    }
    if asset.recipe_hash != recipe_hash(recipe) {
        found.push(format!("{} has changed", recipe.file.display()));
    }
    let by_name = |records: &[InputRecord]| -> BTreeMap<String, (u64, [u8; 32])> {
        records.iter().map(|record| (record.name.clone(), (record.bytes, record.hash))).collect()
    };
    let (before, now) = (by_name(&asset.inputs), by_name(&input_records(recipe)?));
    for (name, content) in &now {
        match before.get(name) {
            Some(known) if known == content => {}
            Some(_) => found.push(format!("{name} has changed")),
            None => found.push(format!("{name} is new")),
        }
    }
    let gone = before.keys().filter(|name| !now.contains_key(*name));
    found.extend(gone.map(|name| format!("{name} is an input no longer")));
    Ok(found)
}
