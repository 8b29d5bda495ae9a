//! Dependency files for Make and Ninja: one rule, in the escapes that both read.

use squall_bake::BakeError;
use std::path::Path;

/// The rule `asset: inputs`.
///
/// Errors: a name that such a file cannot hold: a line break, no UTF-8, a backslash at its end.
pub fn rule<'a>(asset: &'a Path, inputs: impl Iterator<Item = &'a Path>) -> Result<String, BakeError> {
    let mut text = escaped(asset)? + ":";
    let mut seen = Vec::new();
    for input in inputs {
        // Make warns of names that stand twice.
        if !seen.contains(&input) {
            text = text + " \\\n  " + &escaped(input)?;
            seen.push(input);
        }
    }
    Ok(text + "\n")
}

/// A name as Make and Ninja read it back: spaces and `#` behind a backslash, backslashes before those doubled, `$` doubled.
fn escaped(path: &Path) -> Result<String, BakeError> {
    let refused = |found: &str| Err(BakeError::input(path, "--depfile", "a name that Make can read", found));
    let Some(name) = path.to_str() else { return refused("no UTF-8") };
    if name.contains(['\n', '\r']) {
        return refused("a line break");
    }
    if name.ends_with('\\') {
        return refused("a backslash at its end");
    }
    let (mut text, mut backslashes) = (String::with_capacity(name.len() + 8), 0);
    for c in name.chars() {
        match c {
            ' ' | '\t' | '#' => {
                text.extend(std::iter::repeat_n('\\', backslashes + 1));
            }
            '$' => text.push('$'),
            _ => {}
        }
        backslashes = if c == '\\' { backslashes + 1 } else { 0 };
        text.push(c);
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_escaped_as_make_and_ninja_read_them() {
        let wanted = [
            ("storm.toml", "storm.toml"),
            ("a b.toml", "a\\ b.toml"),
            ("a#b", "a\\#b"),
            ("a$b", "a$$b"),
            ("a\\b", "a\\b"),
            ("a\\ b", "a\\\\\\ b"),
            ("ä.toml", "ä.toml"),
        ];
        for (name, text) in wanted {
            assert_eq!(escaped(Path::new(name)).unwrap(), text);
        }
        for name in ["a\nb", "a\rb", "a\\"] {
            assert!(escaped(Path::new(name)).is_err(), "{name:?}");
        }
    }

    #[test]
    fn a_rule_names_the_asset_once_and_every_input_once() {
        let inputs = ["r.toml", "c d.f32", "r.toml"].map(Path::new);
        let rule = rule(Path::new("out.squall"), inputs.into_iter()).unwrap();
        assert_eq!(rule, "out.squall: \\\n  r.toml \\\n  c\\ d.f32\n");
    }
}
