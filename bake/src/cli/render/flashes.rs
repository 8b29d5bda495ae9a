//! Which strokes flash when: a natural flash by its seed, or an artist's keys.

use serde::Deserialize;
use serde_json::{Value, json};
use squall_bake::BakeError;
use squall_bake::input::json::read_json;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::view::ViewFlash;
use squall_formats::units::Seconds;
use squall_runtime::frame::{ChannelPieces, FlashCurve, Thunder};
use squall_runtime::glam::DVec3;
use squall_runtime::{Flash, RuntimeError, StormRenderer};
use std::path::Path;

/// A moment of an artist's curve, or a natural flash.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Key {
    /// Time of the key, or of the first return stroke.
    time_s: f64,
    /// Whose.
    stroke: String,
    /// Share of the stroke's stated intensity.
    #[serde(default = "one")]
    intensity: f64,
    /// Weights of red, green and blue in place of the stroke's own.
    color: Option<[f64; 3]>,
    /// With a seed it is a natural flash, not a key.
    seed: Option<u64>,
}

fn one() -> f64 {
    1.0
}

/// How one stroke shines in time.
struct Shine {
    stroke: String,
    curves: Curves,
    /// The channel in pieces, for exposures so short that light is seen to run along it.
    pieces: Option<ChannelPieces>,
}

/// Longest exposure in which light may be seen to run along a channel, s: a leader takes some 20 ms.
const LONGEST_S: f64 = 5e-3;
/// Pieces that a channel is cut into, and most pieces of all strokes together.
const PIECES: usize = 16;
const MOST_PIECES: usize = 48;
/// Difference between a stroke's pieces, as a share of the stroke's stated intensity, below which they count as one.
const ALIKE: f64 = 1e-2;

enum Curves {
    /// In the stroke's own colour.
    Own(FlashCurve),
    /// A curve for each band.
    Bands(Box<[FlashCurve; 3]>),
}

/// All strokes of a sequence.
pub struct Timeline {
    shines: Vec<Shine>,
}

impl Timeline {
    /// The view's strokes as parts of one natural flash whose first return stroke begins at `start`.
    pub fn natural(flashes: &[ViewFlash], seed: u64, start: f64) -> Self {
        let curve = FlashCurve::natural(seed).delayed(Seconds(start));
        let shine = |flash: &ViewFlash| Shine {
            stroke: flash.stroke.clone(),
            curves: Curves::Own(curve.clone().times(flash.brightness)),
            pieces: None,
        };
        Self { shines: flashes.iter().map(shine).collect() }
    }

    /// The keys of a file: a list of objects, each with `time_s` and `stroke`; `intensity` and `color` make it a key of that stroke's curve,
    /// which is straight between keys and dark outside; `seed` makes it a natural flash that begins then. All of a stroke's add up.
    ///
    /// Errors: no such file, no list of keys, a stroke that the asset lacks, keys that are none.
    pub fn read(path: &Path, strokes: &[StrokeRecord]) -> Result<Self, BakeError> {
        let keys: Vec<Key> = read_json(path, "a list of keys of flashes")?;
        let mut shines = Vec::new();
        let mut named: Vec<&str> = keys.iter().map(|key| key.stroke.as_str()).collect();
        named.sort_unstable();
        named.dedup();
        for name in named {
            let Some(record) = strokes.iter().find(|record| record.name == name) else {
                let known: Vec<&str> = strokes.iter().map(|record| record.name.as_str()).collect();
                let wanted = format!("one of the asset's: {}", known.join(", "));
                return Err(BakeError::input(path, "stroke", wanted, format!("\"{name}\"")));
            };
            let own: Vec<&Key> = keys.iter().filter(|key| key.stroke == name).collect();
            if let Some(key) = own.iter().find(|key| {
                let color = key.color.unwrap_or([1.0; 3]);
                let numbers = [key.intensity, color[0], color[1], color[2]];
                !(key.time_s.is_finite() && numbers.iter().all(|number| *number >= 0.0 && number.is_finite()))
            }) {
                let found =
                    format!("time_s {}, intensity {}, color {:?}", key.time_s, key.intensity, key.color);
                let wanted = "finite times, and intensities and colours of 0 or more";
                return Err(BakeError::input(path, name, wanted, found));
            }
            let curves = if own.iter().any(|key| key.color.is_some()) {
                let band = |band: usize| {
                    let of_stroke = f64::from(record.color[band]);
                    curve(path, name, &own, |key| key.color.map_or(of_stroke, |color| color[band]))
                };
                Curves::Bands(Box::new([band(0)?, band(1)?, band(2)?]))
            } else {
                Curves::Own(curve(path, name, &own, |_| 1.0)?)
            };
            shines.push(Shine { stroke: name.to_owned(), curves, pieces: None });
        }
        Ok(Self { shines })
    }

