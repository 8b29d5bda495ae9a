//! The asset's rows on the card, turned over: not coefficients by row but rows by coefficient, so that each coefficient of a sum
//! is gathered by one thread, without atomics and in the same order every time.
//!
//! Of a grid's places few are used by any row; those are numbered, and sums are as long as their number.

use super::binding::{Kernel, Slot};
use super::clock::{Pass, groups_of};
use super::memory::Held;
use super::shader::ROWS;
use super::{Gpu, LARGEST_BINDING};
use crate::error::RuntimeError;
use crate::relight::{Relighter, SourceWeight};
use squall_formats::section::response::{coefficient_planes, each_coefficient};

/// Longest piece of a list that one thread sums.
const PIECE: usize = 16;
/// What marks a place of a sum as one of several pieces.
const IS_PART: u32 = 1 << 31;

/// The rows of an asset.
pub struct Rows {
    chunks: Vec<Chunk>,
    merges: u32,
    layouts: [wgpu::BindGroupLayout; 2],
    kernels: [Kernel; 2],
    rows: usize,
    /// Number of each place among the used ones, from 1; 0: no row has anything there.
    pub places: Vec<u32>,
    /// Places used.
    used: usize,
    /// Coefficients of a place, rounded up to whole vectors of four.
    pub stride: usize,
    parts: usize,
}

/// Lists whose entries fit one binding.
struct Chunk {
    group: wgpu::BindGroup,
    pieces: u32,
    _buffers: [Held<wgpu::Buffer>; 3],
}

/// One sum of rows.
pub struct RowSum {
    weights: Held<wgpu::Buffer>,
    /// Coefficients of the used places, [`Rows::stride`] a place.
    pub coefficients: Held<wgpu::Buffer>,
    _parts: Held<wgpu::Buffer>,
    group: wgpu::BindGroup,
}

/// All lists, before they are cut into pieces.
struct Lists {
    /// Where each list ends among the entries; one a used place and coefficient.
    ends: Vec<usize>,
    /// Row and bits of the value.
    entries: Vec<[u32; 2]>,
}

impl Rows {
    /// Turns the asset's rows over and brings them to the card.
    ///
    /// Errors: a damaged row; more used places than a binding holds.
    pub fn new(gpu: &Gpu, relighter: &Relighter) -> Result<Self, RuntimeError> {
        // All of them at once, of an asset that is read piece by piece.
        relighter.response().fetch(0..relighter.response().row_count())?;
        let head = &relighter.response().head;
        let (cells, planes) = (head.shape.len(), head.basis.count());
        let stride = planes.next_multiple_of(4);
        let mut places = vec![0u32; cells];
        relighter.each_coefficient(|_, _, place, _| places[place] = 1)?;
        let mut used = 0;
        for place in places.iter_mut().filter(|place| **place > 0) {
            used += 1;
            *place = used;
        }
        let used = used as usize;
        if (used * stride * 4) as u64 > LARGEST_BINDING {
            let most = LARGEST_BINDING as usize / (stride * 4);
            let wanted = format!("an asset whose rows use at most {most} Haar coefficients");
            return Err(RuntimeError::Device { wanted, found: used.to_string() });
        }
        let mut lists = Lists { ends: vec![0; used * planes], entries: Vec::new() };
        let list = |place: usize, plane: usize| (places[place] as usize - 1) * planes + plane;
        relighter.each_coefficient(|_, plane, place, _| lists.ends[list(place, plane)] += 1)?;
        let mut total = 0;
        for end in &mut lists.ends {
            (*end, total) = (total, total + *end);
        }
        lists.entries = vec![[0; 2]; total];
        relighter.each_coefficient(|row, plane, place, value| {
            let end = &mut lists.ends[list(place, plane)];
            lists.entries[*end] = [row as u32, value.to_bits()];
            *end += 1;
        })?;
        Ok(Self::of_lists(gpu, &lists, (relighter.response().row_count(), planes), places))
    }

