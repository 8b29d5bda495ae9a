//! Light towards eyes in a box: from harmonics to the polynomials that hold it there, and which cells those eyes see.

use super::unseen::beside;
use glam::DVec3;
use rayon::prelude::*;
use squall_formats::eyes::{EyeBox, MAX_EYE_FUNCTIONS, eye_functions};
use squall_formats::sphere::{self, MAX_HARMONICS};
use squall_runtime::relight::eye_frame;
use squall_runtime::transport::direct::Tracer;
use squall_runtime::transport::{Boundary, Cloud};

/// Gauss and Legendre's three points on −1…1 with their weights: eyes along each edge of the box that polynomials are fitted to.
const GAUSS: [(f64, f64); 3] =
    [(-0.774_596_669_241_483_4, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.774_596_669_241_483_4, 5.0 / 18.0)];
/// Added to the normal equations: a box that is thin across the line of sight has polynomials that the fit cannot tell.
const RIDGE: f64 = 1e-7;

/// What turns 16 harmonics a cell into polynomials towards eyes: the best fit over the box.
pub struct EyeMap {
    functions: usize,
    /// `functions` × 16 a cell.
    factors: Vec<f32>,
}

impl EyeMap {
    /// The map for polynomials of degree 0 to `degree`.
    pub fn new(cloud: &Cloud, eyes: &EyeBox, degree: u8) -> Self {
        let (frame, functions) = (eye_frame(eyes, cloud), eye_functions(degree));
        let one = |cell: usize| {
            let middle = cloud.centre(cloud.shape.cell(cell));
            let mut normal = [[0.0; MAX_EYE_FUNCTIONS]; MAX_EYE_FUNCTIONS];
            let mut right = [[0.0; MAX_HARMONICS]; MAX_EYE_FUNCTIONS];
            for at in 0..27 {
                let [x, y, z] = [at % 3, at / 3 % 3, at / 9].map(|place| GAUSS[place]);
                let eye = DVec3::from_array(eyes.point([x.0, y.0, z.0]));
                let Some(towards) = (eye - middle).try_normalize() else { continue };
                let towards = towards.to_array();
                let (values, harmonics) =
                    (frame.functions(middle.to_array(), towards), sphere::harmonics(towards));
                let weight = x.1 * y.1 * z.1;
                for a in 0..functions {
                    for b in 0..functions {
                        normal[a][b] += weight * values[a] * values[b];
                    }
                    for (sum, harmonic) in right[a].iter_mut().zip(harmonics) {
                        *sum += weight * values[a] * harmonic;
                    }
                }
            }
            solve(&mut normal, &mut right, functions);
            right.into_iter().take(functions).flat_map(|row| row.map(|v| v as f32)).collect::<Vec<f32>>()
        };
        let cells: Vec<Vec<f32>> = (0..cloud.shape.len()).into_par_iter().map(one).collect();
        Self { functions, factors: cells.concat() }
    }

    /// Sixteen planes of harmonics to planes of polynomials.
    ///
    /// Panics when `harmonics` is not sixteen grids long.
    pub fn apply(&self, harmonics: &[f32]) -> Vec<f32> {
        let cells = self.factors.len() / (self.functions * MAX_HARMONICS);
        assert_eq!(harmonics.len(), cells * MAX_HARMONICS);
        let mut out = vec![0.0f32; cells * self.functions];
        for cell in 0..cells {
            let factors = &self.factors[cell * self.functions * MAX_HARMONICS..];
            for (function, row) in factors.chunks_exact(MAX_HARMONICS).take(self.functions).enumerate() {
                let products = row.iter().enumerate().map(|(m, f)| f * harmonics[m * cells + cell]);
                out[function * cells + cell] = products.sum();
            }
        }
        out
    }
}

