//! `meta.yml` and `extrinsics.yml`.
#![no_main]

use libfuzzer_sys::fuzz_target;
use stage_ingest::read;

fuzz_target!(|bytes: &[u8]| {
    let _ = read::meta_serials(bytes);
    if let Ok(poses) = read::extrinsics(bytes) {
        for pose in poses {
            // What passes for a rotation is one.
            assert!((pose.rotation.norm() - 1.0).abs() < 1e-9, "{pose:?}");
            assert!(
                pose.translation
                    .vector
                    .iter()
                    .all(|number| number.is_finite())
            );
        }
    }
});
