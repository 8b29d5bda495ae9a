//! Steps from every cell of a grid to the nearest that is filled.

use squall_formats::GridShape;

/// How many steps the nearest that is `filled` is away, a cell of a grid, at most 255; all 26 neighbours are one step away. Two sweeps,
/// each of which looks at the 13 neighbours that come before \[rosenfeld-pfaltz\], are exact: twelve of them a row at a time, the last
/// along the row itself.
pub fn distances(shape: GridShape, filled: impl Iterator<Item = bool>) -> Vec<u8> {
    let mut distances: Vec<u8> = filled.map(|filled| if filled { 0 } else { u8::MAX }).collect();
    let [nx, ny, nz] = shape.to_array();
    // The nearest of the rows before, with one more cell on either side.
    let mut near = vec![u8::MAX; nx + 2];
    for row in 0..ny * nz {
        take_rows(&mut distances, shape, row, (&mut near, -1));
        let mut last = u8::MAX;
        for own in &mut distances[row * nx..][..nx] {
            last = (*own).min(last.saturating_add(1));
            *own = last;
        }
    }
    for row in (0..ny * nz).rev() {
        take_rows(&mut distances, shape, row, (&mut near, 1));
        let mut last = u8::MAX;
        for own in distances[row * nx..][..nx].iter_mut().rev() {
            last = (*own).min(last.saturating_add(1));
            *own = last;
        }
    }
    distances
}

/// Has a row's cells be one step farther at most than those beside them in the rows `before` (−1) or behind it (1).
fn take_rows(distances: &mut [u8], shape: GridShape, row: usize, (near, before): (&mut [u8], isize)) {
    let [nx, ny, nz] = shape.to_array();
    let (y, z) = (row % ny, row / ny);
    near.fill(u8::MAX);
    let beside = [[before, 0], [-1, before], [0, before], [1, before]];
    for [dy, dz] in beside {
        let (Some(y), Some(z)) = (y.checked_add_signed(dy), z.checked_add_signed(dz)) else { continue };
        if y < ny && z < nz {
            let other = &distances[(y + ny * z) * nx..][..nx];
            near[1..=nx].iter_mut().zip(other).for_each(|(near, &other)| *near = (*near).min(other));
        }
    }
    let three = near.iter().zip(&near[1..]).zip(&near[2..]);
    for (own, ((&a, &b), &c)) in distances[row * nx..][..nx].iter_mut().zip(three) {
        *own = (*own).min(a.min(b).min(c).saturating_add(1));
    }
}
