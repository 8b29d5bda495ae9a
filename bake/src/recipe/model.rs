//! What a recipe says: data alone, with what it leaves open told apart from what it states. Nothing here reads, decides or makes.

use squall_formats::drops;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::density::Ranges;
use squall_formats::section::response::{Codec, DirectTerm, DirectionalBasis, DistantKind, Stored};
use squall_formats::section::streak::Method;
use squall_formats::section::view::ViewSection;
use squall_formats::units::{Degrees, Millimetres, MillimetresPerHour, Seconds};
use squall_formats::view_region::ViewRegion;
use squall_runtime::transport::solve::SolveSettings;
use std::path::PathBuf;

/// A recipe, read and checked.
#[derive(Clone, Debug)]
pub struct Recipe {
    /// The recipe's own file.
    pub file: PathBuf,
    /// Its text as it was read, hashed into the asset's provenance.
    pub text: String,
    /// A cloud lit by lightning.
    pub clouds: Option<Clouds>,
    /// Rain.
    pub rain: Option<Rain>,
    /// Strokes.
    pub strokes: Vec<StrokeRecord>,
    /// Town file, JSON.
    pub town: Option<PathBuf>,
    /// Meshes that maps are baked of.
    pub scene: Option<SceneSpec>,
    /// The point of the ground that the scene stands on, m: the town's own origin.
    pub place_m: Option<[f64; 3]>,
    /// The picture that the recipe frames.
    pub view: Option<ViewSection>,
}

/// A scene of meshes, and what is baked of it.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneSpec {
    /// The scene, glTF 2.0.
    pub file: PathBuf,
    /// Lumens that a watt of the scene's lamps stands for.
    pub lumens_per_watt: f64,
    /// Low and high corner of the ground that maps cover, m; all of the scene where absent.
    pub region_m: Option<[[f64; 2]; 2]>,
    /// Side of a cell of heights and water, m.
    pub cell_m: f64,
    /// Deepest standing water, m.
    pub deepest_m: f64,
    /// An artist's depths, in place of those that are found.
    pub puddles: Option<PuddleMask>,
    /// Whether edges that drip are looked for.
    pub drips: bool,
    /// Whether silhouettes are looked for.
    pub fins: bool,
    /// Side of a cell of light from overhead, m; none is baked where absent.
    pub overhead_cell_m: Option<f64>,
    /// Points of a shining triangle that are asked whether they are hidden.
    pub overhead_points: u32,
    /// Seed of those points.
    pub overhead_seed: u64,
    /// Unit vectors towards lightning in its key directions.
    pub directions: Vec<glam::DVec3>,
    /// Distance between nodes of lightning's light, m.
    pub lightning_cell_m: f64,
    /// Height above the lowest ground that they reach to, m.
    pub lightning_top_m: f64,
    /// Paths of a node.
    pub paths: u32,
    /// Reflections of a path.
    pub bounces: u32,
    /// Seed of the paths.
    pub lightning_seed: u64,
}

/// A picture of depths over the map.
#[derive(Clone, Debug, PartialEq)]
pub struct PuddleMask {
    /// The picture.
    pub file: PathBuf,
    /// Depth of a grey value of 1, m.
    pub white_m: f64,
}

/// What the recipe says of the cloud.
#[derive(Clone, Debug)]
pub struct Clouds {
    /// SCENE.json with the grid.
    pub scene: PathBuf,
    /// Optics that override the scene's.
    pub optics: Optics,
    /// Where virtual point lights stand.
    pub lights: VirtualLights,
    /// Distant light to bake beside them.
    pub distant: Vec<DistantKind>,
    /// Where the sun may stand over the cloud; none is baked where absent.
    pub sun: Option<SunWish>,
    /// How to solve, and how to store.
    pub response: ResponseSettings,
    /// Cells along x, y and z that light is baked for, blocks of the density's; the density's own where absent.
    pub light_cells: Option<[u32; 3]>,
    /// Held-out strokes that evaluate the result: rows are not baked for them.
    pub held_out_strokes: u32,
    /// How good is good enough.
    pub budget: CloudBudget,
    /// Which settings the recipe states itself.
    pub given: Given,
    /// Keys that have an older name too, as this recipe's text has them.
    pub keys: Keys,
}

/// Where a recipe lets the sun stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SunWish {
    /// Anywhere in the sky, down to where it lights no part of the cloud.
    Anywhere,
    /// Where the recipe's view has it.
    View,
    /// Unit vector towards it.
    At(glam::DVec3),
    /// Where it passes at a latitude on a day, x east and y north.
    Path {
        /// Latitude, rad, north positive.
        latitude_rad: f64,
        /// Day of the year, from 1.
        day: f64,
        /// From and to, hours of local solar time.
        hours: [f64; 2],
    },
}

