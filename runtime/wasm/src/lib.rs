//! Light per cell of an asset's cloud, for a page or Node: what a wasm32 module of the runtime exports.
//!
//! `cargo build --release -p squall-wasm --target wasm32-unknown-unknown` makes `squall_wasm.wasm`, which imports nothing.
//! [`exports`] lists its functions; `relight.mjs` beside this crate calls them from Node. [`Session`] is the same from Rust.
//!
//! A call that fails answers 0 (or a null address) and leaves its reason in words; the module stays usable.

pub mod exports;

use squall_runtime::glam::DVec3;
use squall_runtime::relight::PointLight;
use squall_runtime::{Asset, Clouds, RuntimeError};

/// Most bytes of an asset that a session takes: its bytes lie in memory twice while it opens, and wasm32 has 4 GiB in all.
pub const LARGEST_ASSET: usize = 1 << 30;

/// One opened asset, and what was last asked of it.
#[derive(Default)]
pub struct Session {
    input: Vec<u8>,
    clouds: Option<Clouds>,
    /// Nx, Ny, Nz; edges of a cell, m; corner of the grid, m.
    grid: [f64; 9],
    values: Vec<f32>,
    error: String,
}

impl Session {
    /// Room for an asset of `length` bytes, which the caller fills before [`Session::open`]. `None` where it is empty, longer than
    /// [`LARGEST_ASSET`] or more than memory holds: [`Session::error`] says which.
    pub fn input(&mut self, length: usize) -> Option<&mut [u8]> {
        self.input = Vec::new();
        let refused = if !(1..=LARGEST_ASSET).contains(&length) {
            Some(RuntimeError::argument("asset's length", format!("1 to {LARGEST_ASSET} bytes"), length))
        } else {
            let memory = |_| RuntimeError::argument("asset's length", "what memory has room for", length);
            self.input.try_reserve_exact(length).map_err(memory).err()
        };
        if let Some(error) = refused {
            self.error = error.to_string();
            return None;
        }
        self.error.clear();
        self.input.resize(length, 0);
        Some(&mut self.input)
    }

    /// Opens the asset whose bytes were put into [`Session::input`] and frees that room. Returns the number of cells of its cloud
    /// grid; 0 where the asset is damaged or has no cloud, and then no asset is open.
    pub fn open(&mut self) -> u32 {
        let input = std::mem::take(&mut self.input);
        (self.clouds, self.grid, self.values) = (None, [0.0; 9], Vec::new());
        let opened = Asset::from_bytes(&input).and_then(|asset| {
            drop(input);
            Clouds::new(&asset)
        });
        self.answer(|session| {
            let clouds = opened?;
            let (cloud, cells) = (clouds.cloud(), clouds.cloud().shape.len());
            let shape = cloud.shape.to_array().map(|count| count as f64);
            let rows = [shape, cloud.cell_m, cloud.origin_m.to_array()];
            session.grid.copy_from_slice(rows.as_flattened());
            session.clouds = Some(clouds);
            Ok(cells)
        })
    }

    /// In-scattered radiance J of a point light at `position`, m, of `intensity`, W/sr, towards somebody at `viewer`, m, per cell,
    /// W/(m² sr), direct light included: [`squall_runtime::clouds::CloudLight::radiance`]. Returns the number of cells, which
    /// [`Session::values`] then has; 0 where it is refused.
    pub fn radiance(&mut self, position: DVec3, intensity: f64, viewer: DVec3) -> u32 {
        self.answer(|session| {
            let light = session.clouds()?.light(&[PointLight { position, intensity }])?;
            light.radiance(viewer, session.room()?)?;
            Ok(session.values.len())
        })
    }

    /// Fluence rate φ of the same light per cell, W/m²: [`squall_runtime::clouds::CloudLight::fluence`]. Returns as
    /// [`Session::radiance`].
    pub fn fluence(&mut self, position: DVec3, intensity: f64) -> u32 {
        self.answer(|session| {
            let light = session.clouds()?.light(&[PointLight { position, intensity }])?;
            light.fluence(session.room()?)?;
            Ok(session.values.len())
        })
    }

    /// Extinction per cell, 1/m: along a ray, radiance is ∫ albedo · extinction · J · transmittance ds. Returns as
    /// [`Session::radiance`].
    pub fn extinction(&mut self) -> u32 {
        self.answer(|session| {
            let extinction = session.clouds()?.cloud().extinction.clone();
            session.values = extinction;
            Ok(session.values.len())
        })
    }

