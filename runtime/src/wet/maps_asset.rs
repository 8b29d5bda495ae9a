//! Maps out of an asset.

use super::maps::{DripEdge, Fin, GroundMap, LightningVolume, WetMaps};
use crate::error::RuntimeError;
use crate::load::Asset;
use glam::{DVec2, DVec3, Vec3};
use squall_formats::section::wet_maps::{BoxRecord, GroundRecord, LightningRecord, WetMapsSection};

impl WetMaps {
    /// The maps of an asset's scene; empty where the asset has none.
    ///
    /// Errors: a damaged section.
    pub fn of(asset: &Asset) -> Result<Self, RuntimeError> {
        if asset.directory().find(WetMapsSection::TAG).is_none() {
            return Ok(Self::default());
        }
        let section = asset.section(WetMapsSection::TAG, "maps of a scene", WetMapsSection::read)?;
        Self::from_section(&section)
    }

    /// The maps that a section holds.
    ///
    /// Errors: a section that [`WetMapsSection::check`] refuses.
    pub fn from_section(section: &WetMapsSection) -> Result<Self, RuntimeError> {
        section.check().map_err(|(field, wanted, found)| RuntimeError::argument(field, wanted, found))?;
        let drips = section.drips.ends.iter().zip(&section.drips.drains_m2);
        let fins = section.fins.ends.iter().zip(&section.fins.normals);
        let overhead = match section.overhead.as_slice() {
            [red, green, blue] => Some([map(red)?, map(green)?, map(blue)?]),
            _ => None,
        };
        Ok(Self {
            height_m: section.height.as_ref().map(map).transpose()?,
            water_m: section.water.as_ref().map(map).transpose()?,
            overhead,
            drips: drips
                .map(|(ends, area)| DripEdge {
                    ends_m: places(&section.drips.within, ends),
                    drains_m2: *area,
                })
                .collect(),
            fins: fins
                .map(|(ends, [a, b, c, d, e, f])| Fin {
                    ends_m: places(&section.fins.within, ends),
                    normals: [[a, b, c], [d, e, f]].map(|normal| unit(normal.map(|part| f32::from(*part)))),
                })
                .collect(),
            lightning: section.lightning.as_ref().map(volume),
        })
    }
}

fn map(record: &GroundRecord) -> Result<GroundMap, RuntimeError> {
    let values = record.values().map_err(|wanted| RuntimeError::argument("map.code", wanted, "others"))?;
    Ok(GroundMap {
        origin_m: DVec2::from_array(record.origin_m),
        cell_m: record.cell_m,
        size: record.size.map(|side| side as usize),
        values,
    })
}

fn places(within: &BoxRecord, &[a, b, c, d, e, f]: &[u16; 6]) -> [DVec3; 2] {
    [[a, b, c], [d, e, f]].map(|steps| DVec3::from_array(within.place(steps)))
}

fn unit(normal: [f32; 3]) -> DVec3 {
    Vec3::from_array(normal).as_dvec3().normalize_or(DVec3::Z)
}

fn volume(record: &LightningRecord) -> LightningVolume {
    LightningVolume {
        origin_m: DVec3::from_array(record.origin_m),
        cell_m: record.cell_m,
        size: record.size.map(|side| side as usize),
        directions: record.directions.iter().map(|direction| unit(*direction)).collect(),
        harmonics: record.harmonics(),
    }
}
