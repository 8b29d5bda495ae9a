//! The shadow that the storm's cloud throws: what of the sun's beam comes through it to a place, from a table over the plane across the beam.
//!
//! Along the beam a cloud begins and ends once for every place of that plane (gaps inside count as thin cloud). Places behind the cloud have what all of
//! it lets through, places before it all of the beam, those inside it what lies between; so the table serves suns of every height, and rain
//! at any. It depends on cloud and sun alone, and is kept while they stay.

use crate::parallel::prelude::*;
use crate::transport::direct::Tracer;
use crate::transport::{Boundary, Cloud};
use glam::{DVec2, DVec3, Vec3};

/// Most nodes along a side: some hundred thousand cells are crossed for each thousand of them.
const MOST: usize = 192;
/// Depth from which a beam is gone.
const DARK: f32 = 30.0;

/// The cloud on the way of the beam through one node.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Column {
    depth: f32,
    /// Where it begins and ends, m towards the sun.
    ends: [f32; 2],
}

/// The shadow of a cloud under one sun.
#[derive(Clone, Debug, PartialEq)]
pub struct CloudShade {
    towards: Vec3,
    across: [DVec3; 2],
    low: DVec2,
    step: f64,
    counts: [usize; 2],
    columns: Vec<Column>,
}

impl CloudShade {
    /// Of a cloud that ends somewhere, under a sun in unit direction `towards`; `kept` if it is that. None of a cloud that goes on for ever.
    pub fn of(kept: Option<Self>, cloud: Option<&Cloud>, towards: Vec3) -> Option<Self> {
        let cloud = cloud.filter(|cloud| cloud.boundary == Boundary::Open)?;
        match kept {
            Some(known) if known.towards == towards => Some(known),
            _ => Some(Self::new(cloud, towards)),
        }
    }

