//! Gray images of a PNG file.
//!
//! After the "Portable Network Graphics Specification, Third Edition" (W3C, 2025): gray of 8 or 16 bits, which is what
//! masks and depths have. The checksum of the compressed data finds damage; those of the chunks are passed over.

use flate2::{Decompress, FlushDecompress, Status};

use crate::error::Fault;

/// How a file begins (§5.2).
const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Most pixels along a side, and in all.
const MAX_SIDE: usize = 1 << 13;
const MAX_PIXELS: usize = 1 << 24;
/// Most bytes that a byte of compressed data stands for (zlib's technical details: 1032 to 1), rounded up.
const MAX_RATIO: usize = 1040;
/// What images are expected to be, for messages.
const GRAY: &str = "gray of 8 or 16 bits, not interlaced";

/// A gray image.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GrayImage {
    /// Pixels of a row, and number of rows.
    pub(crate) size: [usize; 2],
    /// Bits of a number: 8 or 16.
    pub(crate) bits: u8,
    /// The numbers row by row.
    pub(crate) values: Vec<u16>,
}

impl GrayImage {
    /// Reads the bytes of a file.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, Fault> {
        let mut rest = bytes
            .strip_prefix(SIGNATURE)
            .ok_or_else(|| Fault::unsupported("no PNG signature", "a PNG image"))?;
        let (kind, header) = chunk(&mut rest)?;
        if kind != b"IHDR" {
            return Err(Fault::damaged("its first chunk is no header"));
        }
        let (size, bits) = parse_header(header)?;
        let mut compressed = Vec::new();
        loop {
            match chunk(&mut rest)? {
                (b"IDAT", data) => compressed.extend_from_slice(data),
                (b"IEND", _) => break,
                _ => {}
            }
        }
        let [width, height] = size;
        let row_bytes = width * usize::from(bits) / 8;
        // Each row begins with the number of its filter.
        let mut rows = inflated(&compressed, height * (row_bytes + 1))?;
        let mut values = Vec::with_capacity(width * height);
        let mut above = vec![0; row_bytes];
        for row in rows.chunks_exact_mut(row_bytes + 1) {
            let (filter, row) = row.split_first_mut().ok_or_else(Fault::cut_off)?;
            unfilter(*filter, usize::from(bits) / 8, &above, row)?;
            if bits == 8 {
                values.extend(row.iter().map(|&value| u16::from(value)));
            } else {
                let (pairs, _) = row.as_chunks::<2>();
                values.extend(pairs.iter().map(|&pair| u16::from_be_bytes(pair)));
            }
            above.copy_from_slice(row);
        }
        Ok(Self { size, bits, values })
    }
}

/// Takes the next chunk: its type and its data (§5.3).
fn chunk<'a>(rest: &mut &'a [u8]) -> Result<(&'a [u8], &'a [u8]), Fault> {
    let parts = || {
        let (length, after) = rest.split_first_chunk::<4>()?;
        let (kind, after) = after.split_at_checked(4)?;
        let length = usize::try_from(u32::from_be_bytes(*length)).ok()?;
        let (data, after) = after.split_at_checked(length)?;
        let (_checksum, after) = after.split_at_checked(4)?;
        Some((kind, data, after))
    };
    let (kind, data, after) = parts().ok_or_else(Fault::cut_off)?;
    *rest = after;
    Ok((kind, data))
}

/// Reads the size and the number of bits from a header (§11.2.1).
fn parse_header(header: &[u8]) -> Result<([usize; 2], u8), Fault> {
    let damaged = || Fault::damaged("its header");
    let (width, rest) = header.split_first_chunk().ok_or_else(damaged)?;
    let (height, rest) = rest.split_first_chunk().ok_or_else(damaged)?;
    let &[bits, color, 0, 0, interlaced] = rest else {
        return Err(damaged());
    };
    let size = checked_size([width, height].map(|&bytes| u32::from_be_bytes(bytes)))?;
    match (color, bits, interlaced) {
        (0, 8 | 16, 0) => Ok((size, bits)),
        (0, 8 | 16, _) => Err(Fault::unsupported("interlaced rows", GRAY)),
        (0, ..) => Err(Fault::unsupported(format!("numbers of {bits} bits"), GRAY)),
        (2 | 3 | 6, ..) => Err(Fault::unsupported("colors", GRAY)),
        (4, ..) => Err(Fault::unsupported("transparency", GRAY)),
        _ => Err(damaged()),
    }
}

/// Checks that an image of this many columns and rows is none of excessive size.
pub(crate) fn checked_size(size: [u32; 2]) -> Result<[usize; 2], Fault> {
    let size = size.map(|side| usize::try_from(side).unwrap_or(usize::MAX));
    let within = size.map(|side| (1..=MAX_SIDE).contains(&side));
    if within != [true; 2] || size[0] * size[1] > MAX_PIXELS {
        let found = format!("{} by {} pixels", size[0], size[1]);
        return Err(Fault::unsupported(found, "up to 4096 by 4096"));
    }
    Ok(size)
}

