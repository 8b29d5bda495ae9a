//! What relighting a stroke costs, as a count: budgets in milliseconds are held to this, never to a clock, so that the same recipe
//! gives the same asset on a busy machine and on an idle one.
//!
//! Two things take the time: adding the coefficients of the rows that the stroke touches, which goes with their number, and
//! transforming every plane back, which goes with cells times coefficients. What a picture does with the light is not in it: light
//! straight from the stroke, reading towards the viewer, following rays. The prices are those of one core at some 3 GHz; `cargo
//! bench -p squall-bake --bench relight` prints the count beside the clock of the machine at hand.

use crate::error::BakeError;
use crate::recipe::model::Recipe;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::response::{Codec, ResponseHead};
use squall_runtime::relight::{PointLight, RelightBuffers, Relighter, SourceWeight};
use squall_runtime::stroke::Stroke;

/// Adding a coefficient of a row, a scattered addition.
const NS_PER_COEFFICIENT: f64 = 3.2;
/// Decoding gap and value of one before that, where they are coded by how rare they are.
const NS_PER_DECODED: f64 = 12.0;
/// Clearing and transforming a cell of a plane.
const NS_PER_CELL: f64 = 3.0;

/// Bytes that a coefficient takes, nearly, and ns: a pair of gap and value, coded or not, or of index and value.
fn bytes_and_ns(codec: Codec) -> (f64, f64) {
    match codec {
        Codec::Entropy => (0.95, NS_PER_COEFFICIENT + NS_PER_DECODED),
        Codec::Bytes => (2.0, NS_PER_COEFFICIENT),
        Codec::Paper => (8.0, NS_PER_COEFFICIENT),
    }
}

/// Milliseconds that relighting from rows of `bytes` bytes in all counts for.
pub fn relight_ms(head: &ResponseHead, bytes: f64) -> f64 {
    let cells = head.shape.len() * head.basis.count();
    let (each, ns) = bytes_and_ns(head.codec);
    let coefficients = bytes / each;
    1e-6 * (ns * coefficients + NS_PER_CELL * cells as f64)
}

/// Milliseconds that relighting `lights` counts for.
///
/// Errors: a point outside what was baked.
pub fn stroke_ms(
    relighter: &Relighter,
    lights: &[PointLight],
    buffers: &mut RelightBuffers,
) -> Result<f64, BakeError> {
    let response = relighter.response();
    let length = |weight: &SourceWeight| f64::from(response.index[weight.row as usize].length);
    let bytes = relighter.weigh(lights, buffers)?.iter().map(length).sum();
    Ok(relight_ms(&response.head, bytes))
}

/// What a scene relights at once: each of its strokes, and those that flash one after the other in its own picture's list and have one
/// colour, as frames sum them.
pub fn flashes(recipe: &Recipe) -> Vec<Vec<PointLight>> {
    let lights = |record: &StrokeRecord| Stroke::grow(record).lights(0.0);
    let mut all: Vec<Vec<PointLight>> = recipe.strokes.iter().map(lights).collect();
    let shown = recipe.view.iter().flat_map(|view| &view.flashes).filter(|flash| flash.brightness > 0.0);
    let shown: Vec<&StrokeRecord> =
        shown.filter_map(|flash| recipe.strokes.iter().find(|record| record.name == flash.stroke)).collect();
    for group in shown.chunk_by(|a, b| a.color == b.color).filter(|group| group.len() > 1) {
        all.push(group.iter().flat_map(|record| lights(record)).collect());
    }
    all
}

/// The most that any of `strokes` counts for; points outside what was baked are left out.
///
/// Errors: a point that is not finite.
pub fn most_ms<'a>(
    relighter: &Relighter,
    strokes: impl Iterator<Item = &'a [PointLight]>,
) -> Result<f64, BakeError> {
    let mut buffers = RelightBuffers::default();
    let mut most = 0.0f64;
    for lights in strokes {
        let reached: Vec<PointLight> =
            lights.iter().filter(|light| relighter.reaches(light.position)).copied().collect();
        most = most.max(stroke_ms(relighter, &reached, &mut buffers)?);
    }
    Ok(most)
}
