//! Reflection at a water surface, and what wetting does to a material.

/// Refractive index of water in visible light.
pub const WATER_INDEX: f64 = 1.333;

/// Share of unpolarised light that a smooth surface between two dielectrics reflects (Fresnel). `cosine` is that of the angle to the normal on the
/// side that the light comes from, 0 to 1; `index` the other side's refractive index over this side's. Total reflection gives 1.
pub fn fresnel(cosine: f64, index: f64) -> f64 {
    let c = cosine.clamp(0.0, 1.0);
    let g2 = index * index - 1.0 + c * c;
    if g2 <= 0.0 {
        return 1.0;
    }
    let g = libm::sqrt(g2);
    let sides = (g - c) / (g + c);
    let ratio = (c * (g + c) - 1.0) / (c * (g - c) + 1.0);
    0.5 * sides * sides * (1.0 + ratio * ratio)
}

/// The paper's f = .95 (1 − n·v)⁴ + .05, \[toyshop\] §3.1: as much as .146 above or below [`fresnel`] of water, and .113 in place of .066 on
/// the average over a hemisphere.
pub fn paper_fresnel(cosine: f64) -> f64 {
    let rest = 1.0 - cosine.clamp(0.0, 1.0);
    0.95 * rest * rest * rest * rest + 0.05
}

/// The paper's attenuation of reflections at edges, k_a = sat(1 − f²) with f = (1 − n·v)^f_o, \[toyshop\] §6.3. It removes reflection at grazing angles,
/// where there is most of it: against aliasing, not optics.
pub fn paper_edge_attenuation(cosine: f64, edge_exponent: f64) -> f64 {
    let f = libm::pow(1.0 - cosine.clamp(0.0, 1.0), edge_exponent.max(0.0));
    (1.0 - f * f).clamp(0.0, 1.0)
}

/// Mean of [`fresnel`] over a hemisphere of even radiance: ∫ 2 R cosθ d(cosθ). With `index` below 1 it is that of light from inside.
/// Gauss-Legendre would need a node at the critical angle; the midpoint rule of 4096 cells is right to 10⁻⁴ across it.
pub fn diffuse_fresnel(index: f64) -> f64 {
    const CELLS: u32 = 4096;
    let width = 1.0 / f64::from(CELLS);
    (0..CELLS).map(|cell| (f64::from(cell) + 0.5) * width).map(|c| 2.0 * c * fresnel(c, index) * width).sum()
}

/// Albedo of a rough, absorbing surface under a film of water, from its dry `albedo` in 0..1 (\[lekner-dorf\],
/// eqs. 1 and 2): light that the surface scatters is thrown back at the film's upper side with probability p and has a further chance to be absorbed.
/// R(film) + (1 − R) a (1 − p)/(1 − p a) less the film's own reflection, which a renderer adds as a mirror image.
pub fn wet_albedo(albedo: f64) -> f64 {
    let (entering, back) = (1.0 - DIFFUSE_OUTSIDE, DIFFUSE_INSIDE);
    let a = albedo.clamp(0.0, 1.0);
    entering * a * (1.0 - back) / (1.0 - back * a)
}

/// [`wet_albedo`] over the dry one, which is its limit at black: for a picture's pixels.
#[inline]
pub(super) fn wet_share(albedo: f32) -> f32 {
    const OPEN: f32 = ((1.0 - DIFFUSE_OUTSIDE) * (1.0 - DIFFUSE_INSIDE)) as f32;
    OPEN / (1.0 - DIFFUSE_INSIDE as f32 * albedo.clamp(0.0, 1.0))
}

/// [`diffuse_fresnel`] of water from outside, and from inside.
const DIFFUSE_OUTSIDE: f64 = 0.066_405_8;
const DIFFUSE_INSIDE: f64 = 0.474_590_6;

/// How wet a surface is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wetness {
    /// Water in and on the surface over what it can hold, 0 to 1.
    pub share: f32,
}

