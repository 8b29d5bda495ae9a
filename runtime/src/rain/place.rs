//! Where a frame's rain is, beside its weather: a map, covers, how far it is seen.

use super::{CoverMap, RainMap};
use squall_formats::units::Metres;
use std::sync::Arc;

/// Which map of rain a frame has.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum MapChoice {
    /// The asset's, or none where it has none.
    #[default]
    Asset,
    /// None: the weather's rate everywhere within its bounds.
    Even,
    /// One's own.
    Own(Arc<RainMap>),
}

/// Where rain is. With a map the weather's rate is that of the map's heaviest rain, and its bounds hold beside it.
#[derive(Clone, Debug, PartialEq)]
pub struct RainPlace {
    /// Rain over the ground.
    pub map: MapChoice,
    /// What keeps rain off beside the asset's town.
    pub covers: Vec<Arc<CoverMap>>,
    /// Whether the asset's town keeps rain off.
    pub town_covers: bool,
    /// Distance from the eye beyond which rain is not looked through: \[weber\]'s sphere of the sky. The asset's where absent.
    pub farthest: Option<Metres>,
}

impl Default for RainPlace {
    fn default() -> Self {
        Self { map: MapChoice::Asset, covers: Vec::new(), town_covers: true, farthest: None }
    }
}
