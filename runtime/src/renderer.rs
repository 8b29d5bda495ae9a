//! Pictures of a storm, from its asset alone: cloud lit by its flashes, sky, town, channel, rain.

#[cfg(feature = "gpu")]
mod card;
mod channel;
mod cloud_shade;
pub(crate) mod draw;
mod foreground;
pub(crate) mod halos;
mod layers;
pub(crate) mod light;
pub(crate) mod lit_stroke;
mod panes;
mod rain;
pub(crate) mod rain_sun;
mod sun_shadows;
mod surfaces;
mod times;
mod town;
pub(crate) mod town_rain;
#[cfg(feature = "gpu")]
mod weather;
pub(crate) mod world;

#[cfg(feature = "gpu")]
pub use card::Backend;
pub use foreground::Foreground;
pub use layers::{Layer, LayerPixels};
pub use times::{Clock, FrameTimes};

use crate::camera::Camera;
use crate::clouds::{Clouds, SunSource};
use crate::error::RuntimeError;
use crate::frame::{Frame, tone_of};
use crate::load::Asset;
use crate::picture::Picture;
use crate::place::Place;
use crate::rain::{DryTiles, Workspace};
use crate::relight::Relighter;
use crate::shade::cloud::CloudShape;
use crate::shade::detail::{Detail, DetailParameters};
use crate::shade::sky::{Sky, SkyParameters};
use crate::shade::streak::StreakSet;
use crate::shade::town::Town;
use crate::stroke::{Stroke, Strokes};
use crate::tone::Tone;
use crate::transport::Cloud;
use glam::Vec4;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::density::DensitySection;
use squall_formats::section::rain_place::RainPlaceSection;
use squall_formats::section::streak::StreakSection;
use squall_formats::section::town::TownSection;
use squall_formats::section::view::ViewSection;
use std::path::Path;
use std::sync::Arc;

/// Draws pictures of an asset's storm. It holds its asset and its memory, so that an engine can store it and hand it from thread
/// to thread.
///
/// What stays the same from one frame to the next is kept: the sky, the billows, the cloud's light under that sky, and the
/// light of every stroke while stroke and viewer stand still, which brightness and colour only scale.
///
/// ```
/// use squall_runtime::StormRenderer;
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
/// let mut renderer = StormRenderer::open(path)?;
/// let frame = renderer.frame().expect("the asset brings a view");
/// let picture = renderer.render(&frame)?;
/// assert_eq!((picture.width, picture.height), (64, 36));
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
pub struct StormRenderer {
    scene: Scene,
    memory: Memory,
    report: FrameReport,
    #[cfg(feature = "gpu")]
    card: Option<card::Card>,
}

/// The parts of an asset that pictures need. What it lacks is not drawn.
struct Scene {
    asset: Asset,
    place: Place,
    strokes: Arc<Strokes>,
    cloud: Option<SceneCloud>,
    rain: Option<DensitySection>,
    rain_place: rain::Place,
    patterns: StreakSet,
    town: Option<Town>,
    view: Option<ViewSection>,
}

/// The cloud as rays see it.
struct SceneCloud {
    relighter: Arc<Relighter>,
    shape: CloudShape,
    /// Its grid measured from the scene's place, where that is another.
    moved: Option<Cloud>,
}

impl SceneCloud {
    fn new(clouds: &Clouds, place: Place) -> Self {
        let cloud = clouds.cloud();
        Self { relighter: clouds.shared(), shape: CloudShape::new(cloud), moved: place.cloud(cloud) }
    }

    /// The grid, measured from the scene's place.
    fn grid(&self) -> &Cloud {
        self.moved.as_ref().unwrap_or(self.relighter.cloud())
    }
}

