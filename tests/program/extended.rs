//! A pipeline file that extends another holds only the differences, and a value shared by several
//! stages is written once.

use std::{fs, path::Path, process::Command};

use tempfile::TempDir;

use crate::program::bench::{put, stderr};

/// A folder with `cgf.toml` and files beside it.
struct Folder(TempDir);

impl Folder {
    fn with(files: &[(&str, &str)]) -> Self {
        let folder = TempDir::new().unwrap();
        let whole = include_str!("../../pipelines/cgf.toml");
        put(&folder.path().join("cgf.toml"), whole);
        for (name, text) in files {
            put(&folder.path().join(name), text);
        }
        Self(folder)
    }

    /// Plans a file with these arguments, and returns exit code and messages.
    fn plan(&self, file: &str, arguments: &[&str]) -> (i32, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_pipeline"))
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .arg("plan")
            .arg(self.0.path().join(file))
            .arg("--lake")
            .arg(self.0.path().join("lake"))
            .args(arguments)
            .output()
            .unwrap();
        (output.status.code().unwrap(), stderr(&output))
    }
}

/// Plans `own.toml` with this text, which is wrong in one way.
fn refused(text: &str, says: &[&str]) {
    check(&Folder::with(&[("own.toml", text)]), &[], says);
}

fn check(folder: &Folder, arguments: &[&str], says: &[&str]) {
    let (code, text) = folder.plan("own.toml", arguments);
    assert_eq!(code, 2, "{text}");
    for part in says {
        assert!(text.contains(part), "no `{part}` in:\n{text}");
    }
    assert_eq!(text.matches("error: ").count(), 1, "{text}");
}

#[test]
fn a_fault_of_an_extended_file_is_shown_in_that_file() {
    let folder = Folder::with(&[("own.toml", "extends = \"cgf.toml\"\nseed = 9\n")]);
    assert_eq!(folder.plan("own.toml", &[]).0, 0);
    let path = folder.0.path().join("cgf.toml");
    let text = fs::read_to_string(&path).unwrap();
    put(&path, &text.replacen("kl_weight", "kl_wieght", 1));
    let says = [
        "cgf.toml:",
        "kl_wieght = 2e-3\n",
        "did you mean `kl_weight`?",
    ];
    check(&folder, &[], &says);
    // One of its own is shown in its own line.
    put(&path, &text);
    let own = "extends = \"cgf.toml\"\n[stages.train.training]\nkl_wieght = 2e-3\n";
    put(&folder.0.path().join("own.toml"), own);
    check(&folder, &[], &["own.toml:3:1", "did you mean `kl_weight`?"]);
    // So is TOML that is none.
    put(
        &folder.0.path().join("own.toml"),
        "extends = \"cgf.toml\"\n",
    );
    put(&path, "seed = \n");
    check(&folder, &[], &["cgf.toml:1:"]);
}

#[test]
fn extends_must_name_an_existing_file() {
    refused(
        "extends = \"cfg.toml\"\n",
        &[
            "cannot read the extended file",
            "own.toml:1:11",
            "did you mean `",
            "cgf.toml`?",
        ],
    );
    refused(
        "extends = 3\n",
        &[
            "`extends` must be the name of a pipeline file, found the number 3",
            "own.toml:1:11",
            "hint: write, e.g., `extends = \"cgf.toml\"`",
        ],
    );
    refused(
        "extend = \"cgf.toml\"\nseed = 7\n[stages]\n",
        &["did you mean `extends`?"],
    );
}

#[test]
fn a_circle_of_files_is_refused() {
    refused(
        "extends = \"own.toml\"\n",
        &["extends itself", "own.toml:1:11"],
    );
    let files = [
        ("own.toml", "extends = \"other.toml\"\n"),
        ("other.toml", "extends = \"./own.toml\"\n"),
    ];
    let says = [
        "a file that extends it",
        "other.toml:1:11",
        "hint: remove one",
    ];
    check(&Folder::with(&files), &[], &says);
}

#[test]
fn without_leaves_stages_out_with_their_own_inputs() {
    let less = "extends = \"cgf.toml\"\nwithout = [\"screen\", \"dispatch\"]\n";
    let folder = Folder::with(&[("own.toml", less)]);
    let (code, text) = folder.plan("own.toml", &[]);
    assert_eq!(code, 0, "{text}");
    refused(
        "extends = \"cgf.toml\"\nwithout = [\"dispach\"]\n",
        &[
            "no stage `dispach` to leave out",
            "own.toml:2:12",
            "`dispatch`?",
        ],
    );
    refused(
        "extends = \"cgf.toml\"\nwithout = \"dispatch\"\n",
        &[
            "`without` must be a list of names of stages",
            "found the text",
        ],
    );
    refused(
        "extends = \"cgf.toml\"\nwithout = [\"train\"]\n",
        &[
            "stage `sample` reads from an unknown stage `train`",
            "cgf.toml:",
        ],
    );
}

#[test]
fn a_shared_value_has_the_name_that_stages_take_it_by() {
    let own = |text: &str| format!("extends = \"cgf.toml\"\n{text}\n");
    refused(
        &own("[stages.train]\nshared.hand = \"hnad\""),
        &[
            "stage `train` takes an unknown shared value `hnad`",
            "own.toml:3:15",
            "did you mean `hand`?",
        ],
    );
    refused(
        &own("[shared]\nfrictoin = 3"),
        &[
            "no stage takes the shared value `frictoin`",
            "own.toml:3:1",
            "did you mean `friction`?",
        ],
    );
    refused(
        &own("[stages.train]\nshared.hand = 3"),
        &[
            "`shared.hand` of stage `train` must name a shared value",
            "own.toml:3:15",
        ],
    );
    refused(
        &own("[stages.train]\nshared.hnad = \"hand\""),
        &[
            "unknown key `hnad` in stage `train`",
            "own.toml:3:8",
            "`hand`?",
        ],
    );
    refused(
        &own("[stages.shared]\nkind = \"replay\""),
        &["`shared` is not a name for a stage"],
    );
}

#[test]
fn a_shared_value_is_said_once_and_given_once() {
    let folder = Folder::with(&[("own.toml", "extends = \"cgf.toml\"\n")]);
    let path: &Path = folder.0.path();
    let says = |set: &str| {
        let (code, text) = folder.plan("own.toml", &["--set", set]);
        assert_eq!(code, 2, "{text}");
        text
    };
    // Both stages that use it are named, at the location of the value.
    let text = says("shared.protocol.reach_s=soon");
    for stage in [
        "`protocol.reach_s` in stage `screen`",
        "`protocol.reach_s` in stage `dispatch`",
    ] {
        assert!(text.contains(stage), "{text}");
    }
    assert!(
        text.contains("| --set shared.protocol.reach_s=soon\n"),
        "{text}"
    );
    assert!(!text.contains(path.to_str().unwrap()), "{text}");
    let text = says("shared.protocl.reach_s=1");
    assert!(
        text.contains("no stage takes the shared value `protocl`"),
        "{text}"
    );
    assert!(text.contains("did you mean `protocol`?"), "{text}");
    let text = says("shraed.protocol.reach_s=1");
    assert!(text.contains("did you mean `shared`?"), "{text}");
    // What a stage says itself comes before it.
    let own = [
        "--set",
        "screen.protocol.reach_s=1",
        "--set",
        "shared.protocol.reach_s=2",
    ];
    assert_eq!(folder.plan("own.toml", &own).0, 0);
}
