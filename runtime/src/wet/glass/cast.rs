//! A wet pane in a scene, and what light through it does to a frame.

use super::Glass;
use crate::error::RuntimeError;
use crate::wet::controls::controls;
use crate::wet::drop;
use crate::wet::drop::eye::Eye;
use crate::wet::frame::{Layer, WetFrame};
use glam::{DVec3, Vec3};

controls! {
    /// How drops' shadows look.
    pub struct ShadowControls {
        /// Share of a surface's light that comes through the pane.
        share: 0.6, 0.0..=1.0, "", "";
        /// Farthest surface behind the pane that is shadowed.
        far_m: 4.0, 0.05..=100.0, "m", "";
        /// Most light that is gathered in one place, over that of a dry pane.
        brightest: 6.0, 1.0..=1e3, "", "";
        /// How much of shadow and highlight is shown.
        strength: 1.0, 0.0..=1.0, "", "";
    }
}

/// Where a pane hangs in the world: its upper left corner, and its upper and left edges as vectors, m. It is seen from the side where `across` leads to the right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pane {
    /// Upper left corner, m.
    pub corner_m: DVec3,
    /// From there to the upper right corner, m.
    pub across_m: DVec3,
    /// And to the lower left one, m.
    pub down_m: DVec3,
}

/// A light that shines through a pane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PaneLight {
    /// Parallel light: the unit vector towards it.
    Distant(DVec3),
    /// A lamp, its place, m.
    Lamp(DVec3),
}

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShadowReport {
    /// Pixels that light through the pane falls on.
    pub lit: u64,
    /// Those whose light drops changed.
    pub pixels: u64,
}

/// Screens behind a pane, at distances of which each is twice the one before.
const SCREENS: usize = 4;
/// Values of a screen that are made at most where cells are told apart finer than one by one.
const VALUES_MOST: usize = 400_000;

/// Shadows of drops, with the memory that is kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct GlassShadows {
    screens: Vec<Vec<f32>>,
}

impl GlassShadows {
    /// No memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Clears `out` and draws what a light through the pane's water does to the surfaces behind it: shadows hide, gathered light adds. Needs colour, depth and normals. A
    /// pane whose water is even leaves the frame its bits.
    ///
    /// # Errors
    ///
    /// Buffers of another size than the camera's, a pane without area, a light that is nowhere.
    pub fn draw(
        &mut self,
        (glass, pane, source): (&Glass, &Pane, &PaneLight),
        frame: &WetFrame<'_>,
        controls: &ShadowControls,
        out: &mut Layer,
    ) -> Result<ShadowReport, RuntimeError> {
        drop::check(frame)?;
        let facing = pane.across_m.cross(pane.down_m);
        let towards = match source {
            PaneLight::Distant(way) | PaneLight::Lamp(way) => way,
        };
        if !(facing.length() > 0.0 && facing.is_finite() && pane.corner_m.is_finite()) {
            return Err(RuntimeError::argument("pane", "edges that span an area", format!("{pane:?}")));
        }
        if !towards.is_finite() || matches!(source, PaneLight::Distant(way) if way.length() < 1e-6) {
            return Err(RuntimeError::argument("light", "a place or a direction", format!("{source:?}")));
        }
        out.clear(frame.buffer.size);
        self.cast(glass, controls)?;
        let (eye, buffer) = (Eye::new(frame.camera), frame.buffer);
        let (mut report, size) =
            (ShadowReport::default(), glass.settings().cells.map(|cells| cells * per_cell(glass)));
        let (normal, distant) = (facing.normalize(), towards.normalize_or_zero());
        for pixel in 0..buffer.pixels() {
            let depth = buffer.depth_m[pixel];
            if !(depth > 0.0 && depth.is_finite()) {
                continue;
            }
            let [x, y] = [pixel % eye.size[0], pixel / eye.size[0]].map(|at| at as f32 + 0.5);
            let place = eye.position + eye.at(x, y, depth).as_dvec3();
            let way = match source {
                PaneLight::Distant(_) => distant,
                PaneLight::Lamp(lamp) => *lamp - place,
            };
            let Some([u, v, distance]) = pane.crossed(normal, place, way, source) else { continue };
            let lit = Vec3::from(buffer.normal[pixel]).as_dvec3().dot(way) > 0.0;
            if !lit || distance > f64::from(controls.far_m) {
                continue;
            }
            report.lit += 1;
            let light = self.light([u, v], distance as f32 / controls.far_m, size);
            let change = (light.min(controls.brightest) - 1.0) * controls.share * controls.strength;
            if change < 0.0 {
                out.over(pixel, [0.0; 3], -change);
            } else if change > 0.0 {
                out.over(pixel, frame.colour[pixel].map(|band| band.max(0.0) * change), 0.0);
            }
            report.pixels += u64::from(change != 0.0);
        }
        Ok(report)
    }

