//! A frame's drops as a graphics card looks for them.

use super::{Rain, RainField, RainPath, Shot, Weather, Workspace};
use crate::error::RuntimeError;
use crate::gpu::rain::{CLASSES, RainFrame};
use glam::DVec3;

/// Most cells that one frame's threads may look at.
const MOST_THREADS: u64 = 1 << 30;

impl Rain {
    /// The numbers of a frame's search but for lamps and patterns; returns the threads too.
    ///
    /// Errors: as [`Rain::find`]; more classes of drops than a uniform buffer holds.
    pub(crate) fn uniform(
        &self,
        shot: &Shot,
        weather: &Weather,
        field: &RainField,
        workspace: &mut Workspace,
        out: &mut RainFrame,
    ) -> Result<(), RuntimeError> {
        let radius = self.plan(shot, weather, &mut workspace.searches)?;
        let camera = shot.camera;
        let relative = |v: DVec3| DVec3::new(v.dot(camera.right), v.dot(camera.up), v.dot(camera.forward));
        let (half, focal) = (camera.half_extent(), camera.pixels_per_metre());
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        let four = |v: DVec3, w: f64| [v.x, v.y, v.z, w].map(|value| value as f32);
        out.exposure[0] = shot.exposure.0 as f32;
        let still_way = relative(weather.wind - shot.velocity) * (0.5 * shot.exposure.0);
        out.still_way = four(still_way, f64::from(out.still_way[3]));
        out.world_up = four(relative(DVec3::Z), squall_formats::drops::slope(weather.rate));
        out.wind = four(weather.wind, f64::from(out.wind[3]));
        out.lens = [focal, 0.5 * width, 0.5 * height, camera.pixel_aspect].map(|value| value as f32);
        out.shift = [camera.shift_px.x, camera.shift_px.y, half.x, half.y].map(|value| value as f32);
        out.lengths[0] = (shot.min_px / focal) as f32;
        out.lengths[1] = (shot.max_px / focal) as f32;
        let mut threads = 0u64;
        let searches = &workspace.searches;
        if searches.len() > CLASSES {
            let found = format!("{} classes of drops", searches.len());
            return Err(RuntimeError::argument(
                "rain",
                format!("at most {CLASSES} on a graphics card"),
                found,
            ));
        }
        for (slot, search) in out.classes.iter_mut().zip(searches) {
            let (class, own) = search.uniform(threads.min(u64::from(u32::MAX)) as u32);
            *slot = class;
            threads += own;
        }
        if threads > MOST_THREADS {
            let wanted = format!("a shot that looks at no more than {MOST_THREADS} cells");
            return Err(RuntimeError::argument("rain", wanted, threads));
        }
        out.counts[0] = searches.len() as u32;
        out.flags[0] = threads as u32;
        out.flags[1] = u32::from(field.fills(camera.position, radius));
        Ok(())
    }

    /// Drops that a frame's search touches at most.
    pub(crate) fn most_found(&self, shot: &Shot, workspace: &Workspace) -> Result<f64, RuntimeError> {
        let view = shot.view()?;
        Ok(workspace.searches.iter().map(|search| search.work(&view)[0]).sum())
    }
}
