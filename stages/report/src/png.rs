//! Images of a few colors as PNG files.
//!
//! After the "Portable Network Graphics Specification, Third Edition" (W3C, 2025): a palette, transparency, one byte for
//! each pixel, and rows without a filter, which is best for palettes (§12.7).

use std::io::Write;

use flate2::{Compression, Crc, write::ZlibEncoder};

use crate::ReportError;

/// How a file begins (§5.2).
const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Of a header (§11.2.1): 8 bits, colors of a palette, the one compression, the one set of filters, not interlaced.
const FORM: [u8; 5] = [8, 3, 0, 0, 0];

/// An image of at most 256 colors.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct PaletteImage {
    /// Pixels of a row, and number of rows.
    pub(crate) size: [u32; 2],
    /// Red, green, blue and opacity of each color.
    pub(crate) colors: Vec<[u8; 4]>,
    /// The color of each pixel by its place in `colors`, row by row.
    pub(crate) pixels: Vec<u8>,
}

impl PaletteImage {
    /// Writes the image as a PNG file.
    ///
    /// # Errors
    ///
    /// Fails if it cannot be compressed.
    pub(crate) fn to_png(&self) -> Result<Vec<u8>, ReportError> {
        let [width, height] = self.size.map(u32::to_be_bytes);
        let palette: Vec<[u8; 3]> = self
            .colors
            .iter()
            .map(|[r, g, b, _]| [*r, *g, *b])
            .collect();
        let opacity: Vec<u8> = self.colors.iter().map(|color| color[3]).collect();
        let mut compressed = ZlibEncoder::new(Vec::new(), Compression::best());
        let row_length = usize::try_from(self.size[0]).unwrap_or(usize::MAX).max(1);
        for row in self.pixels.chunks(row_length) {
            // The number of its filter: none.
            compressed.write_all(&[0]).map_err(ReportError::Compress)?;
            compressed.write_all(row).map_err(ReportError::Compress)?;
        }
        let compressed = compressed.finish().map_err(ReportError::Compress)?;
        let mut bytes = SIGNATURE.to_vec();
        let header = [&width[..], &height, &FORM].concat();
        for (kind, data) in [
            (b"IHDR", &header[..]),
            (b"PLTE", palette.as_flattened()),
            (b"tRNS", &opacity),
            (b"IDAT", &compressed),
            (b"IEND", &[]),
        ] {
            add_chunk(&mut bytes, *kind, data);
        }
        Ok(bytes)
    }
}

/// Adds a chunk: length, type, data and checksum (§5.3).
fn add_chunk(bytes: &mut Vec<u8>, kind: [u8; 4], data: &[u8]) {
    let mut checksum = Crc::new();
    checksum.update(&kind);
    checksum.update(data);
    let length = u32::try_from(data.len()).unwrap_or(u32::MAX);
    bytes.extend(length.to_be_bytes());
    bytes.extend(kind);
    bytes.extend(data);
    bytes.extend(checksum.sum().to_be_bytes());
}

#[cfg(test)]
pub(crate) mod tests {
    use std::io::Read;

    use flate2::read::ZlibDecoder;

    use super::*;

    /// Reads what [`PaletteImage::to_png`] writes, with its own checksum.
    pub(crate) fn parsed(png: &[u8]) -> PaletteImage {
        let mut rest = png.strip_prefix(SIGNATURE).unwrap();
        let mut image = PaletteImage {
            size: [0; 2],
            colors: Vec::new(),
            pixels: Vec::new(),
        };
        let mut kinds = Vec::new();
        while !rest.is_empty() {
            let number = |at: usize| u32::from_be_bytes(rest[at..at + 4].try_into().unwrap());
            let length = number(0) as usize;
            let (kind, data) = (&rest[4..8], &rest[8..8 + length]);
            assert_eq!(number(8 + length), crc(&rest[4..8 + length]), "{kind:?}");
            match kind {
                b"IHDR" => {
                    image.size = [number(8), number(12)];
                    assert_eq!(data[8..], FORM);
                }
                b"PLTE" => {
                    let (colors, rest) = data.as_chunks::<3>();
                    assert!(rest.is_empty());
                    image.colors = colors.iter().map(|&[r, g, b]| [r, g, b, 255]).collect();
                }
                b"tRNS" => {
                    for (color, &opacity) in image.colors.iter_mut().zip(data) {
                        color[3] = opacity;
                    }
                }
                b"IDAT" => {
                    let mut rows = Vec::new();
                    ZlibDecoder::new(data).read_to_end(&mut rows).unwrap();
                    for row in rows.chunks(image.size[0] as usize + 1) {
                        assert_eq!(row[0], 0);
                        image.pixels.extend(&row[1..]);
                    }
                }
                b"IEND" => assert!(data.is_empty()),
                other => panic!("{other:?}"),
            }
            kinds.push(kind.to_vec());
            rest = &rest[12 + length..];
        }
        assert_eq!(kinds.concat(), b"IHDRPLTEtRNSIDATIEND");
        let pixels_n = image.size[0] * image.size[1];
        assert_eq!(image.pixels.len(), pixels_n as usize);
        image
    }

    /// The checksum of a chunk bit by bit (§5.5).
    fn crc(bytes: &[u8]) -> u32 {
        let mut sum = u32::MAX;
        for &byte in bytes {
            sum ^= u32::from(byte);
            for _ in 0..8 {
                sum = (sum >> 1) ^ if sum & 1 == 1 { 0xedb8_8320 } else { 0 };
            }
        }
        !sum
    }

    #[test]
    fn an_image_is_read_back() {
        let image = PaletteImage {
            size: [7, 5],
            colors: vec![[0; 4], [255, 128, 0, 255], [3, 2, 1, 90]],
            pixels: (0..35).map(|k| k % 3).collect(),
        };
        assert_eq!(parsed(&image.to_png().unwrap()), image);
        // The checksum of an empty IEND, as it ends every PNG file.
        assert_eq!(crc(b"IEND"), 0xae42_6082);
    }
}
