//! What kind of file some bytes start: for messages that say what was handed in, by its magic number.

use crate::container::MAGIC;

/// Bytes from a file's start that [`kind_of`] looks at, at most.
pub const LOOKED_AT: usize = 512;

/// Magic numbers, and what each starts.
const MAGIC_NUMBERS: [(&[u8], &str); 38] = [
    (&MAGIC, "a .squall asset"),
    (b"\x20BDV\0\0\0\0", "an OpenVDB file"),
    (b"NanoVDB", "a NanoVDB file"),
    (b"\x93NUMPY", "a NumPy array (.npy)"),
    (b"\x89PNG\r\n\x1a\n", "a PNG picture"),
    (b"\x76\x2f\x31\x01", "an OpenEXR picture"),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file (also Field3D, NetCDF 4 and MATLAB 7.3)"),
    (b"CDF\x01", "a NetCDF file"),
    (b"CDF\x02", "a NetCDF file"),
    (b"CDF\x05", "a NetCDF file"),
    (b"PK\x03\x04", "a zip archive (also .npz and .usdz)"),
    (b"PK\x05\x06", "an empty zip archive"),
    (b"\x1f\x8b", "a gzip file"),
    (b"\x28\xb5\x2f\xfd", "a Zstandard file"),
    (b"\xfd7zXZ\0", "an xz file"),
    (b"BZh", "a bzip2 file"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"GIF8", "a GIF picture"),
    (b"II*\0", "a TIFF picture"),
    (b"MM\0*", "a TIFF picture"),
    (b"#?RADIANCE", "a Radiance HDR picture"),
    (b"#?RGBE", "a Radiance HDR picture"),
    (b"DDS ", "a DDS texture"),
    (b"\xabKTX", "a KTX texture"),
    (b"VOL\x03", "a Mitsuba volume (.vol)"),
    (b"# vtk DataFile", "a VTK file"),
    (b"BLENDER", "a Blender file"),
    (b"PXR-USDC", "a USD file"),
    (b"#usda", "a USD file"),
    (b"glTF", "a glTF file"),
    (b"ply\n", "a PLY file"),
    (b"%PDF", "a PDF document"),
    (b"\x7fELF", "a program"),
    (b"version https://git-lfs", "a Git LFS pointer, in place of the file itself (git lfs pull)"),
    (b"GRIB", "a GRIB file"),
    (b"\xff\xfe", "UTF-16 text"),
    (b"\xfe\xff", "UTF-16 text"),
];

/// What the first bytes of a file say that it is, with its article, such as "an OpenVDB file"; `None` where they say nothing.
///
/// Looks at [`LOOKED_AT`] bytes at most. Text is told apart by how it begins: JSON, TOML, XML or other text.
pub fn kind_of(start: &[u8]) -> Option<&'static str> {
    if start.is_empty() {
        return Some("an empty file");
    }
    if let Some((_, kind)) = MAGIC_NUMBERS.iter().find(|(magic, _)| start.starts_with(magic)) {
        return Some(kind);
    }
    match start {
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => return Some("a WebP picture"),
        _ if start.get(257..262) == Some(b"ustar") => return Some("a tar archive"),
        _ => {}
    }
    text_kind(&start[..start.len().min(LOOKED_AT)])
}

/// What kind of text bytes are; `None` for bytes that are none.
fn text_kind(start: &[u8]) -> Option<&'static str> {
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    let text = match std::str::from_utf8(start) {
        Ok(text) => text,
        // The last character may be cut.
        Err(error) if error.error_len().is_none() => {
            std::str::from_utf8(&start[..error.valid_up_to()]).ok()?
        }
        Err(_) => return None,
    };
    if text.chars().any(|c| c.is_control() && !c.is_ascii_whitespace()) {
        return None;
    }
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let first = lines.into_iter().next().unwrap_or_default();
    let is_key = |text: &str| {
        let text = text.trim().trim_matches('"');
        !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || "_-.\"".contains(c))
    };
    let table = || {
        first
            .trim_start_matches('[')
            .split_once(']')
            .is_some_and(|(name, _)| is_key(name) && !is_number(name))
    };
    Some(match first {
        _ if first.starts_with('<') => "XML or HTML text",
        _ if first.starts_with('{') => "JSON text",
        _ if first.starts_with('[') && table() => "TOML text",
        _ if first.starts_with('[') => "JSON text",
        _ if first.split_once('=').is_some_and(|(key, _)| is_key(key)) => "TOML text",
        _ => "text",
    })
}

fn is_number(text: &str) -> bool {
    text.split(',').all(|part| part.trim().parse::<f64>().is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_people_hand_in_are_named() {
        for (start, kind) in [
            (&b"\x20BDV\0\0\0\0\xe0\0\0\0"[..], "OpenVDB"),
            (b"\x93NUMPY\x01\0v\0{'descr'", "NumPy"),
            (b"\x89PNG\r\n\x1a\n\0\0", "PNG"),
            (b"\x76\x2f\x31\x01\x02\0\0\0", "OpenEXR"),
            (b"PK\x03\x04\x14\0", "zip"),
            (b"\x1f\x8b\x08\0", "gzip"),
            (b"RIFF\x24\0\0\0WEBPVP8 ", "WebP"),
            (b"\x89SQUALL\n\x01\0", ".squall"),
            (b"{\"dims_xyz\": [1, 2, 3]}", "JSON"),
            (b"\xef\xbb\xbf { }", "JSON"),
            (b"[{\"position_m\": [0, 0, 1]}]", "JSON"),
            (b"[[1, 2], [3, 4]]", "JSON"),
            (b"[1, 2]", "JSON"),
            (b"# a recipe\n\n[clouds]\nscene = \"a\"", "TOML"),
            (b"[[strokes]]\nname = \"a\"", "TOML"),
            (b"seed = 3\n", "TOML"),
            (b"<?xml version=\"1.0\"?>", "XML"),
            (b"once upon a time", "text"),
            (b"", "empty"),
        ] {
            let found = kind_of(start).unwrap();
            assert!(found.contains(kind), "{found} for {kind}");
        }
        assert_eq!(kind_of(&[0, 0, 128, 63, 0, 0, 0, 64]), None);
        // A character cut by the end of what is looked at is text all the same.
        assert_eq!(kind_of("grün".as_bytes().split_at(3).0), Some("text"));
    }
}
