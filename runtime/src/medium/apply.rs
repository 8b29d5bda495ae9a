//! The medium over a picture: some pixels at a time, four side by side in a register, nothing allocated, the same bytes for any number of threads.
//!
//! | quantity | where | error |
//! |---|---|---|
//! | secant, optical depth | per pixel, single precision | 4e-7 of τ |
//! | e^−τ | 2^x by a polynomial of degree 5 on [−½, ½] | 2e-7 of itself |
//! | sky and ground of J | at nodes 16 pixels apart, cubic between rows and to 8 pixels, linear below; per pixel where pixels are wide | below 2e-3 of J at 120° and 1080 rows |
//! | sun and flash of J | per pixel, in closed form | 1e-6 of the peak |
//!
//! Pixels that bounded rain may end before, and pixels among the drawn shells, take the exact sums instead; over a map some of those
//! are worked out at nodes ([`mapped`]).

mod dry;
mod mapped;

use super::{Medium, Outlook};
use crate::camera::{Camera, Lens, Projection, Ray};
use crate::depth::{DepthBuffer, DepthKind};
use crate::error::RuntimeError;
use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::rain::RainPath;
use crate::registers::in_registers;
use crate::world::InScattering;
use glam::{Vec4, Vec4Swizzles};
use mapped::Mapped;

/// Pixels worked out together, a multiple of eight: loops of a fixed length, which compilers put into registers.
const LANES: usize = 64;
/// Pixels between which J is linear.
const FLAT: usize = 8;
/// Pixels between nodes of J, down and across.
const STEP: usize = 2 * FLAT;
/// Steps in a band of rows that share their nodes.
const BAND: usize = 4;
/// Most nodes across; wider pictures work J out at every pixel.
const NODES: usize = 520;
/// Distant lights that are blended with the pixels; of more, each is added to all of J's pixels first.
const MOST_BEAMS: usize = 4;
/// Widest step of J, as a tangent: a horizon in rain of g = .88 bends over .12.
const WIDEST_STEP: f32 = 0.08;

type Lanes = [f32; LANES];

impl Medium {
    /// Attenuates `picture` and adds the light scattered in; writes each pixel's transmittance F.
    ///
    /// Without a depth buffer, all is sky; sky is infinitely far, so in rain without bounds it vanishes and
    /// in a finite `volume` it does not. Rows are spread over the caller's rayon pool. Nothing is allocated.
    ///
    /// Where the depth buffer has holes ([`crate::depth::DepthHoles`]) that are to be left alone, the pixel keeps its light and F
    /// is 1. Answers how many holes there were, filled ones included.
    ///
    /// Errors: an orthographic camera; a picture, depth buffer or transmittance of another size than the
    /// camera's.
    pub fn apply<V: RainPath>(
        &self,
        outlook: &Outlook<V>,
        picture: &mut Picture,
        transmittance: &mut [f32],
    ) -> Result<usize, RuntimeError> {
        let Outlook { camera, depth, .. } = outlook;
        let (width, height) = (camera.width as usize, camera.height as usize);
        if !matches!(camera.projection, Projection::Perspective { .. }) {
            return Err(RuntimeError::argument("rain camera", "a perspective camera", "an orthographic one"));
        }
        if (picture.width, picture.height) != (width, height) || picture.pixels.len() != width * height {
            let found = format!("{} × {}", picture.width, picture.height);
            return Err(RuntimeError::argument("picture", format!("the camera's {width} × {height}"), found));
        }
        if transmittance.len() != width * height {
            let wanted = format!("{} pixels", width * height);
            return Err(RuntimeError::argument("transmittance", wanted, transmittance.len()));
        }
        if let Some(depth) = depth {
            depth.check_size(width, height)?;
        }
        let band_medium = BandMedium::new(self, outlook);
        let bands = picture.pixels.par_chunks_mut(width * STEP * BAND);
        let bands = bands.zip(transmittance.par_chunks_mut(width * STEP * BAND));
        bands.enumerate().for_each(|(number, (pixels, left))| {
            in_registers(
                #[inline(always)]
                || band_medium.band(number * STEP * BAND, pixels, left),
            );
        });
        Ok(depth.as_ref().map_or(0, DepthBuffer::holes))
    }
}