    fn of_lists(gpu: &Gpu, lists: &Lists, (rows, planes): (usize, usize), places: Vec<u32>) -> Self {
        let stride = planes.next_multiple_of(4);
        let layouts = [
            gpu.layout("rows", &[Slot::Read, Slot::Read, Slot::Read]),
            gpu.layout("sum of rows", &[Slot::Read, Slot::Write, Slot::Write]),
        ];
        let module = gpu.module(&ROWS);
        let groups = [None, Some(&layouts[0]), Some(&layouts[1])];
        let kernels = ["sum_rows", "merge_parts"].map(|entry| gpu.kernel(&module, entry, &groups));
        let most = LARGEST_BINDING as usize / 2 / 8;
        let (mut merges, mut parts) = (Vec::new(), 0u32);
        // Pieces and the entries they begin at, chunk by chunk.
        let mut cuts: Vec<(Vec<[u32; 2]>, std::ops::Range<usize>)> = vec![(Vec::new(), 0..0)];
        let mut start = 0;
        for (list, &end) in lists.ends.iter().enumerate() {
            let target = (list / planes * stride + list % planes) as u32;
            let pieces = (end - start).div_ceil(PIECE);
            if pieces > 1 {
                merges.push([parts, pieces as u32, target, 0]);
            }
            for piece in 0..pieces {
                let from = start + piece * PIECE;
                let to = (from + PIECE).min(end);
                if cuts.last().is_some_and(|(_, range)| to - range.start > most) {
                    cuts.push((Vec::new(), from..from));
                }
                let goal = if pieces > 1 { parts | IS_PART } else { target };
                parts += u32::from(pieces > 1);
                if let Some((pieces, range)) = cuts.last_mut() {
                    pieces.push([(from - range.start) as u32, goal]);
                    range.end = to;
                }
            }
            start = end;
        }
        let merged = merges.len() as u32;
        let chunk = |(mut pieces, range): (Vec<[u32; 2]>, std::ops::Range<usize>)| {
            let count = pieces.len() as u32;
            pieces.push([range.len() as u32, 0]);
            let buffers = [
                gpu.storage("entries of rows", &lists.entries[range]),
                gpu.storage("pieces of rows", &pieces),
                gpu.storage("merged pieces", &merges),
            ];
            let resources = buffers.each_ref().map(|buffer| buffer.as_entire_binding());
            Chunk { group: gpu.group("rows", &layouts[0], &resources), pieces: count, _buffers: buffers }
        };
        let chunks = cuts.into_iter().map(chunk).collect();
        let used = lists.ends.len() / planes.max(1);
        Self { chunks, merges: merged, layouts, kernels, rows, places, used, stride, parts: parts as usize }
    }

    /// Room for one sum.
    pub fn sum(&self, gpu: &Gpu) -> RowSum {
        use wgpu::BufferUsages as Use;
        let floats =
            |label: &str, count: usize| gpu.buffer(label, 4 * count as u64, Use::STORAGE | Use::COPY_SRC);
        let weights = floats("weights of rows", self.rows);
        let coefficients = floats("summed coefficients", self.used * self.stride);
        let parts = floats("parts of sums", self.parts);
        let resources = [&weights, &coefficients, &parts].map(|buffer| buffer.as_entire_binding());
        let group = gpu.group("sum of rows", &self.layouts[1], &resources);
        RowSum { weights, coefficients, _parts: parts, group }
    }

    /// Tells the next submission how bright the sources of `sum` are.
    pub fn weigh(&self, gpu: &Gpu, sum: &RowSum, sources: &[SourceWeight]) {
        let mut weights = vec![0.0f32; self.rows];
        for source in sources {
            weights[source.row as usize] += source.intensity;
        }
        gpu.write(&sum.weights, &weights);
    }

    /// Puts one sum on record.
    pub fn run(&self, pass: &mut Pass<'_>, sum: &RowSum) {
        for chunk in &self.chunks {
            let groups = [None, Some(&chunk.group), Some(&sum.group)];
            pass.run(&self.kernels[0], &groups, groups_of(chunk.pieces, 64));
        }
        if self.merges > 0 {
            let groups = [None, Some(&self.chunks[0].group), Some(&sum.group)];
            pass.run(&self.kernels[1], &groups, groups_of(self.merges, 64));
        }
    }
}

impl Relighter {
    /// Hands every coefficient of every row that holds light in all cells to `each`: row, plane, place, value. Rows in windows are summed
    /// elsewhere.
    ///
    /// Errors: a damaged row.
    fn each_coefficient(&self, mut each: impl FnMut(usize, usize, usize, f32)) -> Result<(), RuntimeError> {
        let response = self.response();
        let (cells, planes) = (response.head.shape.len(), response.head.basis.count());
        let full = response.head.finer.first().map_or(response.row_count(), |level| level.first_row as usize);
        for row in 0..full {
            let parts = coefficient_planes(response.row(row)?, planes).map_err(|error| self.wrap(error))?;
            for (plane, part) in parts.iter().enumerate() {
                if part.mean != 0.0 {
                    each(row, plane, 0, part.mean);
                }
                each_coefficient(part, &response.code, cells, |place, value| each(row, plane, place, value))
                    .map_err(|error| self.wrap(error))?;
            }
        }
        Ok(())
    }
}
