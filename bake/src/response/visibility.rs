//! Which cells of a cloud the viewpoints of a view region see.

use glam::DVec3;
use rayon::prelude::*;
use squall_formats::view_region::ViewRegion;
use squall_runtime::transport::direct::Tracer;
use squall_runtime::transport::{Boundary, Cloud};

/// How many half diagonals of the box its middle has to be away from the grid: seen from there it spans 60° at most, over which
/// polynomials of degree 2 are a match for harmonics of degree 3.
const APART: f64 = 2.0;

/// Whether a view region is far enough away for a basis towards it, a single viewpoint too: a cell away at least.
pub fn stand_apart(cloud: &Cloud, view_region: &ViewRegion) -> bool {
    let centre = DVec3::from_array(view_region.centre());
    let nearest = centre.distance(centre.clamp(cloud.origin_m, cloud.far_corner()));
    let least = (APART * DVec3::from_array(view_region.half()).length())
        .max(DVec3::from_array(cloud.cell_m).length());
    cloud.boundary == Boundary::Open && nearest >= least
}

/// Optical depth behind which nothing is seen: pictures give up at a share of 10⁻⁶ of the light.
pub const DEEPEST: f32 = 13.815_511;
/// Most viewpoints along an edge of the box, faces included, from which cells are looked for.
const MOST_LOOKOUTS: usize = 9;
/// Most dilations: each takes in the cells beside those found.
const MOST_DILATIONS: usize = 8;

/// Cells that a viewpoint of the region can see: through an optical depth of less than [`DEEPEST`], traced to their middles from a lattice of
/// viewpoints, and the cells beside those, dilated so often that what shows through a gap to a viewpoint between two of the lattice is among
/// them, wherever the gap and what shows through it stand; and once more, as light is read between cells.
///
/// Extinction is the grid's, constant within a cell. Pictures cut billows into its edges, or read it between middles, and look deeper
/// there than the grid lets through: they end at a share of 2 · 10⁻³ (an optical depth of 6.2), which leaves 7.6 for that. A slit in the
/// shadow of whole cells may show to some viewpoint a sliver of a cell whose middle is hidden from the lattice, beyond those dilations; it is filled
/// from the cells around it.
///
/// `None` where that cannot be said: a view region that does not stand apart, or so near before so deep a cloud that it would take
/// too many dilations.
pub fn visible(cloud: &Cloud, view_region: &ViewRegion) -> Option<Vec<bool>> {
    if !stand_apart(cloud, view_region) {
        return None;
    }
    let (lookouts, dilations) = lookouts(cloud, view_region)?;
    let tracer = Tracer::new(cloud, 1.0);
    let half_diagonal = 0.5 * DVec3::from_array(cloud.cell_m).length() as f32;
    let sees = |cell: usize| {
        let extinction = cloud.extinction[cell];
        let middle = cloud.centre(cloud.shape.cell(cell));
        extinction > 0.0
            && lookouts.iter().any(|&viewpoint| {
                tracer.optical_depth(viewpoint, middle) - extinction * half_diagonal < DEEPEST
            })
    };
    let mut seen: Vec<bool> = (0..cloud.shape.len()).into_par_iter().map(sees).collect();
    for _ in 0..dilations {
        seen = cloud.beside(&seen);
    }
    Some(seen)
}

