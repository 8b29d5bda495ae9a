//! Rows of codec `Bytes` coded anew: counts over all of them, then each by itself.

use super::{
    ESCAPED, EntropyRecord, FAR_GAPS, GAP_SYMBOLS, LARGEST_GAP_SHARE, LARGEST_VALUE, LEAST_STATE, PLAIN_GAPS,
    SHARE_BITS, SHARES, VALUE_SYMBOLS, most_places, table_behind,
};
use crate::section::response::head::Codec;
use crate::section::response::stream::{Coefficient, CoefficientPlane, RowCode, coefficient_planes, walk};

/// How often each symbol comes.
type Counts = Vec<u64>;

/// Shares of each symbol, and where they begin.
struct Shares {
    of: Vec<u16>,
    starts: Vec<u32>,
}

impl Shares {
    /// Shares of 4096 near to how often symbols come; whatever comes has one at least.
    fn near(counts: &Counts) -> Self {
        let total: u64 = counts.iter().sum();
        let mut of: Vec<u16> = vec![0; counts.len()];
        if total > 0 {
            let share = |count: u64| (count * u64::from(SHARES) / total).max(u64::from(count > 0)) as u16;
            of.iter_mut().zip(counts).for_each(|(own, &count)| *own = share(count));
            // What rounding left or took is the commonest symbols'.
            let mut left = i64::from(SHARES) - of.iter().map(|&share| i64::from(share)).sum::<i64>();
            while left != 0 {
                let most = (0..of.len()).max_by_key(|&at| (of[at], usize::MAX - at)).unwrap_or(0);
                let step = if left > 0 { left } else { left.max(-i64::from(of[most] / 2)) };
                of[most] = (i64::from(of[most]) + step) as u16;
                left -= step;
            }
        }
        Self::of(of)
    }

    /// The same with no share above `most`: what the commonest symbol has beyond it is the next one's.
    fn below(counts: &Counts, most: u16) -> Self {
        let mut of = Self::near(counts).of;
        if let Some(at) = (0..of.len()).find(|&at| of[at] > most) {
            of.resize(counts.len(), 0);
            let next = (at + 1) % counts.len();
            of[next] += of[at] - most;
            of[at] = most;
        }
        Self::of(of)
    }

    fn of(mut of: Vec<u16>) -> Self {
        while of.last() == Some(&0) {
            of.pop();
        }
        let starts = of.iter().scan(0, |sum, &share| {
            let start = *sum;
            *sum += u32::from(share);
            Some(start)
        });
        Self { starts: starts.collect(), of }
    }
}

/// What a stream is made of, in the order in which it is read: a share's start and size.
#[derive(Default)]
struct Symbols(Vec<(u32, u32)>);

impl Symbols {
    fn symbol(&mut self, shares: &Shares, symbol: usize) {
        self.0.push((shares.starts[symbol], u32::from(shares.of[symbol])));
    }

    fn bits(&mut self, value: u32, mut count: u32) {
        while count > 0 {
            let part = count.min(SHARE_BITS);
            count -= part;
            let size = 1 << (SHARE_BITS - part);
            self.0.push(((value >> count & ((1 << part) - 1)) * size, size));
        }
    }

    fn gap(&mut self, shares: &Shares, gap: usize) {
        let (symbol, bits) = gap_symbol(gap);
        self.symbol(shares, symbol);
        self.bits((gap & ((1 << bits) - 1)) as u32, bits);
    }

    /// The stream of `count` things; takes the symbols.
    fn coded(&mut self, mut count: u64) -> Vec<u8> {
        if count == 0 {
            return Vec::new();
        }
        let (mut state, mut bytes) = (LEAST_STATE, Vec::new());
        // Backwards, so that it is read forwards.
        for (start, size) in self.0.drain(..).rev() {
            while state >= (LEAST_STATE >> SHARE_BITS << 8) * size {
                bytes.push(state as u8);
                state >>= 8;
            }
            state = ((state / size) << SHARE_BITS) + state % size + start;
        }
        let mut out = Vec::new();
        while count > 0x7f {
            out.push(count as u8 | 0x80);
            count >>= 7;
        }
        out.push(count as u8);
        out.extend(state.to_le_bytes());
        out.extend(bytes.iter().rev());
        out
    }
}

fn gap_symbol(gap: usize) -> (usize, u32) {
    if gap < PLAIN_GAPS {
        return (gap, 0);
    }
    let bits = gap.ilog2();
    (PLAIN_GAPS + (bits - PLAIN_GAPS.ilog2()) as usize, bits)
}

fn value_symbol(coefficient: &Coefficient) -> usize {
    match *coefficient {
        Coefficient::Steps(steps) if usize::from(steps.unsigned_abs()) <= LARGEST_VALUE => {
            2 * (usize::from(steps.unsigned_abs()) - 1) + usize::from(steps < 0)
        }
        _ => ESCAPED,
    }
}

/// Coefficients of a plane that are not 0, in rising index.
fn coefficients(plane: &CoefficientPlane<'_>, cells: usize) -> Vec<(usize, Coefficient)> {
    let mut all = Vec::new();
    let read = walk(plane, &RowCode::plain(Codec::Bytes), cells, |index, coefficient| {
        if !matches!(coefficient, Coefficient::Steps(0)) {
            all.push((index, coefficient));
        }
    });
    debug_assert!(read.is_ok(), "a writer's own stream");
    all
}

