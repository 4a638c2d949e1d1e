//! Pages of little, of nothing and of very much; equal inputs give equal bytes.

use std::collections::BTreeMap;

use dataflow::RunFacts;
use glb::{Moment, MotionScene, ObjectMesh};
use schemas::{
    candidates::{DrawSource, ObjectSplit, Origin},
    rollouts::{ExecutedSmoothness, Measures, Rollout, Smoothness, Verdict},
    success::Success,
    tally::Tally,
};
use stage_report::{Facts, Motion, OutcomeGroup, PageData, Rendered, render};

fn rollout(object: &str, n: usize, verdict: Verdict) -> Rollout {
    Rollout {
        candidate_id: format!("{object}-{n:05}"),
        generator: "cgf".to_owned(),
        source: DrawSource::replayed("a"),
        verdict,
        measures: Measures {
            control_steps_n: 100,
            skipped_steps_n: 20,
            lift_m: 0.15,
            contacts_n: 3,
            ..Measures::default()
        },
        smoothness: Smoothness::default(),
        executed: ExecutedSmoothness(None),
    }
}

fn motion(object: &str, n: usize, verdict: Verdict) -> Motion {
    let hand = "<robot name='r'><link name='palm'><collision><geometry><box size='0.1 0.1 0.03'/></geometry></collision></link></robot>";
    let hand = robot::RobotModel::from_urdf(hand).unwrap();
    let mesh = ObjectMesh {
        vertices_m: vec![[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]],
        triangles: vec![[0, 1, 2]],
    };
    let scene = MotionScene {
        name: object,
        robot: &hand,
        object: &mesh,
        about: &[],
    };
    let rollout = rollout(object, n, verdict);
    Motion {
        id: rollout.candidate_id.clone(),
        object: object.to_owned(),
        generator: "cgf".to_owned(),
        origin: "prior".to_owned(),
        verdict: verdict.as_str().to_owned(),
        outcome: OutcomeGroup::of(&rollout),
        lift_m: 0.1,
        slip_m: 0.0,
        duration_s: 1.0,
        recording: None,
        glb: scene
            .to_glb(&[Moment::still(0.0), Moment::still(1.0)])
            .unwrap(),
    }
}

/// A run of so many objects, each with 20 candidates, of which 3 fail.
fn run(objects_n: usize) -> PageData {
    let names: Vec<String> = (0..objects_n).map(|n| format!("{n:04}_object")).collect();
    let of = |object: &String| {
        let verdict = |n: usize| match n {
            0 => Verdict::Dropped,
            1 | 2 => Verdict::NotGrasped,
            _ => Verdict::Held,
        };
        (0..20)
            .map(|n| rollout(object, n, verdict(n)))
            .collect::<Vec<_>>()
    };
    let success = |object: &String| Success {
        object: object.clone(),
        generator: "cgf".to_owned(),
        origin: Origin::Prior,
        object_split: Some(ObjectSplit::Seen),
        verdicts: Tally::from_iter([
            (Verdict::Held, 17),
            (Verdict::Dropped, 1),
            (Verdict::NotGrasped, 2),
        ]),
        draws_n: 80,
        control_steps_n: 2000,
        spread_palm_m: 0.0,
        spread_palm_rad: 0.0,
        spread_q_rad: 0.0,
        spread_n: 0,
    };
    let shown = names.iter().take(48);
    PageData {
        facts: facts(),
        successes: names.iter().map(success).collect(),
        rollouts: names.iter().map(|name| (name.clone(), of(name))).collect(),
        motions: shown.map(|name| motion(name, 3, Verdict::Held)).collect(),
        recorded_n: 2 * objects_n,
        objects: names,
        ..PageData::default()
    }
}

fn facts() -> Facts {
    Facts {
        run: RunFacts {
            pipeline: "cgf".to_owned(),
            seed: 7,
            kinds: BTreeMap::from([("screen".to_owned(), "screen".to_owned())]),
            ..RunFacts::default()
        },
        ..Facts::default()
    }
}

fn rendered(gathered: PageData) -> Rendered {
    render(&[("run 1".to_owned(), gathered)]).unwrap()
}

fn page(files: &Rendered) -> String {
    String::from_utf8(files["index.html"].clone()).unwrap()
}

