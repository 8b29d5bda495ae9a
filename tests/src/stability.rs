//! Where methods fail, and what is done there: the tests behind docs/stability.md.
//!
//! `cargo test --release -p squall-tests stability -- --nocapture` prints the figures of that page.

mod transport;
