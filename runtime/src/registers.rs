//! Which registers work runs in: those that every machine has, or the widest of this one.
//!
//! All of them run the same additions and multiplications in the same order, none fused, so that the bytes are the same.

use glam::{Vec4, Vec4Swizzles};

/// Runs `work`, which is inlined, with the widest registers of this machine.
#[cfg(feature = "simd")]
pub(crate) fn in_registers(work: impl FnOnce()) {
    use fearless_simd::Simd;
    fearless_simd::dispatch!(*LEVEL, simd => simd.vectorize(work));
}

/// Runs `work` with the registers that every machine has.
#[cfg(not(feature = "simd"))]
pub(crate) fn in_registers(work: impl FnOnce()) {
    work();
}

/// What this machine has, asked once.
#[cfg(feature = "simd")]
static LEVEL: std::sync::LazyLock<fearless_simd::Level> = std::sync::LazyLock::new(fearless_simd::Level::new);

/// Work that is written for registers of some width; `run` and all that it calls are `#[inline(always)]`.
pub(crate) trait Work {
    /// The work.
    fn run<R: Registers>(self, registers: R);
}

/// What a streak's products are turned into: pixel by pixel, the factors of its coverage and of its pattern's light in red, green, blue and
/// the coverage itself.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look {
    pub cover: [f32; 16],
    pub light: [f32; 16],
}

/// Work on four pixels of a [`crate::rain::tile_buffer::TileBuffer`], each of red, green, blue and coverage, and on a thin streak's tables: three products of light and one of
/// coverage, pixel by pixel.
pub(crate) trait Registers: Copy {
    /// Sum of four tables' nodes with their weights: the first two, the last two, and both.
    fn mix(self, out: &mut [f32; 16], tables: [&[f32; 16]; 4], weights: [f32; 4]);

    /// The same of tables of one product, which is light's first and coverage's: what lies between is nothing.
    fn mix_one(self, out: &mut [f32; 16], tables: [&[f32; 4]; 4], weights: [f32; 4]);

    /// Lays a streak over four pixels: (low + (high − low) · share) · (value + gain · (at + step)), `steps` one for each pixel, four times over; of that the sum
    /// of the first three is light, and the last coverage.
    fn lay_line(
        self,
        cells: &mut [f32; 16],
        nodes: [&[f32; 16]; 2],
        share: f32,
        along: (&[[f32; 4]; 2], f32, &[f32; 16]),
        look: &Look,
    );

    /// The same where each pixel has its own value and gain along, at its own place.
    fn lay_end(
        self,
        cells: &mut [f32; 16],
        nodes: [&[f32; 16]; 2],
        share: f32,
        along: [(&[[f32; 4]; 2], f32); 4],
        look: &Look,
    );

    /// Lays a colour over four pixels: `over` is how much of it each shows, and how much of each is covered. The colour's fourth number is 1.
    fn lay(self, cells: &mut [f32; 16], over: [[f32; 4]; 2], colour: &[f32; 4]);

    /// Lays four pixels of a tile buffer over those of a picture, and into their mask.
    fn uncover(self, cells: &[f32; 16], light: &mut [f32; 12], mask: &mut [f32; 4]);
}

/// Runs `work` with explicit registers: 512 or 256 bits where the machine has them.
pub(crate) fn run(work: impl Work) {
    #[cfg(all(feature = "simd", target_arch = "x86_64"))]
    {
        use fearless_simd::Simd;
        if let Some(simd) = LEVEL.as_avx512() {
            return simd.vectorize(
                #[inline(always)]
                || work.run(Wide(simd)),
            );
        }
        if let Some(simd) = LEVEL.as_avx2() {
            return simd.vectorize(
                #[inline(always)]
                || work.run(Wide(simd)),
            );
        }
    }
    work.run(Plain);
}

/// Four numbers at a time, as every machine has them.
#[derive(Clone, Copy)]
pub(crate) struct Plain;

/// What is below nothing, or no number, is nothing.
#[inline(always)]
pub(crate) fn positive(value: Vec4) -> Vec4 {
    Vec4::select(value.cmpgt(Vec4::ZERO), value, Vec4::ZERO)
}

impl Plain {
    /// One pixel under what `products` show of a streak.
    #[inline(always)]
    fn lay_pixel(cell: &mut [f32; 4], products: Vec4, cover: &[f32; 4], light: &[f32; 4]) {
        let shown = positive(Vec4::splat((products.x + products.y) + products.z));
        let hidden = positive(Vec4::splat(products.w));
        let under = Vec4::from_array(*cell);
        let gain = hidden * (Vec4::from_array(*cover) - under);
        *cell = (under + (gain + shown * Vec4::from_array(*light))).to_array();
    }

