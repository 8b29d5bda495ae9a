//! A storm that somebody plays with in a web page: its controls, strikes where a pointer is, pictures as bytes of a canvas.
//!
//! `squall page ASSET -o DIR` makes the folder that a static server serves. [`Player`] is the same from Rust, [`exports`] its
//! functions as a wasm32 module that imports the four calls of a page's graphics card alone, `web/` the page around it.

mod controls;
pub mod exports;
mod strike;
#[cfg(target_family = "wasm")]
mod webgpu;

pub use controls::{CONTROLS, Control};

use controls::Settings;
use squall_runtime::formats::units::Seconds;
use squall_runtime::frame::{FlashCurve, FrameQuality};
use squall_runtime::ranges::Opening;
#[cfg(any(feature = "gpu", target_family = "wasm"))]
use squall_runtime::renderer::Backend;
use squall_runtime::tone::Tone;
#[cfg(any(feature = "gpu", target_family = "wasm"))]
use squall_runtime::wgpu;
use squall_runtime::{Asset, Flash, Frame, RuntimeError, StormRenderer, Stroke};
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

/// Strikes that are kept at once; the oldest goes first.
const STRIKES: usize = 4;
/// Largest width and height of a picture, px.
pub const LARGEST: u32 = 4096;
/// Rows from which on streaks grow with the picture, and their number stays.
const STATED_ROWS: u32 = 720;
/// Longest file that is taken, bytes: wasm32 has 4 GiB in all.
pub const LARGEST_ASSET: u64 = 1 << 30;

/// A stroke that a pointer called for, and when it flashes.
struct Strike {
    stroke: Arc<Stroke>,
    curve: FlashCurve,
}

/// An asset that is played.
///
/// ```
/// use squall_page::Player;
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../data/golden/v1/golden.squall");
/// # let file = std::fs::read(path)?;
/// // From anywhere: `file` stands for a request.
/// let fetch = |player: &mut Player| {
///     while let Some(range) = player.wanted() {
///         let end = range.end.min(file.len() as u64);
///         player.give(range.start, &file[range.start as usize..end as usize])?;
///     }
///     Ok::<(), squall_runtime::RuntimeError>(())
/// };
/// let mut player = Player::default();
/// fetch(&mut player)?;
/// player.open()?;
/// player.set("rate_mm_per_h", 20.0)?;
/// // A picture lacks the rows of its strokes, then those of its sky: each once.
/// for _ in 0..3 {
///     if player.draw(64, 36).is_ok() {
///         break;
///     }
///     fetch(&mut player)?;
/// }
/// assert_eq!(player.draw(64, 36)?.len(), 64 * 36 * 4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Default)]
pub struct Player {
    opening: Option<Opening>,
    storm: Option<Storm>,
    /// Bytes of the file that the last call lacked.
    missing: Vec<Range<u64>>,
}

struct Storm {
    renderer: StormRenderer,
    /// The asset's own view, or one that looks at its cloud.
    view: Frame,
    tone: Tone,
    settings: Settings,
    quality: FrameQuality,
    strikes: VecDeque<Strike>,
    pixels: Vec<u8>,
    /// How many strokes were struck, each with a shape of its own.
    struck: u64,
    /// Width and height of the last picture, px.
    size: [u32; 2],
}

fn no_asset() -> RuntimeError {
    RuntimeError::argument("asset", "one that was opened", "none")
}

impl Player {
    /// The bytes of the file that are wanted next: to open it, or because the last call lacked them. `None` where all is here.
    pub fn wanted(&mut self) -> Option<Range<u64>> {
        if self.storm.is_some() {
            return self.missing.last().cloned();
        }
        self.opening.get_or_insert_with(|| Opening::new("asset")).wanted()
    }

    /// Takes bytes from byte `at` of the file on, which [`Player::wanted`] named.
    ///
    /// Errors: bytes that are not wanted, or no asset's; a damaged row.
    pub fn give(&mut self, at: u64, bytes: &[u8]) -> Result<(), RuntimeError> {
        if let Some(storm) = &self.storm {
            storm.renderer.asset().give(at, bytes)?;
            self.missing.retain(|range| range.start != at);
            return Ok(());
        }
        self.opening.get_or_insert_with(|| Opening::new("asset")).give(at, bytes)
    }