/// A medium before one camera, its numbers in single precision.
struct BandMedium<'a, V> {
    medium: &'a Medium,
    camera: &'a Camera,
    lens: Lens<'a>,
    volume: &'a V,
    light: &'a InScattering,
    depth: Option<&'a DepthBuffer<'a>>,
    /// Tangents to the right of and below the axis at the picture's corner, and their step per pixel.
    first: [f32; 2],
    per_pixel: [f32; 2],
    extinction: f32,
    /// Planar depth beyond which every shell is left behind, and what they hold together.
    shells_end: f32,
    shells_hold: f32,
    /// Distance within which rain is full, and that at which it ends.
    full: f32,
    farthest: f32,
    /// Whether J is worked out at nodes.
    has_nodes: bool,
    /// Whether depths of rain over a map are.
    is_mapped: bool,
}

/// J along one row of pixels: at every eighth pixel's left edge, or nowhere.
type Line = [[f32; 3]; 2 * NODES];

/// What some pixels show of a distant light: the share of its irradiance that is scattered along each ray, 1/sr.
#[derive(Clone, Copy)]
struct Shown {
    share: Lanes,
    irradiance: [f32; 3],
}

/// A distant light in one row of pixels: cos θ = (first + x · per pixel)/secant.
struct RowBeam {
    first: f32,
    per_tangent: f32,
    irradiance: [f32; 3],
}

impl<'a, V: RainPath> BandMedium<'a, V> {
    fn new(medium: &'a Medium, outlook: &'a Outlook<'a, V>) -> Self {
        let camera = outlook.camera;
        let [low, high] = [0.0, 1.0].map(|at| camera.tangents(at, at));
        let per_pixel = [(high.x - low.x) as f32, (high.y - low.y) as f32];
        let widest = STEP as f32 * per_pixel[0].abs().max(per_pixel[1].abs());
        Self {
            medium,
            camera,
            lens: Lens::new(camera),
            volume: &outlook.volume,
            light: outlook.light,
            depth: outlook.depth.as_ref(),
            first: [low.x as f32, low.y as f32],
            per_pixel,
            extinction: medium.extinction.0 as f32,
            shells_end: medium.drawn.iter().map(|shell| shell.far).fold(0.0, f64::max) as f32,
            shells_hold: medium.drawn.iter().map(|s| s.extinction * (s.far - s.near)).sum::<f64>() as f32,
            full: outlook.volume.filled_radius(camera.position) as f32,
            farthest: outlook.volume.farthest() as f32,
            has_nodes: widest <= WIDEST_STEP && (camera.width as usize) < (NODES - 5) * STEP,
            is_mapped: outlook.volume.is_costly()
                && widest <= WIDEST_STEP
                && (camera.width as usize) < (NODES - 5) * STEP,
        }
    }

    /// J of sky and ground at the nodes of the line `y` pixels from the top; the first stands one step left of the picture.
    fn nodes(&self, y: f64, nodes: &mut [[f32; 3]; NODES]) {
        let camera = self.camera;
        let down = self.first[1] + y as f32 * self.per_pixel[1];
        let row = (camera.forward - camera.up * f64::from(down)).as_vec3();
        let right = camera.right.as_vec3();
        for (k, node) in nodes[..self.count()].iter_mut().enumerate() {
            let across = self.first[0] + (k as f32 - 1.0) * STEP as f32 * self.per_pixel[0];
            *node = self.light.diffuse(row + right * across);
        }
    }

    /// Nodes of a line.
    fn count(&self) -> usize {
        self.camera.width as usize / STEP + 5
    }