/// Solves `normal` x = `right` for `count` unknowns and sixteen right sides, by Cholesky; x takes the place of `right`.
fn solve(
    normal: &mut [[f64; MAX_EYE_FUNCTIONS]; MAX_EYE_FUNCTIONS],
    right: &mut [[f64; MAX_HARMONICS]; MAX_EYE_FUNCTIONS],
    count: usize,
) {
    for j in 0..count {
        normal[j][j] += RIDGE;
        for i in j..count {
            let known: f64 = (0..j).map(|k| normal[i][k] * normal[j][k]).sum();
            let left = normal[i][j] - known;
            // The ridge keeps what the root is taken of above zero.
            normal[i][j] = if i == j { libm::sqrt(left.max(RIDGE)) } else { left / normal[j][j] };
        }
    }
    for i in 0..count {
        for m in 0..MAX_HARMONICS {
            let known: f64 = (0..i).map(|k| normal[i][k] * right[k][m]).sum();
            right[i][m] = (right[i][m] - known) / normal[i][i];
        }
    }
    for i in (0..count).rev() {
        for m in 0..MAX_HARMONICS {
            let known: f64 = (i + 1..count).map(|k| normal[k][i] * right[k][m]).sum();
            right[i][m] = (right[i][m] - known) / normal[i][i];
        }
    }
}

/// How many half diagonals of the box its middle has to be away from the grid: seen from there it spans 60° at most, over which
/// polynomials of degree 2 are a match for harmonics of degree 3.
const APART: f64 = 2.0;

/// Whether eyes are far enough away for channels towards them.
pub fn stand_apart(cloud: &Cloud, eyes: &EyeBox) -> bool {
    let centre = DVec3::from_array(eyes.centre());
    let nearest = centre.clamp(cloud.origin_m, cloud.far_corner());
    cloud.boundary == Boundary::Open
        && centre.distance(nearest) >= APART * DVec3::from_array(eyes.half()).length()
}

/// Optical depth behind which no eye sees: pictures give up at a share of 10⁻⁶ of the light.
pub const DEEPEST: f32 = 13.815_511;
/// Eyes along each edge of the box, faces included, from which cells are looked for.
const LOOKOUTS: usize = 5;