    /// Light behind the pane on screens at an eighth, a quarter, half and all of the farthest distance.
    fn cast(&mut self, glass: &Glass, controls: &ShadowControls) -> Result<(), RuntimeError> {
        let (cells, per_cell) = (glass.settings().cells, per_cell(glass));
        self.screens.resize_with(SCREENS, Vec::new);
        let share = |k: usize| f64::from(1u32 << k) / f64::from(1u32 << (SCREENS - 1));
        let distances: [f64; SCREENS] = std::array::from_fn(|k| share(k) * f64::from(controls.far_m));
        for screen in &mut self.screens {
            screen.resize(cells[0] * cells[1] * per_cell * per_cell, 0.0);
        }
        let mut screens: Vec<&mut [f32]> = self.screens.iter_mut().map(Vec::as_mut_slice).collect();
        glass.screens(per_cell, &distances, &mut screens)
    }

    /// Light at a place of the pane and a share of the farthest distance, between screens; before the first one between it and a dry pane.
    fn light(&self, [u, v]: [f64; 2], share: f32, size: [usize; 2]) -> f32 {
        let at = [u as f32 * size[0] as f32 - 0.5, v as f32 * size[1] as f32 - 0.5];
        let of = |screen: &[f32]| {
            let [x, y] = [0, 1].map(|k| at[k].clamp(0.0, (size[k] - 1) as f32));
            let (left, top) = (x as usize, y as usize);
            let (right, under) = ((left + 1).min(size[0] - 1), (top + 1).min(size[1] - 1));
            let row = |y: usize| {
                let (a, b) = (screen[y * size[0] + left], screen[y * size[0] + right]);
                a + (x - left as f32) * (b - a)
            };
            row(top) + (y - top as f32) * (row(under) - row(top))
        };
        let place = libm::log2f(share.max(1e-6)) + (SCREENS - 1) as f32;
        if place <= 0.0 {
            // Nearer than the first screen shadows sharpen towards nothing: light has not gone aside yet.
            let near = libm::exp2f(place);
            return 1.0 + near * (of(&self.screens[0]) - 1.0);
        }
        let low = (place as usize).min(SCREENS - 2);
        let part = (place - low as f32).min(1.0);
        let (first, second) = (of(&self.screens[low]), of(&self.screens[low + 1]));
        first + part * (second - first)
    }
}

fn per_cell(glass: &Glass) -> usize {
    let [across, down] = glass.settings().cells;
    if across * down * 4 <= VALUES_MOST { 2 } else { 1 }
}