/// Every section says something, and no number is one of nothing.
fn has_no_holes(html: &str) {
    let sections: Vec<&str> = html.split("<section ").skip(1).collect();
    assert!(sections.len() >= 9, "{}", sections.len());
    for section in sections {
        let (_, rest) = section.split_once("</h2>").unwrap();
        let body = rest.split("</section>").next().unwrap();
        let says = ["<p>", "<tr>", "<svg "]
            .iter()
            .any(|part| body.contains(part));
        assert!(says, "{section}");
        for table in body.split("<tbody>").skip(1) {
            let rows = table.split("</tbody>").next().unwrap();
            assert!(rows.contains("<tr>"), "an empty table: {section}");
        }
    }
    let text = html.split("<script").next().unwrap();
    for nothing in ["NaN", "inf", ">-0", "undefined", "null"] {
        let words = text.split(|c: char| !c.is_alphanumeric() && !"->".contains(c));
        assert!(!words.into_iter().any(|word| word == nothing), "{nothing}");
    }
}

#[test]
fn nothing_at_all_gives_a_page_without_holes() {
    let files = rendered(PageData::default());
    has_no_holes(&page(&files));
    assert!(page(&files).contains("nothing was screened"));
    let files = rendered(PageData {
        facts: facts(),
        ..PageData::default()
    });
    has_no_holes(&page(&files));
}

#[test]
fn one_object_without_executions_gives_a_page_without_holes() {
    let files = rendered(run(1));
    has_no_holes(&page(&files));
    let html = page(&files);
    assert!(
        html.contains(
            "simulated success: objects 1 of 1, samples 21.2\u{a0}%, candidates 85.0\u{a0}%"
        ),
        "the headline"
    );
    assert!(html.contains("this run says nothing of unseen ones"));
    let csv = String::from_utf8(files["by_object.csv"].clone()).unwrap();
    let row = csv.lines().nth(1).unwrap();
    assert!(row.starts_with("0000_object,seen,0.85,"), "{row}");
    // No object, no motion, no failure.
    let mut empty = run(1);
    empty.motions.clear();
    for rollouts in empty.rollouts.values_mut() {
        rollouts.retain(|rollout| rollout.verdict == Verdict::Held);
    }
    let html = page(&rendered(empty));
    has_no_holes(&html);
    assert!(html.contains("None of 17 candidates failed.") && html.contains("has a recording"));
}

/// `PIPELINE_PAGES` names a folder in which it is left to be opened.
#[test]
fn a_thousand_objects_are_rows_and_a_histogram_on_a_page_of_moderate_size() {
    let files = rendered(run(1000));
    let html = page(&files);
    has_no_holes(&html);
    assert_eq!(html.matches("data-filter=\"object\"").count(), 1000);
    assert!(html.contains("Objects by the share of their candidates that succeed"));
    assert!(html.len() < 2_000_000, "{} bytes", html.len());
    if let Ok(folder) = std::env::var("PIPELINE_PAGES") {
        for (name, bytes) in &files {
            lake::write_atomic(&std::path::Path::new(&folder).join(name), bytes).unwrap();
        }
    }
}

#[test]
fn equal_inputs_give_equal_bytes_and_another_order_of_runs_another_page() {
    assert!(rendered(run(3)) == rendered(run(3)));
    let both = |first: usize, second: usize| {
        let runs = [first, second].map(|n| (format!("run {n}"), run(n)));
        render(&runs).unwrap()
    };
    let (one, other) = (both(2, 3), both(3, 2));
    has_no_holes(&page(&one));
    assert!(page(&one).contains("Runs side by side") && page(&one) != page(&other));
    let csv = String::from_utf8(one["runs_by_object.csv"].clone()).unwrap();
    // The third object is in the second run alone.
    assert!(csv.contains("0002_object,,0.85"), "{csv}");
}

#[test]
fn names_of_objects_are_text_and_never_markup() {
    let mut gathered = run(1);
    let rollouts = gathered.rollouts.pop_first().unwrap().1;
    let evil = "<script>alert(1)</script>\"&".to_owned();
    gathered.rollouts.insert(evil.clone(), rollouts);
    gathered.objects = vec![evil];
    let html = page(&rendered(gathered));
    assert!(!html.contains("<script>alert"));
    assert!(html.contains("&lt;script&gt;alert(1)&lt;/script&gt;&quot;&amp;"));
}
