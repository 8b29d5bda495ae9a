//! Lays a streak's shares over pixels and into the mask, four pixels at a time.
//!
//! A pixel keeps 1 − α of what is behind, α the coverage, and shows its share of the drop's light. In an even world that share is
//! the coverage, whatever the pattern: no drop can be seen there. How far light follows the pattern is the paint's contrast.

use crate::rain::kernel::{BLOCK, Clip, Ribbon};
use crate::registers::{self, Plain, Registers, Work};
use glam::Vec4;

/// A band of the picture and of its mask.
pub(super) struct Under<'a> {
    pub pixels: &'a mut [[f32; 3]],
    pub mask: &'a mut [f32],
    /// Pixels of a row, and the band's first row.
    pub width: usize,
    pub top: usize,
}

/// What a streak is laid with.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Paint {
    /// Its whole coverage, px².
    pub strength: f32,
    /// How far its light follows the pattern, in [0, 1]; the rest follows its coverage.
    pub contrast: f32,
    pub colour: [f32; 3],
}

impl Paint {
    /// How much of each of four pixels shows the streak's light, and how much is covered: what is below nothing, or no number, is
    /// nothing.
    #[inline(always)]
    fn over(&self, shares: &[f32; BLOCK], covers: &[f32; BLOCK]) -> [Vec4; 2] {
        let positive = |share: &[f32; BLOCK]| {
            let value = Vec4::from_array(*share) * self.strength;
            Vec4::select(value.cmpgt(Vec4::ZERO), value, Vec4::ZERO)
        };
        let (light, cover) = (positive(shares), positive(covers));
        let shown = cover + (light - cover) * self.contrast;
        let alpha = cover.min(Vec4::ONE);
        // A gain may ask for more than all of a pixel: light is then cut as coverage is.
        match cover.cmpgt(Vec4::ONE).any() {
            true => [shown / cover.max(Vec4::ONE), alpha],
            false => [shown, alpha],
        }
    }
}

/// A colour, four times over.
#[inline(always)]
fn spread([r, g, b]: [f32; 3]) -> [f32; 12] {
    [r, g, b, r, g, b, r, g, b, r, g, b]
}

/// The laying of a ribbon.
struct Lay<'a, 'b> {
    under: &'a mut Under<'b>,
    ribbon: &'a Ribbon,
    clip: Clip,
    paint: Paint,
}

impl Work for Lay<'_, '_> {
    #[inline(always)]
    fn run<R: Registers>(self, registers: R) {
        let Self { under, ribbon, clip, paint } = self;
        if ribbon.columns {
            under.lay_columns(ribbon, clip, &paint);
        } else {
            under.lay_rows(registers, ribbon, clip, &paint);
        }
    }
}

