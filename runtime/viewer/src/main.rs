//! A storm in a window: `cargo run --release --manifest-path runtime/viewer/Cargo.toml -- ASSET`.
//!
//! The window's thread only shows; pictures are drawn on another ([`drawer`]), so that controls answer at once.

mod drawer;
mod panel;

use drawer::{Answer, Drawer, Drawn, Shown};
use eframe::egui_wgpu::{RenderState, WgpuSetup};
use eframe::{egui, wgpu};
use panel::Panel;
use squall_runtime::gpu::Gpu;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

const USAGE: &str = "usage: squall-viewer ASSET [--backend cpu|auto] [--screenshot PICTURE.png]\n\n\
    --backend cpu has the processor draw; auto, the default, the window's graphics card where it can\n\
    --screenshot strikes in the middle, saves the window once the flash is in it, and ends\n";

struct Arguments {
    asset: PathBuf,
    screenshot: Option<PathBuf>,
    on_card: bool,
}

fn arguments() -> Result<Arguments, String> {
    let (mut asset, mut screenshot, mut on_card) = (None, None, true);
    let mut given = std::env::args_os().skip(1);
    while let Some(argument) = given.next() {
        if argument == "--screenshot" {
            screenshot = Some(given.next().ok_or("--screenshot: wanted a file, found nothing")?.into());
        } else if argument == "--backend" {
            let found = given.next().map(|word| word.to_string_lossy().into_owned());
            on_card = match found.as_deref() {
                Some("auto") => true,
                Some("cpu") => false,
                found => {
                    return Err(format!(
                        "--backend: wanted cpu or auto, found {}",
                        found.unwrap_or("nothing")
                    ));
                }
            };
        } else if argument.to_string_lossy().starts_with("--") || asset.is_some() {
            return Err(format!("{}: wanted one asset, found another argument", argument.to_string_lossy()));
        } else {
            asset = Some(PathBuf::from(argument));
        }
    }
    Ok(Arguments { asset: asset.ok_or("wanted an asset, found nothing")?, screenshot, on_card })
}

fn main() -> std::process::ExitCode {
    let arguments = match arguments() {
        Ok(arguments) => arguments,
        Err(words) => {
            eprint!("squall-viewer: {words}\n{USAGE}");
            return 2.into();
        }
    };
    let drawer = match Drawer::open(&arguments.asset) {
        Ok(drawer) => drawer,
        Err(error) => {
            eprintln!("squall-viewer: {error}");
            return 3.into();
        }
    };
    let viewport = egui::ViewportBuilder::default().with_inner_size([1280.0, 760.0]).with_title("Squall");
    let mut options = eframe::NativeOptions { viewport, ..Default::default() };
    if let WgpuSetup::CreateNew(setup) = &mut options.wgpu_options.wgpu_setup {
        // The window's own device, with a clock where it has one.
        let usual = setup.device_descriptor.clone();
        setup.device_descriptor = Arc::new(move |adapter| {
            let mut descriptor = usual(adapter);
            descriptor.required_features |= adapter.features() & wgpu::Features::TIMESTAMP_QUERY;
            descriptor
        });
    }
    let make = move |context: &eframe::CreationContext<'_>| -> Result<Box<dyn eframe::App>, _> {
        let state = context.wgpu_render_state.clone();
        Ok(Box::new(Viewer::new(drawer, state, (arguments.on_card, arguments.screenshot))))
    };
    match eframe::run_native("squall", options, Box::new(make)) {
        Ok(()) => 0.into(),
        Err(error) => {
            eprintln!("squall-viewer: no window: {error}");
            4.into()
        }
    }
}

/// Smallest and largest width of a picture, px; it follows the time that one takes.
const WIDTHS: [u32; 8] = [160, 240, 320, 480, 640, 960, 1280, 1920];
/// A picture in motion may take so long.
const BUDGET: Duration = Duration::from_millis(250);
/// One at rest may take so long.
const STILL: Duration = Duration::from_secs(4);
/// Seconds of the storm from one picture to the next.
const STEP_S: f64 = 1.0 / 24.0;
/// Metres a second that the keys fly, and with shift.
const FLY: [f64; 2] = [40.0, 400.0];

