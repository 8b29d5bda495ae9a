//! What a bake or a solve will take of memory, told before the work from cells, sources, coefficients and threads, and what there is.
//!
//! Figures are counted from the arrays that the code holds at once, in bytes a cell; measured peaks of resident memory are in
//! docs/transport.md. An estimate is for refusing what cannot fit, with a word what would.

use crate::error::BakeError;
use crate::input::scene::read_scene;
use crate::plan::lights::{Site, in_light_cells};
use crate::plan::sun::usual_sun;
use crate::recipe::model::{Clouds, Recipe};
use crate::response::BATCH;
use squall_formats::section::response::{DirectTerm, Stored};
use squall_formats::sphere::MAX_HARMONICS;
use squall_runtime::transport::Cloud;
use std::path::Path;

/// Bytes of a value.
const VALUE: u64 = size_of::<f32>() as u64;
/// The program itself, its inputs' text, and what the allocator keeps: bytes, whatever the work.
const PROGRAM: u64 = 16 << 20;
/// Vectors of source moments that a solve holds: its seven, the light that it starts from, and direct light's own.
const VECTORS: u64 = 9;
/// Moments of a bake's sources.
const BAKE_MOMENTS: u64 = 4;
/// Directions that direct light is collected towards in a bake.
const DIRECTIONS: u64 = 26;
/// Values per solve cell that prepared grids hold: extinction, its scaled twin, the root of its scattering, the cell's parent.
const PREPARED: u64 = 5;
/// Rows solved before they are gathered.
const GROUP: u64 = 256;
/// Rows that a stroke touches, about.
const ROWS_OF_A_STROKE: u64 = 16;
/// Bytes that a coefficient of a coded row takes, about: most are zero.
const CODED: f64 = 0.25;

/// A number of bytes, and what would bring it down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Bytes that the work takes whatever the number of threads.
    pub shared: u64,
    /// Bytes that every thread takes on top.
    pub thread: u64,
    /// Threads at work at once.
    pub threads: u64,
    /// Cells of the grid.
    pub cells: u64,
}

impl Estimate {
    /// Bytes in all.
    pub fn bytes(&self) -> u64 {
        self.shared.saturating_add(self.thread.saturating_mul(self.threads))
    }

    /// Refuses work that takes more than `limit`; `file` is what has the cells, `remedy` what else would help.
    ///
    /// Errors (exit code 3): too little memory, with the estimate and with what would fit.
    pub fn require(&self, file: &Path, limit: Limit, remedy: &str) -> Result<(), BakeError> {
        if self.bytes() <= limit.bytes {
            return Ok(());
        }
        let room = limit.bytes.saturating_sub(self.shared);
        let fits = match room.checked_div(self.thread) {
            Some(threads) if threads > 0 && self.threads > 1 => format!("--threads {threads} would fit"),
            _ => {
                let a_cell =
                    (self.shared.saturating_add(self.thread)).saturating_sub(PROGRAM) / self.cells.max(1);
                let cells = limit.bytes.saturating_sub(PROGRAM) / a_cell.max(1);
                format!("with one thread a grid of about {cells} cells would fit")
            }
        };
        let found = format!(
            "about {} for {} cells on {} threads; {fits}{remedy}",
            words(self.bytes()),
            self.cells,
            self.threads
        );
        let wanted = format!("at most {} ({})", words(limit.bytes), limit.whence);
        Err(BakeError::input(file, "memory", wanted, found))
    }
}

/// Values of a stored cell in a least-squares fit: its neighbours.
const FIT_VALUES: u64 = 27;

/// Memory of [`crate::cloud::solve_light`], one light: `refine` parts of each of `cells` along each axis, J towards `directions`.
pub fn of_solve(cells: u64, refine: u32, directions: u64) -> Estimate {
    let fine = cells.saturating_mul(u64::from(refine).saturating_pow(3));
    let moments = MAX_HARMONICS as u64;
    // Beside the solver's vectors what it gathers, and direct light towards directions.
    let values = (VECTORS + 1) * moments + PREPARED + 1 + directions;
    let shared =
        PROGRAM.saturating_add(fine.saturating_mul(values * VALUE)).saturating_add(cells * 4 * VALUE);
    Estimate { shared, thread: 0, threads: 1, cells }
}