/// Where virtual point lights stand.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualLights {
    /// Smallest corner of their bounds, m; the cloud grid's own where absent.
    pub low_m: Option<[f64; 3]>,
    /// Largest corner of their bounds, m; the cloud grid's own where absent.
    pub high_m: Option<[f64; 3]>,
    /// Distance between them sideways and above the cloud's base, h_usr, m.
    pub spacing_m: f64,
    /// ε of \[dobashi\] eq. 4, 1/m².
    pub epsilon_per_m2: f64,
    /// Longest interval below the base, m.
    pub longest_m: f64,
    /// Bake only those that a stroke of the recipe can touch.
    pub prune: bool,
    /// Bake those that a light in cloud can touch, and those that a stroke of the recipe can.
    pub in_cloud: bool,
    /// Levels between them, each with half the distance of the one before.
    pub levels: u32,
}

/// What the recipe says of rain.
#[derive(Clone, Debug)]
pub struct Rain {
    /// Pictures of streaks, in order.
    pub pictures: Vec<PathBuf>,
    /// Layer of the pictures, which are then all OpenEXR.
    pub layer: Option<String>,
    /// How to fit them.
    pub fit: FitSettings,
    /// PSNR that every pattern is to have, dB; method and number of cosines are then chosen picture by
    /// picture.
    pub psnr_db: Option<f64>,
    /// Whether the recipe names the method itself; where not, a PSNR chooses it too.
    pub method_given: bool,
    /// What the density table must cover, and how well.
    pub density: DensitySpec,
    /// Rain over the ground.
    pub map: Option<RainMapSpec>,
    /// Distance from the eye beyond which rain is not looked through, m.
    pub farthest_m: Option<f64>,
}

/// A map of rain over the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct RainMapSpec {
    /// Where it comes from.
    pub source: RainMapSource,
    /// Rate of the heaviest rain, mm/h; what the file says where absent.
    pub rate_mm_per_h: Option<f64>,
    /// Height that rain falls from, m; a cloud's base, or none, where absent.
    pub top_m: Option<f64>,
    /// Height over which it fades above that, m.
    pub softness_m: f64,
    /// Rain beside the map's own: a place has whichever is heavier.
    pub showers: Vec<Shower>,
}

/// Even rain in a disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shower {
    /// Its middle, x and y, m.
    pub centre_m: [f64; 2],
    /// Radius of full rain and width of its edge, m.
    pub radius_m: f64,
    /// Width of the edge outside that.
    pub softness_m: f64,
    /// mm/h.
    pub rate_mm_per_h: f64,
}

/// Where a map of rain comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum RainMapSource {
    /// A file over a square grid.
    File {
        /// The file.
        path: PathBuf,
        /// Cells along x and y, of files that do not say so themselves.
        cells: Option<[u32; 2]>,
        /// Lowest corner, m.
        origin_m: [f64; 2],
        /// Edge of a cell, m.
        cell_m: f64,
    },
    /// The recipe's cloud.
    Cloud {
        /// Water of a column that rains nothing yet, over the wettest one's.
        least_water: f64,
    },
}

/// Optics for scenes that leave them out, where a command brings its own.
#[derive(Clone, Copy, Debug, Default)]
pub struct Optics {
    /// Single-scattering albedo.
    pub albedo: Option<f64>,
    /// Asymmetry parameter.
    pub g: Option<f64>,
    /// Extinction of density 1, 1/m.
    pub kappa_per_m: Option<f64>,
}

/// How to bake a response.
#[derive(Clone, Copy, Debug)]
pub struct ResponseSettings {
    /// Directions, harmonics, or polynomials towards a view region.
    pub basis: DirectionalBasis,
    /// Direct light in the rows or left to the runtime.
    pub direct: DirectTerm,
    /// How coefficients are stored.
    pub codec: Codec,
    /// How far a source may be off, relative to its own L2 norm.
    pub relative_error: f64,
    /// Leave out the light of cells that no ray shades with: [`crate::response::hidden`].
    pub seen_only: bool,
    /// Where viewpoints may lie; anywhere where absent. With `seen_only`, cells that are hidden from all of them are left out too.
    pub view_region: Option<ViewRegion>,
    /// Solve cells per stored cell and axis.
    pub refine: u32,
    /// What cells hold of light that was solved for in smaller ones: parts of them, or with `Fit` those that are shown.
    pub stored: Stored,
    /// What the error of a coefficient counts for.
    pub error_for: ErrorFor,
    /// Direct rays per boundary face of the solve grid and axis.
    pub samples: u32,
    /// Levels of virtual lights between those of the light grid, each with half the distance of the one before, in and beside cloud alone.
    pub finer: u32,
    /// Distance between the light grid's virtual lights, m; matters to finer levels alone.
    pub spacing_m: f64,
    /// The sweeps.
    pub solve: SolveSettings,
}

