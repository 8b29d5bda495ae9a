//! The closing table of a bake.

use squall_bake::pipeline::StageReport;
use std::fmt::Write;
use std::sync::atomic::{AtomicBool, Ordering};

/// What each stage made, how long it took, how big it is and how far off; last the whole asset, by its name, bytes and seconds.
pub fn stages(stages: &[StageReport], (asset, bytes): (&str, u64), seconds: f64) -> String {
    let made = stages.iter().map(|s| s.made.chars().count()).max().unwrap_or(0).max(4);
    let mut text = format!("{:<16} {:<made$} {:>9} {:>12}  error\n", "stage", "made", "seconds", "bytes");
    for s in stages {
        let (stage, words) = (s.stage, &s.made);
        let _ = writeln!(text, "{stage:<16} {words:<made$} {:>9.2} {:>12}  {}", s.seconds, s.bytes, s.error);
    }
    let _ = writeln!(text, "{:<16} {asset:<made$} {seconds:>9.2} {bytes:>12}", "whole asset");
    text
}

/// A column of [`layout`].
pub struct Column {
    name: &'static str,
    right: bool,
}

impl Column {
    /// Words.
    pub fn left(name: &'static str) -> Self {
        Self { name, right: false }
    }

    /// Numbers.
    pub fn right(name: &'static str) -> Self {
        Self { name, right: true }
    }
}

/// A table in plain text: every column as wide as its widest cell, two spaces between.
pub fn layout(columns: &[Column], rows: &[Vec<String>]) -> String {
    let widths: Vec<usize> = (0..columns.len())
        .map(|i| {
            let cells = rows.iter().filter_map(|row| row.get(i)).map(|cell| cell.chars().count());
            cells.chain([columns[i].name.chars().count()]).max().unwrap_or(0)
        })
        .collect();
    let heading: Vec<String> = columns.iter().map(|column| column.name.to_owned()).collect();
    let mut text = String::new();
    for row in std::iter::once(&heading).chain(rows) {
        let mut line = String::new();
        for ((cell, column), &width) in row.iter().zip(columns).zip(&widths) {
            let cell = if column.right { format!("{cell:>width$}") } else { format!("{cell:<width$}") };
            line.push_str(&cell);
            line.push_str("  ");
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// A count of bytes with thin groups of three, as in 1 234 567.
pub fn bytes(count: u64) -> String {
    let digits = count.to_string();
    let group = |(i, digit): (usize, char)| {
        let gap = i > 0 && (digits.len() - i).is_multiple_of(3);
        gap.then_some(' ').into_iter().chain([digit])
    };
    digits.chars().enumerate().flat_map(group).collect()
}

/// A measured figure: four decimals, or a power of ten where those would show nothing.
pub fn figure(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        let rounded = format!("{value:.4}");
        return rounded.trim_end_matches('0').trim_end_matches('.').to_owned();
    }
    format!("{value:.3e}")
}

/// Text out of a file, with control characters shown as escapes so that they cannot steer a terminal.
pub fn plain(text: &str) -> String {
    let show = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    text.chars().map(show).collect()
}

static PRINTED: AtomicBool = AtomicBool::new(false);

/// Whether anything went to standard output.
pub fn printed() -> bool {
    PRINTED.load(Ordering::Relaxed)
}

/// Writes to standard output; a reader that has heard enough is no error.
pub fn print(text: &str) -> anyhow::Result<()> {
    use std::io::Write;
    PRINTED.store(true, Ordering::Relaxed);
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_and_figures_are_short() {
        assert_eq!(["0", "999", "1 000", "1 234 567"], [0, 999, 1000, 1_234_567].map(bytes)[..]);
        let figures = [0.0, 0.0123456, 12.5, 1e-7, 2.0e9].map(figure);
        assert_eq!(["0", "0.0123", "12.5", "1.000e-7", "2.000e9"], figures[..]);
    }

    #[test]
    fn columns_line_up_and_control_characters_show() {
        let rows = [vec!["a".into(), "10".into()], vec![plain("b\u{1b}[2J"), "7".into()]];
        let text = layout(&[Column::left("name"), Column::right("n")], &rows);
        assert_eq!(text, "name         n\na           10\nb\\u{1b}[2J   7\n");
    }
}
