//! Codec `Entropy`: gaps and values of codec `Bytes`, each in as many bits as it is rare, by asymmetric numeral systems (range variant,
//! bytewise). Bytes: SPEC.md, "Entropy".
//!
//! How often which gap and value comes is counted over all rows and stored once; a row stays readable by itself. Gaps count
//! places that some row uses, not cells.
//! Source: Duda, "Asymmetric numeral systems: entropy coding combining speed of Huffman coding with compression rate of arithmetic coding",
//! arXiv:1311.2540 (2013).

mod write;

#[cfg(test)]
mod tests;

pub(super) use write::transcoded;

use super::head::invalid;
use super::stream::Coefficient;
use crate::error::ReadError;
use serde::{Deserialize, Serialize};

/// Shares of symbols are so many 2⁻¹²s.
const SHARE_BITS: u32 = 12;
const SHARES: u32 = 1 << SHARE_BITS;
/// Least state between symbols; a state is below 256 times as much.
const LEAST_STATE: u32 = 1 << 23;
/// Gaps below this are symbols of their own; larger ones are told by their highest bit, and the bits below it.
const PLAIN_GAPS: usize = 16;
/// Symbols of gaps: the plain ones, then those from 2⁴ to 2²⁷.
const GAP_SYMBOLS: usize = PLAIN_GAPS + 24;
/// Symbols of values: 1, −1, 2, −2 and so on to −127, then a value that is written as it is.
const VALUE_SYMBOLS: usize = 255;
const ESCAPED: usize = VALUE_SYMBOLS - 1;
/// Gaps from here on, and from there on, have tables of values of their own: coefficients that stand alone are smaller.
const FAR_GAPS: [usize; 2] = [1, 4];
/// Largest value that is no escape, times step.
const LARGEST_VALUE: usize = 127;

/// How coefficients of codec `Entropy` are coded, as the section's head has it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EntropyRecord {
    /// How often, of 4096, each symbol comes in gaps between places; symbols left out at the end never come.
    pub place_gaps: Vec<u16>,
    /// The same in gaps between coefficients.
    pub gaps: Vec<u16>,
    /// The same in values behind a gap of 0, of 1 to 3, of more.
    pub values: [Vec<u16>; 3],
    /// Places that rows of all cells use, as a stream of gaps; nothing where they count cells.
    pub places: Option<Vec<u8>>,
}

/// A table that symbols are read by.
#[derive(Clone, Debug)]
struct Table {
    /// Symbol, share less one and place within the share, for each state's low bits.
    slots: Vec<Slot>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Slot {
    symbol: u16,
    share: u16,
    within: u16,
}

impl Table {
    fn of(shares: &[u16], symbols: usize) -> Result<Self, ReadError> {
        let sum: u32 = shares.iter().map(|&share| u32::from(share)).sum();
        if shares.len() > symbols || !(shares.is_empty() || sum == SHARES) {
            let found = format!("{} symbols of {sum} shares", shares.len());
            return Err(invalid(None, "entropy table", "no symbol, or shares that sum to 4096", found));
        }
        let mut slots = Vec::with_capacity(sum as usize);
        for (symbol, &share) in shares.iter().enumerate() {
            slots.extend((0..share).map(|within| Slot { symbol: symbol as u16, share, within }));
        }
        Ok(Self { slots })
    }
}

/// Tables and places that streams of codec `Entropy` are read by.
#[derive(Clone, Debug)]
pub(super) struct EntropyTables {
    gaps: Table,
    values: [Table; 3],
    /// Cells of a row that the places belong to, and the places: rising, from 1.
    places: Option<(usize, Vec<u32>)>,
}

/// Largest share of a gap between coefficients that a writer gives: each then takes a fifth of a bit at least, whatever its rows are.
const LARGEST_GAP_SHARE: u16 = 3584;
/// Coefficients are at most so many for each byte of their stream, so that work is bounded by bytes: at the largest share they are 42.
const COEFFICIENTS_PER_BYTE: u64 = 64;
/// Places are at most so many for each byte of rows, beyond a first few: each is used by a coefficient somewhere.
const PLACES_PER_BYTE: u64 = 8;
const FEW_PLACES: u64 = 1 << 16;

/// Most places that `row_bytes` of rows may come with.
fn most_places(row_bytes: u64) -> u64 {
    FEW_PLACES.saturating_add(row_bytes.saturating_mul(PLACES_PER_BYTE))
}

impl EntropyTables {
    /// Errors: shares that do not sum to 4096, places beyond the cells or more than the rows can use.
    pub(super) fn new(record: &EntropyRecord, cells: usize, row_bytes: u64) -> Result<Self, ReadError> {
        let place_gaps = Table::of(&record.place_gaps, GAP_SYMBOLS)?;
        let [near, middle, far] = &record.values;
        let places = match &record.places {
            None => None,
            Some(stream) => {
                let most = most_places(row_bytes).min(cells as u64);
                let (count, _) = number(stream)?;
                let mut places = Vec::with_capacity(count.min(most) as usize);
                each(stream, most, "places", |state| {
                    let gap = state.gap(&place_gaps)?;
                    let place = u64::from(places.last().copied().unwrap_or(0)) + gap as u64 + 1;
                    if place >= cells as u64 {
                        let found = place.to_string();
                        return Err(invalid(None, "entropy place", "below the number of cells", found));
                    }
                    places.push(place as u32);
                    Ok(())
                })?;
                Some((cells, places))
            }
        };
        Ok(Self {
            gaps: Table::of(&record.gaps, GAP_SYMBOLS)?,
            values: [
                Table::of(near, VALUE_SYMBOLS)?,
                Table::of(middle, VALUE_SYMBOLS)?,
                Table::of(far, VALUE_SYMBOLS)?,
            ],
            places,
        })
    }