    #[inline(always)]
    fn band(&self, top: usize, pixels: &mut [[f32; 3]], left: &mut [f32]) {
        let width = self.camera.width as usize;
        let mut nodes = [[[0.0f32; 3]; NODES]; BAND + 3];
        if self.has_nodes {
            for (k, nodes) in nodes.iter_mut().enumerate() {
                self.nodes((top + k * STEP) as f64 - STEP as f64, nodes);
            }
        }
        let mut mapped = Mapped::NONE;
        if self.is_mapped {
            mapped.fill(self, top, pixels.len() / width);
        }
        let mut line = [[0.0f32; 3]; 2 * NODES];
        let rows = pixels.chunks_mut(width).zip(left.chunks_mut(width)).enumerate();
        for (row, (pixels, left)) in rows {
            if self.has_nodes {
                let weights = cubic((row % STEP) as f32 / STEP as f32 + 0.5 / STEP as f32);
                let four = std::array::from_fn(|k| &nodes[row / STEP + k]);
                self.fill_line(four, weights, &mut line);
            }
            self.row([top + row, row], (&line, &mapped), pixels, left);
        }
    }

    /// J of one row between four lines of nodes, at every eighth pixel.
    #[inline(always)]
    fn fill_line(&self, nodes: [&[[f32; 3]; NODES]; 4], weights: [f32; 4], line: &mut Line) {
        let count = self.count();
        let mut own = [[0.0f32; 3]; NODES];
        for k in 0..count {
            for band in 0..3 {
                own[k][band] = weights[0] * nodes[0][k][band]
                    + weights[1] * nodes[1][k][band]
                    + weights[2] * nodes[2][k][band]
                    + weights[3] * nodes[3][k][band];
            }
        }
        for k in 1..count - 2 {
            line[2 * k - 2] = own[k];
            for band in 0..3 {
                let [outer, inner] = [own[k - 1][band] + own[k + 2][band], own[k][band] + own[k + 1][band]];
                line[2 * k - 1][band] = 0.5625 * inner - 0.0625 * outer;
            }
        }
    }

    #[inline(always)]
    fn row(
        &self,
        [y, row]: [usize; 2],
        (line, mapped): (&Line, &Mapped),
        pixels: &mut [[f32; 3]],
        left: &mut [f32],
    ) {
        let tangent = self.first[1] + (y as f32 + 0.5) * self.per_pixel[1];
        let down = f64::from(tangent);
        let beam = |beam: &crate::world::Beam| RowBeam {
            first: (self.camera.forward - self.camera.up * down).dot(beam.towards) as f32,
            per_tangent: self.camera.right.dot(beam.towards) as f32,
            irradiance: beam.irradiance,
        };
        let beams = self.light.beams();
        let lobe = self.light.phase().as_henyey_greenstein();
        let by_line = self.has_nodes && beams.len() <= MOST_BEAMS && (beams.is_empty() || lobe.is_some());
        let mut shown = [Shown { share: [0.0; LANES], irradiance: [0.0; 3] }; MOST_BEAMS];
        let depth = self.depth.map(|depth| (depth.row(y), depth.kind() == DepthKind::Range));
        let squared = 1.0 + tangent * tangent;
        let (mut tangents, mut secants, mut known) = ([0.0; LANES], [1.0; LANES], [f32::INFINITY; LANES]);
        for (k, (pixels, left)) in pixels.chunks_mut(LANES).zip(left.chunks_mut(LANES)).enumerate() {
            let (at, count) = (k * LANES, pixels.len());
            let first = self.first[0] + (at as f32 + 0.5) * self.per_pixel[0];
            for i in 0..LANES {
                tangents[i] = first + i as f32 * self.per_pixel[0];
                secants[i] = (squared + tangents[i] * tangents[i]).sqrt();
            }
            if let Some((metres, _)) = depth {
                known[..count].copy_from_slice(&metres[at..at + count]);
            }
            let ranges = depth.is_none_or(|(_, ranges)| ranges);
            let mut seen = [0.0; LANES];
            self.optical_depths([at, y, row], (&known, ranges, mapped), (&tangents, &secants), &mut seen);
            exp_neg(&mut seen);
            let mut done = 0;
            if by_line {
                for (beam, shown) in beams.iter().map(beam).zip(&mut shown) {
                    shown.irradiance = beam.irradiance;
                    beam.cosines(&tangents, &secants, &mut shown.share);
                    lobe.into_iter().for_each(|lobe| henyey_greenstein(lobe, &mut shown.share));
                }
                done = blend_line(&seen, &line[at / FLAT..], &shown[..beams.len()], pixels);
            }
            if done < count {
                let mut source = [[0.0f32; 3]; LANES];
                self.fill_source([at, y], line, &mut source);
                for beam in beams.iter().map(beam) {
                    self.add_beam(&beam, &tangents, &secants, &mut source);
                }
                blend(&seen[done..], &source[done..], &mut pixels[done..]);
            }
            left.copy_from_slice(&seen[..count]);
        }
    }

