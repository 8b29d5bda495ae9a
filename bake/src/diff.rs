//! What changed between two assets: sections, inputs, budgets, and how far each part of one lies from the other's.
//!
//! A part's distance is its own error measure, with the second asset in the place of the truth.

use crate::error::BakeError;
use crate::evaluate::held_out::grown_strokes;
use crate::evaluate::views::{ViewFactors, Views};
use crate::evaluate::{relative_l2, root_mean_square};
use crate::streak::{draw, quality};
use serde::Serialize;
use squall_formats::Tag;
use squall_formats::container::Entry;
use squall_formats::drops::View;
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::density::{DensitySection, Mode};
use squall_formats::section::provenance::ProvenanceSection;
use squall_formats::section::response::ResponseSection;
use squall_formats::section::streak::StreakSection;
use squall_formats::units::{Degrees, MillimetresPerHour, Seconds};
use squall_formats::view_region::ViewRegion;
use squall_runtime::Asset;
use squall_runtime::density::lookup_counts;
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions, Relighter, view_region_frame};
use squall_runtime::stroke::Stroke;

/// Everything that differs between assets A and B; nothing where they are the same.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Difference {
    /// Whether every byte is the same.
    pub identical: bool,
    /// Sections that are in one alone, or in both with other bytes.
    pub sections: Vec<SectionChange>,
    /// Tool, recipe and inputs that differ.
    pub provenance: Vec<ValueChange>,
    /// Budgets that differ in what was asked, got or chosen.
    pub budgets: Vec<ValueChange>,
    /// How far each part of A lies from B's.
    pub parts: Vec<PartDistance>,
}

/// A section that differs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SectionChange {
    /// Its tag.
    pub tag: String,
    /// Version in A and B.
    pub version: [Option<u16>; 2],
    /// Whether a reader must know it, in A and B.
    pub required: [Option<bool>; 2],
    /// Length in A and B, bytes; `None` where the section is not there.
    pub bytes: [Option<u64>; 2],
}

/// A named value that differs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ValueChange {
    /// What it is.
    pub name: String,
    /// In A, if there.
    pub a: Option<String>,
    /// In B, if there.
    pub b: Option<String>,
}

/// How far a part of A lies from B's.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartDistance {
    /// The section's tag.
    pub part: String,
    /// What was measured, with its unit.
    pub metric: String,
    /// The figure; `None` where the two cannot be compared, and `metric` then says why.
    pub value: Option<f64>,
}

/// Views that tables of counts are compared in: in the ranges that both cover.
const VIEWS: usize = 64;
/// Strokes that responses are compared by where neither asset brings any.
const STROKES: usize = 4;

/// Compares two open assets.
///
/// Errors: a damaged section.
pub fn diff(a: &Asset, b: &Asset) -> Result<Difference, BakeError> {
    let mut found = Difference { identical: a.bytes() == b.bytes(), ..Difference::default() };
    if found.identical {
        return Ok(found);
    }
    let mut tags: Vec<Tag> = a.directory().entries.iter().map(|entry| entry.tag).collect();
    for entry in &b.directory().entries {
        if !tags.contains(&entry.tag) {
            tags.push(entry.tag);
        }
    }
    let mut changed = Vec::new();
    for tag in tags {
        let entries = [a, b].map(|asset| asset.directory().find(tag));
        if same_bytes([a, b], entries)? {
            continue;
        }
        found.sections.push(SectionChange {
            tag: tag.to_string(),
            version: entries.map(|entry| entry.map(|e| e.version)),
            required: entries.map(|entry| entry.map(|e| e.required)),
            bytes: entries.map(|entry| entry.map(|e| e.length)),
        });
        if entries.iter().all(|entry| entry.is_some()) {
            changed.push(tag);
        }
    }
    compare_provenance(a, b, &mut found)?;
    for tag in changed {
        match tag {
            CloudSection::TAG => compare_grids(a, b, &mut found)?,
            ResponseSection::TAG => compare_responses(a, b, &mut found)?,
            StreakSection::TAG => compare_streaks(a, b, &mut found)?,
            DensitySection::TAG => compare_densities(a, b, &mut found)?,
            ProvenanceSection::TAG => {}
            _ => found.cannot(tag, "sections of this kind have no distance"),
        }
    }
    Ok(found)
}

