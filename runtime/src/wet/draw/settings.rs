//! Which effects are on, and their controls by name.

use crate::error::RuntimeError;
use crate::wet::controls::{Parameter, controls};
use crate::wet::drip::DripControls;
use crate::wet::drop::DropControls;
use crate::wet::flicker::FlickerControls;
use crate::wet::glass::WindscreenControls;
use crate::wet::glow::GlowControls;
use crate::wet::halo::HaloControls;
use crate::wet::layers::LayerControls;
use crate::wet::splash::SplashControls;
use crate::wet::splatter::SplatterControls;
use crate::wet::surface::SurfaceControls;
use crate::wet::surface::lightning::LightningControls;
use squall_formats::section::view::ViewEffect;

controls! {
    /// How rain is drawn before the frame.
    pub struct RainControls {
        /// Factor on what drops cover; 1 is physical.
        gain: 1.0, 0.0..=1000.0, "", "";
        /// Time that the shutter is open.
        exposure: 20.0, 0.001..=10000.0, "ms", "";
        /// How far rain reaches: what lies beyond, the sky before all, is dimmed over this way.
        extent: 1000.0, 1.0..=1e7, "m", "";
        /// Above ½, distance dims by the paper's linear fog in place of Beer and Lambert's law.
        paper_fog: 0.0, 0.0..=1.0, "", "";
        /// Where that fog begins.
        paper_start: 5.0, 0.0..=1e6, "m", "";
        /// Where it hides everything.
        paper_end: 600.0, 0.0..=1e6, "m", "";
    }
}

/// Declares the effects: variant, name, field and type of the controls, the paper's section, documentation; in the order in which they are drawn.
macro_rules! effects {
    ($($(#[doc = $about:literal])+ $variant:ident, $name:literal, $field:ident: $controls:ident, $section:literal;)+) => {
        /// An effect.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum Effect { $($(#[doc = $about])+ $variant,)+ }

        impl Effect {
            /// Every effect, in the order in which they are drawn.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$variant),+];

            /// Its name on a command line, in views and in files.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)+ }
            }

            /// The section of \[toyshop\] that it is of.
            pub fn section(self) -> &'static str {
                match self { $(Self::$variant => $section,)+ }
            }

            /// What it draws.
            pub fn says(self) -> &'static str {
                match self { $(Self::$variant => concat!($($about),+).trim_ascii(),)+ }
            }

            /// Its controls.
            pub fn parameters(self) -> &'static [Parameter] {
                match self { $(Self::$variant => $controls::PARAMETERS,)+ }
            }
        }

        /// Which effects are on, and how each is drawn.
        #[derive(Clone, Debug, PartialEq)]
        pub struct WetSettings {
            off: Vec<Effect>,
            said: Vec<(Effect, &'static str)>,
            $($(#[doc = $about])+ pub $field: $controls,)+
        }

        impl Default for WetSettings {
            /// Every effect but [`WetSettings::OFF`], with its usual controls; no control counts as said.
            fn default() -> Self {
                Self { off: Self::OFF.to_vec(), said: Vec::new(), $($field: $controls::default(),)+ }
            }
        }

        impl WetSettings {
            /// Value of an effect's control.
            pub fn get(&self, effect: Effect, name: &str) -> Option<f32> {
                match effect { $(Effect::$variant => self.$field.get(name),)+ }
            }

            /// Sets an effect's control, which counts as said from then on.
            ///
            /// Errors: no control of that name; a value out of its range.
            pub fn set(&mut self, effect: Effect, name: &str, value: f32) -> Result<(), RuntimeError> {
                match effect { $(Effect::$variant => self.$field.set(name, value)?,)+ }
                let known = effect.parameters().iter().find(|parameter| parameter.name == name);
                if let Some(known) = known.filter(|known| !self.is_said(effect, known.name)) {
                    self.said.push((effect, known.name));
                }
                Ok(())
            }
        }
    };
}

effects! {
    /// Neon that flickers, and with it what mirrors it; off unless it is asked for.
    Flicker, "flicker", flicker: FlickerControls, "6.3";
    /// Light of lightning on surfaces.
    Lightning, "lightning", lightning: LightningControls, "6.1";
    /// Wet surfaces: darkened, filmed over, with puddles, ripples and what they mirror.
    Surface, "surface", surface: SurfaceControls, "4, 6.3";
    /// Splatters: rings that drops leave on surfaces near the camera.
    Splatters, "splatters", splatters: SplatterControls, "3.4";
    /// Splashes where drops hit.
    Splashes, "splashes", splashes: SplashControls, "3.3";
    /// Drops that drip from edges.
    Drips, "drips", drips: DripControls, "3.2";
    /// Mist at silhouettes.
    Halos, "halos", halos: HaloControls, "3.4";
    /// Rain before the frame: streaks and distance.
    Rain, "rain", rain: RainControls, "3.1, 6.2";
    /// Drops close to the lens, each for itself; off unless it is asked for, as the rain's streaks show some of the same drops.
    Drops, "drops", drops: DropControls, "3.1";
    /// Rainfall as layers over the picture, the paper's, in place of rain that stands in the world; off unless it is asked for.
    Layers, "layers", layers: LayerControls, "3.1";
    /// Glow around lights.
    Glow, "glow", glow: GlowControls, "6.2";
    /// A wet pane between the eye and the scene, a windscreen or a window; off unless it is asked for.
    Glass, "glass", glass: WindscreenControls, "5";
}

impl Effect {
    /// The effect of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|effect| effect.name() == name)
    }

    /// Whether it belongs to the scene, so that what comes later looks at it.
    pub(super) fn is_before_the_rain(self) -> bool {
        !matches!(self, Self::Rain | Self::Drops | Self::Layers | Self::Glow | Self::Glass)
    }
}

