//! The functions that the module exports. Numbers go in and out by value; bytes, pixels and words lie in the module's memory, at
//! the addresses that these functions answer with, until the next call.
//!
//! | export | answers |
//! |---|---|
//! | `squall_room(length)` | address of room for bytes or a control's name; 0 where refused |
//! | `squall_wanted()` | 1 where bytes of the file are wanted: `squall_wanted_from()` to `squall_wanted_to()` |
//! | `squall_give(at)` | 1 after taking the bytes in that room, from byte `at` of the file on; 0 where refused |
//! | `squall_open(whole)` | 1 with the asset open: 0 of what was given, 1 of the whole file in that room; 0 where refused |
//! | `squall_set(value)` | 1 after turning the control whose name lies in that room; 0 where refused |
//! | `squall_get()` | that control's value; not a number where refused |
//! | `squall_strike(x, y)` | metres that the stroke stands beside where (x, y), 0 to 1, points; not a number where refused |
//! | `squall_draw(width, height)` | address of width × height × 4 bytes of RGBA; 0 where refused, or where bytes are wanted |
//! | `squall_card(on)` | 1 with the card (1) or the processor (0) drawing from now on; 0 where refused, or where bytes are wanted |
//! | `squall_draw_on_card(width, height)` | the host's number of a texture that the picture is being drawn onto; 0 as of `squall_draw` |
//! | `squall_streaks()` | streaks of the last picture |
//! | `squall_bytes(all)` | bytes of the file that came, or all that it has |
//! | `squall_error()`, `squall_error_length()` | address and bytes of why the last call was refused, UTF-8 |
//!
//! The host answers four functions of module `webgpu`: `web/gpu.js`. Without a card none of them is called.
//!
//! The memory may grow, and move for JavaScript, in any of them: take a new view of it after each.
//!
//! Unsafe is only that a name is exported as it stands, which no other symbol may have; nothing here reads an address.
#![allow(unsafe_code)]

use crate::{LARGEST_ASSET, Player};
use squall_runtime::RuntimeError;
#[cfg(target_family = "wasm")]
use squall_runtime::{gpu::Gpu, renderer::Backend, wgpu};
use std::cell::RefCell;

#[derive(Default)]
struct Session {
    player: Player,
    #[cfg(target_family = "wasm")]
    target: Option<Target>,
    room: Vec<u8>,
    wanted: [u64; 2],
    error: String,
}

/// What a card draws onto.
#[cfg(target_family = "wasm")]
struct Target {
    size: [u32; 2],
    texture: wgpu::Texture,
    view: wgpu::TextureView,
}

/// Rows of it are the bytes that a canvas takes.
#[cfg(target_family = "wasm")]
const SHOWN: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