    /// Hands every coefficient of a stream to `each_one`, with its index, from 1 and below `cells`.
    #[inline(always)]
    pub(super) fn walk(
        &self,
        stream: &[u8],
        cells: usize,
        mut each_one: impl FnMut(usize, Coefficient) -> Result<(), ReadError>,
    ) -> Result<(), ReadError> {
        let places = self.places.as_ref().filter(|(of, _)| *of == cells).map(|(_, places)| places.as_slice());
        let most = places.map_or(cells.saturating_sub(1), <[u32]>::len);
        let mut next = 0usize;
        let bound = (most as u64).min(COEFFICIENTS_PER_BYTE * stream.len() as u64);
        each(stream, bound, "coefficients", |state| {
            let gap = state.gap(&self.gaps)?;
            let rank = next + gap;
            if rank >= most {
                let found = rank.to_string();
                return Err(invalid(None, "coefficient index", "below the number of cells", found));
            }
            next = rank + 1;
            let index = places.map_or(rank + 1, |places| places[rank] as usize);
            match state.symbol(&self.values[table_behind(gap)])? {
                ESCAPED => each_one(index, Coefficient::Exact(f32::from_bits(state.bits(32)?))),
                symbol => {
                    let size = (symbol / 2 + 1) as i8;
                    each_one(index, Coefficient::Steps(if symbol % 2 == 0 { size } else { -size }))
                }
            }
        })
    }
}

/// Which table of values holds behind a gap.
fn table_behind(gap: usize) -> usize {
    FAR_GAPS.iter().filter(|&&from| gap >= from).count()
}

/// Reads a stream's count, then calls `one` so many times. A stream without bytes has none.
#[inline(always)]
fn each(
    stream: &[u8],
    most: u64,
    field: &'static str,
    mut one: impl FnMut(&mut State<'_>) -> Result<(), ReadError>,
) -> Result<(), ReadError> {
    if stream.is_empty() {
        return Ok(());
    }
    let (count, rest) = number(stream)?;
    if count > most {
        return Err(invalid(None, field, "as many as there are places and bytes for", count.to_string()));
    }
    let mut state = State::begin(rest)?;
    for _ in 0..count {
        one(&mut state)?;
    }
    state.end()
}

/// A number in groups of seven bits, lowest first, the high bit set in all bytes but the last.
fn number(stream: &[u8]) -> Result<(u64, &[u8]), ReadError> {
    let mut value = 0u64;
    for (at, &byte) in stream.iter().enumerate().take(9) {
        value |= u64::from(byte & 0x7f) << (7 * at);
        if byte & 0x80 == 0 {
            return Ok((value, &stream[at + 1..]));
        }
    }
    Err(cut_off())
}

fn cut_off() -> ReadError {
    invalid(None, "coefficient stream", "whole coefficients", "one cut off".into())
}

/// The decoder's state, and bytes to come.
struct State<'a> {
    state: u32,
    bytes: &'a [u8],
}

impl<'a> State<'a> {
    fn begin(bytes: &'a [u8]) -> Result<Self, ReadError> {
        let Some((first, bytes)) = bytes.split_first_chunk::<4>() else { return Err(cut_off()) };
        let state = u32::from_le_bytes(*first);
        if (LEAST_STATE..LEAST_STATE << 8).contains(&state) {
            Ok(Self { state, bytes })
        } else {
            Err(cut_off())
        }
    }

    /// The encoder began with the least state and no byte: so must the decoder end.
    fn end(&self) -> Result<(), ReadError> {
        if self.state == LEAST_STATE && self.bytes.is_empty() { Ok(()) } else { Err(cut_off()) }
    }

    #[inline(always)]
    fn refill(&mut self) -> Result<(), ReadError> {
        while self.state < LEAST_STATE {
            let Some((&byte, rest)) = self.bytes.split_first() else { return Err(cut_off()) };
            self.state = self.state << 8 | u32::from(byte);
            self.bytes = rest;
        }
        Ok(())
    }

    #[inline(always)]
    fn symbol(&mut self, table: &Table) -> Result<usize, ReadError> {
        // A table without symbols has no slot.
        let Some(slot) = table.slots.get((self.state & (SHARES - 1)) as usize) else { return Err(cut_off()) };
        self.state = u32::from(slot.share) * (self.state >> SHARE_BITS) + u32::from(slot.within);
        self.refill()?;
        Ok(usize::from(slot.symbol))
    }

    /// `count` bits, highest first: symbols of equal shares, at most twelve bits each.
    fn bits(&mut self, mut count: u32) -> Result<u32, ReadError> {
        let mut value = 0;
        while count > 0 {
            let part = count.min(SHARE_BITS);
            let low = self.state & (SHARES - 1);
            let share_bits = SHARE_BITS - part;
            value = value << part | low >> share_bits;
            self.state = (self.state >> SHARE_BITS << share_bits) + (low & ((1 << share_bits) - 1));
            self.refill()?;
            count -= part;
        }
        Ok(value)
    }

    #[inline(always)]
    fn gap(&mut self, table: &Table) -> Result<usize, ReadError> {
        let symbol = self.symbol(table)?;
        if symbol < PLAIN_GAPS {
            return Ok(symbol);
        }
        let bits = (symbol - PLAIN_GAPS) as u32 + PLAIN_GAPS.ilog2();
        Ok(1 << bits | self.bits(bits)? as usize)
    }
}

/// Rows of the codec without what reads them.
pub(super) fn no_tables() -> ReadError {
    invalid(None, "codec", "one with its tables in the section's head", "entropy without".into())
}
