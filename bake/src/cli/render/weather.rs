//! What `squall render` may say of rain, lens and sun in place of the view.

use super::super::{json, number};
use squall_formats::section::view::{ViewForm, ViewPhase, ViewSection};

/// The form of the rain's medium.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Form {
    /// Rain that is not drawn as streaks, Q = 1.
    BesideStreaks,
    /// All rain, Q = 2.
    Whole,
    /// The rain paper's eq. 9 and 10 as printed, which loses light.
    Paper,
}

/// How drops spread light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum PhaseName {
    /// Henyey and Greenstein's function.
    Hg,
    /// Rays through spheres of water: with rainbows.
    Drops,
}

/// Rain, lens and sun.
#[derive(clap::Args)]
pub struct Weather {
    /// Full angle between the picture's top and bottom edge, degrees.
    #[arg(long, value_name = "DEG", value_parser = number::from_to(0.06, 179.3, "degrees"), conflicts_with = "camera", help_heading = "Weather")]
    fov: Option<f64>,
    /// Form of the rain's medium in place of the view's.
    #[arg(long, value_enum, help_heading = "Weather")]
    medium: Option<Form>,
    /// How drops spread light, in place of the view's.
    #[arg(long, value_enum, help_heading = "Weather")]
    phase: Option<PhaseName>,
    /// Asymmetry of Henyey and Greenstein's function, -0.999 to 0.999, in place of the view's or the form's own.
    #[arg(long, value_name = "G", value_parser = number::from_to(-0.999, 0.999, ""), help_heading = "Weather")]
    g: Option<f64>,
    /// Irradiance of the sun outside the air, W/m²: one number, or three for red, green and blue with commas between them.
    #[arg(long, value_name = "W", value_parser = irradiance, help_heading = "Weather")]
    sun_irradiance: Option<[f64; 3]>,
}

impl Weather {
    /// Sets what a view holds.
    pub fn set_view(&self, view: &mut ViewSection) {
        if let Some(degrees) = self.fov {
            view.camera.vertical_fov_rad = degrees.to_radians();
        }
        if let Some(form) = self.medium {
            view.medium.form = match form {
                Form::BesideStreaks => ViewForm::BesideStreaks,
                Form::Whole => ViewForm::Whole,
                Form::Paper => ViewForm::Paper,
            };
        }
        match (self.phase, self.g) {
            (None, None) => {}
            (Some(PhaseName::Hg), None) => view.medium.phase = ViewPhase::OfForm,
            (Some(PhaseName::Drops), None) => view.medium.phase = ViewPhase::Drops,
            (None | Some(PhaseName::Hg), Some(g)) => view.medium.phase = ViewPhase::Asymmetry(g),
            (Some(PhaseName::Drops), Some(g)) => {
                json::usage(&format!(
                    "--g {g}: wanted with --phase hg only; rays through drops have their own"
                ));
            }
        }
        if let Some(bands) = self.sun_irradiance {
            view.sky.sun_irradiance_w_per_m2 = bands;
        }
    }
}

fn irradiance(text: &str) -> Result<[f64; 3], String> {
    let found = number::list::<1>(text).map(|[all]| [all; 3]).or_else(|_| number::list::<3>(text));
    let found = found.ok().filter(|bands| bands.iter().all(|band| (0.0..=1e12).contains(band)));
    found.ok_or_else(|| "wanted one number or three of 0 or more with commas between them, W/m²".into())
}
