//! Points in the messages of a depth camera: a `sensor_msgs/msg/PointCloud2`, in the order of an image or in none.

use schemas::ros2::{PointCloud2, PointField};

use crate::{depth_message::decoded, error::Fault};

/// Reads the points of a cloud.
pub(crate) fn points(cdr: &[u8]) -> Result<Vec<[f64; 3]>, Fault> {
    let cloud = decoded::<PointCloud2>(cdr)?;
    let wrong = |problem: String| Fault::new(problem, "correct what publishes the clouds");
    let mut fields = [(0, 0); 3];
    for (name, field) in ["x", "y", "z"].into_iter().zip(&mut fields) {
        let found = cloud.fields.iter().find(|field| field.name == name);
        let found = found.ok_or_else(|| wrong(format!("the cloud has no field `{name}`")))?;
        let bytes = match found.datatype {
            PointField::FLOAT32 => 4,
            PointField::FLOAT64 => 8,
            other => {
                let problem = format!("the field `{name}` is of type {other}, expected 7 or 8");
                return Err(wrong(problem));
            }
        };
        let end = (found.offset as usize).saturating_add(bytes);
        if end > cloud.point_step as usize {
            let step = cloud.point_step;
            let problem =
                format!("the field `{name}` ends at byte {end} of points of {step} bytes");
            return Err(wrong(problem));
        }
        *field = (found.offset as usize, bytes);
    }
    let [width, height] = [cloud.width, cloud.height].map(|side| side as usize);
    let [point_step, row_step] = [cloud.point_step, cloud.row_step].map(|step| step as usize);
    let row_bytes = width.saturating_mul(point_step);
    if width == 0 || height == 0 {
        return Ok(Vec::new());
    }
    if height > 1 && row_step < row_bytes {
        let problem =
            format!("`row_step` is {row_step}, and a row of points has {row_bytes} bytes");
        return Err(wrong(problem));
    }
    let expected = row_step
        .saturating_mul(height - 1)
        .saturating_add(row_bytes);
    if cloud.data.len() < expected {
        let found = cloud.data.len();
        let problem = format!("its `data` has {found} bytes, expected {expected}");
        return Err(wrong(problem));
    }
    let rows = cloud.data.chunks(row_step.max(row_bytes)).take(height);
    let points = rows.flat_map(|row| row[..row_bytes].chunks(point_step));
    let coordinate = |point: &[u8], (offset, bytes)| {
        let number = &point[offset..offset + bytes];
        number_of(number, cloud.is_bigendian)
    };
    let points = points.map(|point| fields.map(|field| coordinate(point, field)));
    Ok(points.collect())
}

/// Reads a number of 4 or 8 bytes.
fn number_of(bytes: &[u8], is_big: bool) -> f64 {
    match (bytes.try_into(), bytes.try_into()) {
        (Ok(four), _) if is_big => f32::from_be_bytes(four).into(),
        (Ok(four), _) => f32::from_le_bytes(four).into(),
        (_, Ok(eight)) if is_big => f64::from_be_bytes(eight),
        (_, Ok(eight)) => f64::from_le_bytes(eight),
        (Err(_), Err(_)) => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use schemas::ros2::Message;

    use super::*;
    use crate::{fixture::mutated, recording_fixture::cloud_message};

    const POINTS: [[f64; 3]; 4] = [
        [0.5, -1.25, 2.0],
        [0.0, 3.5, -4.0],
        [f64::NAN; 3],
        [1.0, 2.0, 3.0],
    ];

    /// The points, two in a row, and how a test changes them.
    fn read(change: impl Fn(&mut PointCloud2)) -> Result<Vec<[f64; 3]>, Fault> {
        let mut cloud = cloud_message(&POINTS, 2);
        change(&mut cloud);
        points(&cloud.to_cdr())
    }

    #[test]
    fn points_of_both_widths_and_orders_are_read() {
        let found = read(|_| ()).unwrap();
        assert_eq!(found[..2], POINTS[..2]);
        assert!(found[2].iter().all(|number| number.is_nan()));
        assert_eq!(found[3..], POINTS[3..]);
        let wide = read(|cloud| {
            (cloud.height, cloud.width, cloud.point_step) = (1, 2, 26);
            let of = |point: [f64; 3]| point.map(f64::to_be_bytes).concat();
            cloud.data = [of(POINTS[0]), vec![0, 0], of(POINTS[3]), vec![0, 0]].concat();
            cloud.is_bigendian = true;
            for (idx, field) in (0..).zip(&mut cloud.fields[..3]) {
                (field.offset, field.datatype) = (8 * idx, PointField::FLOAT64);
            }
        });
        assert_eq!(wide.unwrap(), [POINTS[0], POINTS[3]]);
        assert_eq!(read(|cloud| cloud.width = 0).unwrap().len(), 0);
    }

    #[test]
    fn says_what_is_wrong_with_other_clouds() {
        let check = |change: fn(&mut PointCloud2), expected: &str| {
            let said = read(change).unwrap_err().to_string();
            assert!(said.contains(expected), "{expected}: {said}");
        };
        check(
            |it| "depth".clone_into(&mut it.fields[2].name),
            "no field `z`",
        );
        check(
            |it| it.fields[0].datatype = 4,
            "`x` is of type 4, expected 7 or 8",
        );
        check(
            |it| it.fields[1].offset = 30,
            "`y` ends at byte 34 of points of 20 bytes",
        );
        check(|it| it.fields[1].offset = u32::MAX, "`y` ends at byte");
        check(|it| it.point_step = 0, "of points of 0 bytes");
        check(
            |it| it.row_step = 39,
            "`row_step` is 39, and a row of points has 40 bytes",
        );
        check(|it| it.height = u32::MAX, "has 80 bytes, expected");
        check(|it| it.width = u32::MAX, "`row_step` is 40");
        check(
            |it| it.data.truncate(it.data.len() - 1),
            "`data` has 79 bytes, expected 80",
        );
    }

    #[test]
    fn no_byte_of_a_message_makes_it_panic() {
        let cdr = cloud_message(&POINTS, 2).to_cdr();
        for bytes in mutated(&cdr, 4000) {
            if let Ok(points) = points(&bytes) {
                assert!(points.len() <= bytes.len());
            }
        }
    }
}