    /// Has light run along the channels where `exposure` is short enough to see it.
    ///
    /// Errors: a stroke that the asset lacks.
    pub fn run_along(&mut self, renderer: &StormRenderer, exposure: Seconds) -> Result<(), RuntimeError> {
        if exposure.0 <= 0.0 || exposure.0 > LONGEST_S {
            return Ok(());
        }
        let count = (MOST_PIECES / self.shines.len().max(1)).clamp(1, PIECES);
        for shine in &mut self.shines {
            shine.pieces = Some(ChannelPieces::of(&*renderer.stroke(&shine.stroke)?, count)?);
        }
        Ok(())
    }

    /// What an exposure sees of every stroke, or of its pieces where light is on its way along it; what is dark is left out.
    pub fn seen(&self, opens: Seconds, exposure: Seconds) -> Vec<Flash> {
        let seen = |shine: &Shine| shine.seen(opens, exposure);
        self.shines.iter().flat_map(seen).filter(|flash| flash.brightness > 0.0).collect()
    }

    /// Every stroke with its return strokes and its thunder, as data.
    ///
    /// Errors: a stroke that the asset lacks.
    pub fn data(&self, renderer: &StormRenderer, listener: DVec3) -> Result<Value, RuntimeError> {
        let one = |shine: &Shine| {
            let curve = match &shine.curves {
                Curves::Own(curve) => curve,
                Curves::Bands(bands) => &bands[1],
            };
            let strokes = curve.return_strokes().iter();
            let strokes = strokes.map(|s| json!({ "time_s": s.start.0, "energy_s": s.energy.0 }));
            let span = curve.span().map(|span| span.map(|time| time.0));
            Ok(json!({
                "stroke": shine.stroke,
                "span_s": span,
                "return_strokes": strokes.collect::<Vec<_>>(),
                "thunder": thunder(renderer, &shine.stroke, listener)?,
            }))
        };
        self.shines.iter().map(one).collect()
    }
}

impl Shine {
    fn seen(&self, opens: Seconds, exposure: Seconds) -> Vec<Flash> {
        let curves = match &self.curves {
            Curves::Own(curve) => std::slice::from_ref(curve),
            Curves::Bands(bands) => bands.as_slice(),
        };
        let whole = || {
            let means: Vec<f64> = curves.iter().map(|curve| curve.mean(opens, exposure)).collect();
            vec![lit(Flash::named(&self.stroke), &means)]
        };
        let Some(pieces) = &self.pieces else { return whole() };
        let bands: Vec<Vec<f64>> =
            curves.iter().map(|curve| pieces.brightness(curve, opens, exposure)).collect();
        let spread = |own: &Vec<f64>| {
            let (least, most) = own.iter().fold((f64::INFINITY, 0.0f64), |(a, b), &v| (a.min(v), b.max(v)));
            most - least
        };
        if bands.iter().all(|own| spread(own) <= ALIKE) {
            return whole();
        }
        let piece = |(number, stroke): (usize, &std::sync::Arc<squall_runtime::Stroke>)| {
            let means: Vec<f64> = bands.iter().map(|own| own[number]).collect();
            lit(Flash::own(stroke.clone()), &means)
        };
        pieces.strokes().iter().enumerate().map(piece).collect()
    }
}

/// A flash as bright as one mean says in the stroke's own colour, or as three say in bands.
fn lit(flash: Flash, means: &[f64]) -> Flash {
    let &[red, green, blue] = means else { return flash.brightness(means.iter().sum()) };
    let most = red.max(green).max(blue);
    let band = |mean: f64| if most > 0.0 { (mean / most) as f32 } else { 0.0 };
    flash.brightness(most).colored([red, green, blue].map(band))
}

/// When a stroke's thunder is heard, and from how far, as data.
pub fn thunder(renderer: &StormRenderer, stroke: &str, listener: DVec3) -> Result<Value, RuntimeError> {
    Ok(Thunder::of(&*renderer.stroke(stroke)?, listener).map_or(Value::Null, |thunder| {
        json!({
            "delay_s": thunder.delay.0,
            "duration_s": thunder.duration.0,
            "nearest_m": thunder.nearest.0,
            "farthest_m": thunder.farthest.0,
        })
    }))
}

/// The sum of a stroke's natural flashes and of the line through its keys, each times `factor`.
fn curve(
    path: &Path,
    name: &str,
    keys: &[&Key],
    factor: impl Fn(&Key) -> f64,
) -> Result<FlashCurve, BakeError> {
    let mut sum = FlashCurve::default();
    let mut points = Vec::new();
    for key in keys {
        let strength = key.intensity * factor(key);
        match key.seed {
            Some(seed) => {
                sum = sum.and(FlashCurve::natural(seed).delayed(Seconds(key.time_s)).times(strength))
            }
            None => points.push((Seconds(key.time_s), strength)),
        }
    }
    if points.is_empty() {
        return Ok(sum);
    }
    points.sort_by(|a, b| a.0.0.total_cmp(&b.0.0));
    let line = FlashCurve::from_keys(&points).map_err(|error| match error {
        RuntimeError::Argument { field, wanted, found } => {
            BakeError::input(path, format!("{name}: {field}"), wanted, found)
        }
        other => other.into(),
    })?;
    Ok(sum.and(line))
}