fn same_bytes(assets: [&Asset; 2], entries: [Option<&Entry>; 2]) -> Result<bool, BakeError> {
    let [Some(a), Some(b)] = entries else { return Ok(false) };
    let [in_a, in_b] = [(assets[0], a), (assets[1], b)]
        .map(|(asset, entry)| entry.bytes(asset.bytes()).map_err(|error| asset.wrap(error)));
    Ok(a.version == b.version && a.required == b.required && in_a? == in_b?)
}

fn compare_provenance(a: &Asset, b: &Asset, found: &mut Difference) -> Result<(), BakeError> {
    let read = |asset: &Asset| -> Result<Option<ProvenanceSection>, BakeError> {
        Ok(match asset.directory().find(ProvenanceSection::TAG) {
            Some(_) => Some(asset.section(ProvenanceSection::TAG, "provenance", ProvenanceSection::read)?),
            None => None,
        })
    };
    let both = [read(a)?, read(b)?];
    let hex = |hash: &[u8; 32]| blake3::Hash::from_bytes(*hash).to_hex();
    let facts = |made: &ProvenanceSection| -> Vec<(String, String)> {
        let mut list =
            vec![("tool".into(), made.tool.clone()), ("recipe".into(), hex(&made.recipe_hash).to_string())];
        let inputs = made.inputs.iter();
        list.extend(
            inputs.map(|input| (input.name.clone(), format!("{} bytes, {}", input.bytes, hex(&input.hash)))),
        );
        list
    };
    let budgets = |made: &ProvenanceSection| -> Vec<(String, String)> {
        let asked = |value: Option<f64>| value.map_or("nothing".into(), |v| format!("{v}"));
        let line = |budget: &squall_formats::section::provenance::BudgetRecord| {
            let value =
                format!("asked {}, got {}, chosen {}", asked(budget.asked), budget.got, budget.chosen);
            (format!("{}: {}", budget.part, budget.metric), value)
        };
        made.budgets.iter().map(line).collect()
    };
    let lists = |pick: &dyn Fn(&ProvenanceSection) -> Vec<(String, String)>| {
        both.each_ref().map(|made| made.as_ref().map(pick).unwrap_or_default())
    };
    found.provenance = changes(lists(&facts));
    found.budgets = changes(lists(&budgets));
    Ok(())
}

/// Values that differ by name; a name that is there twice is told apart by its place.
fn changes([a, b]: [Vec<(String, String)>; 2]) -> Vec<ValueChange> {
    let number = |list: &[(String, String)], name: &str, nth: usize| -> Option<String> {
        list.iter().filter(|(n, _)| n == name).nth(nth).map(|(_, value)| value.clone())
    };
    let mut names: Vec<(String, usize)> = Vec::new();
    for list in [&a, &b] {
        for (at, (name, _)) in list.iter().enumerate() {
            let nth = list[..at].iter().filter(|(n, _)| n == name).count();
            if !names.contains(&(name.clone(), nth)) {
                names.push((name.clone(), nth));
            }
        }
    }
    let change = |(name, nth): (String, usize)| {
        let (in_a, in_b) = (number(&a, &name, nth), number(&b, &name, nth));
        (in_a != in_b).then_some(ValueChange { name, a: in_a, b: in_b })
    };
    names.into_iter().filter_map(change).collect()
}

impl Difference {
    fn measured(&mut self, part: Tag, metric: impl Into<String>, value: f64) {
        self.parts.push(PartDistance { part: part.to_string(), metric: metric.into(), value: Some(value) });
    }

    fn cannot(&mut self, part: Tag, why: impl Into<String>) {
        let metric = format!("not comparable: {}", why.into());
        self.parts.push(PartDistance { part: part.to_string(), metric, value: None });
    }
}

fn compare_grids(a: &Asset, b: &Asset, found: &mut Difference) -> Result<(), BakeError> {
    let read = |asset| Asset::section(asset, CloudSection::TAG, "the cloud grid", CloudSection::read);
    let [x, r] = [read(a)?, read(b)?];
    if x.head.shape != r.head.shape {
        found.cannot(CloudSection::TAG, format!("{:?} beside {:?}", x.head.shape, r.head.shape));
        return Ok(());
    }
    let l2 = relative_l2(&x.extinction.values(), &r.extinction.values());
    found.measured(CloudSection::TAG, "extinction, relative L2", l2);
    if x.head != r.head {
        found.cannot(CloudSection::TAG, format!("other optics or place: {:?} beside {:?}", x.head, r.head));
    }
    Ok(())
}

