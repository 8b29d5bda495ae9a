//! How drops look: the paper's controls, as they are meant and as they are printed.

use glam::Vec3;

/// The paper's lightning bias l_b = 1 + k_c (L1 + L2), \[toyshop\] §3.1: what reflection and refraction are multiplied by while lightning flashes.
/// `contrast` is k_c, 0 or more; intensities are 1 at their brightest, and those below 0 count as 0.
pub fn lightning_bias(contrast: f32, lightning: [f32; 2]) -> f32 {
    1.0 + contrast.max(0.0) * (lightning[0].max(0.0) + lightning[1].max(0.0))
}

/// Milk in water, as films are shot: colour pulled by `milk`, 0 to 1, towards a white as bright as its brightest band. \[toyshop\] §3.1.
pub fn milky(colour: Vec3, milk: f32) -> Vec3 {
    colour.lerp(Vec3::splat(colour.max_element()), milk.clamp(0.0, 1.0))
}

/// What the opacity of a drop depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Opacity {
    /// e_s: how much Fresnel's share adds at the edges.
    pub edge_strength: f32,
    /// e_b: what is left where nothing is reflected.
    pub edge_bias: f32,
    /// d_p: share that the distance leaves, 0 to 1; see [`distance_fade`].
    pub distance: f32,
    /// l_b, 1 without lightning.
    pub lightning_bias: f32,
    /// The distance itself, m, where [`paper_opacity`] is asked for in place of all this.
    pub paper_m: Option<f32>,
}

impl Opacity {
    /// α' = d_p α (e_s f + e_b)(1 − ½ sat(l_b − 1)), held to 0 to 1: `alpha` is the shape's own, `fresnel` the share reflected. \[toyshop\] §3.2, where
    /// drops grow clearer as lightning strikes. With `paper_m` it is the print's, held to 0 to 1 as well: a picture has no other opacities.
    pub fn of(&self, alpha: f32, fresnel: f32) -> f32 {
        if let Some(distance_m) = self.paper_m {
            let edge = [self.edge_strength, self.edge_bias];
            return paper_opacity(alpha, fresnel, edge, distance_m).clamp(0.0, 1.0);
        }
        let clear = 1.0 - 0.5 * (self.lightning_bias - 1.0).clamp(0.0, 1.0);
        (self.distance * alpha * (self.edge_strength * fresnel + self.edge_bias) * clear).clamp(0.0, 1.0)
    }
}

/// d_p as bounded as an opacity has to be: 1 at the lens, ½ at `half_m`, falling as the square beyond.
pub fn distance_fade(distance_m: f32, half_m: f32) -> f32 {
    let share = distance_m.max(0.0) / half_m.max(1e-6);
    1.0 / (1.0 + share * share)
}

/// The paper's opacity as it is printed, \[toyshop\] §3.2: α' = d_p α (e_s f + e_b)(1 − ½), with d_p the distance itself, m. The print lost l_b: as the text says
/// it, 1 − ½ l_b, it would be ½ without lightning and below 0 from l_b = 2 on. Not held to anything.
pub fn paper_opacity(alpha: f32, fresnel: f32, edge: [f32; 2], distance_m: f32) -> f32 {
    distance_m * alpha * (edge[0] * fresnel + edge[1]) * (1.0 - 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lightning_bias_grows_with_either_light() {
        assert_eq!(lightning_bias(0.7, [0.0; 2]), 1.0);
        for k in 1..10 {
            let (less, more) = (0.1 * (k - 1) as f32, 0.1 * k as f32);
            assert!(lightning_bias(0.7, [more, 0.3]) > lightning_bias(0.7, [less, 0.3]));
            assert!(lightning_bias(0.7, [0.3, more]) > lightning_bias(0.7, [0.3, less]));
        }
        assert_eq!(lightning_bias(0.7, [-4.0, f32::NAN]), 1.0);
    }

    #[test]
    fn opacity_stays_an_opacity_and_leaves_the_artists_own_without_lightning() {
        let plain =
            Opacity { edge_strength: 0.5, edge_bias: 0.5, distance: 1.0, lightning_bias: 1.0, paper_m: None };
        assert_eq!(plain.of(0.8, 0.2), 0.8 * 0.6);
        for bias in [1.0, 1.5, 2.0, 7.0] {
            for fresnel in [0.0, 0.02, 1.0] {
                let strong = Opacity { edge_strength: 5.0, lightning_bias: bias, ..plain };
                assert!((0.0..=1.0).contains(&strong.of(1.0, fresnel)));
                assert!(
                    strong.of(0.3, fresnel) <= Opacity { lightning_bias: 1.0, ..strong }.of(0.3, fresnel)
                );
            }
        }
    }

    #[test]
    fn the_papers_opacity_grows_with_distance_beyond_what_an_opacity_is() {
        assert!(paper_opacity(1.0, 0.02, [0.5, 0.5], 10.0) > 1.0);
        let print = Opacity {
            edge_strength: 0.5,
            edge_bias: 0.5,
            distance: 0.3,
            lightning_bias: 1.0,
            paper_m: Some(1.2),
        };
        assert_eq!(print.of(0.4, 0.2), paper_opacity(0.4, 0.2, [0.5, 0.5], 1.2));
        assert_eq!(Opacity { paper_m: Some(10.0), ..print }.of(1.0, 0.2), 1.0);
        assert_eq!(distance_fade(3.0, 3.0), 0.5);
        assert!((0..100).all(|d| distance_fade(d as f32, 8.0) <= 1.0));
    }

    #[test]
    fn milk_whitens_and_no_milk_leaves_the_colour() {
        let blue = Vec3::new(0.1, 0.2, 0.8);
        assert_eq!(milky(blue, 0.0), blue);
        assert_eq!(milky(blue, 1.0), Vec3::splat(0.8));
    }
}