/// Memory for pictures; most of it is kept from one to the next.
struct Memory {
    clouds: Option<Clouds>,
    picture: Picture,
    sky: Option<(SkyParameters, Sky)>,
    detail: Option<(DetailParameters, Detail)>,
    ambient: light::Ambient,
    cells: Vec<Vec4>,
    flash_cells: Vec<Vec4>,
    surrounding: Option<world::Surrounding>,
    town: town::Kept,
    spreading: Option<halos::Spreading>,
    lamp_halos: Option<halos::kept::Kept>,
    cloud_shade: Option<cloud_shade::CloudShade>,
    dry: Option<DryTiles>,
    rain: Workspace,
    transmittance: Vec<f32>,
    metres: Vec<f32>,
    /// What the caller has stand before sky, cloud and town.
    foreground: Option<Foreground>,
    clock: Option<Clock>,
}

impl Memory {
    /// Nothing yet.
    fn empty() -> Result<Self, RuntimeError> {
        Ok(Self {
            clouds: None,
            picture: Picture::new(1, 1)?,
            sky: None,
            detail: None,
            ambient: light::Ambient::default(),
            cells: Vec::new(),
            flash_cells: Vec::new(),
            surrounding: None,
            town: town::Kept::default(),
            spreading: None,
            lamp_halos: None,
            cloud_shade: None,
            dry: None,
            rain: Workspace::new(),
            transmittance: Vec::new(),
            metres: Vec::new(),
            foreground: None,
            clock: None,
        })
    }
}

impl Memory {
    /// Has a picture of the size that `camera` takes.
    fn fit(&mut self, camera: &Camera) -> Result<(), RuntimeError> {
        let size = [camera.width as usize, camera.height as usize];
        if [self.picture.width, self.picture.height] != size {
            self.picture = Picture::new(size[0], size[1])?;
        }
        Ok(())
    }
}

/// What a picture took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct FrameReport {
    /// Points of light on the flashing strokes.
    pub lights: usize,
    /// Virtual point lights that they were split over.
    pub sources: usize,
    /// Points that no row answers for, whose light was solved for on the spot.
    pub lights_live: usize,
    /// Largest residual that the last gather of a stroke's light found ([`crate::clouds::LightQuality::gathers`]); above that of the
    /// light now. Nothing without gathers.
    pub gather_residual: Option<f64>,
    /// Flashing strokes whose light was kept from an earlier frame.
    pub strokes_kept: usize,
    /// Rain streaks found.
    pub streaks: usize,
    /// Where the sun's light on the cloud came from.
    pub sun: SunSource,
    /// Whether the asset lacks light of the sky's hemispheres, so that its cloud stays dark under a bright sky.
    pub sky_missing: bool,
    /// How long its parts took, where there is a clock ([`StormRenderer::set_clock`]).
    pub times: FrameTimes,
}

