//! Points of a `.npy` file, after `numpy.lib.format`, versions 1.0 to 3.0.
//!
//! The crate `npyz` reserves as much memory as a header says, and reads a header of any depth by recursion: neither is for
//! files of others. The headers that are accepted here are those of numbers in three columns.

use crate::error::Fault;

/// Longest accepted header, in bytes: `numpy` writes 118.
const MAX_HEADER_BYTES: usize = 4096;
/// What an array is expected to be, for messages.
const EXPECTED: &str = "an array of shape (n, 3) and type f4 or f8";

/// Returns the rows of an array of three columns.
pub(crate) fn points(bytes: &[u8]) -> Result<Vec<[f64; 3]>, Fault> {
    let damaged = || Fault::damaged("its header");
    let rest = bytes.strip_prefix(b"\x93NUMPY");
    let rest = rest.ok_or_else(|| Fault::unsupported("no NPY signature", EXPECTED))?;
    let (length, rest) = match rest {
        [1, 0, a, b, rest @ ..] => (u32::from(u16::from_le_bytes([*a, *b])), rest),
        [2 | 3, 0, a, b, c, d, rest @ ..] => (u32::from_le_bytes([*a, *b, *c, *d]), rest),
        _ => return Err(damaged()),
    };
    let length = usize::try_from(length).ok();
    let length = length.filter(|&length| length <= MAX_HEADER_BYTES);
    let (text, data) = rest
        .split_at_checked(length.ok_or_else(damaged)?)
        .ok_or_else(Fault::cut_off)?;
    let text = String::from_utf8_lossy(text);
    let after = |key: &str| Some(text.split_once(key)?.1.trim_start());
    let descr = after("'descr':").ok_or_else(damaged)?;
    let descr = descr.split(", 'fortran").next().unwrap_or(descr).trim();
    let shape = after("'shape':").and_then(|it| it.strip_prefix('('));
    let (shape, _) = shape
        .and_then(|it| it.split_once(')'))
        .ok_or_else(damaged)?;
    let sides = shape
        .split(',')
        .map(str::trim)
        .filter(|side| !side.is_empty());
    let sides: Result<Vec<usize>, _> = sides.map(str::parse).collect();
    let Ok([rows_n, 3]) = sides.as_deref() else {
        return Err(Fault::unsupported(format!("the shape ({shape})"), EXPECTED));
    };
    let rows_n = *rows_n;
    let numbers = numbers(descr, rows_n.saturating_mul(3), data)?;
    let order = after("'fortran_order':").ok_or_else(damaged)?;
    if order.starts_with("True") {
        let row = |row| [0, 1, 2].map(|column| numbers[column * rows_n + row]);
        return Ok((0..rows_n).map(row).collect());
    }
    Ok(numbers.as_chunks().0.to_vec())
}

/// Returns the first `n` numbers of this type.
fn numbers(descr: &str, n: usize, data: &[u8]) -> Result<Vec<f64>, Fault> {
    let bytes = |size: usize| {
        data.get(..n.saturating_mul(size))
            .ok_or_else(Fault::cut_off)
    };
    let fours = || bytes(4).map(|bytes| bytes.as_chunks::<4>().0.iter());
    let eights = || bytes(8).map(|bytes| bytes.as_chunks::<8>().0.iter());
    Ok(match descr {
        "'<f4'" => fours()?.map(|it| f32::from_le_bytes(*it).into()).collect(),
        "'>f4'" => fours()?.map(|it| f32::from_be_bytes(*it).into()).collect(),
        "'<f8'" => eights()?.map(|it| f64::from_le_bytes(*it)).collect(),
        "'>f8'" => eights()?.map(|it| f64::from_be_bytes(*it)).collect(),
        _ => return Err(Fault::unsupported(format!("the type {descr}"), EXPECTED)),
    })
}

#[cfg(test)]
mod tests {
    use npyz::{DType, Order, Serialize, WriterBuilder};

    use super::*;
    use crate::fixture::mutated;

    const POINTS: [[f64; 3]; 3] = [[0.5, -1.25, 2.0], [0.0, 3.5, -4.0], [1.0, 2.0, 3.0]];

    /// The points as another program writes them.
    fn written(descr: &str, order: Order) -> Vec<u8> {
        let numbers: Vec<f64> = match order {
            Order::C => POINTS.concat(),
            Order::Fortran => (0..9).map(|k| POINTS[k % 3][k / 3]).collect(),
        };
        if descr.ends_with('8') {
            of_numbers(descr, order, numbers)
        } else {
            let numbers = numbers.iter().map(|&number| number as f32);
            of_numbers(descr, order, numbers.collect())
        }
    }

    fn of_numbers<T: Serialize>(descr: &str, order: Order, numbers: Vec<T>) -> Vec<u8> {
        let mut bytes = Vec::new();
        let options = npyz::WriteOptions::new().order(order).shape(&[3, 3]);
        let dtype = DType::Plain(descr.parse().unwrap());
        let writer = options.dtype(dtype).writer(&mut bytes);
        let mut writer = writer.begin_nd().unwrap();
        writer.extend(numbers).unwrap();
        writer.finish().unwrap();
        bytes
    }

    #[test]
    fn arrays_of_every_type_and_order_are_read() {
        for descr in ["<f4", "<f8", ">f4", ">f8"] {
            for order in [Order::C, Order::Fortran] {
                assert_eq!(points(&written(descr, order)).unwrap(), POINTS);
            }
        }
    }

    #[test]
    fn says_what_is_wrong_with_other_files() {
        let whole = written("<f8", Order::C);
        let changed = |from: &str, to: &str| {
            let at = whole
                .windows(from.len())
                .position(|it| it == from.as_bytes());
            let mut bytes = whole.clone();
            let at = at.unwrap();
            bytes[at..at + from.len()].copy_from_slice(to.as_bytes());
            bytes
        };
        for (bytes, expected) in [
            (b"PK\x03\x04".to_vec(), "no NPY signature"),
            (whole[..whole.len() - 1].to_vec(), "ends early"),
            (whole[..50].to_vec(), "ends early"),
            (b"\x93NUMPY\x01".to_vec(), "its header"),
            (b"\x93NUMPY\x02\0\xff\xff\xff\xff{".to_vec(), "its header"),
            (changed("<f8", "<i8"), "the type '<i8'"),
            (changed("(3, 3", "(9, 1"), "the shape (9, 1"),
            (changed("(3, 3", "(3, 4"), "the shape (3, 4"),
            (changed("(3, 3", "(3   "), "the shape (3 "),
            (changed("(3, 3", "(-, 3"), "the shape (-, 3"),
            (changed("(3, 3", "(8, 3"), "ends early"),
            (changed("'shape'", "'chape'"), "its header"),
            (changed("'<f8',", "[('x',"), "the type [('x'"),
            (changed("'descr'", "'bescr'"), "its header"),
        ] {
            let said = points(&bytes).unwrap_err().to_string();
            assert!(said.contains(expected), "{expected}: {said}");
        }
    }

    #[test]
    fn no_byte_of_a_file_makes_it_panic() {
        for bytes in mutated(&written("<f4", Order::Fortran), 4000) {
            if let Ok(points) = points(&bytes) {
                assert!(points.len() <= bytes.len());
            }
        }
    }
}