/// How a surface takes water up and gives it off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WetnessRates {
    /// Water that the surface holds before the rest runs off, mm: .2 for smooth stone, 1 for asphalt.
    pub holds_mm: f32,
    /// What it loses to the air, mm/h.
    pub dries_mm_per_h: f32,
}

/// Times and rates beyond this are this: no product of them is beyond numbers.
const LONGEST: f64 = 1e12;

impl Wetness {
    /// After `seconds` of rain at `rate_mm_per_h`: rain brings R, drying takes in proportion to what there is. The closed form of
    /// dw/dt = (R − E w)/H, held at 1: any split of the time gives the same. Not a number, and negative arguments, count as 0.
    #[must_use]
    pub fn after(self, seconds: f64, rate_mm_per_h: f64, rates: &WetnessRates) -> Self {
        let usable = |value: f64| if value > 0.0 { value.min(LONGEST) } else { 0.0 };
        let hours = usable(seconds) / 3600.0;
        let holds = usable(f64::from(rates.holds_mm)).max(1e-6);
        let (rain, dries) = (usable(rate_mm_per_h), usable(f64::from(rates.dries_mm_per_h)));
        let now = usable(f64::from(self.share)).min(1.0);
        let decay = dries * hours / holds;
        // (1 − e^−x)/x, which is 1 where nothing dries.
        let mean = if decay > 1e-9 { -libm::expm1(-decay) / decay } else { 1.0 };
        let share = now * libm::exp(-decay) + rain * hours / holds * mean;
        Self { share: share.min(1.0) as f32 }
    }
}

/// What a renderer shades with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Diffuse albedo, red, green and blue, 0 to 1.
    pub albedo: [f32; 3],
    /// Perceptual roughness, 0 to 1.
    pub roughness: f32,
    /// Pores: 0 for metal, glass and paint, which water does not enter, 1 for sand.
    pub porosity: f32,
}

impl Material {
    /// The material when it is as wet as that: albedo falls towards [`wet_albedo`] where pores take water up, roughness towards a film's as the film closes.
    /// Dry is left as it is, bit by bit.
    #[must_use]
    pub fn wet(self, wetness: Wetness) -> Self {
        let share = if wetness.share > 0.0 { wetness.share.min(1.0) } else { return self };
        let darkened = share * self.porosity.clamp(0.0, 1.0);
        let albedo = self.albedo.map(|dry| dry + darkened * (wet_albedo(f64::from(dry)) as f32 - dry));
        Self {
            albedo,
            roughness: self.roughness * (1.0 - share) + share * self.roughness.min(FILM_ROUGHNESS),
            ..self
        }
    }
}

/// Roughness of a closed film of water on a street.
pub const FILM_ROUGHNESS: f32 = 0.08;

#[cfg(test)]
mod tests {
    use super::*;

    /// A midpoint rule of 4096 cells across the critical angle.
    const RULE: f64 = 2e-4;

    #[test]
    fn fresnel_has_its_closed_forms() {
        let straight = (WATER_INDEX - 1.0) / (WATER_INDEX + 1.0);
        assert!((fresnel(1.0, WATER_INDEX) - straight * straight).abs() < 1e-12);
        assert!((fresnel(0.0, WATER_INDEX) - 1.0).abs() < 1e-12);
        // At Brewster's angle one polarisation is not reflected at all: half of the other's share is left.
        let angle = libm::atan(WATER_INDEX);
        let inside = WATER_INDEX * libm::cos(libm::asin(libm::sin(angle) / WATER_INDEX));
        let across = (libm::cos(angle) - inside) / (libm::cos(angle) + inside);
        assert!((fresnel(libm::cos(angle), WATER_INDEX) - 0.5 * across * across).abs() < 1e-12);
        // Beyond the critical angle everything stays inside.
        let critical = libm::sqrt(1.0 - 1.0 / (WATER_INDEX * WATER_INDEX));
        assert_eq!(fresnel(critical * 0.999, 1.0 / WATER_INDEX), 1.0);
        assert!(fresnel(critical * 1.001, 1.0 / WATER_INDEX) < 1.0);
    }

