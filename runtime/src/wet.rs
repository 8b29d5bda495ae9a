//! What rain does where it lands: ripples on standing water, drops that run down glass, wet materials.
//!
//! Each part stands alone and takes plain numbers and slices: a program's own scene, clock and shading call it. Lengths are
//! metres, times seconds, slopes rise over run. The system is that of \[toyshop\]; where its formulas err, the right one is the
//! default and the printed one is called `paper`.
//!
//! | module | is |
//! |---|---|
//! | [`ripples`] | waves on a lattice, struck by drops at the rain's flux and pushed by moving bodies |
//! | [`puddle`] | how water's slopes come to an object's normal |
//! | [`glass`] | drops on a pane: they wait, run, merge and leave a film; wipers; no water is lost |
//! | [`splash`] | splashes where drops hit what a frame shows |
//! | [`splatter`] | rings that drops leave on surfaces near the camera |
//! | [`flicker`] | neon that flickers |
//! | [`halo`] | mist at silhouettes |
//! | [`layers`] | rainfall as layers over the picture, the paper's baseline |
//! | [`drip`] | drops that drip from edges |
//! | [`mod@drop`] | how drops look, shared by all that draws them; rain close to the lens |
//! | [`draw`] | every effect in its turn over a renderer's buffers |
//! | [`surface`] | wet surfaces: darkened, filmed over, with puddles and ripples; light of lightning on them |
//! | [`reflect`] | what water mirrors of the frame and of the world |
//! | [`glow`] | glow around lights by the atmosphere's point spread |
//! | [`frame`] | a renderer's buffers, what effects are told of a frame, layers over it |
//! | [`maps`] | what is baked from a scene's meshes |
//! | `card` (feature `gpu`) | a frame whose buffers are on a graphics card; effects that draw there are called `card` too |
//! | [`controls`] | the effects' controls by name, with ranges |
//! | [`material`] | reflection at a water surface, and what wetting does to albedo and roughness |

#[cfg(feature = "gpu")]
pub mod card;
pub mod controls;
pub mod draw;
pub mod drip;
pub mod drop;
pub mod flicker;
pub mod frame;
pub mod glass;
pub mod glow;
pub mod halo;
pub mod layers;
pub mod maps;
pub mod material;
pub mod puddle;
pub mod reflect;
pub mod ripples;
pub mod splash;
pub mod splatter;
pub mod surface;

mod maps_asset;
mod slopes;
