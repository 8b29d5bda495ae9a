//! Cells whose light nobody reads: no density there nor beside, so no ray shades with it; or too deep for every viewpoint
//! that there is. They may hold anything, and hold what the transform has least to say of: the mean of the seen cells around, block by
//! block of the transform's own pairing.

use super::visibility::visible;
use squall_formats::GridShape;
use squall_formats::view_region::ViewRegion;
use squall_runtime::transport::Cloud;

/// One level of blocks: its size and which of them hold a seen cell.
struct Level {
    size: [usize; 3],
    seen: Vec<bool>,
}

/// Which cells of a grid are read, and a way to fill the others.
pub struct HiddenCells {
    shape: GridShape,
    levels: Vec<Level>,
}

impl HiddenCells {
    /// Looks at a stored grid. Light is read between the middles of eight cells, and only where there is density: a cell is seen
    /// where one of the 27 around it has some, and, with `view_region`, where those can see it. `None` where all are.
    pub fn new(cloud: &Cloud, view_region: Option<&ViewRegion>) -> Option<Self> {
        let mut seen = cloud.shaded();
        if let Some(visible) = view_region.and_then(|view_region| visible(cloud, view_region)) {
            seen.iter_mut().zip(visible).for_each(|(seen, visible)| *seen &= visible);
        }
        Self::of(cloud.shape, seen)
    }

    /// The same where the cells that are read are known.
    pub fn of(shape: GridShape, seen: Vec<bool>) -> Option<Self> {
        let size = shape.to_array();
        if seen.iter().all(|&seen| seen) {
            return None;
        }
        let mut levels = vec![Level { size, seen }];
        while levels.last().is_some_and(|level| level.size != [1; 3]) {
            let fine = &levels[levels.len() - 1];
            let size = fine.size.map(|count| count.div_ceil(2));
            let mut seen = vec![false; size.iter().product()];
            for index in (0..fine.seen.len()).filter(|&index| fine.seen[index]) {
                seen[parent(index, fine.size, size)] = true;
            }
            levels.push(Level { size, seen });
        }
        Some(Self { shape, levels })
    }

    /// Which cells are read.
    pub fn seen(&self) -> &[bool] {
        &self.levels[0].seen
    }

    /// Fills the cells that nobody reads. `plane` holds a value a cell; linear in it.
    ///
    /// Panics when `plane` is not one grid long.
    pub fn fill(&self, plane: &mut [f32]) {
        assert_eq!(plane.len(), self.shape.len());
        let mut means: Vec<Vec<f32>> = vec![plane.to_vec()];
        for pair in self.levels.windows(2) {
            let [fine, coarse] = pair else { continue };
            let values = &means[means.len() - 1];
            let mut sums = vec![(0.0f64, 0u32); coarse.seen.len()];
            for index in (0..values.len()).filter(|&index| fine.seen[index]) {
                let sum = &mut sums[parent(index, fine.size, coarse.size)];
                *sum = (sum.0 + f64::from(values[index]), sum.1 + 1);
            }
            means.push(sums.into_iter().map(|(sum, count)| (sum / f64::from(count.max(1))) as f32).collect());
        }
        for at in (1..self.levels.len()).rev() {
            let (fine, coarse) = (&self.levels[at - 1], &self.levels[at]);
            let (low, high) = means.split_at_mut(at);
            for index in (0..fine.seen.len()).filter(|&index| !fine.seen[index]) {
                low[at - 1][index] = high[0][parent(index, fine.size, coarse.size)];
            }
        }
        plane.copy_from_slice(&means[0]);
    }
}

/// The block of the next level that cell or block `index` belongs to.
fn parent(index: usize, fine: [usize; 3], coarse: [usize; 3]) -> usize {
    let cell = [index % fine[0], index / fine[0] % fine[1], index / (fine[0] * fine[1])];
    let [x, y, z] = cell.map(|at| at / 2);
    x + coarse[0] * (y + coarse[1] * z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use squall_formats::haar::Haar;
    use squall_runtime::transport::Boundary;

    /// A cloud of a few cells in the corner of a grid that is no power of two.
    fn corner() -> Cloud {
        let shape = GridShape::new(13, 9, 6);
        let dense = |index: usize| shape.cell(index).iter().all(|&at| at < 2);
        let extinction = (0..shape.len()).map(|index| if dense(index) { 0.01 } else { 0.0 }).collect();
        Cloud {
            shape,
            cell_m: [10.0; 3],
            origin_m: DVec3::ZERO,
            extinction,
            albedo: 0.9,
            g: 0.5,
            boundary: Boundary::Open,
        }
    }

    #[test]
    fn seen_cells_keep_their_values_and_the_rest_adds_no_detail() {
        let cloud = corner();
        let hidden = HiddenCells::new(&cloud, None).unwrap();
        assert_eq!(hidden.seen().iter().filter(|&&seen| seen).count(), 27);
        let values: Vec<f32> = (0..cloud.shape.len()).map(|i| ((i * 37) % 101) as f32).collect();
        let mut filled = values.clone();
        hidden.fill(&mut filled);
        let kept = (0..values.len()).filter(|&i| hidden.seen()[i]).all(|i| filled[i] == values[i]);
        assert!(kept);
        let details = |values: &[f32]| {
            let mut planes = values.to_vec();
            Haar::new(cloud.shape).forward(&mut planes, &mut Vec::new());
            planes.iter().filter(|value| value.abs() > 1e-3).count()
        };
        // Sixty-four cells of the corner's blocks can hold detail, and what ties those to the empty rest.
        let [few, many] = [details(&filled), details(&values)];
        assert!(few <= 70 && 4 * few < many, "{few} of {many}");
    }

    #[test]
    fn a_cloud_that_fills_its_grid_has_nothing_hidden() {
        let mut cloud = corner();
        cloud.extinction.fill(0.01);
        assert!(HiddenCells::new(&cloud, None).is_none());
    }

    #[test]
    fn periodic_sides_see_across() {
        let cloud = Cloud { boundary: Boundary::PeriodicXy, ..corner() };
        let hidden = HiddenCells::new(&cloud, None).unwrap();
        assert!(hidden.seen()[cloud.shape.index(12, 8, 0)]);
        assert!(!hidden.seen()[cloud.shape.index(6, 4, 0)]);
    }
}
