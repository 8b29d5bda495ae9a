//! `squall diff A B [--json]`
use super::asset;
use super::table::{self, Column};
use squall_bake::BakeError;
use squall_bake::diff::{Difference, ValueChange, diff};
use std::fmt::Write;
use std::path::PathBuf;

/// Says what changed between two assets; exits 1 where they differ.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// The asset that is looked at.
    a: PathBuf,
    /// The asset that it is measured against.
    b: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        self.json
    }
}

pub fn run(args: Args) -> anyhow::Result<()> {
    let [a, b] = [asset::open(&args.a)?, asset::open(&args.b)?];
    let found = diff(&a, &b)?;
    if args.json {
        table::print(&(serde_json::to_string_pretty(&found)? + "\n"))?;
    } else {
        table::print(&in_words(&found))?;
    }
    if found.identical {
        return Ok(());
    }
    let what = match found.sections.len() {
        0 => "their section tables differ".to_owned(),
        1 => "1 section differs".to_owned(),
        count => format!("{count} sections differ"),
    };
    Err(BakeError::Different { a: args.a, b: args.b, what }.into())
}

fn in_words(found: &Difference) -> String {
    if found.identical {
        return "the same bytes\n".into();
    }
    let mut text = String::new();
    let mut add = |heading: [&'static str; 3], rows: Vec<Vec<String>>| {
        if !rows.is_empty() {
            let gap = if text.is_empty() { "" } else { "\n" };
            let columns = heading.map(Column::left);
            let _ = write!(text, "{gap}{}", table::layout(&columns, &rows));
        }
    };
    let length = |bytes: Option<u64>| bytes.map_or("–".into(), table::bytes);
    let sections = found.sections.iter();
    let sections = sections.map(|s| vec![s.tag.clone(), length(s.bytes[0]), length(s.bytes[1])]);
    add(["section", "bytes in A", "bytes in B"], sections.collect());
    let value = |value: &Option<String>| value.as_deref().map_or("–".into(), table::plain);
    let row = |c: &ValueChange| vec![table::plain(&c.name), value(&c.a), value(&c.b)];
    add(["made from", "A", "B"], found.provenance.iter().map(row).collect());
    add(["budget", "A", "B"], found.budgets.iter().map(row).collect());
    let distance = |p: &squall_bake::diff::PartDistance| {
        vec![p.part.clone(), table::plain(&p.metric), p.value.map_or("–".into(), table::figure)]
    };
    add(["part", "distance of A from B", "value"], found.parts.iter().map(distance).collect());
    text
}
