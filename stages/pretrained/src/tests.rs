//! The stage on the function that is part of this repository, and on files that are none.

use std::path::{Path, PathBuf};

use cgf::Description;

use super::*;

fn shipped() -> PretrainedConfig {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    PretrainedConfig {
        checkpoint: root.join("data/checkpoints/allegro_right"),
    }
}

fn made(config: &PretrainedConfig, folder: &Path) -> Result<PretrainedMetrics, BoxedDiagnostic> {
    let files = config.files().into_iter();
    let files = files.map(|(name, path)| SourceFile::named(name, &path));
    let inputs = Inputs::new(std::collections::BTreeMap::new(), files.collect());
    let cx = Context::detached(&MODEL.parse().unwrap(), 7, folder);
    match Pretrained::make(config, &inputs, &cx)? {
        Outcome::Made(metrics) => Ok(metrics),
        _ => panic!("nothing was made"),
    }
}

/// A copy of the shipped function.
fn copied(to: &Path) -> PretrainedConfig {
    for (name, path) in shipped().files() {
        fs::copy(path, to.join(name)).unwrap();
    }
    PretrainedConfig {
        checkpoint: to.to_owned(),
    }
}

#[test]
fn the_function_of_the_repository_is_offered_as_it_is() {
    let out = tempfile::tempdir().unwrap();
    let metrics = made(&shipped(), out.path()).unwrap();
    let path = |name: &str| -> PathBuf { out.path().join(name) };
    let [(weights, from), (description, shipped_description)] = shipped().files();
    assert_eq!(fs::read(path(weights)).unwrap(), fs::read(from).unwrap());
    let offered = Cgf::load(&path(weights), &path(description)).unwrap();
    let shipped = Description::read(&shipped_description).unwrap();
    assert_eq!(*offered.description(), shipped);
    let knows = &offered.description().objects;
    assert_eq!(metrics.objects, knows.len() as f64);
    // Those of the fold that its table calls unseen.
    for unseen in [
        "002_master_chef_can",
        "006_mustard_bottle",
        "021_bleach_cleanser",
        "036_wood_block",
    ] {
        assert!(!knows.contains(unseen), "{unseen}");
    }
    let best = Cgf::load(
        &path(checkpoint::BEST.weights),
        &path(checkpoint::BEST.description),
    );
    assert_eq!(*best.unwrap().description(), shipped);
}

#[test]
fn files_that_are_no_function_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let config = copied(folder.path());
    let [(_, weights), (_, description)] = config.files();
    let out = tempfile::tempdir().unwrap();
    assert!(Pretrained::prepare(&config).is_ok());

    let bytes = fs::read(&weights).unwrap();
    fs::write(&weights, &bytes[..bytes.len() / 2]).unwrap();
    let err = made(&config, out.path()).err().unwrap();
    assert!(err.hint().unwrap().contains("copy both files"), "{err}");

    fs::write(&weights, bytes).unwrap();
    let text = fs::read_to_string(&description).unwrap();
    // Other versions have other keys.
    let other = text.replacen("checkpoint/", "checkpoint/0", 1);
    fs::write(&description, other.replacen("\"objects\"", "\"things\"", 1)).unwrap();
    let err = made(&config, out.path()).err().unwrap();
    assert!(err.to_string().contains("checkpoint/0"), "{err}");

    fs::remove_file(&weights).unwrap();
    let err = Pretrained::prepare(&config).unwrap_err();
    assert!(err.to_string().contains("last.safetensors"), "{err}");
    assert!(err.hint().unwrap().contains("`checkpoint`"), "{err}");
}