impl StormRenderer {
    /// Opens an asset file and every part of it that pictures need.
    ///
    /// Errors: as [`Asset::open`]; a part that is there and damaged.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RuntimeError> {
        Self::new(Asset::open(path)?)
    }

    /// The same of an open asset, in an [`Arc`] or not: a renderer shares its bytes.
    ///
    /// Errors: a part that is there and damaged.
    pub fn new(asset: impl Into<Asset>) -> Result<Self, RuntimeError> {
        let asset = asset.into();
        let has = |tag| asset.directory().find(tag).is_some();
        let strokes = Arc::new(Strokes::of(&asset)?);
        let clouds = match has(CloudSection::TAG) {
            true => Some(Clouds::with_strokes(&asset, strokes.clone())?),
            false => None,
        };
        let place = Place::of(&asset)?;
        let cloud = clouds.as_ref().map(|clouds| SceneCloud::new(clouds, place));
        let rain = match has(DensitySection::TAG) {
            true => Some(asset.section(DensitySection::TAG, "the rain's density", DensitySection::read)?),
            false => None,
        };
        let rain_place = match has(RainPlaceSection::TAG) {
            true => rain::Place::new(&asset.section(
                RainPlaceSection::TAG,
                "the place of rain",
                RainPlaceSection::read,
            )?)?,
            false => rain::Place::default(),
        };
        let patterns = match has(StreakSection::TAG) {
            true => asset.section(StreakSection::TAG, "streak patterns", StreakSection::read)?,
            false => StreakSection { patterns: Vec::new() },
        };
        let town = match has(TownSection::TAG) {
            true => Some(Town::new(&asset.section(TownSection::TAG, "the town", TownSection::read)?)),
            false => None,
        };
        let view = match has(ViewSection::TAG) {
            true => Some(asset.section(ViewSection::TAG, "the view", ViewSection::read)?),
            false => None,
        };
        let patterns = StreakSet::new(&patterns);
        let rain_place = rain_place.measured_from(place.origin);
        let scene = Scene { asset, place, strokes, cloud, rain, rain_place, patterns, town, view };
        let memory = Memory { clouds, ..Memory::empty()? };
        Ok(Self {
            scene,
            memory,
            report: FrameReport::default(),
            #[cfg(feature = "gpu")]
            card: None,
        })
    }

    /// The asset.
    pub fn asset(&self) -> &Asset {
        &self.scene.asset
    }

    /// The view that the asset brings, as its author wrote it.
    pub fn view(&self) -> Option<&ViewSection> {
        self.scene.view.as_ref()
    }

    /// The frame of the asset's own view.
    #[must_use]
    pub fn frame(&self) -> Option<Frame> {
        self.view().map(Frame::from)
    }

    /// A frame from another camera, in the weather and under the sky of the asset's own view (where it has one), dark.
    #[must_use]
    pub fn frame_from(&self, camera: Camera) -> Frame {
        match self.frame() {
            Some(frame) => frame.camera(camera).dark(),
            None => Frame::new(camera),
        }
    }

    /// How the asset's author wants light to become a picture, or a default.
    #[must_use]
    pub fn tone(&self) -> Tone {
        self.view().map_or_else(Tone::default, |view| tone_of(&view.tone))
    }

    /// The asset's strokes, as the numbers that grow them: a stroke grows when it flashes.
    pub fn strokes(&self) -> &[StrokeRecord] {
        self.scene.strokes.records()
    }

    /// The asset's stroke of this name, grown.
    ///
    /// Errors: no stroke has it, or it has more segments than strokes that flash together may have.
    pub fn stroke(&self, name: &str) -> Result<Arc<Stroke>, RuntimeError> {
        self.scene.strokes.named(name)
    }

    /// The asset's cloud, where it has one: where it is lit, and its light as data.
    pub fn clouds(&mut self) -> Option<&mut Clouds> {
        self.memory.clouds.as_mut()
    }

    /// Has the parts of pictures timed by `clock`: [`FrameReport::times`].
    ///
    /// ```
    /// # use squall_runtime::StormRenderer;
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
    /// fn seconds() -> f64 {
    ///     use std::{sync::LazyLock, time::Instant};
    ///     static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    ///     START.elapsed().as_secs_f64()
    /// }
    /// let mut renderer = StormRenderer::open(path)?;
    /// let frame = renderer.frame().expect("the asset brings a view");
    /// renderer.set_clock(Some(seconds));
    /// renderer.render(&frame)?;
    /// assert!(renderer.report().times.named().iter().map(|(_, time)| time).sum::<f64>() > 0.0);
    /// # Ok::<(), squall_runtime::RuntimeError>(())
    /// ```
    pub fn set_clock(&mut self, clock: Option<Clock>) {
        self.memory.clock = clock;
    }

    /// Draws `frame`: linear radiance, W/(m² sr), row 0 on top. The picture stays until the next call.
    ///
    /// Errors: a number out of range, by name; a stroke that the asset lacks or, without feature `live`, whose light was not
    /// baked; a camera outside the view region that the asset was baked for; rain where the asset has none; a damaged row.
    pub fn render(&mut self, frame: &Frame) -> Result<&Picture, RuntimeError> {
        frame.check()?;
        #[cfg(feature = "gpu")]
        if self.render_on_card(frame)? {
            return Ok(&self.memory.picture);
        }
        self.report = self.scene.draw(frame, &mut self.memory)?;
        Ok(&self.memory.picture)
    }

    /// The picture of the last [`StormRenderer::render`]; one black pixel before the first.
    #[must_use]
    pub fn picture(&self) -> &Picture {
        &self.memory.picture
    }

    /// What the last picture took.
    #[must_use]
    pub fn report(&self) -> FrameReport {
        self.report
    }
}
