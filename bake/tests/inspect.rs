//! `squall inspect` and `squall verify` from outside: words, keys, exit codes.

use assert_cmd::Command;
use serde_json::Value;
use squall_bake::recipe::Recipe;
use squall_bake::{pipeline, progress::Quiet};
use squall_formats::Tag;
use squall_formats::container::{Directory, OutSection, checksum, write};
use squall_formats::section::bolt::BoltSection;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

fn recipe() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.toml")
}

/// A small asset with a section of every kind that the golden recipe has.
fn baked() -> &'static [OutSection] {
    static BAKED: OnceLock<Vec<OutSection>> = OnceLock::new();
    BAKED.get_or_init(|| pipeline::bake(&Recipe::read(&recipe()).unwrap(), &Quiet).unwrap().sections)
}

fn asset(sections: &[OutSection]) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut bytes, sections).unwrap();
    bytes
}

/// Exit code, standard output and standard error of `squall COMMAND ASSET`.
fn squall(command: &str, asset: &[u8]) -> (i32, String, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("storm.squall");
    std::fs::write(&path, asset).unwrap();
    run(command, &path)
}

fn run(command: &str, path: &Path) -> (i32, String, String) {
    let mut words = command.split(' ');
    let mut call = Command::cargo_bin("squall").unwrap();
    let output = call.arg(words.next().unwrap()).arg(path).args(words).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

fn keys(value: &Value) -> Vec<&str> {
    let mut keys: Vec<&str> = value.as_object().unwrap().keys().map(String::as_str).collect();
    keys.sort_unstable();
    keys
}

#[test]
fn inspect_prints_json_with_the_promised_keys_and_what_the_file_holds() {
    let bytes = asset(baked());
    let (code, out, error) = squall("inspect --json", &bytes);
    assert_eq!((code, error.as_str()), (0, ""));
    let json: Value = serde_json::from_str(&out).unwrap();
    let wanted =
        "budgets bytes command format_version grid inputs recipe_hash response sections strokes tool view";
    assert_eq!(keys(&json), wanted.split(' ').collect::<Vec<_>>());
    assert_eq!((&json["format_version"], &json["bytes"]), (&1.into(), &bytes.len().into()));
    let recipe = std::fs::read(recipe()).unwrap();
    assert_eq!(json["recipe_hash"], blake3::hash(&recipe).to_hex().as_str());

    let sections = json["sections"].as_array().unwrap();
    assert_eq!(sections.len(), baked().len());
    for (section, out) in sections.iter().zip(baked()) {
        assert_eq!(keys(section), ["bytes", "checksum", "offset", "required", "tag", "version"]);
        assert_eq!(section["tag"], out.tag.to_string());
        assert_eq!(section["version"], out.version);
        assert_eq!(section["required"], out.required);
        assert_eq!(section["bytes"], out.length());
        assert_eq!(section["checksum"], format!("{:08x}", checksum(&out.to_bytes())));
        let at = section["offset"].as_u64().unwrap() as usize;
        assert_eq!(bytes[at..at + out.length() as usize], out.to_bytes());
    }
    let budgets = json["budgets"].as_array().unwrap();
    assert!(budgets.len() >= 4, "{budgets:?}");
    for budget in budgets {
        let wanted = ["asked", "chosen", "got", "metric", "next_better", "next_cheaper", "part"];
        assert_eq!(keys(budget), wanted);
        assert!(budget["part"].is_string() && budget["got"].is_number(), "{budget}");
    }
    let density = budgets.iter().find(|budget| budget["part"] == "density").unwrap();
    assert!(density["got"].as_f64() <= density["asked"].as_f64(), "{density}");
}

#[test]
fn inspect_says_in_words_what_each_section_holds() {
    let (code, out, error) = squall("inspect", &asset(baked()));
    assert_eq!((code, error.as_str()), (0, ""));
    for words in [
        "9 × 8 × 4 cells of 50 × 40 × 30 m",
        "64 of 4 × 4 × 4 virtual lights (not pruned: the whole box is lit), 3 distant lights, 4 harmonics",
        "2 strokes: inside, ground",
        "from 1 to 50 mm/h, 3 classes",
        "cloud.f32",
        "lightning grid",
        "largest residual",
    ] {
        assert!(out.contains(words), "{words}: {out}");
    }
    for section in baked() {
        let line = out.lines().find(|line| line.starts_with(&section.tag.to_string())).unwrap();
        assert!(!line.contains("unknown"), "{line}");
    }
}

#[test]
fn verify_passes_a_whole_asset_and_names_the_section_that_any_damage_lies_in() {
    let bytes = asset(baked());
    let (code, out, _) = squall("verify", &bytes);
    assert!(code == 0 && out.contains("whole") && out.contains("67 rows"), "{out}");
    for entry in Directory::read(&bytes, &Default::default()).unwrap().entries {
        for at in [0, entry.length / 2, entry.length - 1] {
            let mut spoilt = bytes.clone();
            spoilt[(entry.offset + at) as usize] ^= 0x20;
            let (code, out, error) = squall("verify", &spoilt);
            assert_eq!((code, out.as_str()), (1, ""), "{} byte {at}: {error}", entry.tag);
            assert!(error.contains(&format!("section {}", entry.tag)), "{error}");
            assert_eq!(error.lines().count(), 1, "{error}");
        }
    }
    // The header, the section table, a cut end and an end that is too long.
    for (name, spoilt) in [
        ("header", [&bytes[..20], &[9], &bytes[21..]].concat()),
        ("table", [&bytes[..70], &[9], &bytes[71..]].concat()),
        ("file length", bytes[..bytes.len() - 1].to_vec()),
        ("file length", bytes[..40].to_vec()),
        ("file length", [&bytes[..], &[0]].concat()),
    ] {
        let (code, _, error) = squall("verify", &spoilt);
        assert!(code == 1 && error.contains(name), "{name}: {code} {error}");
    }
}

#[test]
fn a_section_with_a_right_checksum_and_wrong_numbers_does_not_verify() {
    // Each is written anew around spoilt content, so that every checksum is right.
    let spoil = |tag: &[u8; 4], change: fn(&mut OutSection)| {
        let mut sections = baked().to_vec();
        change(sections.iter_mut().find(|section| section.tag == Tag(*tag)).unwrap());
        let (code, _, error) = squall("verify", &asset(&sections));
        assert_eq!(code, 1, "{error}");
        assert!(error.contains(std::str::from_utf8(tag).unwrap()), "{error}");
    };
    spoil(b"CLDG", |section| section.parts[1][..4].copy_from_slice(&f32::NAN.to_le_bytes()));
    spoil(b"CLRT", |section| section.parts[5][..4].copy_from_slice(&[0; 4]));
    spoil(b"CLRT", |section| section.head_length -= 64);
    spoil(b"BOLT", |section| section.parts[0].push(0));
    // A response of another grid than the asset's.
    let mut sections = baked().to_vec();
    sections.retain(|section| section.tag != Tag(*b"CLDG"));
    let (code, _, error) = squall("verify", &asset(&sections));
    assert!(code == 1 && error.contains("CLRT") && error.contains("CLDG"), "{error}");
}

#[test]
fn what_is_no_asset_or_a_newer_one_is_bad_input_to_both() {
    let bytes = asset(baked());
    let mut newer = bytes.clone();
    newer[8] = 2;
    let stranger = OutSection::small(Tag(*b"NEWS"), 1, true, vec![1, 2, 3]);
    let png = [&b"\x89PNG\r\n\x1a\n"[..], &[0; 200]].concat();
    for command in ["verify", "inspect", "inspect --json"] {
        for (words, bytes) in [
            ("an empty file", &b""[..]),
            ("magic", b"\x89SQU"),
            ("magic", &png),
            ("version 2", &newer),
            ("NEWS", &asset(std::slice::from_ref(&stranger))),
        ] {
            let (code, out, error) = squall(command, bytes);
            assert_eq!(code, 3, "{command} {words}: {error}");
            // Without an answer, standard output has nothing but the error where JSON was asked for.
            assert_eq!(out.contains("\"exit_code\": 3"), command.ends_with("--json"), "{out}");
            assert_eq!(out.is_empty(), !command.ends_with("--json"), "{out}");
            assert!(error.contains(words) && error.contains("storm.squall"), "{error}");
            assert_eq!(error.lines().count(), 1, "{error}");
        }
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(run(command, &folder.path().join("none.squall")).0, 3);
        assert_eq!(run(command, folder.path()).0, 3, "a folder");
    }
}

#[test]
fn an_optional_section_of_unknown_kind_is_skipped_by_name() {
    let mut sections = baked().to_vec();
    sections.push(OutSection::small(Tag(*b"NEWS"), 7, false, vec![1, 2, 3]));
    let bytes = asset(&sections);
    let (code, out, _) = squall("verify", &bytes);
    assert!(code == 0 && out.contains("1 of unknown kind"), "{out}");
    let (code, out, _) = squall("inspect", &bytes);
    assert!(code == 0 && out.contains("NEWS") && out.contains("unknown to this build"), "{out}");
}

#[test]
fn inspect_shows_the_rest_of_a_damaged_asset_and_fails() {
    let bytes = asset(baked());
    let directory = Directory::read(&bytes, &Default::default()).unwrap();
    let spoil = |tag: Tag| {
        let mut bytes = bytes.clone();
        bytes[directory.find(tag).unwrap().offset as usize + 9] ^= 1;
        bytes
    };
    let damaged = spoil(Tag(*b"DENS"));
    let (code, out, error) = squall("inspect", &damaged);
    assert_eq!(code, 3);
    assert!(out.contains("cannot be read") && out.contains("9 × 8 × 4 cells"), "{out}");
    assert!(error.contains("DENS"), "{error}");
    // JSON does not speak of the tables of rain, and tells their damage all the same.
    let (code, out, error) = squall("inspect --json", &damaged);
    assert!(code == 3 && error.contains("DENS") && serde_json::from_str::<Value>(&out).is_ok(), "{error}");
    assert_eq!(squall("inspect --json", &spoil(Tag(*b"PROV"))).0, 3);
    let (code, out, _) = squall("inspect --json", &spoil(Tag(*b"VIEW")));
    let json: Value = serde_json::from_str(&out).unwrap();
    assert!(code == 3 && json["view"].is_null() && json["grid"].is_object(), "{json}");
}

#[test]
fn names_out_of_a_file_cannot_steer_the_terminal() {
    let mut sections = baked().to_vec();
    let bolts = sections.iter_mut().find(|section| section.tag == BoltSection::TAG).unwrap();
    let mut read = BoltSection::read(&bolts.to_bytes(), 1, &Default::default()).unwrap();
    read.strokes[0].name = "\u{1b}[2J\u{7}".into();
    *bolts = read.write();
    let (code, out, _) = squall("inspect", &asset(&sections));
    assert_eq!(code, 0);
    assert!(!out.contains('\u{1b}') && out.contains("\\u{1b}[2J"), "{out}");
}
