//! The thread that holds the storm and draws, on the window's graphics card or on the processor.

use squall_page::{CONTROLS, Player};
use squall_runtime::gpu::{Gpu, PassTime};
use squall_runtime::renderer::Backend;
use squall_runtime::{Asset, RuntimeError, wgpu};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

enum Ask {
    Card(Gpu),
    Set(&'static str, f64),
    Strike(f64, f64),
    Draw(u32, u32),
}

/// What the thread answers.
pub enum Answer {
    /// A picture.
    Drawn(Drawn),
    /// Metres that a stroke stands beside where it was meant.
    Moved(f64),
    /// Why something is not done.
    Refused(String),
}

/// Where a picture lies.
pub enum Shown {
    /// RGBA, 8 bits, row 0 on top.
    Pixels(Vec<u8>),
    /// A texture of the window's own device.
    Texture(wgpu::TextureView),
}

/// A picture.
pub struct Drawn {
    pub width: u32,
    pub height: u32,
    pub shown: Shown,
    pub took: Duration,
    /// What a card's passes took, where it has a clock.
    pub passes: Vec<PassTime>,
    on: String,
}

impl Drawn {
    /// What it took, in words.
    pub fn words(&self) -> String {
        format!(
            "{} × {} px in {:.0} ms on {}",
            self.width,
            self.height,
            self.took.as_secs_f64() * 1e3,
            self.on
        )
    }
}

/// The window's end of the thread, which ends with it.
pub struct Drawer {
    asks: Sender<Ask>,
    answers: Receiver<Answer>,
    values: BTreeMap<&'static str, f64>,
}

impl Drawer {
    /// Opens an asset and starts the thread.
    ///
    /// Errors: those of opening, in words.
    pub fn open(path: &Path) -> Result<Self, String> {
        let mut player = Player::default();
        Asset::open(path).and_then(|asset| player.start(asset)).map_err(|error| error.to_string())?;
        let mut value = |name| player.get(name).unwrap_or(0.0);
        let values = CONTROLS.iter().map(|control| (control.name, value(control.name))).collect();
        let (asks, asked) = channel();
        let (answer, answers) = channel();
        std::thread::spawn(move || {
            let mut card = None;
            while let Ok(ask) = asked.recv() {
                if let Some(done) = answered(&mut player, &mut card, ask)
                    && answer.send(done).is_err()
                {
                    return;
                }
            }
        });
        Ok(Self { asks, answers, values })
    }

    /// Every control's value in the asset's own view.
    pub fn values(&self) -> &BTreeMap<&'static str, f64> {
        &self.values
    }

    // The thread ends only with its senders: what is asked for always arrives.
    fn ask(&self, ask: Ask) {
        let _ = self.asks.send(ask);
    }

    /// Has pictures drawn on the window's own device.
    pub fn take_card(&self, gpu: Gpu) {
        self.ask(Ask::Card(gpu));
    }

    pub fn set(&self, name: &'static str, value: f64) {
        self.ask(Ask::Set(name, value));
    }

    pub fn strike(&self, x: f64, y: f64) {
        self.ask(Ask::Strike(x, y));
    }

    pub fn draw(&self, width: u32, height: u32) {
        self.ask(Ask::Draw(width, height));
    }

    /// What has been answered since the last call.
    pub fn answers(&self) -> Vec<Answer> {
        self.answers.try_iter().collect()
    }
}

/// What a card draws onto.
struct Card {
    gpu: Gpu,
    target: Option<([u32; 2], wgpu::TextureView)>,
}

/// What egui shows.
const SHOWN: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

impl Card {
    fn target(&mut self, size: [u32; 2]) -> wgpu::TextureView {
        if let Some((_, view)) = self.target.as_ref().filter(|(known, _)| *known == size) {
            return view.clone();
        }
        let texture = self.gpu.device().create_texture(&wgpu::TextureDescriptor {
            label: Some("storm"),
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: SHOWN,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        self.target = Some((size, view.clone()));
        view
    }

    /// Draws, and waits for it: the time is the card's, and the window is not a picture ahead.
    fn draw(&mut self, player: &mut Player, size: [u32; 2]) -> Result<(Shown, Vec<PassTime>), RuntimeError> {
        let view = self.target(size);
        player.draw_into(size, &view, SHOWN)?;
        self.gpu.wait()?;
        let report = player.renderer().and_then(|renderer| renderer.gpu_report());
        Ok((Shown::Texture(view), report.map_or_else(Vec::new, |report| report.passes.clone())))
    }
}

/// Takes a card, or says why the processor draws.
fn take(player: &mut Player, gpu: Gpu) -> Result<Card, RuntimeError> {
    player.set_backend(Backend::Gpu(gpu.clone()))?;
    if let Some(renderer) = player.renderer() {
        renderer.measure(true);
    }
    Ok(Card { gpu, target: None })
}

fn drawn(player: &mut Player, card: &mut Option<Card>, size: [u32; 2]) -> Result<Drawn, RuntimeError> {
    let start = Instant::now();
    let (shown, passes, on) = match card {
        Some(card) => {
            let (shown, passes) = card.draw(player, size)?;
            (shown, passes, card.gpu.name().to_owned())
        }
        None => {
            let pixels = player.draw(size[0], size[1])?.to_vec();
            (Shown::Pixels(pixels), Vec::new(), format!("the processor, {} streaks", player.streaks()))
        }
    };
    Ok(Drawn { width: size[0], height: size[1], shown, took: start.elapsed(), passes, on })
}

fn answered(player: &mut Player, card: &mut Option<Card>, ask: Ask) -> Option<Answer> {
    let done = match ask {
        Ask::Card(gpu) => match take(player, gpu) {
            Ok(taken) => {
                *card = Some(taken);
                Ok(None)
            }
            Err(error) => Ok(Some(Answer::Refused(format!("the processor draws: {error}")))),
        },
        Ask::Set(name, value) => player.set(name, value).map(|()| None),
        Ask::Strike(x, y) => player.strike(x, y).map(|metres| Some(Answer::Moved(metres))),
        Ask::Draw(width, height) => {
            drawn(player, card, [width, height]).map(|drawn| Some(Answer::Drawn(drawn)))
        }
    };
    done.unwrap_or_else(|error| Some(Answer::Refused(error.to_string())))
}