struct Viewer {
    drawer: Drawer,
    panel: Panel,
    shown: Option<(Drawn, Texture)>,
    state: Option<RenderState>,
    words: Result<String, String>,
    width: usize,
    is_drawing: bool,
    is_stale: bool,
    last_change: Instant,
    is_playing: bool,
    screenshot: Option<Screenshot>,
}

/// What egui shows a picture by.
enum Texture {
    Loaded(egui::TextureHandle),
    /// A texture of the card's that egui knows.
    Native(egui::TextureId, wgpu::TextureView),
}

/// A screenshot on its way.
struct Screenshot {
    path: PathBuf,
    state: Stage,
    ends: bool,
}

enum Stage {
    BeforeStrike,
    AwaitsPicture,
    AwaitsWindow(Receiver<Arc<egui::ColorImage>>),
}

impl Viewer {
    fn new(
        drawer: Drawer,
        state: Option<RenderState>,
        (on_card, screenshot): (bool, Option<PathBuf>),
    ) -> Self {
        let mut panel = Panel::of(drawer.values());
        if let Some(state) = state.as_ref().filter(|_| on_card) {
            match Gpu::with_device(state.device.clone(), state.queue.clone()) {
                Ok(gpu) => drawer.take_card(gpu),
                Err(error) => panel.instead = Some(format!("The processor draws: {error}")),
            }
        }
        let take = |path| Screenshot { path, state: Stage::BeforeStrike, ends: true };
        Self {
            drawer,
            panel,
            shown: None,
            state,
            words: Ok(String::new()),
            width: 2,
            is_drawing: false,
            is_stale: true,
            last_change: Instant::now(),
            is_playing: false,
            screenshot: screenshot.map(take),
        }
    }

    fn set(&mut self, name: &'static str, value: f64) {
        self.panel.values.insert(name, value);
        self.drawer.set(name, value);
        self.touch();
    }

    fn touch(&mut self) {
        (self.is_stale, self.last_change) = (true, Instant::now());
    }

    fn strike(&mut self, x: f64, y: f64) {
        self.drawer.strike(x, y);
        self.touch();
    }

    /// Takes what the drawer has made, and asks for the next picture.
    fn exchange(&mut self, context: &egui::Context) {
        for answer in self.drawer.answers() {
            match answer {
                Answer::Drawn(drawn) => {
                    self.is_drawing = false;
                    self.adapt(&drawn);
                    self.words = Ok(drawn.words());
                    self.panel.passes.clone_from(&drawn.passes);
                    self.show(context, drawn);
                }
                Answer::Moved(metres) => self.panel.moved = Some(metres),
                Answer::Refused(words) => {
                    self.is_drawing = false;
                    self.words = Err(words);
                }
            }
        }
        if self.is_drawing {
            return;
        }
        if self.is_playing {
            let time = self.panel.values.get("time_s").copied().unwrap_or(0.0) + STEP_S;
            self.set("time_s", time);
        }
        let rested = self.last_change.elapsed() > 2 * BUDGET;
        let finer = self.finer().filter(|_| rested && !self.is_playing);
        if self.is_stale || finer.is_some() {
            let width = finer.filter(|_| !self.is_stale).unwrap_or(WIDTHS[self.width]);
            self.drawer.draw(width, width * 9 / 16);
            (self.is_drawing, self.is_stale) = (true, false);
        }
    }