    /// Opens the asset of which [`Player::give`] took the bytes.
    ///
    /// Errors: bytes are still wanted; it is damaged.
    pub fn open(&mut self) -> Result<(), RuntimeError> {
        let asset = self.opening.take().ok_or_else(no_asset)?.finish()?;
        self.start(asset)
    }

    /// Opens an asset of which all bytes are here, from a server that knows no ranges.
    ///
    /// Errors: it is no asset, or damaged.
    pub fn open_whole(&mut self, bytes: &[u8]) -> Result<(), RuntimeError> {
        self.opening = None;
        self.start(Asset::from_bytes(bytes)?)
    }

    /// Starts with an asset that is open.
    ///
    /// Errors: a part that is there and damaged.
    pub fn start(&mut self, asset: Asset) -> Result<(), RuntimeError> {
        let mut renderer = StormRenderer::new(asset)?;
        let view = match renderer.frame() {
            Some(frame) => frame,
            None => Frame::new(controls::camera_at(renderer.clouds())?),
        };
        let tone = renderer.tone();
        let settings = Settings::of(&view);
        let (strikes, pixels) = (VecDeque::new(), Vec::new());
        let (quality, struck, size) = (FrameQuality::PREVIEW, 0, [16, 9]);
        self.storm = Some(Storm { renderer, view, tone, settings, quality, strikes, pixels, struck, size });
        self.missing.clear();
        Ok(())
    }

    fn storm(&mut self) -> Result<&mut Storm, RuntimeError> {
        self.storm.as_mut().ok_or_else(no_asset)
    }

