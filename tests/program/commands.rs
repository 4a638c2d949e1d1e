//! Every command and option does what its help says.

use std::{
    collections::BTreeSet,
    fs,
    path::Path,
    process::{Command, Output},
    sync::OnceLock,
};

use dataflow::Pipeline;
use serde_json::Value;

use crate::program::bench::{Bench, put, stderr, stdout};

/// A lake in which everything up to `retarget` is made; tests only look at it.
pub(crate) fn finished() -> &'static Bench {
    static FINISHED: OnceLock<Bench> = OnceLock::new();
    FINISHED.get_or_init(|| {
        let bench = Bench::new();
        bench.run_well(&["--until", "retarget"]);
        bench
    })
}

/// Returns the output of a command that succeeds.
pub(crate) fn done(bench: &Bench, command: &str, arguments: &[&str]) -> String {
    let output = bench.command(command, arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    stdout(&output)
}

/// The program with nothing but these arguments.
pub(crate) fn pipeline(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .env_remove("COLUMNS")
        .args(arguments)
        .output()
        .unwrap()
}

fn made(bench: &Bench) -> Vec<String> {
    bench.made_by_newest_run().into_keys().collect()
}

#[test]
fn a_profile_replaces_values_and_an_unknown_one_names_those_there_are() {
    let folder = tempfile::tempdir().unwrap();
    // Another file of this name is the same pipeline.
    let file = folder.path().join("cgf.toml");
    let extends = format!("{}/pipelines/cgf.toml", env!("CARGO_MANIFEST_DIR"));
    let own = "[profiles.light.retarget]\nobject_weight = 0.0\n\
               [profiles.quick.train.training]\nepochs = 3\n";
    put(&file, &format!("extends = \"{extends}\"\n{own}"));
    let planned = |profile: &str| {
        let arguments = ["--profile", profile];
        let mut plan = finished().command_on(file.to_str().unwrap(), "plan", &arguments);
        plan.output().unwrap()
    };
    for (profile, expected) in [
        ("light", "`object_weight` changed from 3.0 to 0.0"),
        ("quick", "cached   retarget.trajectories"),
    ] {
        let plan = planned(profile);
        assert_eq!(plan.status.code(), Some(0), "{}", stderr(&plan));
        let plan = stdout(&plan);
        // It goes on to the last stage.
        for part in [expected, "dispatch.trials"] {
            assert!(plan.contains(part), "{part}: {plan}");
        }
    }
    let text = fs::read_to_string(&file).unwrap();
    let values = |profile: Option<&str>| {
        let read = Pipeline::parse(&file, &text, &pipeline::kinds(), profile, &[]).unwrap();
        let [retarget, train] = ["retarget", "train"].map(|name| read.find(name).unwrap().config());
        let epochs = train["training"]["epochs"].as_u64().unwrap();
        (retarget["object_weight"].as_f64().unwrap(), epochs)
    };
    let (weight, epochs) = values(None);
    assert_eq!(values(Some("light")), (0.0, epochs));
    assert_eq!(values(Some("quick")), (weight, 3));
    let unknown = planned("lihgt");
    assert_eq!(unknown.status.code(), Some(2));
    let text = stderr(&unknown);
    assert!(text.contains("no profile `lihgt`"), "{text}");
    // That of the base file, and its own.
    for name in ["its profiles are:", "table_lift", "light", "quick"] {
        assert!(text.contains(name), "{name}: {text}");
    }
}

#[test]
fn only_runs_one_stage_and_refuses_missing_inputs() {
    let bench = Bench::new();
    let refused = bench.run(&["--only", "retarget"]);
    assert_eq!(refused.status.code(), Some(1));
    let text = stderr(&refused);
    assert!(text.contains("is not made yet"), "{text}");
    assert!(text.contains("hint: make it first with"), "{text}");
    bench.run_well(&["--until", "ingest"]);
    bench.run_well(&["--only", "retarget"]);
    assert_eq!(
        made(&bench),
        [
            "retarget.distance_fields",
            "retarget.tracking",
            "retarget.trajectories"
        ]
    );
    // Later stages are not touched, and the stage itself is up to date.
    let plan = done(&bench, "plan", &["--only", "retarget"]);
    assert_eq!(plan, "cached   everything; nothing to run\n");
    let both = bench.run(&["--only", "retarget", "--until", "train"]);
    assert_eq!(both.status.code(), Some(2));
}

#[test]
fn units_are_made_by_name_checked_and_collected() {
    let bench = Bench::new();
    bench.run_well(&["--until", "ingest"]);
    bench.run_well(&[
        "--only",
        "retarget",
        "--set",
        "retarget.smoothness_weight=0.3",
    ]);
    let units = bench.made_by_newest_run()["retarget.trajectories"];
    let partition = {
        let plan = done(&bench, "plan", &["--until", "retarget", "--format", "json"]);
        let plan: Value = serde_json::from_str(&plan).unwrap();
        let unit = &plan["nodes"][4]["units"][0];
        assert_eq!(unit["state"], "run");
        assert_eq!(unit["causes"][0]["key"], "smoothness_weight");
        assert_eq!(unit["causes"][0]["old"], 0.3);
        assert_eq!(unit["causes"][0]["new"], 0.2);
        unit["partition"].as_str().unwrap().to_owned()
    };
    let fingerprint = done(&bench, "unit", &["retarget.trajectories", &partition]);
    assert_eq!(fingerprint.trim().len(), 64);
    let again = done(&bench, "unit", &["retarget.trajectories", &partition]);
    assert_eq!(again, fingerprint);
    let lake = bench.lake();
    let lake = ["--lake", lake.to_str().unwrap()];
    let verified = pipeline(&[&["verify"], &lake[..]].concat());
    assert_eq!(verified.status.code(), Some(0), "{}", stdout(&verified));
    bench.run_well(&["--until", "retarget", "--processes"]);
    let said = pipeline(&[&["gc", "--dry-run"], &lake[..]].concat());
    let expected = format!("goes  retarget.trajectories  {units} units");
    assert!(stdout(&said).contains(&expected), "{}", stdout(&said));
    let done = pipeline(&[&["gc"], &lake[..]].concat());
    assert!(stdout(&done).contains("gone  retarget.trajectories"));
    let verified = pipeline(&[&["verify", "--inputs"], &lake[..]].concat());
    assert_eq!(verified.status.code(), Some(0), "{}", stdout(&verified));
}

#[test]
fn until_stops_and_fresh_remakes_one_stage_or_all() {
    let bench = Bench::new();
    bench.run_well(&["--until", "retarget", "--jobs", "1"]);
    let all = [
        "ingest.demonstrations",
        "ingest.objects",
        "ingest.shapes",
        "retarget.distance_fields",
        "retarget.tracking",
        "retarget.trajectories",
    ];
    assert_eq!(made(&bench), all);
    bench.run_well(&["--until", "retarget", "--fresh", "retarget"]);
    assert_eq!(made(&bench), all[3..]);
    bench.run_well(&["--until", "retarget", "--fresh"]);
    assert_eq!(made(&bench), all);
}

#[test]
fn zero_worker_threads_are_refused() {
    let ran = finished().run(&["--jobs", "0"]);
    assert_eq!(ran.status.code(), Some(2));
    assert!(stderr(&ran).contains("--jobs"), "{}", stderr(&ran));
}

#[test]
fn a_dry_run_prints_what_plan_prints_and_writes_nothing() {
    let bench = Bench::new();
    let plan = done(&bench, "plan", &[]);
    assert!(plan.contains("run"), "{plan}");
    assert_eq!(done(&bench, "run", &["--dry-run"]), plan);
    assert!(!bench.lake().exists());
    let before = finished().published();
    let change = ["--until", "retarget", "--fresh", "ingest"];
    let plan = done(finished(), "plan", &change);
    let dry = done(finished(), "run", &[&change[..], &["--dry-run"]].concat());
    assert_eq!(dry, plan);
    assert_eq!(finished().published(), before);
}

#[test]
fn graph_lists_inputs_outputs_and_partition_counts() {
    let unmade = done(&Bench::new(), "graph", &[]);
    assert!(unmade.contains("one partition per sequence"), "{unmade}");
    let text = done(finished(), "graph", &[]);
    let lines: Vec<&str> = text.lines().collect();
    let stage = lines.iter().position(|line| *line == "retarget").unwrap();
    assert_eq!(
        lines[stage + 1],
        "  reads  ingest.demonstrations, ingest.objects"
    );
    let makes = |output: &str| {
        let made = format!("makes  {output}");
        lines[stage..]
            .iter()
            .find(|line| line.contains(&made))
            .unwrap()
            .to_string()
    };
    assert!(makes("retarget.trajectories").contains(" partitions, one per sequence"));
    assert!(makes("retarget.tracking").contains(" partitions, one per object"));
    assert!(text.contains("from its demonstrations"), "{text}");
    assert!(text.contains("dispatch.executions"), "{text}");
}

/// The words in double quotes of one line.
fn quoted(line: &str) -> Vec<&str> {
    assert_eq!(line.matches('"').count() % 2, 0, "{line}");
    line.split('"').skip(1).step_by(2).collect()
}

#[test]
fn drawings_name_every_output_once_and_only_connect_what_they_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("my pipeline.toml");
    let renamed = include_str!("../../pipelines/cgf.toml")
        .replace("stages.screen", "stages.screen-2")
        .replace("\"screen.", "\"screen-2.");
    put(&file, &renamed);
    let draw = |format: &str| {
        let lake = folder.path().join("lake");
        let drawn = pipeline(&[
            "graph",
            file.to_str().unwrap(),
            "--format",
            format,
            "--lake",
            lake.to_str().unwrap(),
        ]);
        assert_eq!(drawn.status.code(), Some(0), "{}", stderr(&drawn));
        stdout(&drawn)
    };

    let dot = draw("dot");
    assert!(dot.starts_with("digraph \"my pipeline\" {\n"), "{dot}");
    assert_eq!(dot.matches('{').count(), dot.matches('}').count());
    let mut nodes = BTreeSet::new();
    let mut n_edges = 0;
    for line in dot.lines() {
        let words = quoted(line);
        if line.contains("->") {
            assert!(words.iter().all(|word| nodes.contains(word)), "{line}");
            n_edges += 1;
        } else if line.contains('[') && words.len() == 2 {
            assert!(nodes.insert(words[0]), "{line}");
        }
    }
    assert!(nodes.contains("screen-2.rollouts"), "{dot}");
    assert_eq!((nodes.len(), n_edges), (24, 99), "{dot}");

    let mermaid = draw("mermaid");
    assert!(mermaid.starts_with("flowchart LR\n"), "{mermaid}");
    let count = |what: &str| mermaid.lines().filter(|line| line.contains(what)).count();
    assert_eq!(count("subgraph"), count("end"), "{mermaid}");
    assert_eq!((count("<br/>"), count("-->")), (24, 99), "{mermaid}");
    for edge in mermaid.lines().filter(|line| line.contains("-->")) {
        for end in edge.trim().split(" --> ") {
            assert!(mermaid.contains(&format!("{end}[\"")), "{edge}");
        }
    }
}

