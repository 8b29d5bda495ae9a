//! Whether a file is a WebAssembly module from its first byte to its last: its head, and the lengths of its sections.

/// How every WebAssembly module begins: its magic number and version 1.
const HEAD: &[u8] = b"\0asm\x01\0\0\0";

/// What is wrong with a module's bytes; nothing where its sections fill it to its end. What stands in them is the browser's to check.
pub fn fault(bytes: &[u8]) -> Option<String> {
    let Some(mut rest) = bytes.strip_prefix(HEAD) else {
        return Some(format!("{} bytes of something else", bytes.len()));
    };
    while let Some((_, behind)) = rest.split_first() {
        let section = length(behind).and_then(|(length, content)| content.get(length..));
        match section {
            Some(next) => rest = next,
            None => {
                let at = bytes.len() - rest.len();
                return Some(format!("{} bytes, cut off in the section at byte {at}", bytes.len()));
            }
        }
    }
    None
}

/// A LEB128 number of 32 bits, and what stands behind it.
fn length(bytes: &[u8]) -> Option<(usize, &[u8])> {
    /// Groups of 7 bits in 32.
    const MOST_BYTES: usize = 5;
    let mut value = 0u64;
    for (at, byte) in bytes.iter().take(MOST_BYTES).enumerate() {
        value |= u64::from(byte & 0x7f) << (7 * at);
        if byte & 0x80 == 0 {
            let value = u32::try_from(value).ok()?;
            return Some((usize::try_from(value).ok()?, &bytes[at + 1..]));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_module_cut_at_any_byte_but_between_sections_is_refused() {
        // A custom section of 3 bytes, and one of 200, whose length takes two bytes.
        let mut whole = HEAD.to_vec();
        whole.extend([0, 3, 1, b'a', 7]);
        let between = whole.len();
        whole.extend([0, 0xc8, 0x01]);
        whole.extend([0; 200]);
        assert_eq!(fault(&whole), None);
        for end in 0..whole.len() {
            assert_eq!(fault(&whole[..end]).is_none(), [HEAD.len(), between].contains(&end), "{end}");
        }
        assert!(fault(&[HEAD, &[0, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff]].concat()).is_some());
        assert!(fault(&[HEAD, &[0, 0xff, 0xff, 0xff, 0xff, 0x7f]].concat()).is_some(), "more than 32 bits");
    }
}
