//! Several lights, or several directions, side by side in one register, and which instructions work on them.
//!
//! Every level runs the same additions and multiplications in the same order, none of them fused, so all give the
//! same bytes; a wider level is only faster.

use bytemuck::{Pod, Zeroable};
use fearless_simd::{Level, Simd, SimdBase, dispatch, f32x4, f32x8, f32x16};
use std::ops::{Add, Mul, Sub};

/// Instructions to use. All levels give the same bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SimdLevel {
    /// What every processor of the architecture has.
    Baseline,
    /// At most 256-bit registers on x86-64.
    Avx2,
    /// The best of this machine.
    Best,
}

impl SimdLevel {
    /// All levels, narrowest first.
    pub const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Best];

    /// The level itself, or the widest below it that this machine has.
    fn level(self) -> Level {
        match self {
            Self::Baseline => Level::baseline(),
            Self::Best => Level::new(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => Level::new().as_avx2().map_or(Level::baseline(), Level::Avx2),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 => Level::new(),
        }
    }
}

/// Work that is compiled once for each kind of register; `run` and all that it calls are `#[inline(always)]`.
pub(crate) trait SimdKernel {
    /// What the work returns.
    type Output;
    /// The work.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// Runs `kernel` with the registers of `level`.
pub(crate) fn run<K: SimdKernel>(level: SimdLevel, kernel: K) -> K::Output {
    dispatch!(level.level(), simd => kernel.run(simd))
}

/// A fixed number of single-precision values as they lie in memory, which go through the same arithmetic.
pub trait Lanes: Copy + Default + Pod + Send + Sync + 'static {
    /// How many values.
    const COUNT: usize;
    /// The same values in registers.
    type Vector<S: Simd>: Copy
        + Add<Output = Self::Vector<S>>
        + Sub<Output = Self::Vector<S>>
        + Mul<Output = Self::Vector<S>>
        + Mul<f32, Output = Self::Vector<S>>;
    /// Lane by lane from `f(lane)`.
    fn from_fn(f: impl FnMut(usize) -> f32) -> Self;
    /// The value of one lane.
    fn lane(&self, lane: usize) -> f32;
    /// Replaces the value of one lane.
    fn set_lane(&mut self, lane: usize, value: f32);
    /// From memory to registers.
    fn load<S: Simd>(self, simd: S) -> Self::Vector<S>;
    /// From registers to memory.
    fn store<S: Simd>(vector: Self::Vector<S>) -> Self;
    /// 1 / vector.
    fn reciprocal<S: Simd>(simd: S, vector: Self::Vector<S>) -> Self::Vector<S>;

    /// All lanes alike.
    fn splat(value: f32) -> Self {
        Self::from_fn(|_| value)
    }
}

macro_rules! lanes {
    ($(#[$doc:meta])* $name:ident, $vector:ident, $count:literal, $align:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
        #[repr(C, align($align))]
        pub struct $name(pub [f32; $count]);

        impl Lanes for $name {
            const COUNT: usize = $count;
            type Vector<S: Simd> = $vector<S>;

            fn from_fn(f: impl FnMut(usize) -> f32) -> Self {
                Self(std::array::from_fn(f))
            }

            #[inline(always)]
            fn lane(&self, lane: usize) -> f32 {
                self.0[lane]
            }

            #[inline(always)]
            fn set_lane(&mut self, lane: usize, value: f32) {
                self.0[lane] = value;
            }

            #[inline(always)]
            fn load<S: Simd>(self, simd: S) -> $vector<S> {
                $vector::load_array(simd, self.0)
            }

            #[inline(always)]
            fn store<S: Simd>(vector: $vector<S>) -> Self {
                Self(vector.to_array())
            }

            #[inline(always)]
            fn reciprocal<S: Simd>(simd: S, vector: $vector<S>) -> $vector<S> {
                $vector::splat(simd, 1.0) / vector
            }
        }
    };
}

lanes! {
    /// Sixteen values: one AVX-512 register, two AVX2 ones, four of the baseline's; a cache line.
    F32x16, f32x16, 16, 64
}
lanes! {
    /// Eight values.
    F32x8, f32x8, 8, 32
}
lanes! {
    /// Four values.
    F32x4, f32x4, 4, 16
}

impl Lanes for f32 {
    const COUNT: usize = 1;
    type Vector<S: Simd> = f32;

    fn from_fn(mut f: impl FnMut(usize) -> f32) -> Self {
        f(0)
    }

    #[inline(always)]
    fn lane(&self, _: usize) -> f32 {
        *self
    }

    #[inline(always)]
    fn set_lane(&mut self, _: usize, value: f32) {
        *self = value;
    }

    #[inline(always)]
    fn load<S: Simd>(self, _: S) -> f32 {
        self
    }

    #[inline(always)]
    fn store<S: Simd>(vector: f32) -> Self {
        vector
    }

    #[inline(always)]
    fn reciprocal<S: Simd>(_: S, vector: f32) -> f32 {
        1.0 / vector
    }
}