    /// Sets the control called `name` ([`CONTROLS`]).
    ///
    /// Errors: there is none of that name; a value out of its range.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), RuntimeError> {
        self.storm()?.settings.set(name, value)
    }

    /// Chooses how finely pictures are worked out: a preview's to begin with.
    ///
    /// Errors: no asset is open.
    pub fn set_quality(&mut self, quality: FrameQuality) -> Result<(), RuntimeError> {
        self.storm()?.quality = quality;
        Ok(())
    }

    /// The value of a control.
    ///
    /// Errors: there is none of that name; no asset is open.
    pub fn get(&mut self, name: &str) -> Result<f64, RuntimeError> {
        self.storm()?.settings.get(name)
    }

    /// A stroke where (x, y) of the picture points, from 0 at its left and top to 1: into the cloud there, and on to the ground where
    /// the asset holds light that far down. Returns how far it stands from where the pointer meant, m: an asset has light for
    /// strokes where its recipe says.
    ///
    /// Errors: the asset has no cloud, or nothing of it is lit; no asset is open.
    pub fn strike(&mut self, x: f64, y: f64) -> Result<f64, RuntimeError> {
        let storm = self.storm()?;
        let camera = storm.frame(storm.size)?.camera;
        storm.struck += 1;
        let clouds = storm.renderer.clouds().ok_or_else(|| {
            RuntimeError::argument("asset", "one with a cloud, which a stroke can light", "none")
        })?;
        let ray = camera.ray(x * f64::from(camera.width), y * f64::from(camera.height));
        let found = strike::at(clouds, &ray, storm.struck)?;
        let now = storm.settings.time();
        let curve = FlashCurve::natural(storm.struck).delayed(Seconds(now));
        if storm.strikes.len() == STRIKES {
            storm.strikes.pop_front();
        }
        storm.strikes.push_back(Strike { stroke: Arc::new(found.stroke), curve });
        Ok(found.moved)
    }

    /// Draws the storm as it stands: RGBA, 8 bits a colour, sRGB, row 0 on top, for a canvas.
    ///
    /// Errors: a size out of range; bytes of the file that have not come ([`Player::wanted`] names them; then call again); what
    /// [`StormRenderer::render`] refuses.
    pub fn draw(&mut self, width: u32, height: u32) -> Result<&[u8], RuntimeError> {
        self.with_storm(|storm| storm.draw(width, height))?;
        Ok(&self.storm.as_ref().ok_or_else(no_asset)?.pixels)
    }

    /// Chooses what draws from now on. A card wants every byte of the asset, of which [`Player::wanted`] then names what has not come.
    ///
    /// Errors: bytes of the file that have not come; as [`StormRenderer::set_backend`]; no asset is open.
    #[cfg(any(feature = "gpu", target_family = "wasm"))]
    pub fn set_backend(&mut self, backend: Backend) -> Result<(), RuntimeError> {
        self.with_storm(|storm| storm.renderer.set_backend(backend))
    }

    /// Draws the storm as it stands onto a texture of the card's, of this size and a format that pictures are shown in. Nothing is
    /// waited for.
    ///
    /// Errors: as [`Player::draw`] and [`StormRenderer::develop_into`]; the processor draws.
    #[cfg(any(feature = "gpu", target_family = "wasm"))]
    pub fn draw_into(
        &mut self,
        size: [u32; 2],
        view: &wgpu::TextureView,
        format: wgpu::TextureFormat,
    ) -> Result<(), RuntimeError> {
        self.with_storm(|storm| {
            let frame = storm.frame(size)?;
            storm.size = size;
            let tone = storm.settings.tone(storm.tone);
            storm.renderer.develop_into(&frame, &tone, view, format).map(drop)
        })
    }

    /// The renderer, for what it reports; none where no asset is open.
    pub fn renderer(&mut self) -> Option<&mut StormRenderer> {
        self.storm.as_mut().map(|storm| &mut storm.renderer)
    }

    /// Does what wants an asset, and keeps which of its bytes were lacking.
    fn with_storm<T>(
        &mut self,
        work: impl FnOnce(&mut Storm) -> Result<T, RuntimeError>,
    ) -> Result<T, RuntimeError> {
        let done = work(self.storm.as_mut().ok_or_else(no_asset)?);
        if let Err(RuntimeError::NotFetched { ranges, .. }) = &done {
            self.missing.clone_from(ranges);
        }
        done
    }

    /// Rain streaks of the last picture.
    pub fn streaks(&mut self) -> usize {
        self.storm.as_ref().map_or(0, |storm| storm.renderer.report().streaks)
    }

    /// Bytes of the asset that came so far, and all of them.
    pub fn bytes(&self) -> [u64; 2] {
        let Some(storm) = &self.storm else { return [0; 2] };
        let asset = storm.renderer.asset();
        let all = asset.bytes().len() as u64;
        [asset.fetched_bytes().unwrap_or(all), all]
    }
}

impl Storm {
    /// The frame that the controls ask for.
    fn frame(&self, size: [u32; 2]) -> Result<Frame, RuntimeError> {
        for (name, value) in [("width", size[0]), ("height", size[1])] {
            if !(1..=LARGEST).contains(&value) {
                return Err(RuntimeError::argument(name, format!("1 to {LARGEST} px"), value));
            }
        }
        let mut frame = self.settings.frame(&self.view, size)?;
        frame.quality = self.quality;
        // A large picture has no more drops than one of 720 rows: somebody waits for it.
        frame.streaks = frame.streaks.for_rows(size[1].max(STATED_ROWS));
        let (opens, exposure) = (self.settings.time(), frame.exposure);
        if !self.settings.is_on("flash") {
            return Ok(frame.dark());
        }
        for strike in &self.strikes {
            let brightness = strike.curve.mean(Seconds(opens), exposure);
            if brightness > 0.0 {
                frame = frame.flash(Flash::own(strike.stroke.clone()).brightness(brightness));
            }
        }
        Ok(frame)
    }

    fn draw(&mut self, width: u32, height: u32) -> Result<(), RuntimeError> {
        let frame = self.frame([width, height])?;
        self.size = [width, height];
        let tone = self.settings.tone(self.tone);
        let picture = self.renderer.render(&frame)?;
        let pixels = tone.to_srgb8(picture);
        self.pixels.clear();
        self.pixels.extend(pixels.iter().flat_map(|[r, g, b]| [*r, *g, *b, 255]));
        Ok(())
    }
}