/// What a recipe asks of its clouds; nothing where a field is `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CloudBudget {
    /// L2 error of held-out strokes, all light, against the strokes solved directly: in the 26 directions, or towards held-out
    /// viewpoints.
    pub stroke_l2: Option<f64>,
    /// L2 error of held-out strokes' light, against the same rows before coding.
    pub relit_l2: Option<f64>,
    /// L2 error of the cloud's light under suns that no beam was baked for, direct light included, against direct solves.
    pub sun_l2: Option<f64>,
    /// L2 error of a stroke solved with the chosen directions and refinement, against the finest that is tried.
    pub solver_l2: Option<f64>,
    /// Bytes of the response at most.
    pub bytes: Option<u64>,
    /// Milliseconds that relighting a stroke may count for, on one core: [`crate::evaluate::cost`].
    pub relight_ms: Option<f64>,
}

/// Settings that the recipe states itself; a budget leaves them alone.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Given {
    /// `clouds.lightning.spacing_m`.
    pub spacing: bool,
    /// `clouds.response.basis`.
    pub basis: bool,
    /// `clouds.response.error`.
    pub error: bool,
    /// `clouds.transport.directions` or `refine`.
    pub solver: bool,
    /// `clouds.response.distant`, `sun` or `sun_direction`.
    pub sky: bool,
}

/// Keys that have an older name too, as a recipe's text has them: messages name what its author typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Keys {
    /// `clouds.view_region` or `clouds.eyes`.
    pub view_region: &'static str,
    /// `clouds.response.basis` or `clouds.response.basis`.
    pub basis: &'static str,
}

impl Default for Keys {
    fn default() -> Self {
        Self { view_region: "clouds.view_region", basis: "clouds.response.basis" }
    }
}

impl CloudBudget {
    /// Whether something has to be chosen beside the solver.
    pub fn chooses(&self) -> bool {
        self.errors() || self.costs()
    }

    /// Whether bytes or milliseconds bound the choice.
    pub fn costs(&self) -> bool {
        self.bytes.is_some() || self.relight_ms.is_some()
    }

    /// Whether anything is asked that held-out strokes have to confirm.
    pub fn needs_held_out(&self) -> bool {
        self.chooses() || self.solver_l2.is_some()
    }

    /// Whether an error of relit light bounds the choice.
    pub fn errors(&self) -> bool {
        self.stroke_l2.is_some() || self.relit_l2.is_some()
    }
}

/// Whom `clouds.response.error` is about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ErrorFor {
    /// Those who look at light as it is stored: all coefficients count alike.
    #[default]
    Viewers,
    /// Gathers at run time: coefficients count as a gather scatters them ([`crate::compress::PlaneWeights::for_gathers`]).
    Gathers,
}

/// What a fit is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FitSettings {
    /// How to fit.
    pub method: Method,
    /// Oscillating terms, 0 to [`squall_formats::section::streak::MAX_TERMS`]; the constant and the window come on top.
    pub cosines: usize,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { method: Method::Edges, cosines: 6 }
    }
}

/// What a density table is asked to cover, and how well.
#[derive(Clone, Debug, PartialEq)]
pub struct DensitySpec {
    /// Ranges in which the table must hold.
    pub ranges: Ranges,
    /// Smallest and largest diameter of the default mode's classes; from 0.1 mm.
    pub diameter: [Millimetres; 2],
    /// Number of default classes, 1 to 64, equal in the logarithm of the diameter. Without a say where `class_error` is
    /// given.
    pub classes: usize,
    /// Largest [`crate::plan::density::speed_error`] that the number of classes is chosen by, 0.001 to 0.5.
    pub class_error: Option<f64>,
    /// Largest relative error of any class's count, against quadrature.
    pub relative_error: f64,
}

impl Default for DensitySpec {
    /// Rain of 0.1 to 200 mm/h, fov 20 to 140°, exposures of 1 to 33 ms, streaks of 10 to 200 px; 16 classes.
    fn default() -> Self {
        Self {
            ranges: Ranges {
                rate: [MillimetresPerHour(0.1), MillimetresPerHour(200.0)],
                vertical_fov: [Degrees(20.0), Degrees(140.0)],
                exposure: [Seconds(0.001), Seconds(0.033)],
                length_px: [10.0, 200.0],
            },
            diameter: drops::DEFAULT_DIAMETERS,
            classes: 16,
            class_error: None,
            relative_error: 1e-5,
        }
    }
}
