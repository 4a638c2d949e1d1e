//! Depths in the messages of a depth camera.
//!
//! After REP 118, "Depth Images" (2011): `16UC1` is in millimeters with 0 where nothing was measured, `32FC1` in meters with
//! NaN there. Compressed depths are as the package `compressed_depth_image_transport` of ROS 2 writes them.

use schemas::ros2::{Cdr, CdrError, CdrReader, CompressedImage, Header, Image, Message};

use crate::{
    cloud::DEPTH_STEP_M,
    error::Fault,
    object::check_unit,
    png::{GrayImage, checked_size},
    scene_image::SATURATED,
};

/// Unit of depths of 16 bits, in meters (REP 118).
const MILLIMETER_M: f64 = 1e-3;
/// Depths beyond this are none that a camera over a table measures, in meters: programs write some for what is infinitely
/// far.
const MAX_DEPTH_M: f64 = 100.0;
/// Bytes before a compressed image: its form, and two numbers of the compression.
const COMPRESSION_HEADER: usize = 12;
/// What images are expected to be, for messages.
const DEPTHS: &str = "depths of `16UC1` or `32FC1`";

/// The depths of a message.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Depths {
    /// The camera's optical frame.
    pub(crate) frame: String,
    /// Columns and rows.
    pub(crate) size: [usize; 2],
    /// Row by row, in meters; 0 where nothing was measured.
    pub(crate) depth_m: Vec<f64>,
    /// Depth of the number 1 as it is stored, in meters.
    pub(crate) step_m: f64,
}

/// How a depth is a number.
#[derive(Clone, Copy, PartialEq)]
enum Form {
    Millimeters,
    Meters,
}

impl Form {
    fn parse(encoding: &str) -> Option<Self> {
        match encoding {
            "16UC1" | "mono16" => Some(Self::Millimeters),
            "32FC1" => Some(Self::Meters),
            _ => None,
        }
    }
}

/// Returns what the pixels of an image message of this type are called.
///
/// # Errors
///
/// Fails if the bytes are no such message.
pub(crate) fn encoding(message_type: &str, cdr: &[u8]) -> Result<String, CdrError> {
    let mut reader = CdrReader::new(cdr)?;
    Header::decode(&mut reader)?;
    if message_type == Image::TYPE {
        // Its height and width.
        <[u32; 2]>::decode(&mut reader)?;
    }
    String::decode(&mut reader)
}

/// Says whether pixels that are called so in messages of this type are depths.
pub(crate) fn is_depth(message_type: &str, encoding: &str) -> bool {
    match message_type {
        CompressedImage::TYPE => compression(encoding).is_some(),
        _ => Form::parse(encoding).is_some(),
    }
}

/// Reads the depths of an image message of this type; `unit_m` is what a meter of the message is, for cameras whose unit is
/// another.
pub(crate) fn depths(message_type: &str, cdr: &[u8], unit_m: f64) -> Result<Depths, Fault> {
    let (header, (form, size, lengths_m)) = if message_type == CompressedImage::TYPE {
        let image = decoded::<CompressedImage>(cdr)?;
        let pixels = unpacked(&image)?;
        (image.header, pixels)
    } else {
        let image = decoded::<Image>(cdr)?;
        let pixels = rows(&image)?;
        (image.header, pixels)
    };
    let mut depth_m: Vec<f64> = lengths_m.iter().map(|length_m| length_m * unit_m).collect();
    check_unit(depth_m.iter().copied(), "unit_m", unit_m)?;
    for depth_m in &mut depth_m {
        // NaN is within no range either.
        if !(0.0..=MAX_DEPTH_M).contains(depth_m) {
            *depth_m = 0.0;
        }
    }
    let step_m = match form {
        Form::Millimeters => MILLIMETER_M * unit_m,
        Form::Meters => DEPTH_STEP_M,
    };
    Ok(Depths {
        frame: header.frame_id,
        size,
        depth_m,
        step_m,
    })
}

/// Reads a message.
pub(crate) fn decoded<M: Message>(cdr: &[u8]) -> Result<M, Fault> {
    M::from_cdr(cdr).map_err(|err| {
        Fault::new(
            format!("its message is no {} ({err})", M::TYPE),
            "copy the recording again, or record anew",
        )
    })
}

