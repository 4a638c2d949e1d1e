//! Motions as one table of comma-separated values, a row for each step.

use crate::{
    Episode, Export, FormatError,
    episode::{check_together, joint_names, pose_names, without_commands},
};

/// Name of the file.
const FILE: &str = "motions.csv";

/// Writes motions as a table: `motion`, `object`, `outcome`, `step`, `time_s`, the poses of palm and object in
/// the table's frame, joint positions, and those commanded (names that begin with `command_`, empty where none
/// were recorded). Numbers are written so that reading gives the same bits.
///
/// # Errors
///
/// Fails without motions, or if they are not of one hand or share a name.
pub fn to_csv(episodes: &[Episode]) -> Result<Export, FormatError> {
    let first = check_together(episodes)?;
    let joints = joint_names(first.joints());
    let mut header = ["motion", "object", "outcome", "step", "time_s"]
        .map(str::to_owned)
        .to_vec();
    header.extend(pose_names("palm"));
    header.extend(pose_names("object"));
    header.extend(joints.iter().cloned());
    header.extend(joints.iter().map(|joint| format!("command_{joint}")));
    let mut writer = csv::Writer::from_writer(Vec::new());
    let encode = FormatError::encode(FILE);
    writer.write_record(&header).map_err(&encode)?;
    for episode in episodes {
        for (idx, step) in episode.steps().enumerate() {
            let outcome = episode.outcome().unwrap_or_default();
            let mut row = [episode.name(), episode.object(), outcome]
                .map(str::to_owned)
                .to_vec();
            row.push(idx.to_string());
            let poses = [
                step.table_from_palm.to_array(),
                step.table_from_object.to_array(),
            ];
            let numbers = [step.time_s]
                .into_iter()
                .chain(poses.concat())
                .chain(step.q);
            row.extend(numbers.map(|number| number.to_string()));
            match step.q_command {
                Some(command) => row.extend(command.iter().map(f64::to_string)),
                None => row.extend(joints.iter().map(|_| String::new())),
            }
            writer.write_record(&row).map_err(&encode)?;
        }
    }
    let mut export = Export::default();
    let bytes = writer.into_inner();
    export.put(FILE, bytes.map_err(|err| encode(err.into_error().into()))?);
    export.lost = vec![
        "velocities, accelerations, contacts, forces, latent codes, metrics".to_owned(),
        "shapes of hand and object: only their names and poses are in it".to_owned(),
        "types and frames: names end in units, poses are in the table's frame, and a quaternion is x y z w".to_owned(),
    ];
    export.lost.extend(without_commands(episodes));
    Ok(export)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::tests::{episode, step};

    #[test]
    fn reads_back_bit_for_bit_under_names_with_units() {
        let times = [0.0, 1.0 / 3.0, 0.7];
        let episodes = [
            episode("a", &times),
            episode("b,\"c\"", &times).with_outcome("held"),
        ];
        let export = to_csv(&episodes).unwrap();
        let mut reader = csv::Reader::from_reader(export.files[FILE].as_slice());
        let header = reader.headers().unwrap().clone();
        let at = |name: &str| header.iter().position(|other| other == name).unwrap();
        let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        assert_eq!(rows.len(), 6);
        assert_eq!(
            (&rows[3][0], &rows[3][2], &rows[0][2]),
            ("b,\"c\"", "held", "")
        );
        for (row, time_s) in rows.iter().zip(times.into_iter().cycle()) {
            let was = step(time_s);
            let number = |name: &str| row[at(name)].parse::<f64>().unwrap();
            assert_eq!(number("time_s"), time_s);
            assert_eq!(number("palm_z_m"), was.table_from_palm.to_array()[2]);
            assert_eq!(number("palm_qy"), was.table_from_palm.to_array()[4]);
            assert_eq!([number("knuckle_rad"), number("slide_m")], was.q[..]);
            assert_eq!(&row[at("command_slide_m")], "");
        }
    }
}