/// Inflates data that must have this many bytes.
fn inflated(compressed: &[u8], expected: usize) -> Result<Vec<u8>, Fault> {
    if compressed.len().saturating_mul(MAX_RATIO) < expected {
        return Err(Fault::cut_off());
    }
    // One byte more shows what is too long.
    let mut bytes = vec![0; expected + 1];
    let mut inflater = Decompress::new(true);
    let status = inflater.decompress(compressed, &mut bytes, FlushDecompress::Finish);
    let found = usize::try_from(inflater.total_out()).unwrap_or(usize::MAX);
    bytes.truncate(expected);
    match status {
        Ok(Status::StreamEnd) if found == expected => Ok(bytes),
        Ok(Status::Ok | Status::BufError) if found <= expected => Err(Fault::cut_off()),
        Ok(_) => Err(Fault::damaged("its rows have another size")),
        Err(_) => Err(Fault::damaged("its compressed data")),
    }
}

/// Undoes a row's filter (§9.2); `step` is how many bytes a pixel has.
fn unfilter(filter: u8, step: usize, above: &[u8], row: &mut [u8]) -> Result<(), Fault> {
    if filter > 4 {
        return Err(Fault::damaged("a row's filter is none"));
    }
    for idx in 0..row.len() {
        let before = idx.checked_sub(step);
        let a = before.map_or(0, |before| row[before]);
        let b = above[idx];
        let c = before.map_or(0, |before| above[before]);
        let predicted = match filter {
            0 => 0,
            1 => a,
            2 => b,
            3 => a.midpoint(b),
            _ => paeth(a, b, c),
        };
        row[idx] = row[idx].wrapping_add(predicted);
    }
    Ok(())
}

/// Returns that of the pixels on the left, above, and above on the left which is nearest to a + b − c (§9.4).
fn paeth(a: u8, b: u8, c: u8) -> u8 {
    let [left, up, corner] = [a, b, c].map(i16::from);
    let [pa, pb, pc] = [up - corner, left - corner, left + up - 2 * corner].map(i16::abs);
    if pa <= pb && pa <= pc {
        a
    } else if pb <= pc {
        b
    } else {
        c
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{Png, mutated};

    fn image(bits: u8) -> GrayImage {
        let values = (0..35).map(|k: u16| (k * 1777) % if bits == 8 { 256 } else { 9999 });
        GrayImage {
            size: [7, 5],
            bits,
            values: values.collect(),
        }
    }

    #[test]
    fn every_filter_and_depth_is_read() {
        for bits in [8, 16] {
            for filter in 0..5 {
                let bytes = Png::of(&image(bits)).filtered(filter).bytes();
                assert_eq!(GrayImage::parse(&bytes).unwrap(), image(bits), "{filter}");
            }
        }
        let mut split = Png::of(&image(16));
        split.data_parts = 3;
        assert_eq!(GrayImage::parse(&split.bytes()).unwrap(), image(16));
    }

    #[test]
    fn says_what_is_wrong_with_other_files() {
        let check = |bytes: &[u8], expected: &str| {
            let said = GrayImage::parse(bytes).unwrap_err().to_string();
            assert!(said.contains(expected), "{expected}: {said}");
        };
        let whole = Png::of(&image(16)).bytes();
        check(b"", "no PNG signature");
        check(b"\xff\xd8\xff\xe0 JFIF", "no PNG signature");
        for end in [8, 20, 40, whole.len() - 13, whole.len() - 1] {
            check(&whole[..end], "ends early");
        }
        let with = |change: &dyn Fn(&mut Png)| {
            let mut png = Png::of(&image(16));
            change(&mut png);
            png.bytes()
        };
        check(&with(&|png| png.header[9] = 2), "has colors");
        check(&with(&|png| png.header[9] = 3), "has colors");
        check(&with(&|png| png.header[9] = 4), "has transparency");
        check(&with(&|png| png.header[9] = 6), "has colors");
        check(&with(&|png| png.header[9] = 9), "its header");
        check(&with(&|png| png.header[8] = 1), "numbers of 1 bits");
        check(&with(&|png| png.header[12] = 1), "interlaced");
        check(&with(&|png| png.header[10] = 1), "its header");
        check(&with(&|png| png.header[3] = 0), "0 by 5 pixels");
        check(&with(&|png| png.header[0] = 255), "by 5 pixels");
        check(&with(&|png| png.header[7] = 4), "another size");
        check(&with(&|png| png.header[7] = 6), "another size");
        check(
            &with(&|png| (png.header[2], png.header[6]) = (31, 8)),
            "ends early",
        );
        check(&with(&|png| png.header.truncate(12)), "its header");
        check(&with(&|png| png.rows[0] = 9), "filter");
        check(&with(&|png| png.rows.truncate(20)), "another size");
        check(&with(&|png| png.data_parts = 0), "ends early");
        let mut damaged = whole.clone();
        let at = whole.len() - 30;
        damaged[at] ^= 0x40;
        check(&damaged, "is damaged");
    }

    #[test]
    fn no_byte_of_a_file_makes_it_panic() {
        for bits in [8, 16] {
            for bytes in mutated(&Png::of(&image(bits)).filtered(4).bytes(), 3000) {
                if let Ok(image) = GrayImage::parse(&bytes) {
                    assert_eq!(image.values.len(), image.size[0] * image.size[1]);
                }
            }
        }
    }
}
