//! What all sweeps share: a cell's coefficients, the light on its faces and how fluxes are carried to them.

use squall_formats::section::response::SweepScheme;

/// What every cell contributes to its own source: extinction, and the root of its scaled scattering coefficient.
#[derive(Clone, Debug)]
pub struct CellCoefficients {
    /// Extinction after scaling, 1/m.
    pub extinction: Vec<f32>,
    /// √ of the scattering coefficient after scaling, m^−½.
    pub root_scattering: Vec<f32>,
}

/// A = (uσ + 2κs + ε) / (uσ + κs + ε), the face weights of all schemes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FaceWeights {
    /// u.
    pub thickness: f32,
    /// κ.
    pub stiffness: f32,
    /// ε keeps 0/0 at bay where light does not travel along an axis or the cell is empty.
    pub tiny: f32,
}

impl FaceWeights {
    pub(crate) fn new(scheme: SweepScheme) -> Self {
        let (thickness, stiffness) = match scheme {
            SweepScheme::Weighted => (1.0, 3.0),
            SweepScheme::Diamond => (0.0, 1.0),
            SweepScheme::Step => (1.0, 0.0),
        };
        Self { thickness, stiffness, tiny: 1e-20 }
    }
}

/// Light on the faces between cells.
#[derive(Clone, Debug, Default)]
pub(crate) struct Faces<P> {
    pub(crate) x: Vec<P>,
    pub(crate) y: Vec<P>,
    pub(crate) z: Vec<P>,
    pub(crate) inflow: Vec<P>,
}

/// Light leaving the grid through its six faces, W per lane: −x, +x, −y, +y, −z, +z.
pub type Leak = [Vec<f64>; 6];