#[test]
fn completions_are_scripts_that_know_commands_and_options() {
    for (shell, begins) in [
        ("bash", "_pipeline()"),
        ("zsh", "#compdef pipeline"),
        ("fish", "# Print an optspec"),
    ] {
        let printed = pipeline(&["completions", shell]);
        assert_eq!(printed.status.code(), Some(0), "{shell}");
        let script = stdout(&printed);
        assert!(script.starts_with(begins), "{shell}: {script:.80}");
        for word in ["doctor", "until", "mermaid"] {
            assert!(script.contains(word), "{shell}: {word}");
        }
    }
    let unknown = pipeline(&["completions", "bsh"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(stderr(&unknown).contains("bash"), "{}", stderr(&unknown));
}

/// The subcommands that `pipeline --help` lists.
pub(crate) fn subcommands() -> Vec<String> {
    let help = stdout(&pipeline(&["--help"]));
    let (_, commands) = help.split_once("Commands:\n").unwrap();
    let (commands, _) = commands.split_once("Options of every command").unwrap();
    // A long description goes on in a line that begins further to the right.
    let lines = commands
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let words = lines.filter_map(|line| line.split_whitespace().next());
    words.map(str::to_owned).collect()
}

#[test]
fn help_names_every_command_once() {
    let mut named = subcommands();
    named.sort();
    let short = stdout(&pipeline(&["-h"]));
    for command in &named {
        assert!(short.contains(command.as_str()), "{command}");
    }
    let hidden = ["completions", "unit", "untag"];
    let known = stdout(&pipeline(&["completions", "bash"]));
    // The words after the program's own name, before those after each command's.
    let mut words = known.split("opts=\"").skip(1);
    let words = words.find(|words| !words.starts_with('"')).unwrap();
    let words = words.split('"').next().unwrap().split_whitespace();
    let mut known: Vec<String> = words
        .filter(|word| !word.starts_with('-') && *word != "help" && !hidden.contains(word))
        .map(str::to_owned)
        .collect();
    known.sort();
    assert_eq!(named, known);
}

#[test]
fn every_option_with_a_value_says_its_default() {
    let commands = subcommands();
    for command in ["run", "attach", "graph", "doctor", "query"] {
        assert!(commands.iter().any(|known| known == command), "{command}");
    }
    for command in commands {
        let output = Command::new(env!("CARGO_BIN_EXE_pipeline"))
            .args([command.as_str(), "-h"])
            .env("COLUMNS", "1000")
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(0), "{command}");
        let help = stdout(&output);
        for line in help.lines().filter(|line| line.starts_with("  ")) {
            let has_value = line.contains("--") && line.contains('<');
            let may_be_left_out = line.starts_with("  [");
            if has_value || may_be_left_out {
                assert!(line.contains("[default: "), "{command}: {line}");
            }
            // An option in seconds, meters and so on says so.
            for unit in ["_s ", "_m ", "_hz ", "timeout"] {
                assert!(!line.contains(unit), "{command}: name the unit in {line}");
            }
        }
    }
}

#[test]
fn the_plan_of_every_unit_is_json_with_its_state() {
    let json = done(
        finished(),
        "plan",
        &["--until", "retarget", "--format", "json"],
    );
    let plan: Value = serde_json::from_str(&json).unwrap();
    let units = plan["nodes"][0]["units"].as_array().unwrap();
    assert!(units.iter().all(|unit| unit["state"] == "cached"), "{json}");
    assert!(Path::new(units[0]["partition"].as_str().unwrap()).is_relative());
}