/// Memory of baking `rows` for the response of a grid of `cells`, solved for in the parts of so many.
fn of_response(clouds: &Clouds, (cells, solved): (u64, u64), rows: u64, threads: u64) -> Estimate {
    let settings = &clouds.response;
    let (lanes, harmonics) = (BATCH as u64, MAX_HARMONICS as u64);
    let coefficients = settings.basis.count() as u64;
    let fine = solved.saturating_mul(u64::from(settings.refine).saturating_pow(3));
    let in_rows = settings.direct == DirectTerm::InRows;
    // A batch: the solver's vectors and what it gathers, a lane a light; direct light of one.
    let of_fine = ((VECTORS - 1) * BAKE_MOMENTS + harmonics) * lanes + BAKE_MOMENTS + 1 + harmonics;
    let towards = if in_rows { DIRECTIONS } else { 0 };
    let of_cell = towards * lanes + harmonics + 3 * coefficients;
    let thread = fine.saturating_mul((of_fine + towards) * VALUE).saturating_add(cells * of_cell * VALUE);
    // A held-out stroke: its truth and its direct part in all directions, and its rows' sum.
    let strokes = u64::from(clouds.held_out_strokes);
    let stroke = cells * (2 * DIRECTIONS + 1 + coefficients) * VALUE;
    // Rows are held as they are coded, as a section and once more as an asset to score.
    // Rows that strokes are split over stay as they were solved until their group of batches is done.
    let held = rows.min(GROUP).min(strokes * ROWS_OF_A_STROKE).saturating_mul(cells * coefficients * VALUE);
    let coded = 3.0 * CODED * rows as f64 * coefficients as f64 * cells as f64;
    // What a solve cell counts for, and the normal matrix.
    let fit = if settings.stored == Stored::Fit { (fine + FIT_VALUES * cells) * VALUE } else { 0 };
    let shared = PROGRAM
        .saturating_add(fine.saturating_mul(PREPARED * VALUE))
        .saturating_add(cells * 2 * VALUE)
        .saturating_add(fit)
        .saturating_add(strokes.saturating_mul(stroke))
        .saturating_add(held)
        .saturating_add(coded as u64);
    let batches = rows.div_ceil(lanes).max(1);
    Estimate { shared, thread, threads: threads.min(batches).min(lanes), cells }
}

/// What [`require_bake`] can tell before the grid's cells are read: whether one batch of sources fits.
///
/// Errors (exit code 3): too little memory.
pub fn require_grid(recipe: &Recipe, limit: Limit) -> Result<(), BakeError> {
    let Some(clouds) = &recipe.clouds else { return Ok(()) };
    let Some(cells) = cells_of(&clouds.scene) else { return Ok(()) };
    of_response(clouds, (cells, cells), 1, 1).require(&clouds.scene, limit, remedy(clouds))
}

fn remedy(clouds: &Clouds) -> &'static str {
    if clouds.response.refine > 1 { ", or a smaller clouds.transport.refine" } else { "" }
}

/// Memory of baking `recipe` on `threads`; none where it has no clouds. Settings that budgets choose count as the recipe's own.
///
/// Errors: too little memory (exit code 3); inputs that are missing or out of range.
pub fn require_bake(recipe: &Recipe, threads: u64, limit: Limit) -> Result<Option<Estimate>, BakeError> {
    let Some(clouds) = &recipe.clouds else { return Ok(None) };
    let shown = read_scene(&clouds.scene, clouds.optics)?.cloud;
    let shown_cells = shown.shape.len() as u64;
    let cloud = in_light_cells(recipe, clouds, &shown)?.unwrap_or(shown);
    let cells = cloud.shape.len() as u64;
    // A fit is of light in the shown cells.
    let solved = if clouds.response.stored == Stored::Fit { shown_cells } else { cells };
    let rows = rows_of(recipe, clouds, &cloud)? + clouds.distant.len() as u64;
    let estimate = of_response(clouds, (cells, solved), rows, threads);
    estimate.require(&clouds.scene, limit, remedy(clouds))?;
    Ok(Some(estimate))
}

fn rows_of(recipe: &Recipe, clouds: &Clouds, cloud: &Cloud) -> Result<u64, BakeError> {
    let site = Site::new(recipe, clouds, cloud);
    let suns = usual_sun(&site)?.map_or(0, |sun| sun.beams.len());
    Ok((site.place_lights(site.usual_spacing_m())?.wanted_count() + suns) as u64)
}

/// Cells of a scene's grid by its own words, without reading it; none where they do not say, or say more than any grid may have.
pub fn cells_of(scene: &Path) -> Option<u64> {
    let file: serde_json::Value = crate::input::read_json(scene, "a scene (SCENE.json)").ok()?;
    let counts = file.get("dims_xyz")?.as_array()?;
    let cells = counts.iter().try_fold(1u64, |cells, count| cells.checked_mul(count.as_u64()?))?;
    (cells <= squall_formats::Limits::default().cells).then_some(cells)
}