impl WetSettings {
    /// Effects that are off unless they are asked for.
    pub const OFF: [Effect; 4] = [Effect::Flicker, Effect::Drops, Effect::Layers, Effect::Glass];

    /// Whether [`Self::set`] has set a control, to whatever value: its usual one counts as well.
    pub fn is_said(&self, effect: Effect, name: &str) -> bool {
        self.said.iter().any(|(other, said)| *other == effect && *said == name)
    }

    /// What a view says of the effects; what it doesn't name is as usual.
    ///
    /// Errors: an effect or control that this build doesn't know; a value out of its range.
    pub fn of_view(wet: &[ViewEffect]) -> Result<Self, RuntimeError> {
        let mut settings = Self::default();
        for said in wet {
            let effect = Effect::from_name(&said.effect).ok_or_else(|| {
                let known = Effect::ALL.map(Effect::name).join(", ");
                RuntimeError::argument("view.wet", known, &said.effect)
            })?;
            settings.turn(effect, said.on);
            for (name, value) in &said.controls {
                settings.set(effect, name, *value as f32)?;
            }
        }
        Ok(settings)
    }

    /// Whether an effect is drawn.
    pub fn is_on(&self, effect: Effect) -> bool {
        !self.off.contains(&effect)
    }

    /// Turns an effect on or off.
    pub fn turn(&mut self, effect: Effect, on: bool) {
        self.off.retain(|other| *other != effect);
        if !on {
            self.off.push(effect);
        }
    }

    /// Turns every effect off but these.
    pub fn only(&mut self, effects: &[Effect]) {
        Effect::ALL.into_iter().for_each(|effect| self.turn(effect, effects.contains(&effect)));
    }

    /// Refuses controls out of their ranges.
    ///
    /// Errors: the first one, by name.
    pub fn check(&self) -> Result<(), RuntimeError> {
        for effect in Effect::ALL {
            for parameter in effect.parameters() {
                let value = self.get(effect, parameter.name).unwrap_or(parameter.usual);
                if !(parameter.range[0]..=parameter.range[1]).contains(&value) {
                    let [low, high] = parameter.range;
                    return Err(RuntimeError::argument(parameter.name, format!("{low} to {high}"), value));
                }
            }
        }
        Ok(())
    }
}