    /// Has egui show a picture from now on.
    fn show(&mut self, context: &egui::Context, drawn: Drawn) {
        let before = self.shown.take().map(|(_, texture)| texture);
        let texture = match (&drawn.shown, &self.state) {
            (Shown::Texture(view), Some(state)) => {
                if let Some(Texture::Native(id, known)) = &before
                    && known == view
                {
                    Texture::Native(*id, view.clone())
                } else {
                    let mut renderer = state.renderer.write();
                    if let Some(Texture::Native(id, _)) = &before {
                        renderer.free_texture(id);
                    }
                    let filter = wgpu::FilterMode::Linear;
                    Texture::Native(
                        renderer.register_native_texture(&state.device, view, filter),
                        view.clone(),
                    )
                }
            }
            (Shown::Pixels(pixels), _) => {
                let size = [drawn.width as usize, drawn.height as usize];
                let image = egui::ColorImage::from_rgba_unmultiplied(size, pixels);
                Texture::Loaded(context.load_texture("storm", image, egui::TextureOptions::LINEAR))
            }
            (Shown::Texture(_), None) => return,
        };
        self.shown = Some((drawn, texture));
    }

    /// The width of a picture at rest, where it is wider than what is shown.
    fn finer(&self) -> Option<u32> {
        let (drawn, _) = self.shown.as_ref()?;
        let share = (STILL.as_secs_f64() / drawn.took.as_secs_f64().max(1e-3)).sqrt();
        let wide = WIDTHS.into_iter().rfind(|&width| f64::from(width) <= share * f64::from(drawn.width))?;
        (wide > drawn.width).then_some(wide)
    }

    fn adapt(&mut self, drawn: &Drawn) {
        if drawn.width != WIDTHS[self.width] {
            return;
        }
        if drawn.took > BUDGET * 8 / 5 {
            self.width = self.width.saturating_sub(1);
        } else if drawn.took < BUDGET * 2 / 5 {
            self.width = (self.width + 1).min(WIDTHS.len() - 1);
        }
    }

    /// Keys: WASD and QE fly, arrows turn, space strikes, P plays.
    fn keys(&mut self, context: &egui::Context) {
        if context.egui_wants_keyboard_input() {
            return;
        }
        let (held, pressed, seconds) = context.input(|input| {
            let held = |key| input.key_down(key);
            use egui::Key::{A, ArrowDown, ArrowLeft, ArrowRight, ArrowUp, D, E, P, Q, S, Space, W};
            let way = |plus, minus| f64::from(i8::from(held(plus)) - i8::from(held(minus)));
            let moves =
                [way(W, S), way(D, A), way(E, Q), way(ArrowLeft, ArrowRight), way(ArrowUp, ArrowDown)];
            let speed = FLY[usize::from(input.modifiers.shift)];
            let pressed = [input.key_pressed(Space), input.key_pressed(P)];
            ((moves, speed), pressed, f64::from(input.stable_dt.min(0.1)))
        });
        let ([ahead, right, up, left, higher], speed) = held;
        let value = |viewer: &Self, name| viewer.panel.values.get(name).copied().unwrap_or(0.0);
        if left != 0.0 {
            self.set("heading_deg", value(self, "heading_deg") + 60.0 * left * seconds);
        }
        if higher != 0.0 {
            self.set("pitch_deg", (value(self, "pitch_deg") + 40.0 * higher * seconds).clamp(-89.0, 89.0));
        }
        if [ahead, right, up] != [0.0; 3] {
            let [cos, sin] =
                squall_runtime::glam::DVec2::from_angle(value(self, "heading_deg").to_radians()).to_array();
            let step = speed * seconds;
            self.set("x_m", value(self, "x_m") + step * (ahead * cos + right * sin));
            self.set("y_m", value(self, "y_m") + step * (ahead * sin - right * cos));
            self.set("z_m", value(self, "z_m") + step * up);
        }
        if pressed[0] {
            self.strike(0.5, 0.4);
        }
        if pressed[1] {
            self.is_playing = !self.is_playing;
        }
    }