/// How much memory the work may take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// Bytes.
    pub bytes: u64,
    /// Who says so, in words.
    pub whence: &'static str,
}

impl Limit {
    /// The smallest of what was asked for, what is free on the machine and what this process's group may take.
    pub fn new(asked: Option<u64>) -> Self {
        let asked = asked.map(|bytes| Self { bytes, whence: "--memory" });
        let unknown = Self { bytes: u64::MAX, whence: "the machine" };
        let all = asked.into_iter().chain(free()).chain(group());
        all.min_by_key(|limit| limit.bytes).unwrap_or(unknown)
    }
}

/// What the machine can give without harm, and what it may swap out for it.
fn free() -> Option<Limit> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let of = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()
    };
    let kibibytes = of("MemAvailable:")?.saturating_add(of("SwapFree:").unwrap_or(0));
    Some(Limit { bytes: kibibytes.saturating_mul(1024), whence: "what is free on this machine" })
}

/// What the groups of processes that this one is in may still take (cgroups, version 2 and 1).
fn group() -> Option<Limit> {
    let number = |path: &Path| std::fs::read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let mut least = None::<u64>;
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(kind), Some(name)) = (parts.next(), parts.next()) else { continue };
        let (root, most, now) = match kind {
            "" => ("/sys/fs/cgroup", "memory.max", "memory.current"),
            "memory" => ("/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes"),
            _ => continue,
        };
        // The root stands for all where a container sees its own group there.
        let own = Path::new(root).join(name.trim_start_matches('/'));
        for folder in own.ancestors().take_while(|folder| folder.starts_with(root)) {
            if let Some(most) = number(&folder.join(most)) {
                let left = most.saturating_sub(number(&folder.join(now)).unwrap_or(0));
                least = Some(least.map_or(left, |known| known.min(left)));
            }
        }
    }
    least.map(|bytes| Limit { bytes, whence: "what this process's group may take" })
}

/// Bytes in words, such as 2.5 GiB.
fn words(bytes: u64) -> String {
    let units = ["bytes", "KiB", "MiB", "GiB", "TiB"];
    let (mut value, mut unit) = (bytes as f64, 0);
    while value >= 1024.0 && unit + 1 < units.len() {
        value /= 1024.0;
        unit += 1;
    }
    format!("{value:.3} {}", units[unit])
}

/// A size such as 8G, 1.5GiB, 512M or 65536, in bytes; units are powers of 1024.
pub fn parse_size(text: &str) -> Option<u64> {
    let digits = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let power = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 0,
        "k" | "kb" | "kib" => 1,
        "m" | "mb" | "mib" => 2,
        "g" | "gb" | "gib" => 3,
        "t" | "tb" | "tib" => 4,
        _ => return None,
    };
    let value: f64 = number.parse().ok()?;
    let bytes = value * 1024u64.pow(power) as f64;
    (bytes >= 1.0 && bytes < u64::MAX as f64).then_some(bytes as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_with_and_without_units() {
        let read = ["65536", "64k", "1.5GiB", "2T"].map(parse_size);
        assert_eq!(read, [Some(65536), Some(65536), Some(3 << 29), Some(2 << 40)]);
        for wrong in ["", "G", "-1G", "8 apples", "0", "1e99T"] {
            assert_eq!(parse_size(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_refusal_says_what_would_fit() {
        let limit = Limit { bytes: 1 << 30, whence: "--memory" };
        let refused = |estimate: Estimate| {
            let error = estimate.require(Path::new("scene.json"), limit, "").unwrap_err();
            assert_eq!(error.exit_code(), 3);
            error.to_string()
        };
        let many = Estimate { shared: 1 << 29, thread: 1 << 28, threads: 8, cells: 1000 };
        assert!(refused(many).contains("--threads 2 would fit"));
        // Twice what there is, whatever the threads: half the cells.
        let large = Estimate { shared: PROGRAM + (1 << 31), thread: 0, threads: 1, cells: 1 << 21 };
        let words = refused(large);
        let fits: u64 = words.split("about ").last().unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!((1 << 20) - (1 << 15) < fits && fits <= 1 << 20, "{words}");
        assert!(Estimate { threads: 2, ..many }.require(Path::new("x"), limit, "").is_ok());
    }
}