type Pixels = (Form, [usize; 2], Vec<f64>);

/// Reads the pixels of an image, in meters.
fn rows(image: &Image) -> Result<Pixels, Fault> {
    let form = Form::parse(&image.encoding).ok_or_else(|| {
        let found = format!("pixels of `{}`", image.encoding);
        Fault::unsupported(found, DEPTHS)
    })?;
    let size = checked_size([image.width, image.height])?;
    let pixel_bytes = match form {
        Form::Millimeters => 2,
        Form::Meters => 4,
    };
    let row_bytes = size[0] * pixel_bytes;
    let step = image.step as usize;
    if step < row_bytes {
        let problem = format!("`step` is {step}, and a row of the image has {row_bytes} bytes");
        return Err(Fault::new(problem, "correct what publishes the images"));
    }
    // Of the last row the padding may be missing.
    let expected = step.saturating_mul(size[1] - 1).saturating_add(row_bytes);
    if image.data.len() < expected {
        let found = image.data.len();
        let problem = format!("its `data` has {found} bytes, expected {expected}");
        return Err(Fault::new(problem, "correct what publishes the images"));
    }
    let is_big = image.is_bigendian != 0;
    let mut lengths_m = Vec::with_capacity(size[0] * size[1]);
    for row in image.data.chunks(step).take(size[1]) {
        let row = &row[..row_bytes];
        match form {
            Form::Millimeters => lengths_m.extend(row.as_chunks().0.iter().map(|&pixel| {
                millimeters(if is_big {
                    u16::from_be_bytes(pixel)
                } else {
                    u16::from_le_bytes(pixel)
                })
            })),
            Form::Meters => lengths_m.extend(row.as_chunks().0.iter().map(|&pixel| {
                meters(if is_big {
                    f32::from_be_bytes(pixel)
                } else {
                    f32::from_le_bytes(pixel)
                })
            })),
        }
    }
    Ok((form, size, lengths_m))
}

/// Returns a depth in meters, 0 if it is none.
fn millimeters(number: u16) -> f64 {
    match number {
        SATURATED => 0.0,
        number => f64::from(number) * MILLIMETER_M,
    }
}

fn meters(number: f32) -> f64 {
    if number.is_finite() && number > 0.0 {
        f64::from(number)
    } else {
        0.0
    }
}

/// Returns how the depths of a compressed image are numbers, by its format, and the number of bytes before them; `None` if
/// it has no depths.
fn compression(format: &str) -> Option<(Form, usize)> {
    let is_behind_header = format.contains("compressedDepth");
    let Some((encoding, how)) = format.split_once(';') else {
        // Older programs write no encoding.
        return is_behind_header.then_some((Form::Millimeters, COMPRESSION_HEADER));
    };
    let form = Form::parse(encoding.trim())?;
    if is_behind_header {
        return Some((form, COMPRESSION_HEADER));
    }
    // A gray image of 16 bits, as the package `compressed_image_transport` writes it.
    (form == Form::Millimeters && how.contains("png")).then_some((form, 0))
}