/// Cells that an eye of the box can see: through an optical depth of less than [`DEEPEST`], and those within two cells of them,
/// which light is read between and which other eyes of the box may see.
pub fn visible(cloud: &Cloud, eyes: &EyeBox) -> Vec<bool> {
    let tracer = Tracer::new(cloud, 1.0);
    let half_diagonal = 0.5 * DVec3::from_array(cloud.cell_m).length() as f32;
    let share = |place: usize| 2.0 * place as f64 / (LOOKOUTS - 1) as f64 - 1.0;
    // An edge of no length has one eye.
    let places = |axis: usize| if eyes.half()[axis] > 0.0 { LOOKOUTS } else { 1 };
    let mut lookouts = Vec::new();
    for z in 0..places(2) {
        for y in 0..places(1) {
            lookouts.extend((0..places(0)).map(|x| DVec3::from_array(eyes.point([x, y, z].map(share)))));
        }
    }
    let sees = |cell: usize| {
        let extinction = cloud.extinction[cell];
        let middle = cloud.centre(cloud.shape.cell(cell));
        extinction > 0.0
            && lookouts
                .iter()
                .any(|&eye| tracer.optical_depth(eye, middle) - extinction * half_diagonal < DEEPEST)
    };
    let seen: Vec<bool> = (0..cloud.shape.len()).into_par_iter().map(sees).collect();
    beside(cloud, &beside(cloud, &seen))
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::GridShape;
    use squall_formats::sphere::degree_of;
    use squall_runtime::random::Random;

    const EYES: EyeBox = EyeBox { low_m: [-150.0, -150.0, 0.0], high_m: [150.0, 150.0, 60.0] };

    fn cloud(extinction: impl Fn([usize; 3]) -> f32) -> Cloud {
        let shape = GridShape::new(12, 20, 9);
        let (cell_m, origin_m) = ([50.0, 60.0, 40.0], DVec3::new(-250.0, 900.0, 300.0));
        let extinction = (0..shape.len()).map(|cell| extinction(shape.cell(cell))).collect();
        Cloud { shape, cell_m, origin_m, extinction, albedo: 0.99, g: 0.85, boundary: Boundary::Open }
    }

    #[test]
    fn polynomials_towards_eyes_say_what_harmonics_say_there_and_better_with_degree() {
        /// Of light with the degrees that g = 0.85 leaves, over a box that spans some 20°: measured 8.2, 0.64 and 0.035 %.
        const WORST: [f64; 3] = [0.12, 0.012, 0.001];
        let cloud = cloud(|_| 0.01);
        let mut random = Random::new(3);
        let cells = cloud.shape.len();
        let mut harmonics = vec![0.0f32; cells * MAX_HARMONICS];
        for (i, value) in harmonics.iter_mut().enumerate() {
            let degree = degree_of(i / cells) as f64;
            let mean = if degree == 0.0 { 3.0 } else { 0.0 };
            *value = (libm::pow(0.85, degree) * (random.normal() + mean)) as f32;
        }
        let eyes: Vec<DVec3> = (0..40)
            .map(|_| {
                let at = [random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0)];
                DVec3::from_array(EYES.point(at))
            })
            .collect();
        let frame = eye_frame(&EYES, &cloud);
        let mut before = f64::INFINITY;
        for degree in 0..3u8 {
            let planes = EyeMap::new(&cloud, &EYES, degree).apply(&harmonics);
            let (mut off, mut size) = (0.0, 0.0);
            for cell in 0..cells {
                let middle = cloud.centre(cloud.shape.cell(cell));
                for &eye in &eyes {
                    let towards = (eye - middle).normalize().to_array();
                    let wanted: f64 = sphere::harmonics(towards)
                        .iter()
                        .enumerate()
                        .map(|(m, y)| y * f64::from(harmonics[m * cells + cell]))
                        .sum();
                    let values = frame.functions(middle.to_array(), towards);
                    let found: f64 = (0..eye_functions(degree))
                        .map(|f| values[f] * f64::from(planes[f * cells + cell]))
                        .sum();
                    off += (found - wanted) * (found - wanted);
                    size += wanted * wanted;
                }
            }
            let error = libm::sqrt(off / size);
            println!("degree {degree}: {:.3} %", 100.0 * error);
            assert!(error < WORST[usize::from(degree)] && error < 0.5 * before, "degree {degree}: {error}");
            before = error;
        }
    }

    #[test]
    fn light_that_is_the_same_everywhere_is_the_first_polynomial_alone() {
        /// The ridge, and single precision.
        const EXACT: f32 = 1e-5;
        let cloud = cloud(|_| 0.01);
        let cells = cloud.shape.len();
        let mut harmonics = vec![0.0f32; cells * MAX_HARMONICS];
        harmonics[..cells].fill(libm::sqrtf(4.0 * std::f32::consts::PI));
        for degree in 0..3 {
            let planes = EyeMap::new(&cloud, &EYES, degree).apply(&harmonics);
            for (at, value) in planes.iter().enumerate() {
                let wanted = if at < cells { 1.0 } else { 0.0 };
                assert!((value - wanted).abs() < EXACT, "degree {degree}, {at}: {value}");
            }
        }
    }

    #[test]
    fn a_thick_wall_hides_what_lies_deeper_than_an_eye_can_see() {
        // Seen from y far below: cells of 60 m with an optical depth of 6 each, 2.3 cells deep.
        let cloud = cloud(|_| 0.1);
        let eyes = EyeBox { low_m: [50.0, -9000.0, 420.0], high_m: [50.0, -9000.0, 420.0] };
        let seen = visible(&cloud, &eyes);
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
    fn whatever_an_unseen_eye_looks_into_is_among_the_visible_cells() {
        let mut random = Random::new(11);
        let lumps: Vec<f64> = (0..12 * 20 * 9).map(|_| random.normal()).collect();
        let cloud = cloud(|[x, y, z]| {
            let lump = lumps[x + 12 * (y + 20 * z)];
            if lump < -1.5 { 0.0 } else { (0.06 * libm::exp(0.8 * lump)) as f32 }
        });
        let seen = visible(&cloud, &EYES);
        assert!(seen.contains(&false), "nothing is hidden: the test shows nothing");
        let tracer = Tracer::new(&cloud, 1.0);
        let mut met = 0;
        for _ in 0..20_000 {
            let at = [random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0)];
            let eye = DVec3::from_array(EYES.point(at));
            let size = cloud.far_corner() - cloud.origin_m;
            let share = DVec3::new(random.unit(), random.unit(), random.unit());
            let point = cloud.origin_m + size * share;
            let place = (point - cloud.origin_m) / DVec3::from_array(cloud.cell_m);
            let cell = cloud.shape.index(place.x as usize, place.y as usize, place.z as usize);
            if cloud.extinction[cell] > 0.0 && tracer.optical_depth(eye, point) < DEEPEST {
                assert!(seen[cell], "cell {cell} from {eye}");
                met += 1;
            }
        }
        assert!(met > 1000, "{met} points met");
    }
}