fn compare_responses(a: &Asset, b: &Asset, found: &mut Difference) -> Result<(), BakeError> {
    let tag = ResponseSection::TAG;
    let [x, r] = [Relighter::new(a)?, Relighter::new(b)?];
    if x.light_cloud().shape != r.light_cloud().shape {
        found.cannot(tag, "clouds of other shapes");
        return Ok(());
    }
    if x.direct() != r.direct() || x.extinction_scale() != r.extinction_scale() {
        found.cannot(tag, "rows that hold other parts of the light");
        return Ok(());
    }
    let Some(views) = common_views(&x, &r, found) else { return Ok(()) };
    let head = |relighter: &Relighter| {
        let frame = relighter
            .view_region()
            .map(|view_region| view_region_frame(view_region, relighter.light_cloud()));
        views.factors(relighter.response().head.basis, frame.as_ref())
    };
    let factors = [head(&x), head(&r)];
    let both = |light: &PointLight| x.reaches(light.position) && r.reaches(light.position);
    let mut strokes: Vec<Vec<PointLight>> = Vec::new();
    for asset in [a, b] {
        if strokes.is_empty() && asset.directory().find(BoltSection::TAG).is_some() {
            let section = asset.section(BoltSection::TAG, "the strokes", BoltSection::read)?;
            let lights = section.strokes.iter().map(|record| Stroke::grow(record).lights(0.0));
            strokes.extend(
                lights.map(|lights| lights.into_iter().filter(|light| both(light)).collect::<Vec<_>>()),
            );
            strokes.retain(|lights| !lights.is_empty());
        }
    }
    if strokes.is_empty() {
        let usable = |point| x.reaches(point) && r.reaches(point);
        let [low, high] = x.bounds();
        let spacing = (high - low).max_element() / 40.0;
        strokes = grown_strokes(x.light_cloud(), x.bounds(), usable, spacing, 0..STROKES);
    }
    if strokes.is_empty() {
        found.cannot(tag, "no stroke that both can relight");
        return Ok(());
    }
    let (mut each, mut tail, mut median) = (Vec::new(), 0.0f64, 0.0f64);
    for lights in &strokes {
        let light = |relighter: &Relighter, factors: &ViewFactors| -> Result<Vec<f32>, BakeError> {
            let mut buffers = RelightBuffers::default();
            Ok(views.light(&relighter.relight(lights, RelightOptions::default(), &mut buffers)?, factors))
        };
        let error = views.compare(&light(&x, &factors[0])?, &light(&r, &factors[1])?);
        each.push(error.l2);
        tail = tail.max(error.tail);
        median = median.max(error.median);
    }
    let l2 = root_mean_square(each);
    found.measured(tag, format!("relit light of {} strokes, relative L2", strokes.len()), l2);
    found.measured(tag, "relit light, 99.9th percentile over the peak, worst stroke", tail);
    found.measured(tag, "relit light, median pointwise, worst stroke", median);
    Ok(())
}

/// Views of the cells that both assets know, in the 26 directions or towards viewpoints in the view regions of either. Where they differ in either,
/// that is said; `None` where nothing is left to compare.
fn common_views(x: &Relighter, r: &Relighter, found: &mut Difference) -> Option<Views> {
    let tag = ResponseSection::TAG;
    let words = |view_region: Option<&ViewRegion>| match view_region {
        Some(ViewRegion { low_m, high_m }) => format!("viewpoints between {low_m:?} and {high_m:?} m"),
        None => "viewpoints anywhere".to_owned(),
    };
    let view_region = match (x.view_region(), r.view_region()) {
        (Some(x), Some(r)) => Some(ViewRegion {
            low_m: std::array::from_fn(|axis| x.low_m[axis].max(r.low_m[axis])),
            high_m: std::array::from_fn(|axis| x.high_m[axis].min(r.high_m[axis])),
        }),
        (x, r) => x.or(r).copied(),
    };
    if x.view_region() != r.view_region() {
        found.cannot(tag, format!("baked for {} beside {}", words(x.view_region()), words(r.view_region())));
    }
    if view_region
        .is_some_and(|view_region| (0..3).any(|axis| view_region.low_m[axis] > view_region.high_m[axis]))
    {
        found.cannot(tag, "view regions that do not meet");
        return None;
    }
    let [known_x, known_r] = [x.known_light_cells(), r.known_light_cells()];
    let both: Vec<bool> = known_x.iter().zip(&known_r).map(|(x, r)| *x && *r).collect();
    let count = |cells: &[bool]| cells.iter().filter(|&&known| known).count();
    if known_x != known_r {
        let [x, r, common] = [count(&known_x), count(&known_r), count(&both)];
        found.cannot(tag, format!("light in {x} cells beside {r}; compared in the {common} of both"));
    }
    both.contains(&true).then(|| Views::new(x.light_cloud(), view_region.as_ref(), 0, |cell| both[cell]))
}

