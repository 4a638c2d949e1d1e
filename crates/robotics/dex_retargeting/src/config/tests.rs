use super::*;

const POSITION: &str = "
retargeting:
  type: Position
  urdf_path: hand.urdf
  target_joint_names: null
  target_link_names: [ 'thtip', fftip ]
  target_link_human_indices: [ 4, 8 ]
  add_dummy_free_joint: True
  low_pass_alpha: 1
";

const VECTOR: &str = "
retargeting:
  type: vector
  urdf_path: hand.urdf
  target_origin_link_names: [ palm, palm ]
  target_task_link_names: [ thtip, fftip ]
  scaling_factor: 1.2
  target_link_human_indices: [ [ 0, 0 ], [ 4, 8 ] ]
  low_pass_alpha: 0.2
";

const DEXPILOT: &str = "
retargeting:
  type: DexPilot
  urdf_path: hand.urdf
  wrist_link_name: palm
  finger_tip_link_names: [ thtip, fftip, mftip ]
  huber_delta: 0.5
";

#[test]
fn each_type_has_what_it_follows() {
    let config: Config = POSITION.parse().unwrap();
    assert!(config.add_dummy_free_joint && config.target_joint_names.is_none());
    assert_eq!(config.low_pass_alpha, Some(1.0));
    assert_eq!(config.objective.end_landmarks(), [4, 8]);
    let config: Config = VECTOR.parse().unwrap();
    assert!(!config.add_dummy_free_joint);
    let ObjectiveKind::Vector { vectors, scale } = config.objective.kind else {
        panic!("it is of type `vector`");
    };
    assert_eq!(scale, 1.2);
    assert_eq!(vectors[1].links, ["palm", "fftip"]);
    assert_eq!(vectors[1].landmarks, [0, 8]);
    let config: Config = DEXPILOT.parse().unwrap();
    // The library's own, whatever the file says.
    assert_eq!(config.objective.huber_delta_m, 0.03);
    assert_eq!(config.low_pass_alpha, Some(0.1));
    assert_eq!(config.objective.end_landmarks(), [4, 4, 8, 4, 8, 12]);
}

#[test]
fn refuses_what_the_library_does_not_know() {
    let check = |text: &str, from: &str, to: &str, problem: &str, hint: &str| {
        assert!(text.contains(from), "{from}");
        let err = text.replace(from, to).parse::<Config>().unwrap_err();
        assert_eq!(err.to_string(), problem);
        assert!(err.hint().unwrap().contains(hint), "{:?}", err.hint());
    };
    let scale = ("scaling_factor", "scaling_size");
    let unknown = "unknown key `scaling_size` of `retargeting`";
    check(VECTOR, scale.0, scale.1, unknown, "`scaling_factor`");
    check(
        VECTOR,
        "vector",
        "vectors",
        "`type` is `vectors`",
        "`dexpilot`",
    );
    check(
        VECTOR,
        "1.2",
        "-1.2",
        "`scaling_factor` is -1.2",
        "positive",
    );
    let lists = "`target_link_human_indices` is lists of 2, 1, and `target_origin_link_names` is 2";
    check(
        VECTOR,
        "[ 4, 8 ]",
        "[ 4 ]",
        lists,
        "one landmark for each link",
    );
    let missing = "`type: position` needs `target_link_names`";
    check(
        POSITION,
        "target_link_names: [ 'thtip', fftip ]",
        "",
        missing,
        "add",
    );
    let landmark = "`target_link_human_indices` names landmark 21";
    check(POSITION, "[ 4, 8 ]", "[ 4, 21 ]", landmark, "0 to 20");
    let fingers = "`finger_tip_link_names` names 1 fingers";
    check(
        DEXPILOT,
        "[ thtip, fftip, mftip ]",
        "[ thtip ]",
        fingers,
        "two to five",
    );
}

#[test]
fn text_that_is_no_configuration_is_refused() {
    for text in [
        "",
        "retargeting",
        "retargeting: [",
        "a: 1",
        "retargeting: {type: vector}",
    ] {
        assert!(text.parse::<Config>().is_err(), "{text}");
    }
}
