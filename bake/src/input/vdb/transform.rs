//! From a grid's voxels to metres.

use super::bytes::Bytes;
use super::{Read, Refusal, Up};

/// world = index · matrix + offset, rows as OpenVDB's.
pub(super) struct Transform {
    matrix: [[f64; 3]; 3],
    offset: [f64; 3],
}

/// World axis i is `scale[i]` · index[`axes[i]`] + `offset[i]`.
#[derive(Debug, PartialEq)]
pub(super) struct ToWorld {
    pub axes: [usize; 3],
    pub scale: [f64; 3],
    pub offset: [f64; 3],
}

/// Share of an axis' length that another component may have, by rounding.
const ROUNDING: f64 = 1e-6;

impl Transform {
    pub fn read(at: &mut Bytes<'_>) -> Read<Self> {
        let name = at.text()?;
        let diagonal = |[x, y, z]: [f64; 3]| [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]];
        match name.as_str() {
            "UniformScaleMap" | "ScaleMap" => {
                let scale = at.vector()?;
                at.take(4 * 24)?;
                Ok(Self { matrix: diagonal(scale), offset: [0.0; 3] })
            }
            "UniformScaleTranslateMap" | "ScaleTranslateMap" => {
                let offset = at.vector()?;
                let scale = at.vector()?;
                at.take(4 * 24)?;
                Ok(Self { matrix: diagonal(scale), offset })
            }
            "TranslationMap" => Ok(Self { matrix: diagonal([1.0; 3]), offset: at.vector()? }),
            "AffineMap" | "UnitaryMap" => {
                let mut rows = [[0.0; 4]; 4];
                for value in rows.as_flattened_mut() {
                    *value = at.f64()?;
                }
                let [matrix @ .., last] = rows.map(|[x, y, z, _]| [x, y, z]);
                Ok(Self { matrix, offset: last })
            }
            other => Err(Refusal::new("transform", "scale, translation or an affine map", other)),
        }
    }

    /// With `up` turned to z and one unit of `metres_per_unit` m.
    pub fn to_world(&self, up: Up, metres_per_unit: f64) -> Read<ToWorld> {
        // Which of the file's components each of ours is, and with which sign.
        let ours: [(usize, f64); 3] = match up {
            Up::Z => [(0, 1.0), (1, 1.0), (2, 1.0)],
            Up::Y => [(0, 1.0), (2, -1.0), (1, 1.0)],
        };
        let mut world = ToWorld { axes: [0; 3], scale: [0.0; 3], offset: [0.0; 3] };
        let mut taken = [false; 3];
        for (axis, (from, sign)) in ours.into_iter().enumerate() {
            let column = [0, 1, 2].map(|index| self.matrix[index][from] * sign * metres_per_unit);
            let longest = column.iter().fold(0.0f64, |most, value| most.max(value.abs()));
            let along: Vec<usize> = (0..3).filter(|&i| column[i].abs() > ROUNDING * longest).collect();
            let &[index] = along.as_slice() else { return Err(self.refusal()) };
            let offset = self.offset[from] * sign * metres_per_unit;
            if taken[index] || !(longest.is_normal() && offset.is_finite()) {
                return Err(self.refusal());
            }
            taken[index] = true;
            world.axes[axis] = index;
            world.scale[axis] = column[index];
            world.offset[axis] = offset;
        }
        Ok(world)
    }

    fn refusal(&self) -> Refusal {
        let wanted = "voxels along the axes: neither turned nor sheared, no edge of 0";
        Refusal::new("transform", wanted, format!("rows {:?}", self.matrix))
    }
}
