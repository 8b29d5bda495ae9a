//! Reads a `.squall` asset and shades: clouds lit by lightning, rain streaks of the right number and length, the loss of visibility
//! that belongs to the same rain, and the wet ground under them.
//!
//! # A picture with a camera and a stroke of one's own
//!
//! ```
//! use squall_runtime::{Camera, Frame, RuntimeError, StormRenderer, Stroke};
//! use squall_runtime::{formats::units::Degrees, glam::DVec3};
//!
//! # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
//! let mut renderer = StormRenderer::open(path)?;
//! let camera = Camera::look_at(DVec3::new(0.0, -900.0, 2.0), DVec3::new(0.0, 0.0, 600.0), Degrees(60.0), [96, 54])?;
//! let stroke = Stroke::between(DVec3::new(-100.0, 0.0, 690.0), DVec3::new(120.0, 40.0, 650.0), 7, 1e6)?;
//! let frame = renderer.frame_from(camera).flash(stroke);
//! let picture = renderer.render(&frame)?;
//! assert!(picture.pixels.iter().flatten().all(|light| light.is_finite()));
//! let srgb: Vec<[u8; 3]> = renderer.tone().to_srgb8(renderer.picture());
//! # assert_eq!(srgb.len(), 96 * 54);
//! # Ok::<(), RuntimeError>(())
//! ```
//!
//! # The names
//!
//! | name | is |
//! |---|---|
//! | [`Asset`] | an open file: a handle whose clones share the bytes |
//! | [`StormRenderer`] | draws pictures; holds its asset and its memory, and what stays the same from frame to frame |
//! | [`Frame`] | what a picture is to show: camera, weather, sky, flashes |
//! | [`Camera`] | from a target, a renderer's matrices or a calibrated lens |
//! | [`Stroke`], [`Flash`] | lightning: the asset's strokes by name, or one's own; how brightly they flash |
//! | [`Clouds`] | the cloud's light as data: in-scattered radiance towards a viewer, fluence, per cell |
//! | [`Rain`], [`Weather`] | streaks over one's own frame and depth ([`rain`]), beside the medium of finer drops ([`medium`]) |
//! | [`wet`] | where rain lands: ripples, drops on glass, wet materials |
//! | [`RuntimeError`] | what was refused, in words: argument, accepted range, value |
//!
//! # The data
//!
//! Metres, seconds, radians; z up, x and y along the ground, right-handed. Pictures are linear radiance, W/(m² sr) in three
//! broad bands red, green and blue, row 0 on top; [`tone`] makes them sRGB. Cells lie x fastest. An asset holds sections: a cloud
//! grid, its light's rows, strokes, rain tables, streak patterns, a town, a view; what one lacks is not drawn. The types of those
//! sections are [`formats`]', the vectors are [`glam`]'s.
//!
//! # What it does not do
//!
//! No clouds that move or grow, no terrain, no sound; no light of the flash from the town back on the cloud. It bakes nothing.
//! A stroke may stand where the asset's virtual point lights were baked ([`Clouds::is_lit`]); anywhere else only with feature
//! `live`, which solves for its light on the spot and takes seconds. No globals, no threads but the caller's rayon pool
//! (and those that compile a card's pipelines, until they have), and no work at load beyond checks.
//!
//! | feature | default | does |
//! |---|---|---|
//! | `mmap` | yes | maps files into memory instead of reading them |
//! | `rayon` | yes | spreads work over the caller's rayon pool; results do not depend on the number of threads |
//! | `live` | no | solves for the light of strokes that no baked row answers for |
//! | `gpu` | no | frames on a graphics card, through wgpu: `gpu::Gpu` |
//! | `webgpu` | no | on wasm32, `Gpu::open_async` through wgpu's own bindings, which want wasm-bindgen |
//! | `simd` | no | the machine's widest registers for the rain's medium, found when it runs; the same bytes without |
#![deny(unsafe_code)]

pub mod airlight;
mod audited;
pub mod camera;
pub mod clouds;
pub mod density;
pub mod depth;
pub mod error;
pub mod frame;
pub mod frame_rain;
#[cfg(feature = "gpu")]
pub mod gpu;
#[doc(hidden)]
pub mod in_scattered;
pub mod load;
pub mod medium;
#[doc(hidden)]
pub mod noise;
mod octahedron;
pub mod picture;
pub mod place;
pub mod point_spread;
pub mod rain;
#[doc(hidden)]
pub mod random;
pub mod ranges;
mod registers;
pub mod relight;
pub mod renderer;
pub mod shade;
pub mod single_scatter;
pub mod stroke;
pub mod tone;
pub mod verify;
pub mod wet;
pub mod world;

pub use camera::Camera;
pub use clouds::Clouds;
pub use error::RuntimeError;
pub use frame::{Flash, Frame};
pub use load::Asset;
pub use rain::{Rain, Weather};
pub use renderer::StormRenderer;
pub use stroke::Stroke;
pub use world::WorldLight;

pub use glam;
pub use squall_formats as formats;
pub use squall_transport as transport;
#[cfg(feature = "live")]
pub use squall_transport::live;
#[doc(hidden)]
pub use squall_transport::{math, parallel, phase};
#[cfg(feature = "gpu")]
pub use wgpu;