    #[inline(always)]
    fn sum(tables: [&[f32; 4]; 4], weights: [f32; 4]) -> Vec4 {
        let [a, b, c, d] = tables.map(|table| Vec4::from_array(*table));
        (a * weights[0] + b * weights[1]) + (c * weights[2] + d * weights[3])
    }

    /// A table's values at a share of the way from one node to the next.
    #[inline(always)]
    fn between(low: &[f32; 4], high: &[f32; 4], share: f32) -> Vec4 {
        let low = Vec4::from_array(*low);
        low + (Vec4::from_array(*high) - low) * share
    }
}

impl Registers for Plain {
    #[inline(always)]
    fn mix(self, out: &mut [f32; 16], tables: [&[f32; 16]; 4], weights: [f32; 4]) {
        let [a, b, c, d] = tables.map(|table| table.as_chunks::<4>().0);
        for (i, out) in out.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            *out = Self::sum([&a[i], &b[i], &c[i], &d[i]], weights).to_array();
        }
    }

    #[inline(always)]
    fn mix_one(self, out: &mut [f32; 16], tables: [&[f32; 4]; 4], weights: [f32; 4]) {
        let sum = Self::sum(tables, weights).to_array();
        for (out, own) in out.as_chunks_mut::<4>().0.iter_mut().zip(sum) {
            *out = [own, 0.0, 0.0, own];
        }
    }

    #[inline(always)]
    fn lay_line(
        self,
        cells: &mut [f32; 16],
        nodes: [&[f32; 16]; 2],
        share: f32,
        (along, at, steps): (&[[f32; 4]; 2], f32, &[f32; 16]),
        look: &Look,
    ) {
        let pixels = std::array::from_fn(|pixel| (along, at + steps[4 * pixel]));
        self.lay_end(cells, nodes, share, pixels, look);
    }

    #[inline(always)]
    fn lay_end(
        self,
        cells: &mut [f32; 16],
        nodes: [&[f32; 16]; 2],
        share: f32,
        along: [(&[[f32; 4]; 2], f32); 4],
        look: &Look,
    ) {
        let [low, high] = nodes.map(|node| node.as_chunks::<4>().0);
        let (covers, lights) = (look.cover.as_chunks::<4>().0, look.light.as_chunks::<4>().0);
        for (pixel, cell) in cells.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let ([value, gain], at) = along[pixel];
            let factor = Vec4::from_array(*value) + Vec4::from_array(*gain) * at;
            let products = Self::between(&low[pixel], &high[pixel], share) * factor;
            Self::lay_pixel(cell, products, &covers[pixel], &lights[pixel]);
        }
    }

    #[inline(always)]
    fn lay(self, cells: &mut [f32; 16], [shown, hidden]: [[f32; 4]; 2], colour: &[f32; 4]) {
        let colour = Vec4::from_array(*colour);
        for (pixel, cell) in cells.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let own = Vec4::splat(shown[pixel]).with_w(hidden[pixel]) * colour;
            *cell = (Vec4::from_array(*cell) * (Vec4::ONE - Vec4::splat(hidden[pixel])) + own).to_array();
        }
    }

    #[inline(always)]
    fn uncover(self, cells: &[f32; 16], light: &mut [f32; 12], mask: &mut [f32; 4]) {
        uncover(cells, light, mask);
    }
}

/// [`Registers::uncover`] in registers of 128 bits, which three numbers a pixel fall into.
#[inline(always)]
fn uncover(cells: &[f32; 16], light: &mut [f32; 12], mask: &mut [f32; 4]) {
    let (a, b) = (Vec4::from_slice(&cells[..4]), Vec4::from_slice(&cells[4..8]));
    let (c, d) = (Vec4::from_slice(&cells[8..12]), Vec4::from_slice(&cells[12..]));
    let own = [Vec4::new(a.x, a.y, a.z, b.x), Vec4::new(b.y, b.z, c.x, c.y), Vec4::new(c.z, d.x, d.y, d.z)];
    let hidden = Vec4::new(a.w, b.w, c.w, d.w);
    let keep = Vec4::ONE - hidden;
    let each = [keep.xxxy(), keep.yyzz(), keep.zwww()];
    for ((light, own), keep) in light.as_chunks_mut::<4>().0.iter_mut().zip(own).zip(each) {
        *light = (Vec4::from_array(*light) * keep + own).to_array();
    }
    *mask = (Vec4::from_array(*mask) * keep + hidden).to_array();
}

