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
    /// Σ (low + (high − low) · share) · (value + place · gain), two products of four numbers, `place` from −1.5 to 1.5. Gains are
    /// left out unless `LEAN`.
    fn two<const LEAN: bool>(
        self,
        low: &[[f32; 4]; 2],
        high: &[[f32; 4]; 2],
        share: f32,
        factors: &[[f32; 4]; 2],
    ) -> [f32; 4];

    /// The same of four products: those of an even number and those of an odd one are summed apart.
    fn four<const LEAN: bool>(
        self,
        low: &[[f32; 4]; 4],
        high: &[[f32; 4]; 4],
        share: f32,
        factors: &[[f32; 4]; 2],
    ) -> [f32; 4];
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
    fn product<const LEAN: bool>(
        low: &[f32; 4],
        high: &[f32; 4],
        share: f32,
        factors: &[[f32; 4]; 2],
        k: usize,
    ) -> glam::Vec4 {
        use glam::Vec4;
        let low = Vec4::from_array(*low);
        let between = low + (Vec4::from_array(*high) - low) * share;
        let mut factor = Vec4::splat(factors[0][k]);
        if LEAN {
            factor += Vec4::from_array(PLACES) * factors[1][k];
        }
        between * factor
    }
}

impl Registers for Plain {
    #[inline(always)]
    fn two<const LEAN: bool>(
        self,
        low: &[[f32; 4]; 2],
        high: &[[f32; 4]; 2],
        share: f32,
        factors: &[[f32; 4]; 2],
    ) -> [f32; 4] {
        let product = |k: usize| Self::product::<LEAN>(&low[k], &high[k], share, factors, k);
        (product(0) + product(1)).to_array()
    }

    #[inline(always)]
    fn four<const LEAN: bool>(
        self,
        low: &[[f32; 4]; 4],
        high: &[[f32; 4]; 4],
        share: f32,
        factors: &[[f32; 4]; 2],
    ) -> [f32; 4] {
        let product = |k: usize| Self::product::<LEAN>(&low[k], &high[k], share, factors, k);
        ((product(0) + product(2)) + (product(1) + product(3))).to_array()
    }
}

/// All products in one register.
#[cfg(feature = "simd")]
#[derive(Clone, Copy)]
pub(crate) struct Wide<S>(pub S);

#[cfg(feature = "simd")]
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
        fn two<const LEAN: bool>(
            self,
            low: &[[f32; 4]; 2],
            high: &[[f32; 4]; 2],
            share: f32,
            factors: &[[f32; 4]; 2],
        ) -> [f32; 4] {
            let simd = self.0;
            let low = f32x8::from_slice(simd, low.as_flattened());
            let high = f32x8::from_slice(simd, high.as_flattened());
            let between = low + (high - low) * share;
            let mut factor = pair(simd, factors[0][0], factors[0][1]);
            if LEAN {
                let places = f32x4::from_slice(simd, &PLACES);
                factor = factor + simd.combine_f32x4(places, places) * pair(simd, factors[1][0], factors[1][1]);
            }
            let (a, b) = simd.split_f32x8(between * factor);
            (a + b).into()
        }

        #[inline(always)]
        fn four<const LEAN: bool>(
            self,
            low: &[[f32; 4]; 4],
            high: &[[f32; 4]; 4],
            share: f32,
            factors: &[[f32; 4]; 2],
        ) -> [f32; 4] {
            let simd = self.0;
            let low = f32x16::from_slice(simd, low.as_flattened());
            let high = f32x16::from_slice(simd, high.as_flattened());
            let between = low + (high - low) * share;
            let mut factor = all(simd, factors[0]);
            if LEAN {
                let places = f32x4::from_slice(simd, &PLACES);
                let places = simd.combine_f32x4(places, places);
                factor = factor + simd.combine_f32x8(places, places) * all(simd, factors[1]);
            }
            // Products 0 and 1 lie in one half, 2 and 3 in the other.
            let (front, back) = simd.split_f32x16(between * factor);
            let (a, b) = simd.split_f32x8(front + back);
            (a + b).into()
        }
    }
}
