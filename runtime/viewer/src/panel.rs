//! The controls beside the picture.

use eframe::egui;
use squall_runtime::gpu::PassTime;
use std::collections::BTreeMap;

/// A group of controls: what it is called, and per control its name, label, range and unit.
type Group = (&'static str, &'static [(&'static str, &'static str, [f64; 2], &'static str)]);

const GROUPS: [Group; 3] = [
    (
        "Weather",
        &[
            ("rate_mm_per_h", "Rain", [0.0, 100.0], " mm/h"),
            ("wind_x_m_per_s", "Wind to the east", [-25.0, 25.0], " m/s"),
            ("wind_y_m_per_s", "Wind to the north", [-25.0, 25.0], " m/s"),
            ("overcast", "Overcast", [0.0, 1.0], ""),
        ],
    ),
    (
        "Light",
        &[
            ("sun_elevation_deg", "Sun's height", [-17.0, 90.0], "°"),
            ("sun_azimuth_deg", "Sun's azimuth", [-180.0, 180.0], "°"),
            ("exposure_stops", "Exposure", [-6.0, 6.0], " stops"),
            ("gain", "Gain of streaks", [0.0, 16.0], "×"),
        ],
    ),
    (
        "Camera",
        &[
            ("fov_deg", "Field of view", [5.0, 120.0], "°"),
            ("heading_deg", "Heading", [-180.0, 180.0], "°"),
            ("pitch_deg", "Pitch", [-89.0, 89.0], "°"),
            ("time_s", "Time", [0.0, 60.0], " s"),
        ],
    ),
];
const LAYERS: [(&str, &str); 4] =
    [("rain", "Rain"), ("streaks", "Streaks"), ("flash", "Flashes"), ("bloom", "Lens bloom")];

/// What somebody asked for.
#[derive(Default)]
pub struct Asked {
    pub changes: Vec<(&'static str, f64)>,
    pub strike: bool,
    pub screenshot: bool,
}

/// The controls' values.
pub struct Panel {
    pub values: BTreeMap<&'static str, f64>,
    /// Metres that the last stroke stands beside where it was meant.
    pub moved: Option<f64>,
    /// Why the processor draws where a card was wanted.
    pub instead: Option<String>,
    /// What the passes of the last picture took.
    pub passes: Vec<PassTime>,
}

impl Panel {
    pub fn of(values: &BTreeMap<&'static str, f64>) -> Self {
        Self { values: values.clone(), moved: None, instead: None, passes: Vec::new() }
    }

    pub fn show(&mut self, ui: &mut egui::Ui, playing: &mut bool, words: &Result<String, String>) -> Asked {
        let mut asked = Asked::default();
        ui.horizontal(|ui| {
            if ui.button(if *playing { "Pause" } else { "Play" }).clicked() {
                *playing = !*playing;
            }
            asked.strike = ui.button("Strike").clicked();
            asked.screenshot = ui.button("Screenshot").clicked();
        });
        match words {
            Ok(words) => ui.label(words),
            Err(words) => ui.colored_label(ui.visuals().error_fg_color, words),
        };
        if let Some(metres) = self.moved.filter(|&metres| metres > 1.0) {
            ui.label(format!("The stroke stands {metres:.0} m from there, where the asset has light."));
        }
        if let Some(instead) = &self.instead {
            ui.label(instead);
        }
        if !self.passes.is_empty() {
            let all: f64 = self.passes.iter().map(|pass| pass.ms).sum();
            ui.collapsing(format!("{all:.1} ms of the card's own"), |ui| {
                for pass in &self.passes {
                    ui.monospace(format!("{:>8.2}  {}", pass.ms, pass.name));
                }
            });
        }
        for (title, controls) in GROUPS {
            ui.separator();
            ui.strong(title);
            for &(name, label, [low, high], unit) in controls {
                let mut value = self.values.get(name).copied().unwrap_or(0.0);
                ui.label(label);
                let slider = egui::Slider::new(&mut value, low..=high)
                    .suffix(unit)
                    .clamping(egui::SliderClamping::Never);
                if ui.add(slider).changed() {
                    asked.changes.push((name, value));
                }
            }
        }
        ui.separator();
        for (name, label) in LAYERS {
            let mut on = self.values.get(name).copied().unwrap_or(0.0) >= 0.5;
            if ui.checkbox(&mut on, label).changed() {
                asked.changes.push((name, f64::from(u8::from(on))));
            }
        }
        ui.separator();
        ui.weak("Click the picture to strike there. W A S D Q E fly (with shift faster), arrows turn, space strikes, P plays.");
        asked
    }
}