#[cfg(target_family = "wasm")]
impl Target {
    fn new(size: [u32; 2]) -> Self {
        let texture = crate::webgpu::device().0.create_texture(&wgpu::TextureDescriptor {
            label: Some("shown"),
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: SHOWN,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Self { size, texture, view }
    }
}

thread_local! {
    // An instance of the module is a session: whoever wants two assets open makes two instances.
    static SESSION: RefCell<Session> = RefCell::default();
}

fn with<T>(work: impl FnOnce(&mut Session) -> T) -> T {
    SESSION.with_borrow_mut(work)
}

/// What `work` answers; `refused` where it fails, with the reason kept in words.
fn answer<T>(refused: T, work: impl FnOnce(&mut Session) -> Result<T, RuntimeError>) -> T {
    with(|session| match work(session) {
        Ok(answer) => {
            session.error.clear();
            answer
        }
        Err(error) => {
            session.error = error.to_string();
            refused
        }
    })
}

/// Room for `length` bytes: its address.
// SAFETY: `squall_` begins the names of this module alone, so that no other symbol is replaced.
#[unsafe(no_mangle)]
pub extern "C" fn squall_room(length: usize) -> *mut u8 {
    answer(std::ptr::null_mut(), |session| {
        session.room = Vec::new();
        let refused = || RuntimeError::argument("length", format!("1 to {LARGEST_ASSET} bytes"), length);
        if length == 0 || length as u64 > LARGEST_ASSET {
            return Err(refused());
        }
        session.room.try_reserve_exact(length).map_err(|_| refused())?;
        session.room.resize(length, 0);
        Ok(session.room.as_mut_ptr())
    })
}

/// [`Player::wanted`]: whether anything is.
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_wanted() -> u32 {
    with(|session| {
        let wanted = session.player.wanted();
        session.wanted = wanted.as_ref().map_or([0; 2], |range| [range.start, range.end]);
        u32::from(wanted.is_some())
    })
}

/// First byte of what [`squall_wanted`] found.
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_wanted_from() -> f64 {
    with(|session| session.wanted[0] as f64)
}

/// First byte behind it.
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_wanted_to() -> f64 {
    with(|session| session.wanted[1] as f64)
}

/// [`Player::give`] of the bytes in the room.
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_give(at: f64) -> u32 {
    answer(0, |session| {
        let bytes = std::mem::take(&mut session.room);
        session.player.give(at as u64, &bytes).map(|()| 1)
    })
}

/// [`Player::open`], or [`Player::open_whole`] of the bytes in the room.
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_open(whole: u32) -> u32 {
    answer(0, |session| {
        let bytes = std::mem::take(&mut session.room);
        let opened = if whole == 0 { session.player.open() } else { session.player.open_whole(&bytes) };
        opened.map(|()| 1)
    })
}

fn name(room: &[u8]) -> Result<&str, RuntimeError> {
    std::str::from_utf8(room).map_err(|_| RuntimeError::argument("control", "UTF-8", "other bytes"))
}

/// [`Player::set`] of the control whose name lies in the room.
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_set(value: f64) -> u32 {
    answer(0, |session| session.player.set(name(&session.room)?, value).map(|()| 1))
}

/// [`Player::get`] of the control whose name lies in the room.
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_get() -> f64 {
    answer(f64::NAN, |session| session.player.get(name(&session.room)?))
}

/// [`Player::strike`].
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_strike(x: f64, y: f64) -> f64 {
    answer(f64::NAN, |session| session.player.strike(x, y))
}

/// [`Player::draw`]: the pixels' address.
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_draw(width: u32, height: u32) -> *const u8 {
    answer(std::ptr::null(), |session| session.player.draw(width, height).map(<[u8]>::as_ptr))
}

/// [`Player::set_backend`]: the host's device, or the processor.
// SAFETY: as of `squall_room`.
#[cfg(target_family = "wasm")]
#[unsafe(no_mangle)]
pub extern "C" fn squall_card(on: u32) -> u32 {
    answer(0, |session| {
        session.target = None;
        let backend = match on {
            0 => Backend::Cpu,
            _ => {
                let (device, queue) = crate::webgpu::device();
                Backend::Gpu(Gpu::with_device(device, queue)?)
            }
        };
        session.player.set_backend(backend).map(|()| 1)
    })
}

/// [`Player::draw_into`]: the texture's number.
// SAFETY: as of `squall_room`.
#[cfg(target_family = "wasm")]
#[unsafe(no_mangle)]
pub extern "C" fn squall_draw_on_card(width: u32, height: u32) -> u32 {
    answer(0, |session| {
        let size = [width, height];
        if size.iter().any(|side| !(1..=crate::LARGEST).contains(side)) {
            let wanted = format!("1 to {} px", crate::LARGEST);
            return Err(RuntimeError::argument("size", wanted, format!("{width} × {height}")));
        }
        let target = match session.target.take() {
            Some(target) if target.size == size => target,
            _ => Target::new(size),
        };
        let target = session.target.insert(target);
        session.player.draw_into(size, &target.view, SHOWN)?;
        Ok(crate::webgpu::number_of(&target.texture))
    })
}

/// [`Player::streaks`].
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_streaks() -> u32 {
    with(|session| session.player.streaks() as u32)
}

/// [`Player::bytes`]: those that came, or all.
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_bytes(all: u32) -> f64 {
    with(|session| session.player.bytes()[usize::from(all != 0)] as f64)
}

/// Why the last call was refused: its address.
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_error() -> *const u8 {
    with(|session| session.error.as_ptr())
}

/// Bytes of [`squall_error`]'s words.
// SAFETY: as of `squall_room`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_error_length() -> usize {
    with(|session| session.error.len())
}