impl Under<'_> {
    /// Lays a ribbon's part inside `clip`.
    pub fn lay_ribbon(&mut self, ribbon: &Ribbon, clip: Clip, paint: Paint) {
        registers::run(Lay { under: self, ribbon, clip, paint });
    }

    /// [`Under::lay_ribbon`] of lines that are rows.
    #[inline(always)]
    fn lay_rows(&mut self, registers: impl Registers, ribbon: &Ribbon, clip: Clip, paint: &Paint) {
        let count = (ribbon.blocks * BLOCK) as i32;
        let colours = spread(paint.colour);
        for (y, first, [shares, covers]) in ribbon.lines() {
            let end = first.saturating_add(count);
            if y < clip.top || y >= clip.bottom {
                continue;
            }
            if first >= clip.left && end <= clip.right {
                let at = (y as usize - self.top) * self.width + first as usize;
                for (block, (shares, covers)) in shares.iter().zip(covers).enumerate() {
                    self.lay_block(registers, at + block * BLOCK, paint.over(shares, covers), &colours);
                }
            } else if end > clip.left && first < clip.right {
                let (from, to) = (first.max(clip.left), end.min(clip.right));
                let at = (y as usize - self.top) * self.width + from as usize;
                self.lay_some(at, 1, [shares, covers], (from - first) as usize..(to - first) as usize, paint);
            }
        }
    }

    /// [`Under::lay_ribbon`] of lines that are columns.
    #[inline(always)]
    fn lay_columns(&mut self, ribbon: &Ribbon, clip: Clip, paint: &Paint) {
        for (x, first, blocks) in ribbon.lines() {
            let end = first.saturating_add((ribbon.blocks * BLOCK) as i32);
            let (from, to) = (first.max(clip.top), end.min(clip.bottom));
            if from >= to || x < clip.left || x >= clip.right {
                continue;
            }
            let at = (from as usize - self.top) * self.width + x as usize;
            self.lay_some(at, self.width, blocks, (from - first) as usize..(to - first) as usize, paint);
        }
    }

    /// Some pixels of a line, the first of them at `at` and the next `step` further on.
    #[inline(always)]
    fn lay_some(
        &mut self,
        at: usize,
        step: usize,
        [shares, covers]: [&[[f32; BLOCK]]; 2],
        some: std::ops::Range<usize>,
        paint: &Paint,
    ) {
        let places = (at..).step_by(step);
        let own = shares.as_flattened()[some.clone()].iter().zip(&covers.as_flattened()[some]);
        for (at, (&share, &cover)) in places.zip(own) {
            let [shown, alpha] = paint.over(&[share; BLOCK], &[cover; BLOCK]);
            self.lay_pixel(at, [shown.x, alpha.x], paint.colour);
        }
    }

    /// Lays the first `count` of a row's shares, which are padded to whole blocks, from the pixel (x, y) on.
    #[inline(always)]
    pub fn lay_span(&mut self, [x, y]: [i32; 2], count: usize, [shares, covers]: [&[f32]; 2], paint: &Paint) {
        let at = (y as usize - self.top) * self.width + x as usize;
        let ((shares, _), (covers, _)) = (shares.as_chunks::<BLOCK>(), covers.as_chunks::<BLOCK>());
        let colours = spread(paint.colour);
        let whole = count / BLOCK;
        for (block, (shares, covers)) in shares.iter().zip(covers).take(whole).enumerate() {
            self.lay_block(Plain, at + block * BLOCK, paint.over(shares, covers), &colours);
        }
        if let (Some(shares), Some(covers)) = (shares.get(whole), covers.get(whole)) {
            let [shown, alpha] = paint.over(shares, covers).map(|four| four.to_array());
            let pairs = shown.iter().zip(&alpha).take(count % BLOCK);
            for (at, (&shown, &alpha)) in (at + whole * BLOCK..).zip(pairs) {
                self.lay_pixel(at, [shown, alpha], paint.colour);
            }
        }
    }

    /// Four pixels of a row from `at` on.
    #[inline(always)]
    fn lay_block(&mut self, registers: impl Registers, at: usize, over: [Vec4; 2], colours: &[f32; 12]) {
        let pixels = self.pixels.get_mut(at..).and_then(<[[f32; 3]]>::first_chunk_mut::<BLOCK>);
        let mask = self.mask.get_mut(at..).and_then(<[f32]>::first_chunk_mut::<BLOCK>);
        let (Some(pixels), Some(mask)) = (pixels, mask) else { return };
        if let Some(light) = pixels.as_flattened_mut().first_chunk_mut() {
            registers.lay(light, mask, over.map(|four| four.to_array()), colours);
        }
    }

    /// One pixel.
    #[inline(always)]
    fn lay_pixel(&mut self, at: usize, [shown, alpha]: [f32; 2], colour: [f32; 3]) {
        let (Some(pixel), Some(mask)) = (self.pixels.get_mut(at), self.mask.get_mut(at)) else { return };
        let keep = 1.0 - alpha;
        for band in 0..3 {
            pixel[band] = pixel[band] * keep + shown * colour[band];
        }
        *mask = *mask * keep + alpha;
    }
}