    #[test]
    fn what_goes_in_comes_out_by_the_reciprocity_of_diffuse_light() {
        // n² (1 − R inside) = 1 − R outside.
        let outside = 1.0 - diffuse_fresnel(WATER_INDEX);
        let inside = 1.0 - diffuse_fresnel(1.0 / WATER_INDEX);
        assert!((WATER_INDEX * WATER_INDEX * inside - outside).abs() < 10.0 * RULE, "{inside} {outside}");
        assert!((diffuse_fresnel(WATER_INDEX) - DIFFUSE_OUTSIDE).abs() < RULE);
        assert!((diffuse_fresnel(1.0 / WATER_INDEX) - DIFFUSE_INSIDE).abs() < RULE);
    }

    #[test]
    fn the_papers_fresnel_errs_by_what_the_pages_say() {
        let worst = (0..=1000)
            .map(|k| f64::from(k) / 1000.0)
            .map(|c| (paper_fresnel(c) - fresnel(c, WATER_INDEX)).abs());
        let worst = worst.fold(0.0, f64::max);
        assert!((worst - 0.146).abs() < 1e-3, "{worst}");
        let mean: f64 = (0..4096)
            .map(|k| (f64::from(k) + 0.5) / 4096.0)
            .map(|c| 2.0 * c * paper_fresnel(c) / 4096.0)
            .sum();
        assert!((mean - 0.113).abs() < 1e-3, "{mean}");
    }

    #[test]
    fn the_papers_edges_lose_their_reflection() {
        assert_eq!(paper_edge_attenuation(1.0, 3.0), 1.0);
        assert_eq!(paper_edge_attenuation(0.0, 3.0), 0.0);
    }

    #[test]
    fn wet_is_darker_than_dry_but_black_and_white_stay() {
        assert_eq!(wet_albedo(0.0), 0.0);
        // White loses nothing inside: all that entered comes out.
        assert!((wet_albedo(1.0) - (1.0 - DIFFUSE_OUTSIDE)).abs() < 1e-12);
        for albedo in [0.1, 0.3, 0.6] {
            assert!(wet_albedo(albedo) < albedo);
        }
        for albedo in [0.01f32, 0.2, 0.7, 1.0] {
            let wanted = (wet_albedo(f64::from(albedo)) / f64::from(albedo)) as f32;
            assert!((wet_share(albedo) - wanted).abs() < 1e-6);
        }
        let dry = Material { albedo: [0.3, 0.2, 0.1], roughness: 0.8, porosity: 0.5 };
        assert_eq!(dry.wet(Wetness::default()), dry);
        assert_eq!(dry.wet(Wetness { share: -3.0 }), dry);
        assert_eq!(dry.wet(Wetness { share: f32::NAN }), dry);
        let glass = Material { porosity: 0.0, ..dry };
        assert_eq!(glass.wet(Wetness { share: 1.0 }).albedo, dry.albedo);
        assert!(dry.wet(Wetness { share: 1.0 }).roughness <= FILM_ROUGHNESS);
    }

    #[test]
    fn wetness_grows_with_rain_and_dries_whatever_the_steps() {
        /// Single precision.
        const ROUND_OFF: f32 = 1e-6;
        let rates = WetnessRates { holds_mm: 1.0, dries_mm_per_h: 0.5 };
        let whole = Wetness::default().after(60.0, 25.0, &rates);
        let parts = (0..60).fold(Wetness::default(), |wet, _| wet.after(1.0, 25.0, &rates));
        assert!((whole.share - parts.share).abs() < 10.0 * ROUND_OFF && whole.share > 0.4);
        assert_eq!(whole.after(86_400.0, 75.0, &rates).share, 1.0);
        let dried = whole.after(3600.0, 0.0, &rates).share;
        assert!((dried - whole.share * libm::expf(-0.5)).abs() < ROUND_OFF);
        assert_eq!(Wetness { share: 0.3 }.after(f64::INFINITY, 0.0, &rates).share, 0.0);
        assert_eq!(Wetness { share: 0.3 }.after(f64::NAN, -1.0, &rates).share, 0.3);
    }
}
