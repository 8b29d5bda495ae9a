//! An asset's own strokes, by name: grown when they flash, and kept while there is room for them.

use super::{MAX_SEGMENTS, Stroke};
use crate::error::RuntimeError;
use crate::frame::{Flash, FlashStroke};
use crate::load::Asset;
use squall_formats::ReadError;
use squall_formats::section::bolt::{BoltSection, StrokeRecord};
use std::sync::{Arc, Mutex, PoisonError};

/// The strokes of an asset.
pub(crate) struct Strokes {
    asset: Asset,
    records: Vec<StrokeRecord>,
    kept: Mutex<Kept>,
}

/// Strokes that have grown, beside the records.
#[derive(Default)]
struct Kept {
    strokes: Vec<Option<Arc<Stroke>>>,
    segments: u64,
}

impl Strokes {
    /// Errors: a damaged section. An asset without it has no strokes.
    pub fn of(asset: &Asset) -> Result<Self, RuntimeError> {
        let records = match asset.directory().find(BoltSection::TAG) {
            Some(_) => asset.section(BoltSection::TAG, "the strokes", BoltSection::read)?.strokes,
            None => Vec::new(),
        };
        let kept = Kept { strokes: vec![None; records.len()], segments: 0 };
        Ok(Self { asset: asset.clone(), records, kept: Mutex::new(kept) })
    }

    /// The numbers that grow them, in the asset's order.
    pub fn records(&self) -> &[StrokeRecord] {
        &self.records
    }

    /// The asset's stroke of this name. Errors: none has it; more segments than strokes that flash together may have.
    pub fn named(&self, name: &str) -> Result<Arc<Stroke>, RuntimeError> {
        self.grown(name, &mut self.asset.limits().segments.clone())
    }

    /// The strokes that flash, in the order of `flashes`.
    ///
    /// Errors: no stroke of the asset has a name that flashes; more segments in sum than strokes that flash together may have.
    pub fn find<'f>(
        &self,
        flashes: impl IntoIterator<Item = &'f Flash>,
    ) -> Result<Vec<Arc<Stroke>>, RuntimeError> {
        let mut left = self.asset.limits().segments;
        let find = |flash: &Flash| match &flash.stroke {
            FlashStroke::Own(stroke) => Ok(stroke.clone()),
            FlashStroke::Named(name) => self.grown(name, &mut left),
        };
        flashes.into_iter().map(find).collect()
    }

    /// Takes a stroke's segments off those that are `left`; it grows no further than that.
    fn grown(&self, name: &str, left: &mut u64) -> Result<Arc<Stroke>, RuntimeError> {
        let Some(at) = self.records.iter().position(|record| record.name == name) else {
            let names: Vec<&str> = self.records.iter().take(64).map(|record| record.name.as_str()).collect();
            let known = format!("the name of one of the asset's strokes ({})", names.join(", "));
            return Err(RuntimeError::argument("flashes.stroke", known, name));
        };
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let stroke = match &kept.strokes[at] {
            Some(stroke) => stroke.clone(),
            None => {
                let most = usize::try_from(*left).unwrap_or(usize::MAX).saturating_add(1).min(MAX_SEGMENTS);
                Arc::new(Stroke::grow_up_to(&self.records[at], most))
            }
        };
        let segments = stroke.segments.len() as u64;
        if segments > *left {
            return Err(self.too_many(*left, segments));
        }
        *left -= segments;
        if kept.strokes[at].is_none() {
            if kept.segments + segments > self.asset.limits().segments {
                kept.strokes.iter_mut().for_each(|stroke| *stroke = None);
                kept.segments = 0;
            }
            kept.segments += segments;
            kept.strokes[at] = Some(stroke.clone());
        }
        Ok(stroke)
    }

    fn too_many(&self, left: u64, segments: u64) -> RuntimeError {
        let allowed = self.asset.limits().segments;
        let (section, field) = (BoltSection::TAG, "segments of strokes that flash together");
        self.asset.wrap(ReadError::OverLimit { section, field, wanted: allowed - left + segments, allowed })
    }
}
