//! Which registers work runs in: those that every machine has, or the widest of this one.
//!
//! All of them run the same additions and multiplications in the same order, none fused, so that the bytes are the same.

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

/// Sums of products of four numbers side by side.
pub(crate) trait Registers: Copy {
    /// (low + (high − low) · share) · (value + place · step · gain) of four numbers, `place` from −1.5 to 1.5; `factors` are values and
    /// gains. Once with the first factors, which are light's, and once with the last, which are the coverage's.
    fn one(
        self,
        low: &[f32; 4],
        high: &[f32; 4],
        share: f32,
        step: f32,
        factors: &[[f32; 4]; 2],
    ) -> [[f32; 4]; 2];

    /// The same of four such products: the sum of the first three, and the last.
    fn four(
        self,
        low: &[[f32; 4]; 4],
        high: &[[f32; 4]; 4],
        share: f32,
        step: f32,
        factors: &[[f32; 4]; 2],
    ) -> [[f32; 4]; 2];

    /// Lays a colour, three times over and a fourth of it, over four pixels and into their mask: `over` is how much of it each shows,
    /// and how much of each is covered.
    fn lay(self, light: &mut [f32; 12], mask: &mut [f32; 4], over: [[f32; 4]; 2], colours: &[f32; 12]);
}

/// Places of four pixels from their middle.
const PLACES: [f32; 4] = [-1.5, -0.5, 0.5, 1.5];

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

impl Plain {
    #[inline(always)]
    fn product(
        [low, high]: [&[f32; 4]; 2],
        [share, step]: [f32; 2],
        factors: &[[f32; 4]; 2],
        k: usize,
    ) -> glam::Vec4 {
        use glam::Vec4;
        let low = Vec4::from_array(*low);
        let between = low + (Vec4::from_array(*high) - low) * share;
        let factor = Vec4::splat(factors[0][k]) + (Vec4::from_array(PLACES) * step) * factors[1][k];
        between * factor
    }
}

impl Registers for Plain {
    #[inline(always)]
    fn one(
        self,
        low: &[f32; 4],
        high: &[f32; 4],
        share: f32,
        step: f32,
        factors: &[[f32; 4]; 2],
    ) -> [[f32; 4]; 2] {
        let product = |k: usize| Self::product([low, high], [share, step], factors, k).to_array();
        [product(0), product(3)]
    }

    #[inline(always)]
    fn four(
        self,
        low: &[[f32; 4]; 4],
        high: &[[f32; 4]; 4],
        share: f32,
        step: f32,
        factors: &[[f32; 4]; 2],
    ) -> [[f32; 4]; 2] {
        let product = |k: usize| Self::product([&low[k], &high[k]], [share, step], factors, k);
        [((product(0) + product(1)) + product(2)).to_array(), product(3).to_array()]
    }

    #[inline(always)]
    fn lay(self, light: &mut [f32; 12], mask: &mut [f32; 4], over: [[f32; 4]; 2], colours: &[f32; 12]) {
        let [shown, covers] = over.map(|[a, b, c, d]| [[a, a, a, b], [b, b, c, c], [c, d, d, d]]);
        let (light, _) = light.as_chunks_mut::<4>();
        let (colours, _) = colours.as_chunks::<4>();
        for (i, (light, colour)) in light.iter_mut().zip(colours).enumerate() {
            Self::over(light, shown[i], covers[i], colour);
        }
        Self::over(mask, over[1], over[1], &[1.0; 4]);
    }
}

impl Plain {
    /// Four numbers that `cover` hides and `shown` of `colour` is added to.
    #[inline(always)]
    fn over(under: &mut [f32; 4], shown: [f32; 4], cover: [f32; 4], colour: &[f32; 4]) {
        use glam::Vec4;
        let kept = Vec4::from_array(*under) * (Vec4::ONE - Vec4::from_array(cover));
        *under = (kept + Vec4::from_array(shown) * Vec4::from_array(*colour)).to_array();
    }
}

/// All products in one register: three of light and one of coverage.
#[cfg(all(feature = "simd", target_arch = "x86_64"))]
#[derive(Clone, Copy)]
pub(crate) struct Wide<S>(pub S);

#[cfg(all(feature = "simd", target_arch = "x86_64"))]
mod wide {
    use super::{PLACES, Registers, Wide};
    use fearless_simd::{Simd, SimdBase, f32x4, f32x8, f32x16};

    /// Four numbers, each four times or two of them.
    #[inline(always)]
    fn pair<S: Simd>(simd: S, a: f32, b: f32) -> f32x8<S> {
        simd.combine_f32x4(f32x4::splat(simd, a), f32x4::splat(simd, b))
    }

