//! A constant and cosines under a window. \[weber\] eq. 1 with a plus where × is printed, and with the
//! constant that the printed sum leaves out.

use super::kind::Kind;
use super::packing::{Cursor, invalid, nearest};
use super::window::Window;
use crate::error::ReadError;
use std::f64::consts::TAU;

/// Most cosine terms of one pattern; more would take more bytes than the picture it came from.
pub const MAX_TERMS: usize = 1024;
/// Steps of the constant, −8 to 8.
const CONSTANT_STEPS: f64 = 4096.0;
/// Largest code of a 12-bit number without and with a sign.
const UNSIGNED_MAX: i64 = 4095;
const SIGNED_MAX: i64 = 2047;
/// Steps of a phase, one full turn.
const PHASE_STEPS: f64 = 4096.0;
/// Finest step of frequencies and amplitudes: 2^−15.
const FINEST: u8 = 15;

/// a·cos(2π(f·u + g·v) + φ).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cosine {
    /// f: periods over the picture's width, 0 to 4095.
    pub across: f64,
    /// g: periods over the picture's length, −2047 to 2047.
    pub along: f64,
    /// a, 0 to 4095.
    pub amplitude: f64,
    /// φ, radians, in [0, 2π).
    pub phase: f64,
}

impl Cosine {
    /// The term at (u, v), without the window.
    pub fn value(&self, u: f64, v: f64) -> f64 {
        self.amplitude * libm::cos(TAU * (self.across * u + self.along * v) + self.phase)
    }

    /// The same term with f ≥ 0, a ≥ 0 and φ in [0, 2π), as it is stored.
    pub fn normalised(&self) -> Self {
        let mut term = *self;
        if term.across < 0.0 || (term.across == 0.0 && term.along < 0.0) {
            term = Self { across: -term.across, along: -term.along, phase: -term.phase, ..term };
        }
        if term.amplitude < 0.0 {
            term.amplitude = -term.amplitude;
            term.phase += 0.5 * TAU;
        }
        term.phase -= TAU * (term.phase / TAU).floor();
        term
    }
}

/// I(u, v) = W(u, v) · (c + Σ aᵢ cos(2π(fᵢ u + gᵢ v) + φᵢ)).
#[derive(Clone, Debug, PartialEq)]
pub struct CosinePattern {
    /// W.
    pub window: Window,
    /// c, −8 to 8.
    pub constant: f64,
    /// The oscillating terms.
    pub terms: Vec<Cosine>,
}

impl CosinePattern {
    /// Light at (u, v).
    pub fn value(&self, u: f64, v: f64) -> f64 {
        let weight = self.window.value(u, v);
        if weight == 0.0 {
            return 0.0;
        }
        weight * self.terms.iter().fold(self.constant, |sum, term| sum + term.value(u, v))
    }

    pub(super) fn read(kind: Kind, terms: usize, pool: &mut Cursor) -> Result<Self, ReadError> {
        let window = Window::read(kind, pool)?;
        let constant = f64::from(pool.i16()?) / CONSTANT_STEPS;
        let exponents: [u8; 3] = pool.array()?;
        if exponents.iter().any(|&exponent| exponent > FINEST) {
            return Err(invalid("term steps", "exponents 0 to 15", format!("{exponents:?}")));
        }
        let [across, along, amplitude] = exponents.map(|exponent| 1.0 / f64::from(1u32 << exponent));
        let mut read = Vec::with_capacity(terms);
        for packed in pool.take(terms * 6)?.chunks_exact(6) {
            let bits = packed.iter().rev().fold(0u64, |bits, &byte| bits << 8 | u64::from(byte));
            let field = |index: u32| (bits >> (12 * index)) & 0xFFF;
            // The 12-bit sign is spread by the shift back.
            let signed = (field(1) << 52) as i64 >> 52;
            read.push(Cosine {
                across: field(0) as f64 * across,
                along: signed as f64 * along,
                amplitude: field(2) as f64 * amplitude,
                phase: field(3) as f64 * (TAU / PHASE_STEPS),
            });
        }
        Ok(Self { window, constant, terms: read })
    }

    pub(super) fn write(&self, pool: &mut Vec<u8>) {
        self.window.write(pool);
        pool.extend((nearest(self.constant * CONSTANT_STEPS, -32_768, 32_767) as i16).to_le_bytes());
        let terms: Vec<Cosine> = self.terms.iter().take(MAX_TERMS).map(Cosine::normalised).collect();
        let largest = |value: fn(&Cosine) -> f64| terms.iter().map(value).fold(0.0, f64::max);
        let across = step_exponent(largest(|term| term.across), UNSIGNED_MAX);
        // By the size of G, so that −2048 is taken at step 1 alone: elsewhere its half at twice the step says the same.
        let along = step_exponent(largest(|term| term.along.abs()), SIGNED_MAX);
        let amplitude = step_exponent(largest(|term| term.amplitude), UNSIGNED_MAX);
        pool.extend([across, along, amplitude]);
        let steps = [across, along, amplitude].map(|exponent| f64::from(1u32 << exponent));
        for term in &terms {
            // What rounds to no turn across may be told by the other sign along: one of the two is stored.
            let upright = nearest(term.across * steps[0], 0, UNSIGNED_MAX) == 0;
            let term = if upright { Cosine { across: 0.0, ..*term }.normalised() } else { *term };
            let phase = nearest(term.phase * (PHASE_STEPS / TAU), 0, 4096) & 0xFFF;
            let fields = [
                nearest(term.across * steps[0], 0, UNSIGNED_MAX),
                nearest(term.along * steps[1], -SIGNED_MAX - 1, SIGNED_MAX) & 0xFFF,
                nearest(term.amplitude * steps[2], 0, UNSIGNED_MAX),
                phase,
            ];
            let bits = fields.iter().rev().fold(0u64, |bits, &field| bits << 12 | field as u64);
            pool.extend_from_slice(&bits.to_le_bytes()[..6]);
        }
    }
}

/// The finest power-of-two step, as −log₂, in which `largest` still fits.
fn step_exponent(largest: f64, max_code: i64) -> u8 {
    let fits = |&exponent: &u8| (largest * f64::from(1u32 << exponent)).round() <= max_code as f64;
    (0..=FINEST).rev().find(fits).unwrap_or(0)
}
