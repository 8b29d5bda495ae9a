//! Accessors: numbers of any kind out of buffers, every bound checked before memory is taken.

use super::File;
use crate::error::SceneError;
use gltf::json::accessor::{ComponentType, IndexComponentType, Type};
use gltf::json::validation::Checked;

/// Most elements of an accessor that has no bytes but those of its sparse part.
const MOST_ZEROS: u64 = 1 << 20;

const fn size_of(kind: ComponentType) -> usize {
    match kind {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

/// One number; whole ones as they are, or over their largest where they are normalised. `bytes` holds at least its size.
fn number(bytes: &[u8], kind: ComponentType, normalised: bool) -> f32 {
    let (value, largest) = match kind {
        ComponentType::I8 => (f32::from(bytes[0] as i8), 127.0),
        ComponentType::U8 => (f32::from(bytes[0]), 255.0),
        ComponentType::I16 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32_767.0),
        ComponentType::U16 => (f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65_535.0),
        ComponentType::U32 => (whole(bytes, kind) as f32, 4_294_967_295.0),
        ComponentType::F32 => return f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    };
    if normalised { (value / largest).max(-1.0) } else { value }
}

fn whole(bytes: &[u8], kind: ComponentType) -> u32 {
    match kind {
        ComponentType::U8 => u32::from(bytes[0]),
        ComponentType::U16 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        _ => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    }
}

/// A run of elements in a view.
struct Run<'a> {
    bytes: &'a [u8],
    stride: usize,
}

impl<'a> File<'a> {
    /// Counts elements that are about to be decoded.
    fn decode(&self, more: u64, field: &str) -> Result<(), SceneError> {
        let (sum, most) = (self.decoded.get().saturating_add(more), self.how.limits.elements);
        if sum > most {
            let wanted = format!("at most {most} elements of all accessors that are read");
            return Err(SceneError::input(field, wanted, sum));
        }
        self.decoded.set(sum);
        Ok(())
    }

    /// `count` elements of `size` bytes from byte `offset` of a view.
    fn run(
        &self,
        view: usize,
        offset: u64,
        count: u64,
        size: usize,
        field: &str,
    ) -> Result<Run<'a>, SceneError> {
        let (bytes, stride) = self.buffers.view(view, field)?;
        let stride = stride.unwrap_or(size);
        let end = count
            .checked_sub(1)
            .map_or(Some(0), |last| last.checked_mul(stride as u64)?.checked_add(size as u64))
            .and_then(|length| offset.checked_add(length));
        match end {
            Some(end) if end <= bytes.len() as u64 && stride >= size => {
                Ok(Run { bytes: &bytes[(offset as usize).min(bytes.len())..], stride })
            }
            _ => {
                let found = format!("{count} from byte {offset}, {stride} bytes apart");
                let wanted = format!("elements of {size} bytes within a view of {} bytes", bytes.len());
                Err(SceneError::input(field, wanted, found))
            }
        }
    }

    /// Elements of N numbers.
    ///
    /// Errors: an accessor that is not there, of another kind, beyond its buffer; more elements in sum than the limits allow.
    pub(super) fn numbers<const N: usize>(
        &self,
        index: usize,
        what: &str,
    ) -> Result<Vec<[f32; N]>, SceneError> {
        let field = format!("{what}: accessors[{index}]");
        let wrong = |wanted: String, found: String| SceneError::input(field.clone(), wanted, found);
        let accessor = self.root.accessors.get(index);
        let accessor = accessor.ok_or_else(|| wrong("an accessor that is there".into(), "none".into()))?;
        let (Checked::Valid(kind), Checked::Valid(shape)) = (accessor.component_type, accessor.type_) else {
            return Err(wrong("known kinds of numbers".into(), "others".into()));
        };
        let (kind, count) = (kind.0, accessor.count.0);
        let wanted = [Type::Scalar, Type::Vec2, Type::Vec3, Type::Vec4][N - 1];
        if shape != wanted {
            return Err(wrong(format!("{wanted:?}"), format!("{shape:?}")));
        }
        self.decode(
            count.saturating_add(accessor.sparse.as_ref().map_or(0, |sparse| sparse.count.0)),
            &field,
        )?;
        let element = |bytes: &[u8]| {
            std::array::from_fn(|axis| number(&bytes[axis * size_of(kind)..], kind, accessor.normalized))
        };
        let size = N * size_of(kind);
        let mut values = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                let run = self.run(view.value(), offset, count, size, &field)?;
                (0..count as usize).map(|at| element(&run.bytes[at * run.stride..])).collect()
            }
            // Zeros, some of which a sparse part replaces: a short file may not ask for many.
            None if accessor.sparse.is_some() && count <= MOST_ZEROS => vec![[0.0; N]; count as usize],
            None => {
                let wanted = format!("a bufferView, or a sparse part and at most {MOST_ZEROS} elements");
                return Err(wrong(wanted, format!("{count} elements")));
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let Checked::Valid(IndexComponentType(places)) = sparse.indices.component_type else {
                return Err(wrong("known kinds of numbers in its sparse part".into(), "others".into()));
            };
            let replaced = sparse.count.0;
            let view = sparse.indices.buffer_view.value();
            let at = self.run(view, sparse.indices.byte_offset.0, replaced, size_of(places), &field)?;
            let view = sparse.values.buffer_view.value();
            let new = self.run(view, sparse.values.byte_offset.0, replaced, size, &field)?;
            for k in 0..replaced as usize {
                let place = whole(&at.bytes[k * at.stride..], places) as usize;
                let value = values
                    .get_mut(place)
                    .ok_or_else(|| wrong(format!("sparse indices below {count}"), place.to_string()))?;
                *value = element(&new.bytes[k * new.stride..]);
            }
        }
        Ok(values)
    }

    /// Indices of vertices, each below `vertices`.
    ///
    /// Errors: as [`File::numbers`]; an index of a vertex that is not there.
    pub(super) fn indices(&self, index: usize, vertices: usize, what: &str) -> Result<Vec<u32>, SceneError> {
        let field = format!("{what}: accessors[{index}]");
        let wrong = |wanted: String, found: String| SceneError::input(field.clone(), wanted, found);
        let accessor = self.root.accessors.get(index);
        let accessor = accessor.ok_or_else(|| wrong("an accessor that is there".into(), "none".into()))?;
        let kind = match (accessor.component_type, accessor.type_) {
            (Checked::Valid(kind), Checked::Valid(Type::Scalar))
                if matches!(kind.0, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) =>
            {
                kind.0
            }
            _ => return Err(wrong("whole numbers without a sign, one each".into(), "others".into())),
        };
        let count = accessor.count.0;
        if count > self.how.limits.elements {
            return Err(wrong(format!("at most {} elements", self.how.limits.elements), count.to_string()));
        }
        let (Some(view), None) = (accessor.buffer_view, &accessor.sparse) else {
            return Err(wrong("indices in a view, none of them sparse".into(), "others".into()));
        };
        let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
        let run = self.run(view.value(), offset, count, size_of(kind), &field)?;
        let values: Vec<u32> =
            (0..count as usize).map(|at| whole(&run.bytes[at * run.stride..], kind)).collect();
        match values.iter().find(|value| **value as usize >= vertices) {
            Some(beyond) => Err(wrong(format!("indices below {vertices}"), beyond.to_string())),
            None => Ok(values),
        }
    }
}