/// A row's planes: mean, step, coefficients.
type Planes = Vec<(f32, f32, Vec<(usize, Coefficient)>)>;

/// `rows` of codec `Bytes`, each of so many cells, in codec `Entropy`; `cells` are those of the grid. Nothing where that is no shorter.
pub fn transcoded(
    rows: &[Vec<u8>],
    row_cells: &dyn Fn(usize) -> usize,
    (cells, planes): (usize, usize),
) -> Option<(EntropyRecord, Vec<Vec<u8>>)> {
    let read = |(row, bytes): (usize, &Vec<u8>)| -> Option<Planes> {
        let parts = coefficient_planes(bytes, planes).ok()?;
        let part = |part: &CoefficientPlane<'_>| (part.mean, part.step, coefficients(part, row_cells(row)));
        Some(parts.iter().map(part).collect())
    };
    // Twice over the rows, so that no more than one is held unpacked.
    let mut used = vec![false; cells];
    for (row, bytes) in rows.iter().enumerate().filter(|&(row, _)| row_cells(row) == cells) {
        let found = read((row, bytes))?;
        found.iter().flat_map(|(_, _, list)| list).for_each(|&(index, _)| used[index] = true);
    }
    let places: Vec<u32> = (1..cells as u32).filter(|&index| used[index as usize]).collect();
    let old: u64 = rows.iter().map(|row| row.len() as u64).sum();
    // Fewer bytes of rows come out than went in, but seldom a sixteenth.
    let listed = places.len() < cells.saturating_sub(1) && places.len() as u64 <= most_places(old / 16);
    let rank_of: Option<Vec<u32>> = listed.then(|| {
        let mut rank = vec![0; cells];
        places.iter().zip(0..).for_each(|(&place, at)| rank[place as usize] = at);
        rank
    });
    let rank = |row: usize, index: usize| match &rank_of {
        Some(ranks) if row_cells(row) == cells => ranks[index] as usize,
        _ => index - 1,
    };

    let mut gaps: Counts = vec![0; GAP_SYMBOLS];
    let mut values: [Counts; FAR_GAPS.len() + 1] = std::array::from_fn(|_| vec![0; VALUE_SYMBOLS]);
    for (row, bytes) in rows.iter().enumerate() {
        for (_, _, list) in read((row, bytes))? {
            let mut next = 0;
            for (index, coefficient) in list {
                let gap = rank(row, index) - next;
                next = rank(row, index) + 1;
                gaps[gap_symbol(gap).0] += 1;
                values[table_behind(gap)][value_symbol(&coefficient)] += 1;
            }
        }
    }
    let (gap_shares, value_shares) =
        (Shares::below(&gaps, LARGEST_GAP_SHARE), values.map(|counts| Shares::near(&counts)));
    let mut symbols = Symbols::default();
    let mut out = Vec::with_capacity(rows.len());
    for (row, bytes) in rows.iter().enumerate() {
        let (mut heads, mut streams) = (Vec::new(), Vec::new());
        for (mean, step, list) in read((row, bytes))? {
            let mut next = 0;
            for (index, coefficient) in &list {
                let gap = rank(row, *index) - next;
                next = rank(row, *index) + 1;
                symbols.gap(&gap_shares, gap);
                symbols.symbol(&value_shares[table_behind(gap)], value_symbol(coefficient));
                if let Coefficient::Exact(value) = coefficient {
                    symbols.bits(value.to_bits(), 32);
                }
            }
            let stream = symbols.coded(list.len() as u64);
            heads.extend_from_slice(&mean.to_le_bytes());
            heads.extend_from_slice(&step.to_le_bytes());
            heads.extend_from_slice(&(stream.len() as u32).to_le_bytes());
            streams.extend_from_slice(&stream);
        }
        heads.extend_from_slice(&streams);
        out.push(heads);
    }
    let mut record = EntropyRecord {
        gaps: gap_shares.of,
        values: value_shares.map(|shares| shares.of),
        ..EntropyRecord::default()
    };
    if listed {
        (record.place_gaps, record.places) = coded_places(&places);
    }
    let new: u64 = out.iter().map(|row| row.len() as u64).sum();
    let sound = !listed || places.len() as u64 <= most_places(new);
    (sound && new + record.bytes() < old).then_some((record, out))
}

/// The places' gaps: how often each comes, and their stream.
fn coded_places(places: &[u32]) -> (Vec<u16>, Option<Vec<u8>>) {
    let before = std::iter::once(0).chain(places.iter().copied());
    let steps: Vec<usize> =
        places.iter().zip(before).map(|(&place, before)| (place - before - 1) as usize).collect();
    let mut counts: Counts = vec![0; GAP_SYMBOLS];
    steps.iter().for_each(|&gap| counts[gap_symbol(gap).0] += 1);
    let shares = Shares::near(&counts);
    let mut symbols = Symbols::default();
    steps.iter().for_each(|&gap| symbols.gap(&shares, gap));
    let stream = symbols.coded(steps.len() as u64);
    (shares.of, Some(stream))
}

impl EntropyRecord {
    /// Bytes in the section's head, lengths included.
    fn bytes(&self) -> u64 {
        let tables = [&self.place_gaps, &self.gaps].into_iter().chain(&self.values);
        let tables: usize = tables.map(|table| 8 + 2 * table.len()).sum();
        (tables + 1 + self.places.as_ref().map_or(0, |places| 8 + places.len())) as u64
    }
}
