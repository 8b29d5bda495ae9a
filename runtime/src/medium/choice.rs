//! Which medium a frame's rain is.

use super::{Medium, Phase, PhaseTable};
use crate::error::RuntimeError;
use crate::rain::Shot;
use squall_formats::drops::Optics;
use squall_formats::section::density::DensitySection;
use squall_formats::section::view::{ViewForm, ViewMedium, ViewPhase};
use squall_formats::units::MillimetresPerHour;
use std::sync::Arc;

/// The medium's forms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum MediumForm {
    /// Q = 1, less the drops that are drawn as streaks: [`Medium::beside_streaks`].
    #[default]
    BesideStreaks,
    /// All rain, Q = 2, streaks or not: [`Medium::whole`].
    Whole,
    /// \[weber\] eq. 9 and eq. 10 as printed: [`Medium::paper`].
    Paper,
}

impl MediumForm {
    /// Every form.
    pub const ALL: [Self; 3] = [Self::BesideStreaks, Self::Whole, Self::Paper];

    /// Its name on a command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::BesideStreaks => "beside-streaks",
            Self::Whole => "whole",
            Self::Paper => "paper",
        }
    }
}

/// How drops spread light.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum PhaseChoice {
    /// Henyey and Greenstein's with the asymmetry that goes with the form's efficiency; \[weber\]'s own .9 with the paper's.
    #[default]
    OfForm,
    /// The form's function with this asymmetry, in (−1, 1).
    Asymmetry(f64),
    /// By angle and colour: [`PhaseTable::drops`] has the rainbow.
    Table(Arc<PhaseTable>),
}

/// The medium of a frame's rain.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MediumChoice {
    /// Its form.
    pub form: MediumForm,
    /// How it and single drops spread light.
    pub phase: PhaseChoice,
}

impl From<&ViewMedium> for MediumChoice {
    /// Works the drops' phase function out where a view asks for it, some tens of milliseconds.
    fn from(view: &ViewMedium) -> Self {
        let form = match view.form {
            ViewForm::BesideStreaks => MediumForm::BesideStreaks,
            ViewForm::Whole => MediumForm::Whole,
            ViewForm::Paper => MediumForm::Paper,
        };
        let phase = match view.phase {
            ViewPhase::OfForm => PhaseChoice::OfForm,
            ViewPhase::Asymmetry(g) => PhaseChoice::Asymmetry(g),
            ViewPhase::Drops => PhaseChoice::Table(Arc::new(PhaseTable::drops())),
        };
        Self { form, phase }
    }
}

/// \[weber\]'s asymmetry.
const PAPER_ASYMMETRY: f64 = 0.9;

impl MediumChoice {
    /// Errors: an asymmetry outside (−1, 1).
    pub(crate) fn check(&self) -> Result<(), RuntimeError> {
        match self.phase {
            // Written so that NaN is refused too.
            PhaseChoice::Asymmetry(g) if g.abs().partial_cmp(&1.0) != Some(std::cmp::Ordering::Less) => {
                Err(RuntimeError::argument("medium g", "a number in (-1, 1)", g))
            }
            _ => Ok(()),
        }
    }

    /// The medium of a shot's rain. Errors: as [`Medium::beside_streaks`]; an asymmetry outside (−1, 1).
    pub fn medium(
        &self,
        section: &DensitySection,
        shot: &Shot,
        rate: MillimetresPerHour,
    ) -> Result<Medium, RuntimeError> {
        self.check()?;
        Ok(match self.form {
            MediumForm::BesideStreaks => self.with_own_phase(Medium::beside_streaks(section, shot, rate)?),
            MediumForm::Whole | MediumForm::Paper => self.undrawn(rate),
        })
    }

    /// The same rain where no drop of it is drawn: on ways that do not begin at the eye.
    pub(crate) fn undrawn(&self, rate: MillimetresPerHour) -> Medium {
        self.with_own_phase(match self.form {
            MediumForm::BesideStreaks => Medium::geometric(rate),
            MediumForm::Whole => Medium::whole(rate),
            MediumForm::Paper => Medium::paper(rate, PAPER_ASYMMETRY),
        })
    }

    fn with_own_phase(&self, medium: Medium) -> Medium {
        match &self.phase {
            PhaseChoice::OfForm => medium,
            PhaseChoice::Asymmetry(g) if self.form == MediumForm::Paper => {
                medium.with_phase(Phase::Paper(*g))
            }
            PhaseChoice::Asymmetry(g) => medium.with_phase(Phase::HenyeyGreenstein(*g)),
            PhaseChoice::Table(table) => medium.with_phase(Phase::Table(table.clone())),
        }
    }

    /// Whether the rain between the sun and a drop dims it and spreads its light ([`Phase::values_behind`]); \[weber\] eq. 12 has it as bright
    /// at every drop, and stays so with the paper's form.
    pub fn dims_sun(&self) -> bool {
        self.form != MediumForm::Paper
    }

    /// How a single drop spreads light, diffraction left out.
    pub fn drop_phase(&self) -> Phase {
        match &self.phase {
            PhaseChoice::OfForm => Phase::HenyeyGreenstein(Optics::GEOMETRIC.asymmetry),
            PhaseChoice::Asymmetry(g) => Phase::HenyeyGreenstein(*g),
            PhaseChoice::Table(table) => Phase::Table(table.clone()),
        }
    }
}