/// Four pixels in one register.
#[cfg(all(feature = "simd", target_arch = "x86_64"))]
#[derive(Clone, Copy)]
pub(crate) struct Wide<S>(pub S);

#[cfg(all(feature = "simd", target_arch = "x86_64"))]
mod wide {
    use super::{Look, Registers, Wide};
    use fearless_simd::{Simd, SimdBase, f32x4, f32x16, u8x64};

    // Nothing here may be a closure, or an array's `map`: what is not inlined leaves the registers.

    /// Bytes of a pixel's number, four times in each of four pixels.
    const EACH: [[u8; 64]; 4] = each();

    const fn each() -> [[u8; 64]; 4] {
        let mut bytes = [[0; 64]; 4];
        let mut at = 0;
        while at < 4 * 64 {
            bytes[at / 64][at % 64] = (4 * (at / 64) + at % 4) as u8;
            at += 1;
        }
        bytes
    }

    /// Within each pixel, its number `LANE` four times.
    #[inline(always)]
    fn each_of<S: Simd, const LANE: usize>(simd: S, pixels: f32x16<S>) -> f32x16<S> {
        simd.swizzle_dyn_within_blocks_f32x16(pixels, u8x64::from_slice(simd, &EACH[LANE]))
    }

    /// Four numbers for each of four pixels.
    #[inline(always)]
    fn four<S: Simd>(simd: S, a: &[f32; 4], b: &[f32; 4], c: &[f32; 4], d: &[f32; 4]) -> f32x16<S> {
        let near = simd.combine_f32x4(f32x4::from_slice(simd, a), f32x4::from_slice(simd, b));
        let far = simd.combine_f32x4(f32x4::from_slice(simd, c), f32x4::from_slice(simd, d));
        simd.combine_f32x8(near, far)
    }

    impl<S: Simd> Wide<S> {
        #[inline(always)]
        fn over(
            self,
            cells: &mut [f32; 16],
            nodes: [&[f32; 16]; 2],
            share: f32,
            factor: f32x16<S>,
            look: &Look,
        ) {
            let simd = self.0;
            let low = f32x16::from_slice(simd, nodes[0]);
            let products = (low + (f32x16::from_slice(simd, nodes[1]) - low) * share) * factor;
            let first = each_of::<S, 0>(simd, products) + each_of::<S, 1>(simd, products);
            let none = f32x16::splat(simd, 0.0);
            let shown = simd.max_f32x16(first + each_of::<S, 2>(simd, products), none);
            let hidden = simd.max_f32x16(each_of::<S, 3>(simd, products), none);
            let under = f32x16::from_slice(simd, cells);
            let gain = hidden * (f32x16::from_slice(simd, &look.cover) - under);
            (under + (gain + shown * f32x16::from_slice(simd, &look.light))).store_slice(cells);
        }
    }

    impl<S: Simd> Registers for Wide<S> {
        #[inline(always)]
        fn mix(self, out: &mut [f32; 16], [a, b, c, d]: [&[f32; 16]; 4], weights: [f32; 4]) {
            let simd = self.0;
            let near = f32x16::from_slice(simd, a) * weights[0] + f32x16::from_slice(simd, b) * weights[1];
            let far = f32x16::from_slice(simd, c) * weights[2] + f32x16::from_slice(simd, d) * weights[3];
            (near + far).store_slice(out);
        }

        #[inline(always)]
        fn mix_one(self, out: &mut [f32; 16], [a, b, c, d]: [&[f32; 4]; 4], weights: [f32; 4]) {
            let simd = self.0;
            let near = f32x4::from_slice(simd, a) * weights[0] + f32x4::from_slice(simd, b) * weights[1];
            let far = f32x4::from_slice(simd, c) * weights[2] + f32x4::from_slice(simd, d) * weights[3];
            let [a, b, c, d]: [f32; 4] = (near + far).into();
            *out = [a, 0.0, 0.0, a, b, 0.0, 0.0, b, c, 0.0, 0.0, c, d, 0.0, 0.0, d];
        }

        #[inline(always)]
        fn lay_line(
            self,
            cells: &mut [f32; 16],
            nodes: [&[f32; 16]; 2],
            share: f32,
            (along, at, steps): (&[[f32; 4]; 2], f32, &[f32; 16]),
            look: &Look,
        ) {
            let simd = self.0;
            let [value, gain] = along;
            let place = f32x16::splat(simd, at) + f32x16::from_slice(simd, steps);
            let factor = four(simd, value, value, value, value) + four(simd, gain, gain, gain, gain) * place;
            self.over(cells, nodes, share, factor, look);
        }