    fn picture(&mut self, ui: &mut egui::Ui) {
        let space = ui.available_size();
        let size = egui::vec2(space.x.min(space.y * 16.0 / 9.0), space.y.min(space.x * 9.0 / 16.0));
        let Some((_, texture)) = &self.shown else {
            ui.allocate_ui(size, |ui| ui.spinner());
            return;
        };
        let id = match texture {
            Texture::Loaded(handle) => handle.id(),
            Texture::Native(id, _) => *id,
        };
        let image = egui::Image::new((id, size)).sense(egui::Sense::click());
        let response = ui.add(image).on_hover_cursor(egui::CursorIcon::Crosshair);
        if let Some(at) = response.interact_pointer_pos().filter(|_| response.clicked()) {
            let share = (at - response.rect.min) / response.rect.size();
            self.strike(f64::from(share.x), f64::from(share.y));
        }
    }

    /// Takes a screenshot of the whole window when it is due.
    fn shoot(&mut self, context: &egui::Context) {
        let is_ready = !self.is_drawing && !self.is_stale && self.shown.is_some();
        let rested = self.finer().is_none();
        let Some(shot) = &mut self.screenshot else { return };
        match shot.state {
            Stage::BeforeStrike if is_ready => {
                shot.state = Stage::AwaitsPicture;
                if shot.ends {
                    self.strike(0.5, 0.4);
                }
            }
            Stage::AwaitsPicture if is_ready && rested => {
                let (send, receive) = channel();
                // Whoever closes the window meanwhile wants no picture of it.
                context.request_screenshot(move |image| drop(send.send(image)));
                shot.state = Stage::AwaitsWindow(receive);
            }
            Stage::AwaitsWindow(ref image) => {
                let Ok(image) = image.try_recv() else { return };
                let saved = save(&shot.path, &image);
                let (path, ends) = (shot.path.clone(), shot.ends);
                self.words = saved.map(|()| format!("{} saved", path.display()));
                if ends {
                    match &self.words {
                        Ok(words) => println!("{words}"),
                        Err(words) => eprintln!("squall-viewer: {words}"),
                    }
                    context.send_viewport_cmd(egui::ViewportCommand::Close);
                }
                self.screenshot = None;
            }
            _ => {}
        }
    }
}

fn save(path: &std::path::Path, image: &egui::ColorImage) -> Result<(), String> {
    let words = |error: &dyn std::fmt::Display| format!("{}: cannot write: {error}", path.display());
    let file = std::fs::File::create(path).map_err(|error| words(&error))?;
    let mut encoder =
        png::Encoder::new(std::io::BufWriter::new(file), image.width() as u32, image.height() as u32);
    encoder.set_color(png::ColorType::Rgb);
    let pixels: Vec<u8> = image.pixels.iter().flat_map(|pixel| [pixel.r(), pixel.g(), pixel.b()]).collect();
    let write = |mut encoder: png::Writer<_>| encoder.write_image_data(&pixels);
    encoder.write_header().and_then(write).map_err(|error| words(&error))
}

impl eframe::App for Viewer {
    fn ui(&mut self, ui: &mut egui::Ui, _: &mut eframe::Frame) {
        let context = ui.ctx().clone();
        self.exchange(&context);
        self.keys(&context);
        egui::Panel::right("controls").exact_size(300.0).show(ui, |ui| {
            egui::ScrollArea::vertical().show(ui, |ui| {
                let asked = self.panel.show(ui, &mut self.is_playing, &self.words);
                for (name, value) in asked.changes {
                    self.set(name, value);
                }
                if asked.strike {
                    self.strike(0.5, 0.4);
                }
                if asked.screenshot && self.screenshot.is_none() {
                    let path = PathBuf::from("storm.png");
                    self.screenshot = Some(Screenshot { path, state: Stage::AwaitsPicture, ends: false });
                }
            });
        });
        egui::CentralPanel::default().show(ui, |ui| self.picture(ui));
        self.shoot(&context);
        context.request_repaint_after(Duration::from_millis(15));
    }
}