impl Pane {
    /// Where the way from a place to the light crosses the pane: 0 to 1 across and down, and how far from the place, m.
    fn crossed(&self, normal: DVec3, place: DVec3, way: DVec3, source: &PaneLight) -> Option<[f64; 3]> {
        let along = way.dot(normal);
        if along.abs() < 1e-9 {
            return None;
        }
        let part = (self.corner_m - place).dot(normal) / along;
        if part <= 1e-6 || (matches!(source, PaneLight::Lamp(_)) && part >= 1.0) {
            return None;
        }
        let at = place + way * part - self.corner_m;
        // The edges need not be square to each other.
        let [aa, ab, bb] =
            [self.across_m.length_squared(), self.across_m.dot(self.down_m), self.down_m.length_squared()];
        let [pa, pb] = [at.dot(self.across_m), at.dot(self.down_m)];
        let whole = aa * bb - ab * ab;
        let [u, v] = [(pa * bb - pb * ab) / whole, (pb * aa - pa * ab) / whole];
        let inside = (0.0..1.0).contains(&u) && (0.0..1.0).contains(&v);
        inside.then(|| [u, v, part * way.length()])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wet::drop::stage::Stage;
    use crate::wet::glass::GlassSettings;

    /// Single precision through sums of some ten thousand values.
    const ROUND_OFF: f32 = 1e-4;

    fn glass() -> Glass {
        Glass::new(GlassSettings {
            cells: [60, 60],
            spacing_m: 2e-3,
            roughness: 0.0,
            ..GlassSettings::default()
        })
        .unwrap()
    }

    #[test]
    fn a_pane_of_even_water_is_the_identity() {
        let mut pane = glass();
        let mut screen = vec![0.0; 120 * 120];
        for _ in 0..2 {
            pane.screen(2, 0.5, &mut screen).unwrap();
            assert!(screen.iter().all(|&light| light == 1.0));
            pane.cells.mass.fill(9_000);
        }
        pane.paper_shadow(2, 100_000, [0.5, 2.0], &mut screen).unwrap();
        assert!(screen.iter().all(|&light| light == screen[0]), "no drop is marked");
    }

    #[test]
    fn what_a_drop_takes_from_its_shadow_it_gathers_in_the_middle() {
        let mut pane = glass();
        pane.wet([30, 30], 5e-3).unwrap();
        let mut screen = vec![0.0; 120 * 120];
        // A half ball of water focuses some radii behind itself.
        pane.screen(2, 4e-3, &mut screen).unwrap();
        let brightest = screen.iter().copied().fold(0.0, f32::max);
        let darkest = screen.iter().copied().fold(f32::INFINITY, f32::min);
        assert!(brightest > 1.8 && darkest < 0.5, "{brightest} {darkest}");
        let at = screen.iter().position(|&light| light == brightest).unwrap();
        let [x, y] = [at % 120, at / 120].map(|at| at as f32 - 60.5);
        assert!(x * x + y * y < 16.0, "{x} {y}");
        let sum: f32 = screen.iter().sum();
        assert!(
            sum <= 14_400.0 * (1.0 + ROUND_OFF) && sum > 14_400.0 - 12.0,
            "{sum}: steep edges reflect some"
        );
    }

    #[test]
    fn the_papers_highlight_stands_where_the_mass_is_above_the_threshold() {
        let mut pane = glass();
        pane.wet([10, 20], 4e-3).unwrap();
        pane.wet([40, 20], 1.5e-3).unwrap();
        let mut screen = vec![0.0; 60 * 60];
        pane.paper_shadow(1, 10_000_000, [0.6, 2.0], &mut screen).unwrap();
        assert!(screen[20 * 60 + 10] > 2.0);
        assert!(screen[20 * 60 + 40] < 1.0);
    }

    #[test]
    fn a_pane_in_the_scene_shadows_what_lies_behind_it() {
        let stage = Stage::new(DVec3::new(3.0, 0.0, 1.6), DVec3::new(3.0, 3.0, 0.0), [160, 120]);
        let hung = Pane {
            corner_m: DVec3::new(2.5, 2.0, 1.0),
            across_m: DVec3::new(1.0, 0.0, 0.0),
            down_m: DVec3::new(0.0, 0.0, -0.8),
        };
        let lamp = PaneLight::Lamp(DVec3::new(3.0, 5.0, 2.0));
        let (mut shadows, mut layer, controls) =
            (GlassShadows::new(), Layer::default(), ShadowControls::default());
        let mut pane = glass();
        let report = shadows.draw((&pane, &hung, &lamp), &stage.frame(0.0), &controls, &mut layer).unwrap();
        assert!(report.lit > 100 && report.pixels == 0, "{report:?}");
        let mut picture = stage.buffer.colour.clone();
        layer.onto(&mut picture).unwrap();
        assert_eq!(picture, stage.buffer.colour);
        for k in 0..40 {
            pane.wet([(k * 17) % 60, (k * 29) % 60], 4e-3).unwrap();
        }
        let report = shadows.draw((&pane, &hung, &lamp), &stage.frame(0.0), &controls, &mut layer).unwrap();
        assert!(report.pixels > 50);
        assert!(layer.alpha.iter().any(|&alpha| alpha > 0.02));
        let flat = Pane { down_m: hung.across_m, ..hung };
        assert!(shadows.draw((&pane, &flat, &lamp), &stage.frame(0.0), &controls, &mut layer).is_err());
    }
}