/// The lattice of viewpoints, and the dilations that go with it; `None` where those would be too many.
fn lookouts(cloud: &Cloud, view_region: &ViewRegion) -> Option<(Vec<DVec3>, usize)> {
    let (low, high) = (DVec3::from_array(view_region.low_m), DVec3::from_array(view_region.high_m));
    let half_diagonal = 0.5 * DVec3::from_array(cloud.cell_m).length();
    // How near and how far from any viewpoint of the box there is cloud.
    let (mut nearest, mut farthest) = (f64::INFINITY, 0.0f64);
    for cell in (0..cloud.shape.len()).filter(|&cell| cloud.extinction[cell] > 0.0) {
        let middle = cloud.centre(cloud.shape.cell(cell));
        nearest = nearest.min(middle.distance(middle.clamp(low, high)) - half_diagonal);
        let away = (middle - low).abs().max((middle - high).abs());
        farthest = farthest.max(away.length() + half_diagonal);
    }
    if nearest <= 0.0 {
        return None;
    }
    // Through a fixed gap at the cloud's near end, a viewpoint that moves by δ sees its far end move by this times δ.
    let share = ((farthest - nearest) / nearest).max(0.0);
    let finest = cloud.cell_m.iter().fold(f64::INFINITY, |least, &edge| least.min(edge));
    let (mut counts, mut moved) = ([1; 3], 0.0f64);
    for (axis, count) in counts.iter_mut().enumerate() {
        let edge = 2.0 * view_region.half()[axis];
        if edge > 0.0 {
            // A viewpoint between two is half their distance from the nearer.
            let gaps = (edge * share / (2.0 * finest)).ceil().clamp(1.0, (MOST_LOOKOUTS - 1) as f64);
            *count = 1 + gaps as usize;
            let half_gap = edge / gaps / 2.0;
            moved += half_gap * half_gap;
        }
    }
    let dilations = (libm::sqrt(moved) * share / finest).ceil().max(1.0) + 1.0;
    if dilations > MOST_DILATIONS as f64 {
        return None;
    }
    let place = |at: usize, count: usize| 2.0 * at as f64 / (count.max(2) - 1) as f64 - 1.0;
    let mut found = Vec::with_capacity(counts.iter().product());
    for z in 0..counts[2] {
        for y in 0..counts[1] {
            for x in 0..counts[0] {
                let at = [place(x, counts[0]), place(y, counts[1]), place(z, counts[2])];
                found.push(DVec3::from_array(view_region.point(at)));
            }
        }
    }
    Some((found, dilations as usize))
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{VIEWPOINTS, cloud};
    use super::*;
    use squall_formats::GridShape;
    use squall_runtime::random::Random;

    #[test]
    fn a_thick_wall_hides_what_lies_deeper_than_can_be_seen() {
        // Seen from y far below: cells of 60 m with an optical depth of 6 each, 2.3 cells deep.
        let cloud = cloud(|_| 0.1);
        let view_region = ViewRegion { low_m: [50.0, -9000.0, 420.0], high_m: [50.0, -9000.0, 420.0] };
        let seen = visible(&cloud, &view_region).unwrap();
        for (cell, &seen) in seen.iter().enumerate() {
            let [_, y, _] = cloud.shape.cell(cell);
            // The half diagonal is 0.73 of a cell's edge along y, two cells more are kept beside.
            let deepest = f64::from(DEEPEST) / 6.0 + 0.73 - 0.5 + 2.0;
            if (y as f64) > deepest + 0.5 {
                assert!(!seen, "cell {y} deep");
            }
            if (y as f64) < f64::from(DEEPEST) / 6.0 {
                assert!(seen, "cell {y} deep");
            }
        }
    }

    #[test]
    fn a_wall_seen_through_a_gap_is_seen_wherever_viewpoints_of_the_box_see_it() {
        // A front a cell thick with one cell missing, nothing behind it for sixteen cells, and a wall.
        let cloud = cloud(|[x, y, z]| match y {
            0 if [x, z] != [6, 4] => 1.0,
            19 => 1.0,
            _ => 0.0,
        });
        let view_region = ViewRegion { low_m: [-150.0, -150.0, 400.0], high_m: [150.0, 150.0, 460.0] };
        let seen = visible(&cloud, &view_region).unwrap();
        let tracer = Tracer::new(&cloud, 1.0);
        let mut random = Random::new(5);
        let gap = cloud.centre([6, 0, 4]);
        let mut met = std::collections::BTreeSet::new();
        for _ in 0..4000 {
            let at = [random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0)];
            let viewpoint = DVec3::from_array(view_region.point(at));
            let aim = gap + DVec3::new(random.range(-25.0, 25.0), 0.0, random.range(-20.0, 20.0));
            let wall = cloud.origin_m.y + 19.1 * cloud.cell_m[1];
            let point = viewpoint + (aim - viewpoint) * ((wall - viewpoint.y) / (aim.y - viewpoint.y));
            let place = (point - cloud.origin_m) / DVec3::from_array(cloud.cell_m);
            let inside = place.cmpge(DVec3::ZERO).all() && place.x < 12.0 && place.z < 9.0;
            if inside && tracer.optical_depth(viewpoint, point) < DEEPEST {
                let cell = cloud.shape.index(place.x as usize, place.y as usize, place.z as usize);
                assert!(seen[cell], "cell {cell} from {viewpoint}");
                met.insert(cell);
            }
        }
        assert!(met.len() > 10, "{} cells of the wall met", met.len());
    }

    #[test]
    fn a_wall_far_behind_a_gap_before_near_viewpoints_is_found_whole_or_nothing_is_hidden() {
        // Viewpoints 200 m before a front a cell thick with one cell missing, a wall far behind it.
        for (far, hides) in [(9u32, true), (89, true), (200, false)] {
            let shape = GridShape::new(61, far + 1, 9);
            let extinction = (0..shape.len()).map(|cell| match shape.cell(cell) {
                [30, 0, 4] => 0.0,
                [_, 0, _] => 1.0,
                [_, y, _] if y == far as usize => 1.0,
                _ => 0.0,
            });
            let cloud = Cloud {
                shape,
                cell_m: [100.0; 3],
                origin_m: DVec3::new(-3050.0, 200.0, -450.0),
                extinction: extinction.collect(),
                albedo: 0.99,
                g: 0.85,
                boundary: Boundary::Open,
            };
            let view_region = ViewRegion { low_m: [-90.0, 0.0, -10.0], high_m: [90.0, 0.0, 10.0] };
            let found = visible(&cloud, &view_region);
            assert_eq!(found.is_some(), hides, "a wall in row {far}");
            let Some(seen) = found else { continue };
            let tracer = Tracer::new(&cloud, 1.0);
            let mut met = 0;
            for at in 0..61 * 9 * 41 {
                let (x, z, viewpoint) = (at % 61, at / 61 % 9, at / (61 * 9));
                let viewpoint = DVec3::from_array(view_region.point([
                    f64::from(viewpoint as u32) / 20.0 - 1.0,
                    0.0,
                    0.3,
                ]));
                // The near side of the cell.
                let point = cloud.centre([x, far as usize, z]) - DVec3::Y * 49.0;
                if tracer.optical_depth(viewpoint, point) < DEEPEST {
                    met += 1;
                    assert!(
                        seen[shape.index(x, far as usize, z)],
                        "cell {x}, {z} of wall {far} from {viewpoint}"
                    );
                }
            }
            assert!(met > 100, "{met} sights of wall {far}");
        }
    }

    #[test]
    fn nothing_is_hidden_from_viewpoints_that_are_near_or_under_a_cloud_without_end() {
        let dense = cloud(|_| 0.1);
        let around = ViewRegion { low_m: [-5000.0, -5000.0, 0.0], high_m: [5000.0, 5000.0, 5000.0] };
        assert!(visible(&dense, &around).is_none());
        let near = ViewRegion { low_m: [-250.0, 0.0, 0.0], high_m: [250.0, 800.0, 300.0] };
        assert!(visible(&dense, &near).is_none());
        let inside = dense.centre([6, 10, 4]).to_array();
        assert!(visible(&dense, &ViewRegion { low_m: inside, high_m: inside }).is_none());
        let endless = Cloud { boundary: Boundary::PeriodicXy, ..dense.clone() };
        assert!(visible(&dense, &VIEWPOINTS).is_some() && visible(&endless, &VIEWPOINTS).is_none());
    }

    #[test]
    fn whatever_a_held_out_viewpoint_looks_into_is_among_the_visible_cells() {
        let mut random = Random::new(11);
        let lumps: Vec<f64> = (0..12 * 20 * 9).map(|_| random.normal()).collect();
        let cloud = cloud(|[x, y, z]| {
            let lump = lumps[x + 12 * (y + 20 * z)];
            if lump < -1.5 { 0.0 } else { (0.06 * libm::exp(0.8 * lump)) as f32 }
        });
        let seen = visible(&cloud, &VIEWPOINTS).unwrap();
        assert!(seen.contains(&false), "nothing is hidden: the test shows nothing");
        let tracer = Tracer::new(&cloud, 1.0);
        let mut met = 0;
        for _ in 0..20_000 {
            let at = [random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0)];
            let viewpoint = DVec3::from_array(VIEWPOINTS.point(at));
            let size = cloud.far_corner() - cloud.origin_m;
            let share = DVec3::new(random.unit(), random.unit(), random.unit());
            let point = cloud.origin_m + size * share;
            let place = (point - cloud.origin_m) / DVec3::from_array(cloud.cell_m);
            let cell = cloud.shape.index(place.x as usize, place.y as usize, place.z as usize);
            if cloud.extinction[cell] > 0.0 && tracer.optical_depth(viewpoint, point) < DEEPEST {
                assert!(seen[cell], "cell {cell} from {viewpoint}");
                met += 1;
            }
        }
        assert!(met > 1000, "{met} points met");
    }
}
