//! What `squall render` may say of rain, lens and sun in place of the view.

use super::super::json;
use squall_formats::section::view::ViewSection;
use squall_runtime::Frame;
use squall_runtime::medium::{MediumForm, PhaseChoice, PhaseTable};
use std::sync::Arc;

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
    #[arg(long, value_name = "DEG", conflicts_with = "camera", help_heading = "Weather")]
    fov: Option<f64>,
    /// Form of the rain's medium.
    #[arg(long, value_enum, default_value = "beside-streaks", help_heading = "Weather")]
    medium: Form,
    /// How drops spread light.
    #[arg(long, value_enum, default_value = "hg", help_heading = "Weather")]
    phase: PhaseName,
    /// Asymmetry of Henyey and Greenstein's function, in (-1, 1); the medium's own if left out.
    #[arg(long, value_name = "G", allow_negative_numbers = true, help_heading = "Weather")]
    g: Option<f64>,
    /// Irradiance of the sun outside the air, W/m²: one number, or three for red, green and blue with commas between them.
    #[arg(long, value_name = "W", value_delimiter = ',', help_heading = "Weather")]
    sun_irradiance: Option<Vec<f64>>,
}

impl Weather {
    /// Sets what a view holds.
    pub fn set_view(&self, view: &mut ViewSection) {
        if let Some(degrees) = self.fov {
            view.camera.vertical_fov_rad = degrees.to_radians();
        }
        match self.sun_irradiance.as_deref() {
            None => {}
            Some([all]) => view.sky.sun_irradiance_w_per_m2 = [*all; 3],
            Some([r, g, b]) => view.sky.sun_irradiance_w_per_m2 = [*r, *g, *b],
            Some(other) => {
                json::usage(&format!("--sun-irradiance: wanted one number or three, found {}", other.len()));
            }
        }
    }

    /// Sets what a frame holds beside its view.
    pub fn set_frame(&self, frame: &mut Frame) {
        frame.medium.form = match self.medium {
            Form::BesideStreaks => MediumForm::BesideStreaks,
            Form::Whole => MediumForm::Whole,
            Form::Paper => MediumForm::Paper,
        };
        frame.medium.phase = match (self.phase, self.g) {
            (PhaseName::Hg, None) => PhaseChoice::OfForm,
            (PhaseName::Hg, Some(g)) => PhaseChoice::Asymmetry(g),
            (PhaseName::Drops, None) => PhaseChoice::Table(Arc::new(PhaseTable::drops())),
            (PhaseName::Drops, Some(g)) => {
                json::usage(&format!(
                    "--g {g}: wanted with --phase hg only; rays through drops have their own"
                ));
            }
        };
    }
}