    /// J of sky and ground at the pixels from (x, y) on.
    #[inline(always)]
    fn fill_source(&self, [x, y]: [usize; 2], line: &Line, source: &mut [[f32; 3]; LANES]) {
        if !self.has_nodes {
            let last = self.camera.width as usize - x;
            for (i, source) in source.iter_mut().enumerate().take(last) {
                *source = self.light.diffuse(self.ray(x + i, y).direction.as_vec3());
            }
            return;
        }
        for (at, pixels) in source.chunks_exact_mut(FLAT).enumerate() {
            let [from, to] = [line[x / FLAT + at], line[x / FLAT + at + 1]];
            for (i, pixel) in pixels.iter_mut().enumerate() {
                let across = (i as f32 + 0.5) / FLAT as f32;
                (0..3).for_each(|band| pixel[band] = from[band] + across * (to[band] - from[band]));
            }
        }
    }

    /// τ of the pixels from (x, y) on, whose depth buffer says `metres`; 0 where a hole is to be left alone.
    #[inline(always)]
    fn optical_depths(
        &self,
        place: [usize; 3],
        (metres, ranges, mapped): (&Lanes, bool, &Mapped),
        (tangents, secants): (&Lanes, &Lanes),
        depths: &mut Lanes,
    ) {
        let [x, y, row] = place;
        // Read from one place and written to another: a value that is left as it was would become a store with a mask, which some processors take long for.
        let mut range = [0.0; LANES];
        for i in 0..LANES {
            let own = if ranges { metres[i] } else { metres[i] * secants[i] };
            range[i] = if own > self.farthest { self.farthest } else { own };
        }
        let mut special = 0u32;
        let dry = self.dry([x, y], (tangents, secants), &range);
        for i in 0..LANES {
            let plain = (range[i] >= self.shells_end * secants[i])
                & (range[i] > 0.0)
                & (range[i] <= self.full)
                & (dry >> i & 1 == 0);
            special |= u32::from(!plain);
            let depth = self.extinction * range[i] - self.shells_hold * secants[i];
            depths[i] = if depth > 0.0 { depth } else { 0.0 };
        }
        if special == 0 {
            return;
        }
        for i in 0..LANES.min(self.camera.width as usize - x) {
            let is_dry = dry >> i & 1 == 1;
            let plain = (range[i] >= self.shells_end * secants[i])
                & (range[i] > 0.0)
                & (range[i] <= self.full)
                & !is_dry;
            if plain {
                continue;
            }
            depths[i] = match self.is_mapped && !is_dry {
                true => self.mapped_depth(mapped, [x + i, y, row], range[i], secants[i]),
                false => self.one_optical_depth([x + i, y], (range[i], secants[i]), is_dry),
            };
        }
    }

    /// [`BandMedium::optical_depths`] of any pixel.
    fn one_optical_depth(&self, [x, y]: [usize; 2], (range, secant): (f32, f32), is_dry: bool) -> f32 {
        let planar = if range > 0.0 {
            f64::from(range / secant)
        } else {
            match self.depth.and_then(|depth| depth.known(x, y, || f64::from(secant))) {
                Some(planar) => planar.min(f64::from(self.farthest / secant)),
                None => return 0.0,
            }
        };
        // A filled hole is as far as it was filled, not as its raw number says.
        let is_full = planar * f64::from(secant) <= f64::from(self.full) || self.full == f32::INFINITY;
        if is_full && !is_dry {
            return self.medium.optical_depth(planar, f64::from(secant)) as f32;
        }
        let ray = self.ray(x, y);
        self.medium.optical_depth_in(self.volume, &ray, planar, f64::from(secant)) as f32
    }