        #[inline(always)]
        fn lay_end(
            self,
            cells: &mut [f32; 16],
            nodes: [&[f32; 16]; 2],
            share: f32,
            along: [(&[[f32; 4]; 2], f32); 4],
            look: &Look,
        ) {
            let simd = self.0;
            let [(a, at_a), (b, at_b), (c, at_c), (d, at_d)] = along;
            let place = four(simd, &[at_a; 4], &[at_b; 4], &[at_c; 4], &[at_d; 4]);
            let factor =
                four(simd, &a[0], &b[0], &c[0], &d[0]) + four(simd, &a[1], &b[1], &c[1], &d[1]) * place;
            self.over(cells, nodes, share, factor, look);
        }

        #[inline(always)]
        fn lay(self, cells: &mut [f32; 16], [shown, hidden]: [[f32; 4]; 2], colour: &[f32; 4]) {
            let simd = self.0;
            let ([a, b, c, d], [e, f, g, h]) = (shown, hidden);
            let own = four(simd, &[a, a, a, e], &[b, b, b, f], &[c, c, c, g], &[d, d, d, h]);
            let hidden = four(simd, &[e; 4], &[f; 4], &[g; 4], &[h; 4]);
            let kept = f32x16::from_slice(simd, cells) * (f32x16::splat(simd, 1.0) - hidden);
            (kept + own * four(simd, colour, colour, colour, colour)).store_slice(cells);
        }

        #[inline(always)]
        fn uncover(self, cells: &[f32; 16], light: &mut [f32; 12], mask: &mut [f32; 4]) {
            super::uncover(cells, light, mask);
        }
    }
}

#[cfg(all(test, feature = "simd", target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Lines, ends and pixels under streaks of random numbers, and a picture under what they show.
    fn bits(registers: impl Registers) -> Vec<u32> {
        let mut random = Random::new(11);
        let mut number = || random.range(-1.0, 1.0) as f32;
        let mut bits = Vec::new();
        for _ in 0..200 {
            let mut four = || -> [f32; 4] { std::array::from_fn(|_| number()) };
            let along: [[[f32; 4]; 2]; 4] = std::array::from_fn(|_| [four(), four()]);
            let (at, colour, over) = (four(), four(), [four(), four()].map(|over| over.map(f32::abs)));
            let mut sixteen = || -> [f32; 16] { std::array::from_fn(|_| number()) };
            let ([low, high, mut steps, mut cells], look) =
                ([(); 4].map(|()| sixteen()), Look { cover: sixteen(), light: sixteen() });
            registers.mix(&mut steps, [&low, &high, &cells, &high], at);
            bits.extend(steps.iter().map(|value| value.to_bits()));
            registers.mix_one(&mut steps, [&at, &colour, &over[0], &over[1]], at);
            registers.lay_line(&mut cells, [&low, &high], at[0], (&along[0], at[1], &pixels(&steps)), &look);
            let own = [0, 1, 2, 3].map(|pixel| (&along[pixel], at[pixel]));
            registers.lay_end(&mut cells, [&low, &high], at[2], own, &look);
            registers.lay(&mut cells, over, &colour);
            let (mut light, mut mask) = (std::array::from_fn(|_| number()), [0.25, 0.5, 0.0, 1.0]);
            registers.uncover(&cells, &mut light, &mut mask);
            bits.extend(cells.iter().chain(&light).chain(&mask).map(|value| value.to_bits()));
        }
        bits
    }

    /// One number a pixel, four times.
    fn pixels(numbers: &[f32; 16]) -> [f32; 16] {
        std::array::from_fn(|at| numbers[at / 4])
    }

    #[test]
    fn streaks_are_the_same_bits_in_registers_of_every_width() {
        let plain = bits(Plain);
        let level = fearless_simd::Level::new();
        if let Some(simd) = level.as_sse2() {
            assert!(bits(Wide(simd)) == plain);
        }
        match level.as_avx2() {
            Some(simd) => assert!(bits(Wide(simd)) == plain),
            None => println!("skipped: this machine has no 256-bit registers"),
        }
        match level.as_avx512() {
            Some(simd) => assert!(bits(Wide(simd)) == plain),
            None => println!("skipped: this machine has no 512-bit registers"),
        }
    }
}