    #[inline(always)]
    fn all<S: Simd>(simd: S, [a, b, c, d]: [f32; 4]) -> f32x16<S> {
        simd.combine_f32x8(pair(simd, a, b), pair(simd, c, d))
    }

    impl<S: Simd> Registers for Wide<S> {
        #[inline(always)]
        fn one(
            self,
            low: &[f32; 4],
            high: &[f32; 4],
            share: f32,
            step: f32,
            factors: &[[f32; 4]; 2],
        ) -> [[f32; 4]; 2] {
            let simd = self.0;
            let low = f32x4::from_slice(simd, low);
            let between = low + (f32x4::from_slice(simd, high) - low) * share;
            let places = f32x4::from_slice(simd, &PLACES) * step;
            let gains = simd.combine_f32x4(places, places) * pair(simd, factors[1][0], factors[1][3]);
            let factor = pair(simd, factors[0][0], factors[0][3]) + gains;
            let (light, cover) = simd.split_f32x8(simd.combine_f32x4(between, between) * factor);
            [light.into(), cover.into()]
        }

        #[inline(always)]
        fn four(
            self,
            low: &[[f32; 4]; 4],
            high: &[[f32; 4]; 4],
            share: f32,
            step: f32,
            factors: &[[f32; 4]; 2],
        ) -> [[f32; 4]; 2] {
            let simd = self.0;
            let low = f32x16::from_slice(simd, low.as_flattened());
            let high = f32x16::from_slice(simd, high.as_flattened());
            let between = low + (high - low) * share;
            let places = f32x4::from_slice(simd, &PLACES) * step;
            let places = simd.combine_f32x4(places, places);
            let factor = all(simd, factors[0]) + simd.combine_f32x8(places, places) * all(simd, factors[1]);
            let (front, back) = simd.split_f32x16(between * factor);
            let ((a, b), (c, cover)) = (simd.split_f32x8(front), simd.split_f32x8(back));
            [((a + b) + c).into(), cover.into()]
        }

        #[inline(always)]
        fn lay(self, light: &mut [f32; 12], mask: &mut [f32; 4], over: [[f32; 4]; 2], colours: &[f32; 12]) {
            let simd = self.0;
            let [shown, covers] = over.map(|[a, b, c, d]| {
                (f32x8::from_slice(simd, &[a, a, a, b, b, b, c, c]), f32x4::from_slice(simd, &[c, d, d, d]))
            });
            let alpha = f32x4::from_slice(simd, &over[1]);
            let (one, ones) = (f32x4::splat(simd, 1.0), f32x8::splat(simd, 1.0));
            let (near, far) = light.split_at_mut(8);
            let lit = f32x8::from_slice(simd, near) * (ones - covers.0);
            (lit + shown.0 * f32x8::from_slice(simd, &colours[..8])).store_slice(near);
            let lit = f32x4::from_slice(simd, far) * (one - covers.1);
            (lit + shown.1 * f32x4::from_slice(simd, &colours[8..])).store_slice(far);
            (f32x4::from_slice(simd, mask) * (one - alpha) + alpha).store_slice(mask);
        }
    }
}

#[cfg(all(test, feature = "simd", target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::random::Random;

    /// One product and sums of four, and four pixels under one streak, of random numbers.
    fn bits(registers: impl Registers) -> Vec<u32> {
        let mut random = Random::new(11);
        let mut four = || -> [f32; 4] { std::array::from_fn(|_| random.range(-1.0, 1.0) as f32) };
        let mut bits = Vec::new();
        for _ in 0..200 {
            let [low, high]: [[[f32; 4]; 4]; 2] = [(); 2].map(|()| [(); 4].map(|()| four()));
            let (factors, [share, step, ..]) = ([four(), four()], four());
            let [one, its_cover] = registers.one(&low[0], &high[0], share, step, &factors);
            let [all, cover] = registers.four(&low, &high, share, step, &factors);
            let mut light = [0.0; 12];
            light.as_chunks_mut().0.iter_mut().for_each(|part: &mut [f32; 4]| *part = four());
            let mut mask = four().map(f32::abs);
            registers.lay(&mut light, &mut mask, [four(), four()].map(|over| over.map(f32::abs)), &[0.3; 12]);
            let sums = [one, its_cover, all, cover, mask];
            bits.extend(sums.as_flattened().iter().chain(&light).map(|value| value.to_bits()));
        }
        bits
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
