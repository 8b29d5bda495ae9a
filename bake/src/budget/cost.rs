//! What relighting a stroke costs, as a count: budgets in milliseconds are held to this, never to a clock, so that the same recipe
//! gives the same asset on a busy machine and on an idle one.
//!
//! Two things take the time: adding the coefficients of the rows that the stroke touches, which goes with their bytes, and
//! transforming every channel back, which goes with cells times channels. The prices are those of one core at some 3 GHz; `cargo
//! bench -p squall-bake --bench relight` prints the count beside the clock of the machine at hand.

use crate::error::BakeError;
use squall_runtime::relight::{LampPoint, RelightBuffers, Relighter};

/// Adding a byte of a row: a pair of gap and value takes some 3 ns, a scattered addition.
const NS_PER_BYTE: f64 = 1.6;
/// Clearing and transforming a cell of a channel.
const NS_PER_CELL: f64 = 3.0;

/// Milliseconds that relighting `lamps` counts for.
///
/// Errors: a lamp outside the baked reach.
pub fn relight_ms(
    relighter: &Relighter<'_>,
    lamps: &[LampPoint],
    buffers: &mut RelightBuffers,
) -> Result<f64, BakeError> {
    let response = relighter.response();
    let mut bytes = 0u64;
    for weight in relighter.weigh(lamps, buffers)? {
        bytes += u64::from(response.index[weight.row as usize].length);
    }
    let cells = response.head.shape.len() * response.head.channels.count();
    Ok(1e-6 * (NS_PER_BYTE * bytes as f64 + NS_PER_CELL * cells as f64))
}

/// The most that any of `strokes` counts for.
///
/// Errors: as [`relight_ms`].
pub fn most_relight_ms<'a>(
    relighter: &Relighter<'_>,
    strokes: impl Iterator<Item = &'a [LampPoint]>,
) -> Result<f64, BakeError> {
    let mut buffers = RelightBuffers::default();
    let mut most = 0.0f64;
    for lamps in strokes {
        most = most.max(relight_ms(relighter, lamps, &mut buffers)?);
    }
    Ok(most)
}
