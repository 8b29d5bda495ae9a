//! Lays a streak's shares over pixels and into the mask, four pixels at a time.

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

/// How much of each of four pixels a streak covers: what is below nothing, or no number, is nothing.
#[inline(always)]
fn alpha_of(shares: &[f32; BLOCK], strength: f32) -> Vec4 {
    let value = Vec4::from_array(*shares) * strength;
    Vec4::select(value.cmpgt(Vec4::ZERO), value, Vec4::ZERO).min(Vec4::ONE)
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
    strength: f32,
    colour: [f32; 3],
}

impl Work for Lay<'_, '_> {
    #[inline(always)]
    fn run<R: Registers>(self, registers: R) {
        let Self { under, ribbon, clip, strength, colour } = self;
        if ribbon.columns {
            under.lay_columns(ribbon, clip, strength, colour);
        } else {
            under.lay_rows(registers, ribbon, clip, (strength, colour));
        }
    }
}

impl Under<'_> {
    /// Lays a ribbon's part inside `clip`.
    pub fn lay_ribbon(&mut self, ribbon: &Ribbon, clip: Clip, strength: f32, colour: [f32; 3]) {
        registers::run(Lay { under: self, ribbon, clip, strength, colour });
    }

    /// [`Under::lay_ribbon`] of lines that are rows.
    #[inline(always)]
    fn lay_rows(
        &mut self,
        registers: impl Registers,
        ribbon: &Ribbon,
        clip: Clip,
        (strength, colour): (f32, [f32; 3]),
    ) {
        let count = (ribbon.blocks * BLOCK) as i32;
        let colours = spread(colour);
        for (y, first, shares) in ribbon.lines() {
            let end = first.saturating_add(count);
            if y < clip.top || y >= clip.bottom {
                continue;
            }
            if first >= clip.left && end <= clip.right {
                let at = (y as usize - self.top) * self.width + first as usize;
                for (block, shares) in shares.iter().enumerate() {
                    self.lay_block(registers, at + block * BLOCK, alpha_of(shares, strength), &colours);
                }
            } else if end > clip.left && first < clip.right {
                let (from, to) = (first.max(clip.left), end.min(clip.right));
                let at = (y as usize - self.top) * self.width + from as usize;
                let own = &shares.as_flattened()[(from - first) as usize..(to - first) as usize];
                for (at, &share) in (at..).zip(own) {
                    self.lay_pixel(at, alpha_of(&[share; BLOCK], strength).x, colour);
                }
            }
        }
    }

    /// [`Under::lay_ribbon`] of lines that are columns.
    #[inline(always)]
    fn lay_columns(&mut self, ribbon: &Ribbon, clip: Clip, strength: f32, colour: [f32; 3]) {
        for (x, first, shares) in ribbon.lines() {
            let end = first.saturating_add((ribbon.blocks * BLOCK) as i32);
            let (from, to) = (first.max(clip.top), end.min(clip.bottom));
            if from >= to || x < clip.left || x >= clip.right {
                continue;
            }
            let own = &shares.as_flattened()[(from - first) as usize..(to - first) as usize];
            for (y, &share) in (from..).zip(own) {
                let at = (y as usize - self.top) * self.width + x as usize;
                self.lay_pixel(at, alpha_of(&[share; BLOCK], strength).x, colour);
            }
        }
    }

    /// Lays the first `count` of a row's shares, which are padded to whole blocks, from the pixel (x, y) on.
    #[inline(always)]
    pub fn lay_span(
        &mut self,
        [x, y]: [i32; 2],
        count: usize,
        shares: &[f32],
        (strength, colour): (f32, [f32; 3]),
    ) {
        let at = (y as usize - self.top) * self.width + x as usize;
        let (blocks, _) = shares.as_chunks::<BLOCK>();
        let colours = spread(colour);
        let whole = count / BLOCK;
        for (block, shares) in blocks[..whole].iter().enumerate() {
            self.lay_block(Plain, at + block * BLOCK, alpha_of(shares, strength), &colours);
        }
        if let Some(shares) = blocks.get(whole) {
            let alpha = alpha_of(shares, strength).to_array();
            for (at, alpha) in (at + whole * BLOCK..).zip(&alpha[..count % BLOCK]) {
                self.lay_pixel(at, *alpha, colour);
            }
        }
    }

    /// Four pixels of a row from `at` on.
    #[inline(always)]
    fn lay_block(&mut self, registers: impl Registers, at: usize, alpha: Vec4, colours: &[f32; 12]) {
        let pixels = self.pixels.get_mut(at..).and_then(<[[f32; 3]]>::first_chunk_mut::<BLOCK>);
        let mask = self.mask.get_mut(at..).and_then(<[f32]>::first_chunk_mut::<BLOCK>);
        let (Some(pixels), Some(mask)) = (pixels, mask) else { return };
        if let Some(light) = pixels.as_flattened_mut().first_chunk_mut() {
            registers.lay(light, mask, alpha.to_array(), colours);
        }
    }

    /// One pixel.
    #[inline(always)]
    fn lay_pixel(&mut self, at: usize, alpha: f32, colour: [f32; 3]) {
        let (Some(pixel), Some(mask)) = (self.pixels.get_mut(at), self.mask.get_mut(at)) else { return };
        let keep = 1.0 - alpha;
        for band in 0..3 {
            pixel[band] = pixel[band] * keep + alpha * colour[band];
        }
        *mask = *mask * keep + alpha;
    }
}
