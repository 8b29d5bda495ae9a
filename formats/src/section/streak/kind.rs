//! Which numbers a pattern stores, and so how the pool is read; independent of how they were found.

/// A pattern's kind, by its stored code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Kind {
    FlatCosines = 0,
    GaussianCosines = 1,
    PowerCosines = 2,
    EdgeCosines = 3,
    Separable = 4,
}

impl Kind {
    const ALL: [Self; 5] =
        [Self::FlatCosines, Self::GaussianCosines, Self::PowerCosines, Self::EdgeCosines, Self::Separable];

    pub(super) fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|&kind| kind as u8 == code)
    }
}
