//! The functions that the module exports. Numbers go in and out by value; bytes, values and words lie in the module's memory, at
//! the addresses that these functions answer with, until the next call.
//!
//! | export | answers |
//! |---|---|
//! | `squall_input(length)` | address of room for an asset's bytes; 0 where refused |
//! | `squall_open()` | cells of the asset in that room; 0 where refused |
//! | `squall_radiance(x, y, z, intensity, vx, vy, vz)` | cells, after working out J of a point light towards a viewer; 0 where refused |
//! | `squall_fluence(x, y, z, intensity)` | the same of fluence rate |
//! | `squall_extinction()` | the same of the cloud's extinction |
//! | `squall_values()` | address of one `f32` a cell, x fastest |
//! | `squall_grid()` | address of nine `f64`: cells along x, y, z; a cell's edges, m; the grid's smallest corner, m |
//! | `squall_error()`, `squall_error_length()` | address and bytes of why the last call was refused, UTF-8 |
//!
//! The memory may grow, and move for JavaScript, in any of the first five: take a new view of it after each.
//!
//! Unsafe is only that a name is exported as it stands, which no other symbol may have; nothing here reads an address.
#![allow(unsafe_code)]

use crate::Session;
use squall_runtime::glam::DVec3;
use std::cell::RefCell;

thread_local! {
    // An instance of the module is a session: whoever wants two assets open makes two instances.
    static SESSION: RefCell<Session> = RefCell::default();
}

fn with<T>(work: impl FnOnce(&mut Session) -> T) -> T {
    SESSION.with_borrow_mut(work)
}

/// [`Session::input`]: its address.
// SAFETY: `squall_` begins the names of this module alone, so that no other symbol is replaced.
#[unsafe(no_mangle)]
pub extern "C" fn squall_input(length: usize) -> *mut u8 {
    with(|session| session.input(length).map_or(std::ptr::null_mut(), <[u8]>::as_mut_ptr))
}

/// [`Session::open`].
// SAFETY: as of `squall_input`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_open() -> u32 {
    with(Session::open)
}

/// [`Session::radiance`] of a point light at x, y, z towards somebody at vx, vy, vz.
// SAFETY: as of `squall_input`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_radiance(x: f64, y: f64, z: f64, intensity: f64, vx: f64, vy: f64, vz: f64) -> u32 {
    with(|session| session.radiance(DVec3::new(x, y, z), intensity, DVec3::new(vx, vy, vz)))
}

/// [`Session::fluence`] of a point light at x, y, z.
// SAFETY: as of `squall_input`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_fluence(x: f64, y: f64, z: f64, intensity: f64) -> u32 {
    with(|session| session.fluence(DVec3::new(x, y, z), intensity))
}

/// [`Session::extinction`].
// SAFETY: as of `squall_input`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_extinction() -> u32 {
    with(Session::extinction)
}

/// [`Session::values`]: their address.
// SAFETY: as of `squall_input`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_values() -> *const f32 {
    with(|session| session.values().as_ptr())
}

/// [`Session::grid`]: its address.
// SAFETY: as of `squall_input`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_grid() -> *const f64 {
    with(|session| session.grid().as_ptr())
}

/// [`Session::error`]: the address of its bytes.
// SAFETY: as of `squall_input`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_error() -> *const u8 {
    with(|session| session.error().as_ptr())
}

/// [`Session::error`]: how many bytes it has.
// SAFETY: as of `squall_input`.
#[unsafe(no_mangle)]
pub extern "C" fn squall_error_length() -> usize {
    with(|session| session.error().len())
}