    fn ray(&self, x: usize, y: usize) -> Ray {
        self.lens.ray(x as f64 + 0.5, y as f64 + 0.5)
    }

    #[inline(always)]
    fn add_beam(&self, beam: &RowBeam, tangents: &Lanes, secants: &Lanes, source: &mut [[f32; 3]; LANES]) {
        let mut shares = [0.0f32; LANES];
        beam.cosines(tangents, secants, &mut shares);
        let Some(lobe) = self.light.phase().as_henyey_greenstein() else {
            for (source, cosine) in source.iter_mut().zip(shares) {
                let share = self.light.phase().values(f64::from(cosine.clamp(-1.0, 1.0)));
                (0..3).for_each(|band| source[band] += share[band] as f32 * beam.irradiance[band]);
            }
            return;
        };
        henyey_greenstein(lobe, &mut shares);
        for (source, share) in source.iter_mut().zip(shares) {
            (0..3).for_each(|band| source[band] += share * beam.irradiance[band]);
        }
    }
}

impl RowBeam {
    /// cos θ between each pixel's ray and the light.
    #[inline(always)]
    fn cosines(&self, tangents: &Lanes, secants: &Lanes, cosines: &mut Lanes) {
        for i in 0..LANES {
            cosines[i] = (self.first + self.per_tangent * tangents[i]) / secants[i];
        }
    }
}

/// What a lobe (its factor and its g) sends along each ray, 1/sr, in the stead of the cosines there.
#[inline(always)]
fn henyey_greenstein((factor, g): (f64, f64), cosines: &mut Lanes) {
    let narrow = ((1.0 - g.abs()) * (1.0 - g.abs())) as f32;
    let twice = (2.0 * g) as f32;
    let top = if g < 0.0 { -1.0 } else { 1.0 };
    let scale = (factor * (1.0 - g * g) / (4.0 * std::f64::consts::PI)) as f32;
    for cosine in cosines {
        // 1 + g² − 2g cos θ in a form that keeps its digits at the peak.
        let base = narrow + twice * (top - *cosine);
        *cosine = scale / (base * base.sqrt());
    }
}

/// Weights of four values one step apart at `t` of the way from the second to the third: Catmull and Rom's cubic.
fn cubic(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (2.0 * t2 - t - t3),
        0.5 * (2.0 - 5.0 * t2 + 3.0 * t3),
        0.5 * (t + 4.0 * t2 - 3.0 * t3),
        0.5 * (t3 - t2),
    ]
}

/// L = J + F (L₀ − J). A hidden sky contributes nothing, even where it is infinitely bright.
#[inline(always)]
fn blended(seen: Vec4, source: Vec4, light: Vec4) -> Vec4 {
    let lit = source + seen * (light - source);
    Vec4::select(seen.cmpgt(Vec4::ZERO), lit, source)
}

/// One number of each of four pixels, three times.
#[inline(always)]
fn each_of(four: &[f32]) -> [Vec4; 3] {
    let four = Vec4::from_slice(four);
    [four.xxxy(), four.yyzz(), four.zwww()]
}

/// The same of four pixels.
#[inline(always)]
fn blend_four(seen: &[f32], source: [Vec4; 3], pixels: &mut [f32]) {
    let each = each_of(seen);
    for v in 0..3 {
        let light = Vec4::from_slice(&pixels[4 * v..]);
        blended(each[v], source[v], light).write_to_slice(&mut pixels[4 * v..]);
    }
}

/// The picture's last pixels, fewer than four.
fn blend_rest(seen: &[f32], source: &[f32], pixels: &mut [f32]) {
    for (i, light) in pixels.iter_mut().enumerate() {
        *light = blended(Vec4::splat(seen[i / 3]), Vec4::splat(source[i]), Vec4::splat(*light)).x;
    }
}