/// Reads the pixels of a compressed image, in meters.
fn unpacked(image: &CompressedImage) -> Result<Pixels, Fault> {
    let (form, skipped) = compression(&image.format).ok_or_else(|| {
        let found = format!("images of `{}`", image.format);
        Fault::unsupported(found, "`16UC1; compressedDepth png`")
    })?;
    if image.format.contains("rvl") {
        let hint = "set the publisher's parameter `compressedDepth.format` to `png`";
        return Err(Fault::new("its depths are compressed as RVL", hint));
    }
    let parts = image.data.split_at_checked(skipped);
    let (header, png) = parts.ok_or_else(Fault::cut_off)?;
    let gray = GrayImage::parse(png)?;
    if gray.bits != 16 {
        return Err(Fault::unsupported("numbers of 8 bits", "depths of 16 bits"));
    }
    let values = gray.values.iter();
    let lengths_m = match (form, header) {
        // The numbers are scaled inverse depths, of these parameters.
        (Form::Meters, &[_, _, _, _, a, b, c, d, e, f, g, h]) => {
            let factor = f64::from(f32::from_le_bytes([a, b, c, d]));
            let offset = f64::from(f32::from_le_bytes([e, f, g, h]));
            let length_m = |&value: &u16| match factor / (f64::from(value) - offset) {
                length_m if value > 0 && length_m.is_finite() && length_m > 0.0 => length_m,
                _ => 0.0,
            };
            values.map(length_m).collect()
        }
        _ => values.map(|&value| millimeters(value)).collect(),
    };
    Ok((form, gray.size, lengths_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        fixture::{Png, mutated},
        recording_fixture::{image_16, image_32},
    };

    const MILLIMETERS: [u16; 6] = [500, 0, 700, 65535, 900, 1000];
    const METERS: [f32; 6] = [0.5, f32::NAN, 0.75, f32::INFINITY, -1.0, 1e6];

    fn read<M: Message>(message: &M, unit_m: f64) -> Result<Depths, Fault> {
        depths(M::TYPE, &message.to_cdr(), unit_m)
    }

    fn of_16(change: impl Fn(&mut Image)) -> Result<Depths, Fault> {
        let mut image = image_16([3, 2], &MILLIMETERS);
        change(&mut image);
        read(&image, 1.0)
    }

    fn png(bits: u8) -> Vec<u8> {
        let values = MILLIMETERS.map(|it| if bits == 8 { it & 0xff } else { it });
        Png::of(&GrayImage {
            size: [3, 2],
            bits,
            values: values.to_vec(),
        })
        .bytes()
    }

    fn compressed(format: &str, header: &[u8], png: &[u8]) -> CompressedImage {
        CompressedImage {
            format: format.to_owned(),
            data: [header, png].concat(),
            ..CompressedImage::default()
        }
    }

    #[test]
    fn depths_of_both_widths_and_orders_are_read() {
        let expected = [0.5, 0.0, 0.7, 0.0, 0.9, 1.0];
        let padded = |image: &mut Image| {
            image.data.splice(6..6, [9; 5]);
            image.step = 11;
        };
        let turned = |image: &mut Image| {
            image.is_bigendian = 1;
            for pair in image.data.chunks_mut(2) {
                pair.reverse();
            }
        };
        for found in [
            of_16(|_| ()),
            of_16(|image| "mono16".clone_into(&mut image.encoding)),
            of_16(padded),
            of_16(turned),
        ] {
            let found = found.unwrap();
            assert_eq!((found.size, found.step_m), ([3, 2], 1e-3));
            for (found_m, expected_m) in found.depth_m.iter().zip(expected) {
                assert!((found_m - expected_m).abs() < 1e-12, "{found:?}");
            }
        }
        let mut image = image_32([3, 2], &METERS);
        let expected = [0.5, 0.0, 0.75, 0.0, 0.0, 0.0];
        let found = read(&image, 1.0).unwrap();
        assert_eq!(
            (found.depth_m.as_slice(), found.step_m),
            (&expected[..], 1e-4)
        );
        image.is_bigendian = 1;
        for four in image.data.chunks_mut(4) {
            four.reverse();
        }
        assert_eq!(read(&image, 1.0).unwrap(), found);
        // A camera whose unit is a tenth of a millimeter.
        let tenths = image_16([2, 1], &[5000, 7000]);
        let found = read(&tenths, 0.1).unwrap();
        assert!((found.depth_m[0] - 0.5).abs() < 1e-12 && (found.step_m - 1e-4).abs() < 1e-12);
    }

    #[test]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the numbers are within 16 bits, and the format's parameters are of 32"
    )]
    fn compressed_depths_are_read() {
        let check = |image: &CompressedImage, expected: [f64; 6], tolerance_m: f64| {
            let found = read(image, 1.0).unwrap();
            for (found_m, expected_m) in found.depth_m.iter().zip(expected) {
                assert!((found_m - expected_m).abs() <= tolerance_m, "{found:?}");
            }
        };
        let expected = [0.5, 0.0, 0.7, 0.0, 0.9, 1.0];
        let header = [0; 12];
        for format in [
            "16UC1; compressedDepth png",
            "16UC1; compressedDepth",
            "compressedDepth",
        ] {
            check(&compressed(format, &header, &png(16)), expected, 1e-12);
        }
        check(
            &compressed("16UC1; png compressed ", &[], &png(16)),
            expected,
            1e-12,
        );
        // As the transport quantizes depths up to 10 m, with the parameter 100.
        let (factor, offset) = (100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0);
        let header = [
            [0; 4],
            (factor as f32).to_le_bytes(),
            (offset as f32).to_le_bytes(),
        ];
        let inverse = expected.map(|depth_m| match depth_m {
            0.0 => 0,
            depth_m => (factor / depth_m + offset) as u16,
        });
        let png = Png::of(&GrayImage {
            size: [3, 2],
            bits: 16,
            values: inverse.to_vec(),
        });
        let image = compressed("32FC1; compressedDepth png", &header.concat(), &png.bytes());
        check(&image, expected, 2e-4);
    }

    #[test]
    fn says_what_is_wrong_with_other_images() {
        let check = |change: fn(&mut Image), expected: &str| {
            let said = of_16(change).unwrap_err().reason();
            assert!(said.contains(expected), "{expected}: {said}");
        };
        check(
            |it| "rgb8".clone_into(&mut it.encoding),
            "has pixels of `rgb8`, expected depths",
        );
        check(
            |it| "8UC1".clone_into(&mut it.encoding),
            "has pixels of `8UC1`",
        );
        check(|it| it.width = 0, "has 0 by 2 pixels");
        check(
            |it| it.height = u32::MAX,
            "pixels, expected up to 4096 by 4096",
        );
        check(
            |it| it.step = 5,
            "`step` is 5, and a row of the image has 6 bytes",
        );
        check(|it| it.step = u32::MAX, "`data` has 12 bytes, expected");
        check(
            |it| it.data.truncate(it.data.len() - 1),
            "`data` has 11 bytes, expected 12",
        );
        check(|it| it.data.fill(0), "no pixel has a depth");
        let far = image_16([2, 1], &[50_000, 60_000]);
        let said = read(&far, 1.0).unwrap_err().reason();
        assert!(
            said.ends_with("`unit_m` of 0.01 would be plausible"),
            "{said}"
        );
        let in_millimeters = image_32([2, 1], &[500.0, 600.0]);
        let said = read(&in_millimeters, 1.0).unwrap_err().reason();
        assert!(
            said.ends_with("`unit_m` of 0.001 would be plausible"),
            "{said}"
        );
        let check = |format: &str, header: &[u8], png: &[u8], expected: &str| {
            let said = read(&compressed(format, header, png), 1.0).unwrap_err();
            assert!(said.reason().contains(expected), "{expected}: {said}");
        };
        let [depths, header] = ["16UC1; compressedDepth png", "            "];
        let header = header.as_bytes();
        check(
            "bgr8; jpeg compressed bgr8",
            &[],
            &png(16),
            "images of `bgr8; jpeg compressed bgr8`",
        );
        check("png", &[], &png(16), "has images of `png`");
        check(
            "16UC1; compressedDepth rvl",
            header,
            &[],
            "as RVL; set the publisher's parameter",
        );
        check(depths, &header[..11], &[], "ends early");
        check(depths, &[], &png(16), "has no PNG signature");
        check(depths, header, &png(16)[..60], "ends early");
        check(depths, header, &png(8), "has numbers of 8 bits");
        let said = depths_of_bytes(&[0, 3, 0, 0]);
        assert!(
            said.contains("no sensor_msgs/msg/Image (encapsulation"),
            "{said}"
        );
    }

    fn depths_of_bytes(cdr: &[u8]) -> String {
        depths(Image::TYPE, cdr, 1.0).unwrap_err().to_string()
    }

    #[test]
    fn no_byte_of_a_message_makes_it_panic() {
        let image = image_16([3, 2], &MILLIMETERS).to_cdr();
        let packed = compressed("32FC1; compressedDepth png", &[1; 12], &png(16)).to_cdr();
        for bytes in mutated(&image, 4000) {
            let _ = encoding(Image::TYPE, &bytes);
            if let Ok(depths) = depths(Image::TYPE, &bytes, 1.0) {
                assert!(depths.depth_m.len() <= bytes.len());
            }
        }
        for bytes in mutated(&packed, 4000) {
            let _ = encoding(CompressedImage::TYPE, &bytes);
            let _ = depths(CompressedImage::TYPE, &bytes, 1.0);
        }
    }
}
