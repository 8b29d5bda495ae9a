//! How finely a picture of the town is worked out.

/// How finely a picture of the town is sampled.
///
/// What stands where, windows and puddles are looked at in every pixel. Light on surfaces and what mirrors show change slowly across most
/// of them: they are worked out at nodes, some pixels apart, and interpolated where the nodes around a pixel are on its own surface, in
/// water as rough as its own, and in light that is nearly the same; everywhere else they are worked out on the spot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Samples along each side of a pixel, at least 1.
    pub samples: u32,
    /// Facets that a place of the roughest water is looked at by, at least 1; smoother water needs fewer.
    pub facets: u32,
    /// Pixels from one node to the next, at least 1; with 1 nothing is interpolated within a surface.
    pub spacing: u32,
    /// How much light may differ between the nodes around a pixel, as a share of the brightest: below it they are interpolated.
    pub tolerance: f32,
    /// Nodes from one whose shadows and images are worked out to the next, 1 or 2; between them they are interpolated within
    /// `tolerance`. A graphics card works them out at every node.
    pub slow_spacing: u32,
    /// Edge of squares of pixels, px, within which light that no node tells is worked out once for each surface; with 1 it is worked
    /// out for each place. A graphics card works it out for each place.
    pub spot: u32,
}

impl Quality {
    /// A still picture's.
    pub const STILL: Self =
        Self { samples: 2, facets: 6, spacing: 2, tolerance: 0.05, slow_spacing: 2, spot: 1 };
    /// A preview's: light and mirrors at an eighth of the size.
    pub const PREVIEW: Self =
        Self { samples: 1, facets: 10, spacing: 8, tolerance: f32::INFINITY, slow_spacing: 2, spot: 8 };

    /// Samples along each side of a pixel, 1 to 64.
    pub(super) fn per_side(self) -> u32 {
        self.samples.clamp(1, 64)
    }
}

impl Default for Quality {
    fn default() -> Self {
        Self::STILL
    }
}