fn compare_streaks(a: &Asset, b: &Asset, found: &mut Difference) -> Result<(), BakeError> {
    let tag = StreakSection::TAG;
    let read = |asset| Asset::section(asset, tag, "streak patterns", StreakSection::read);
    let [x, r] = [read(a)?, read(b)?];
    let mut worst = f64::INFINITY;
    for pattern in &x.patterns {
        let same = |other: &&squall_formats::section::streak::StreakPattern| other.name == pattern.name;
        let Some(other) = r.patterns.iter().find(same) else {
            found.cannot(tag, format!("pattern `{}` is in one alone", pattern.name));
            continue;
        };
        let [width, height] = other.size_px.map(usize::from);
        let drawn = [pattern, other].map(|pattern| draw(&pattern.pattern, width, height));
        worst = worst.min(quality::psnr_db(&drawn[1], &drawn[0]));
    }
    if worst < f64::INFINITY {
        found.measured(tag, "worst pattern, PSNR in dB", worst);
    }
    for other in &r.patterns {
        if !x.patterns.iter().any(|pattern| pattern.name == other.name) {
            found.cannot(tag, format!("pattern `{}` is in one alone", other.name));
        }
    }
    Ok(())
}

fn compare_densities(a: &Asset, b: &Asset, found: &mut Difference) -> Result<(), BakeError> {
    let tag = DensitySection::TAG;
    let read = |asset| Asset::section(asset, tag, "rain density tables", DensitySection::read);
    let [x, r] = [read(a)?, read(b)?];
    let common = |p: [f64; 2], q: [f64; 2]| [p[0].max(q[0]), p[1].min(q[1])];
    let rates = common(x.ranges.rate.map(|v| v.0), r.ranges.rate.map(|v| v.0));
    let fovs = common(x.ranges.vertical_fov.map(|v| v.0), r.ranges.vertical_fov.map(|v| v.0));
    let exposures = common(x.ranges.exposure.map(|v| v.0), r.ranges.exposure.map(|v| v.0));
    let lengths = common(x.ranges.length_px, r.ranges.length_px);
    if [rates, fovs, exposures, lengths].iter().any(|[low, high]| low > high) {
        found.cannot(tag, "ranges that do not meet");
        return Ok(());
    }
    for mode in Mode::ALL {
        let mut worst = 0.0f64;
        for number in 0..VIEWS {
            // Rates one by one, and views that go through their ranges at other paces.
            let share = |step: usize| ((number * step) % VIEWS) as f64 / (VIEWS - 1) as f64;
            let within = |[low, high]: [f64; 2], share: f64| (low + (high - low) * share).clamp(low, high);
            let view = View {
                vertical_fov: Degrees(within(fovs, share(7))).into(),
                height_px: 1080.0,
                aspect: 16.0 / 9.0,
                exposure: Seconds(within(exposures, share(11))),
                min_px: lengths[0],
                max_px: lengths[1],
            };
            let rate = rates[0] * libm::pow(rates[1] / rates[0], share(1));
            let rate = MillimetresPerHour(rate.clamp(rates[0], rates[1]));
            let total = |section: &DensitySection| -> Result<f64, BakeError> {
                Ok(lookup_counts(section, mode, &view, rate)?.iter().sum())
            };
            let (found, wanted) = (total(&x)?, total(&r)?);
            if found != wanted {
                worst = worst.max((found - wanted).abs() / wanted);
            }
        }
        found.measured(tag, format!("counts in mode {}, largest relative difference", mode.name()), worst);
    }
    Ok(())
}
