//! What draws: the processor or a graphics card, and what of that is told.

use serde_json::{Value, json};
use squall_bake::output::Output;
use squall_runtime::picture::Picture;
use squall_runtime::{Frame, RuntimeError, StormRenderer};
use std::io::Write;
use std::path::Path;

/// What draws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Choice {
    /// The processor: the reference, the same bytes everywhere.
    #[default]
    Cpu,
    /// A graphics card, within docs/gpu.md's tolerances of the processor.
    Gpu,
    /// A graphics card where one can draw the picture, else the processor.
    Auto,
}

/// What draws the pictures of one command.
pub struct Backend {
    choice: Choice,
    /// Why the processor draws although a card was asked for.
    instead: Option<String>,
}

/// Seconds since the first call.
fn seconds() -> f64 {
    use std::{sync::LazyLock, time::Instant};
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    START.elapsed().as_secs_f64()
}

impl Backend {
    /// Has `choice` draw from now on: pictures whose parts are timed if `measured`, with layers that are the processor's if `layered`.
    ///
    /// Errors: no card, one that cannot hold the asset, or a binary without feature `gpu`, where a card is insisted on.
    pub fn set(
        choice: Choice,
        renderer: &mut StormRenderer,
        (measured, layered): (bool, bool),
    ) -> Result<Self, RuntimeError> {
        let mut backend = Self { choice, instead: None };
        if measured {
            renderer.set_clock(Some(seconds));
        }
        if choice == Choice::Auto && layered {
            backend.instead = Some("it alone draws layers".into());
        } else if choice != Choice::Cpu {
            match open(renderer, measured) {
                Ok(()) => {}
                Err(error) if choice == Choice::Gpu => return Err(error),
                Err(error) => backend.instead = Some(error.to_string()),
            }
        }
        Ok(backend)
    }

    /// Draws `frame`. With `auto`, what a card refuses the processor draws, and so everything after it.
    ///
    /// Errors: as [`StormRenderer::render`].
    pub fn render<'a>(
        &mut self,
        renderer: &'a mut StormRenderer,
        frame: &Frame,
    ) -> Result<&'a Picture, RuntimeError> {
        if self.choice == Choice::Auto
            && self.instead.is_none()
            && let Err(error) = renderer.render(frame)
        {
            close(renderer)?;
            renderer.render(frame)?;
            self.instead = Some(error.to_string());
            return Ok(renderer.picture());
        }
        if self.choice == Choice::Auto && self.instead.is_none() {
            return Ok(renderer.picture());
        }
        renderer.render(frame)
    }

    /// What is to be said of it.
    pub fn words(&self) -> Option<String> {
        self.instead.as_ref().map(|why| format!("drawn by the processor: {why}"))
    }

    /// Writes what the last picture took: milliseconds a pass, adapter, bytes.
    ///
    /// Errors: as [`Output::write`].
    pub fn report(&self, path: &Path, renderer: &StormRenderer) -> anyhow::Result<()> {
        let parts = renderer.report().times.named();
        let parts = parts.map(|(name, seconds)| json!({ "name": name, "ms": seconds * 1e3 }));
        let processor = json!({ "backend": "cpu", "adapter": null, "passes": parts, "bytes_held": null });
        let mut told = card_report(renderer).unwrap_or(processor);
        told["instead"] = json!(self.instead);
        let text = serde_json::to_vec_pretty(&told)?;
        Ok(Output::prepare(path)?.write(|out| out.write_all(&text).and_then(|()| out.write_all(b"\n")))?)
    }
}

#[cfg(feature = "gpu")]
fn open(renderer: &mut StormRenderer, measured: bool) -> Result<(), RuntimeError> {
    use squall_runtime::gpu::Gpu;
    renderer.set_backend(squall_runtime::renderer::Backend::Gpu(Gpu::open()?))?;
    renderer.measure(measured);
    Ok(())
}

#[cfg(not(feature = "gpu"))]
fn open(_: &mut StormRenderer, _: bool) -> Result<(), RuntimeError> {
    let wanted = "a squall with graphics cards (cargo install --features gpu)".to_owned();
    Err(RuntimeError::Device { wanted, found: "this one, built without them".to_owned() })
}

#[cfg(feature = "gpu")]
fn close(renderer: &mut StormRenderer) -> Result<(), RuntimeError> {
    renderer.set_backend(squall_runtime::renderer::Backend::Cpu)
}

#[cfg(not(feature = "gpu"))]
fn close(_: &mut StormRenderer) -> Result<(), RuntimeError> {
    Ok(())
}

#[cfg(feature = "gpu")]
fn card_report(renderer: &StormRenderer) -> Option<Value> {
    let report = renderer.gpu_report()?;
    let passes: Vec<Value> =
        report.passes.iter().map(|pass| json!({ "name": pass.name, "ms": pass.ms })).collect();
    Some(json!({
        "backend": "gpu",
        "adapter": report.adapter,
        "passes": passes,
        "bytes_held": report.bytes_held,
    }))
}

#[cfg(not(feature = "gpu"))]
fn card_report(_: &StormRenderer) -> Option<Value> {
    None
}