/// Blends with J between the values of a line and what is `shown` of distant lights, at whole runs of eight pixels; answers how many pixels that were.
#[inline(always)]
fn blend_line(seen: &Lanes, line: &[[f32; 3]], shown: &[Shown], pixels: &mut [[f32; 3]]) -> usize {
    /// Eighths from a run's left edge to the middles of its pixels, as three numbers a pixel lie in registers.
    const ACROSS: [Vec4; 3] = [
        Vec4::new(0.0625, 0.0625, 0.0625, 0.1875),
        Vec4::new(0.1875, 0.1875, 0.3125, 0.3125),
        Vec4::new(0.3125, 0.4375, 0.4375, 0.4375),
    ];
    let spread = |[r, g, b]: [f32; 3]| [Vec4::new(r, g, b, r), Vec4::new(g, b, r, g), Vec4::new(b, r, g, b)];
    let mut from = spread(line[0]);
    let runs = pixels.chunks_exact_mut(FLAT).zip(seen.chunks_exact(FLAT)).zip(&line[1..]);
    let mut count = 0;
    for ((pixels, seen), next) in runs {
        let to = spread(*next);
        let pixels = pixels.as_flattened_mut();
        let (near, far) = pixels.split_at_mut(12);
        let slope: [Vec4; 3] = std::array::from_fn(|v| to[v] - from[v]);
        let mut first: [Vec4; 3] = std::array::from_fn(|v| from[v] + slope[v] * ACROSS[v]);
        let mut second: [Vec4; 3] = std::array::from_fn(|v| first[v] + slope[v] * 0.5);
        for Shown { share, irradiance } in shown {
            let irradiance = spread(*irradiance);
            for (v, share) in each_of(&share[count..count + 4]).into_iter().enumerate() {
                first[v] += share * irradiance[v];
            }
            for (v, share) in each_of(&share[count + 4..count + 8]).into_iter().enumerate() {
                second[v] += share * irradiance[v];
            }
        }
        blend_four(&seen[..4], first, near);
        blend_four(&seen[4..], second, far);
        from = to;
        count += FLAT;
    }
    count
}

#[inline(always)]
fn blend(seen: &[f32], source: &[[f32; 3]], pixels: &mut [[f32; 3]]) {
    for ((pixels, seen), source) in pixels.chunks_mut(4).zip(seen.chunks(4)).zip(source.chunks(4)) {
        let (pixels, source) = (pixels.as_flattened_mut(), source.as_flattened());
        match pixels.len() {
            12 => {
                let source = std::array::from_fn(|v| Vec4::from_slice(&source[4 * v..]));
                blend_four(seen, source, pixels);
            }
            _ => blend_rest(seen, source, pixels),
        }
    }
}

/// e^−τ of τ ≥ 0 in its place, error 2e-7 of itself; exactly 1 at 0, and 0 below the smallest number of single precision.
#[inline(always)]
fn exp_neg(depths: &mut Lanes) {
    /// 2^x on [−½, ½] through six Chebyshev points, its constant set to 1.
    const POWERS: [f32; 5] =
        [0.001_339_086_3, 0.009_676_032, 0.055_503_57, 0.240_221_07, std::f32::consts::LN_2];
    /// Adding it rounds to a whole number, which its last bits then hold.
    const ROUND: f32 = 12_582_912.0;
    for depth in depths {
        let power = *depth * -std::f32::consts::LOG2_E;
        let power = if power > -126.0 { power } else { -126.0 };
        let whole = power + ROUND;
        let rest = power - (whole - ROUND);
        let [e, d, c, b, a] = POWERS;
        let low = ((((e * rest + d) * rest + c) * rest + b) * rest + a) * rest + 1.0;
        let value = low * f32::from_bits(whole.to_bits().wrapping_add(127) << 23);
        let value = if value < 1.0 { value } else { 1.0 };
        *depth = if power > -126.0 { value } else { 0.0 };
    }
}

#[cfg(test)]
mod tests;