    /// What was last asked for, one value a cell, x fastest; empty after a call that was refused.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Cells along x, y, z; a cell's edges, m; the grid's smallest corner, m. Zeros where no asset is open.
    pub fn grid(&self) -> &[f64; 9] {
        &self.grid
    }

    /// Why the last call was refused; empty where it was not.
    pub fn error(&self) -> &str {
        &self.error
    }

    fn clouds(&mut self) -> Result<&mut Clouds, RuntimeError> {
        self.clouds.as_mut().ok_or_else(|| RuntimeError::argument("asset", "one that was opened", "none"))
    }

    /// One value a cell of the open cloud's grid.
    fn room(&mut self) -> Result<&mut [f32], RuntimeError> {
        let cells = self.clouds()?.cloud().shape.len();
        self.values.resize(cells, 0.0);
        Ok(&mut self.values)
    }

    /// Does `work`; a refusal leaves no values, its reason in words, and answers 0.
    fn answer(&mut self, work: impl FnOnce(&mut Self) -> Result<usize, RuntimeError>) -> u32 {
        self.error.clear();
        self.values.clear();
        match work(self) {
            // Assets with grids of more than 2^28 cells do not open.
            Ok(cells) => cells as u32,
            Err(error) => {
                self.values.clear();
                self.error = error.to_string();
                0
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOLDEN: &[u8] = include_bytes!("../../../data/golden/v1/golden.squall");
    const LIT: DVec3 = DVec3::new(20.0, 10.0, 650.0);
    const VIEWER: DVec3 = DVec3::new(0.0, -400.0, 2.0);

    fn opened(bytes: &[u8]) -> Session {
        let mut session = Session::default();
        session.input(bytes.len()).unwrap().copy_from_slice(bytes);
        session.open();
        session
    }

    #[test]
    fn an_opened_asset_answers_with_one_value_a_cell() {
        let mut session = opened(GOLDEN);
        assert_eq!((session.error(), &session.grid()[..3]), ("", &[9.0, 8.0, 4.0][..]));
        assert_eq!(session.radiance(LIT, 1e6, VIEWER), 288, "{}", session.error());
        let radiance = session.values().to_vec();
        assert_eq!(session.fluence(LIT, 1e6), 288, "{}", session.error());
        assert!(radiance.len() == 288 && session.values().len() == 288 && radiance != session.values());
        assert!(radiance.iter().chain(session.values()).all(|v| v.is_finite() && *v >= 0.0));
        assert!(radiance.iter().any(|&v| v > 0.0));
        assert_eq!(session.extinction(), 288);
        assert!(session.values().iter().any(|&v| v > 0.0));
    }

    #[test]
    fn a_refused_call_says_why_leaves_no_values_and_the_next_one_is_answered() {
        let mut session = opened(GOLDEN);
        // Nowhere at all: of a place that was not baked the words depend on whether the runtime can solve live.
        assert_eq!(session.fluence(DVec3::NAN, 1e6), 0);
        assert!(session.error().contains("point light"), "{}", session.error());
        assert_eq!(session.radiance(LIT, f64::NAN, VIEWER), 0);
        assert!(session.error().contains("intensity") && session.values().is_empty());
        assert_eq!((session.fluence(LIT, 1e6), session.error()), (288, ""));
    }

    #[test]
    fn bytes_that_are_no_asset_and_calls_before_any_is_open_are_refused_in_words() {
        let mut session = Session::default();
        assert_eq!((session.fluence(LIT, 1.0), session.open()), (0, 0));
        assert!(!session.error().is_empty());
        for length in [0, LARGEST_ASSET + 1, usize::MAX] {
            assert!(
                session.input(length).is_none() && session.error().contains("asset's length"),
                "{length}"
            );
        }
        // A cloud that was open is gone once another file was tried.
        let mut session = opened(GOLDEN);
        session.input(4).unwrap().copy_from_slice(b"none");
        assert_eq!((session.open(), session.grid()), (0, &[0.0; 9]));
        assert!(session.error().contains("(memory)"), "{}", session.error());
        assert_eq!(session.extinction(), 0);
        assert_eq!(session.error(), "asset: wanted one that was opened, found none");
        for cut in [GOLDEN.len() - 1, GOLDEN.len() / 2, 64, 1] {
            assert!(!opened(&GOLDEN[..cut]).error().is_empty(), "{cut}");
        }
    }
}