    fn new(cloud: &Cloud, towards: Vec3) -> Self {
        let sun = towards.as_dvec3().normalize();
        let (x, y) = sun.any_orthonormal_pair();
        let corner = |i: usize| {
            let far = cloud.far_corner();
            let pick = |axis: usize| if i >> axis & 1 == 0 { cloud.origin_m[axis] } else { far[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        };
        let places = [0, 1, 2, 3, 4, 5, 6, 7]
            .map(|i| DVec3::new(corner(i).dot(x), corner(i).dot(y), corner(i).dot(sun)));
        let low = places.into_iter().fold(DVec3::INFINITY, DVec3::min);
        let high = places.into_iter().fold(DVec3::NEG_INFINITY, DVec3::max);
        let size = (high - low).truncate();
        let cell = cloud.cell_m.into_iter().fold(f64::INFINITY, f64::min);
        let step = (0.5 * cell).max(size.max_element() / (MOST - 1) as f64);
        let counts = [size.x, size.y].map(|side| libm::ceil(side / step) as usize + 1);
        let tracer = Tracer::new(cloud, 1.0);
        let mut columns = vec![Column::default(); counts[0] * counts[1]];
        columns.par_chunks_mut(counts[0]).enumerate().for_each(|(row, columns)| {
            for (at, column) in columns.iter_mut().enumerate() {
                let place = low.truncate() + step * DVec2::new(at as f64, row as f64);
                let from = x * place.x + y * place.y + sun * low.z;
                *column = follow(&tracer, from, sun, low.z);
            }
        });
        Self { towards, across: [x, y], low: low.truncate(), step, counts, columns }
    }

    /// Share of the sun's beam that comes through the cloud to a place.
    pub fn left(&self, place: DVec3) -> f32 {
        let [x, y] = self.across;
        let at = (DVec2::new(place.dot(x), place.dot(y)) - self.low) / self.step;
        let (column, row) = (libm::floor(at.x), libm::floor(at.y));
        // Written so that NaN has no cloud.
        if !(column >= 0.0
            && row >= 0.0
            && column < (self.counts[0] - 1) as f64
            && row < (self.counts[1] - 1) as f64)
        {
            return 1.0;
        }
        let (u, v) = ((at.x - column) as f32, (at.y - row) as f32);
        let first = row as usize * self.counts[0] + column as usize;
        let along = place.dot(self.towards.as_dvec3().normalize()) as f32;
        let open = |i: usize| self.columns[i].left(along);
        let (a, b) = (open(first), open(first + 1));
        let (c, d) = (open(first + self.counts[0]), open(first + self.counts[0] + 1));
        let (near, far) = (a + u * (b - a), c + u * (d - c));
        near + v * (far - near)
    }
}

/// The cloud from a place on towards the sun; the place lies `along` m towards it.
fn follow(tracer: &Tracer<'_>, from: DVec3, sun: DVec3, along: f64) -> Column {
    let Some((start, stop)) = tracer.span(from, sun) else { return Column::default() };
    let (mut here, mut column) = (start, Column::default());
    let mut is_in = false;
    tracer.walk(from, sun, start, stop, |_, length, extinction| {
        let next = here + f64::from(length);
        if extinction > 0.0 {
            if !is_in {
                (is_in, column.ends[0]) = (true, (along + here) as f32);
            }
            column.depth += extinction * length;
            column.ends[1] = (along + next) as f32;
        }
        here = next;
        true
    });
    column
}

impl Column {
    fn left(&self, along: f32) -> f32 {
        let [from, to] = self.ends;
        if self.depth == 0.0 || along >= to {
            return 1.0;
        }
        let share = if along <= from { 1.0 } else { (to - along) / (to - from) };
        let depth = self.depth * share;
        if depth > DARK { 0.0 } else { libm::expf(-depth) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::GridShape;

    /// A slab 4 km square between 1 and 2 km, as deep as this from below.
    fn slab(depth: f32) -> Cloud {
        let shape = GridShape::new(20, 20, 8);
        let extinction = (0..shape.len()).map(|i| if shape.cell(i)[2] >= 3 { depth / 1_000.0 } else { 0.0 });
        Cloud {
            shape,
            cell_m: [200.0; 3],
            origin_m: DVec3::new(-2_000.0, -2_000.0, 400.0),
            extinction: extinction.collect(),
            albedo: 1.0,
            g: 0.85,
            boundary: Boundary::Open,
        }
    }

    #[test]
    fn a_place_has_what_the_cloud_between_it_and_the_sun_leaves() {
        /// Of a table of nodes half a cell apart, away from a hard slab's edges.
        const TOLERANCE: f32 = 0.02;
        /// Places of two thousand where such an edge falls between two nodes, a hundred metres apart.
        const AT_EDGES: u32 = 120;
        /// Fewer in the open, and in the shadow, would be a test of the other alone.
        const LEAST: [u32; 2] = [500, 40];
        let cloud = slab(1.5);
        let tracer = Tracer::new(&cloud, 1.0);
        for towards in
            [Vec3::Z, Vec3::new(0.5, 0.2, 1.0), Vec3::new(-1.0, 0.4, 0.15), Vec3::new(1.0, 0.0, 0.0)]
        {
            let towards = towards.normalize();
            let shade = CloudShade::of(None, Some(&cloud), towards).unwrap();
            let mut random = crate::random::Random::new(2);
            let (mut dark, mut open, mut off) = (0, 0, 0);
            for _ in 0..2000 {
                let place =
                    DVec3::new(random.range(-9e3, 9e3), random.range(-4e3, 4e3), random.range(0.0, 2_500.0));
                let wanted = libm::expf(-tracer.optical_depth(place, place + 1e6 * towards.as_dvec3()));
                let found = shade.left(place);
                assert!((0.0..=1.0).contains(&found));
                off += u32::from((found - wanted).abs() > TOLERANCE);
                dark += u32::from(wanted < 0.9);
                open += u32::from(wanted == 1.0);
            }
            assert!(off < AT_EDGES, "{towards}: {off}");
            assert!(open > LEAST[0] && dark > LEAST[1], "{towards}: {dark} {open}");
        }
    }

    #[test]
    fn a_place_inside_the_cloud_has_what_lies_between_it_and_the_clouds_end() {
        /// Single precision of heights in km.
        const ROUND_OFF: f32 = 1e-3;
        let shade = CloudShade::of(None, Some(&slab(1.5)), Vec3::Z).unwrap();
        for (height, above) in
            [(100.0, 1.0), (999.0, 1.0), (1_200.0, 0.8), (1_650.0, 0.35), (1_990.0, 0.01), (2_100.0, 0.0)]
        {
            let (found, wanted) = (shade.left(DVec3::new(30.0, -70.0, height)), libm::expf(-1.5 * above));
            assert!((found - wanted).abs() < ROUND_OFF, "{height}: {found} {wanted}");
        }
    }

    #[test]
    fn a_shadow_is_kept_for_its_sun_and_no_cloud_has_none() {
        let cloud = slab(1.0);
        let shade = CloudShade::of(None, Some(&cloud), Vec3::Z).unwrap();
        let mut marked = shade.clone();
        marked.columns[0].depth = 7.0;
        assert!(CloudShade::of(Some(marked.clone()), Some(&cloud), Vec3::Z) == Some(marked.clone()));
        let other = Vec3::new(0.0, 0.6, 0.8);
        assert!(
            CloudShade::of(Some(marked), Some(&cloud), other) == CloudShade::of(None, Some(&cloud), other)
        );
        assert!(CloudShade::of(None, None, Vec3::Z).is_none());
        let endless = Cloud { boundary: Boundary::PeriodicXy, ..cloud };
        assert!(CloudShade::of(None, Some(&endless), Vec3::Z).is_none());
    }
}
