//! How closely the light of strokes is worked out: flags that `relight` and `render` share.

use squall_runtime::clouds::LightQuality;

/// `--gathers` and `--live-cells`.
#[derive(clap::Args, Clone, Copy)]
pub struct LightArgs {
    /// Transport sweeps over the light of rows and of live solves: docs/clouds.md. Rows have to hold light in all directions.
    #[arg(long, value_name = "SWEEPS", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=64))]
    gathers: u32,
    /// Edge of the cells that light which no row answers for is solved for in, in cells of the rows'.
    #[arg(long, value_name = "CELLS", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=16))]
    live_cells: u32,
}

impl LightArgs {
    /// The runtime's words for it.
    pub fn quality(self) -> LightQuality {
        LightQuality { gathers: self.gathers, live_cells: self.live_cells }
    }
}
