//! What grids a file has, and where the parts of each lie.

use super::bytes::Bytes;
use super::codec::Compression;
use super::transform::Transform;
use super::tree::Value;
use super::{Read, Refusal};

/// A file's first eight bytes.
pub(super) const MAGIC: [u8; 8] = *b"\x20BDV\0\0\0\0";
/// File versions that are read: from masks within nodes on.
const VERSIONS: std::ops::RangeInclusive<u32> = 222..=224;
/// Grids beyond this are none that a person made.
const MOST_GRIDS: i32 = 1 << 16;
/// What stands between a name that several grids have and its number.
const NUMBER_MARK: char = '\u{1e}';

/// One grid, as the file's list has it.
pub(super) struct Listed {
    unique_name: String,
    type_name: String,
    parent: String,
    grid_at: u64,
    leaves_at: u64,
    /// What its values are, of types that are read.
    pub value: Value,
    known: bool,
}

impl Listed {
    fn read(at: &mut Bytes<'_>) -> Read<Self> {
        let unique_name = at.text()?;
        let type_name = at.text()?;
        let parent = at.text()?;
        let [grid_at, leaves_at, _end] = [at.i64()?, at.i64()?, at.i64()?].map(|place| place as u64);
        let value = Value::named(&type_name);
        let known = value.is_some();
        Ok(Self {
            unique_name,
            type_name,
            parent,
            grid_at,
            leaves_at,
            value: value.unwrap_or(Value::F32),
            known,
        })
    }

    fn name(&self) -> &str {
        self.unique_name.split(NUMBER_MARK).next().unwrap_or("")
    }

    pub fn shown_name(&self) -> String {
        format!("\"{}\"", self.name())
    }

    fn shown(&self) -> String {
        format!("\"{}\" ({})", self.name(), self.type_name)
    }
}

/// The file's list of grids.
pub(super) struct Grids(Vec<Listed>);

impl Grids {
    pub fn read(bytes: &[u8]) -> Read<Self> {
        let mut at = Bytes::new(bytes, 0)?;
        if at.take(MAGIC.len())? != MAGIC {
            return Err(Refusal::new("magic number", "that of OpenVDB", "another"));
        }
        let version = at.u32()?;
        if !VERSIONS.contains(&version) {
            return Err(Refusal::new("file version", "222, 223 or 224 (OpenVDB 2 and later)", version));
        }
        let _library = [at.u32()?, at.u32()?];
        if at.u8()? == 0 {
            return Err(Refusal::new(
                "grid offsets",
                "a file with a list of where its grids lie",
                "a stream without",
            ));
        }
        let _unique = at.take(36)?;
        skip_metadata(&mut at, &mut |_, _, _| {})?;
        let count = at.i32()?;
        if !(1..=MOST_GRIDS).contains(&count) {
            return Err(Refusal::new("grids", "1 to 65536", count));
        }
        let mut grids = Vec::new();
        for _ in 0..count {
            let listed = Listed::read(&mut at)?;
            // A grid's own part follows its entry; the next entry stands behind it.
            let end = end_of(bytes, &at)?;
            grids.push(listed);
            at = Bytes::new(bytes, end)?;
        }
        Ok(Self(grids))
    }

    /// The grid called `name`; without a name, the only one that can be read, or the one called "density".
    pub fn choose(&self, name: Option<&str>) -> Read<&Listed> {
        let all = || self.0.iter().map(Listed::shown).collect::<Vec<_>>().join(", ");
        let readable: Vec<&Listed> = self.0.iter().filter(|grid| grid.known).collect();
        let chosen = match name {
            Some(name) => self.0.iter().find(|grid| grid.name() == name || grid.unique_name == name),
            None => match readable.as_slice() {
                [only] => Some(*only),
                several => several.iter().copied().find(|grid| grid.name() == "density"),
            },
        };
        let Some(chosen) = chosen else {
            let wanted = match name {
                Some(name) => format!("a grid called \"{name}\""),
                None if readable.is_empty() => "a grid of float, double or half values".into(),
                None => "a grid called \"density\", or a name: key grid".into(),
            };
            return Err(Refusal::new("grid", wanted, all()));
        };
        if !chosen.known {
            let wanted = "a tree of 5, 4 and 3 levels with float, double or half values";
            return Err(Refusal::new("grid", wanted, chosen.shown()));
        }
        Ok(chosen)
    }

    /// The grid whose voxels `grid` shares, if it is an instance.
    pub fn parent_of(&self, grid: &Listed) -> Read<Option<&Listed>> {
        if grid.parent.is_empty() {
            return Ok(None);
        }
        let parent = self.0.iter().find(|other| other.unique_name == grid.parent && other.parent.is_empty());
        let Some(parent) = parent.filter(|parent| parent.known) else {
            return Err(Refusal::new(
                "instance",
                "a grid that holds its voxels",
                format!("\"{}\"", grid.parent),
            ));
        };
        Ok(Some(parent))
    }
}

/// Where a listed grid ends: the last of the three places just read.
fn end_of(bytes: &[u8], at: &Bytes<'_>) -> Read<u64> {
    let mut back = Bytes::new(bytes, at.position() - 8)?;
    let end = back.i64()?;
    // Each grid lies behind its entry: a list that points back would never end.
    let forward = u64::try_from(end).ok().filter(|&end| end >= at.position());
    forward.ok_or_else(|| Refusal::new("grid's end", format!("{} or more", at.position()), end))
}

/// What stands before a grid's tree.
pub(super) struct GridHeader {
    pub compression: Compression,
    pub transform: Transform,
    pub tree_at: u64,
    pub leaves_at: u64,
    class: Option<String>,
}

impl GridHeader {
    pub fn read(bytes: &[u8], listed: &Listed) -> Read<Self> {
        let mut at = Bytes::new(bytes, listed.grid_at)?;
        let compression = Compression::read(&mut at)?;
        let mut class = None;
        skip_metadata(&mut at, &mut |name, type_name, value| {
            if (name, type_name) == ("class", "string") {
                class = Some(String::from_utf8_lossy(value).into_owned());
            }
        })?;
        let transform = Transform::read(&mut at)?;
        Ok(Self { compression, transform, tree_at: at.position(), leaves_at: listed.leaves_at, class })
    }

    /// A level set holds distances, which no extinction is.
    pub fn refuse_level_sets(&self, name: &str) -> Read<()> {
        match self.class.as_deref() {
            Some("level set") => Err(Refusal::new(
                "class",
                "a fog volume",
                format!("{name} is a level set, which holds distances"),
            )),
            _ => Ok(()),
        }
    }
}

fn skip_metadata(at: &mut Bytes<'_>, each: &mut dyn FnMut(&str, &str, &[u8])) -> Read<()> {
    let count = at.u32()?;
    for _ in 0..count {
        let (name, type_name) = (at.text()?, at.text()?);
        let size = at.u32()? as usize;
        each(&name, &type_name, at.take(size)?);
    }
    Ok(())
}
