//! A cell's topics as a ROS 2 machine on the same router sees them.

use cell::{ServiceConfig, subscribe};
use schemas::ros2::{CdrReader, JointState, JointTrajectory, Message};
use zenoh::Wait;

use crate::lab::{SOON, connect, execute, goal, joints, start_with};

fn decode<M: Message>(bytes: &[u8]) -> M {
    let mut reader = CdrReader::new(bytes).unwrap();
    let message = M::decode(&mut reader).unwrap();
    assert_eq!(reader.remaining(), 0);
    message
}

#[test]
fn joints_are_topics_with_their_types_and_hashes() {
    let cell = start_with(ServiceConfig {
        ros2_domain: Some(7),
        ..ServiceConfig::default()
    });
    let (session, seen) = subscribe(cell.endpoint(), "7/**", SOON).unwrap();
    let tokens = session.liveliness().get("@ros2_lv/7/**").wait().unwrap();
    let mut topics: Vec<String> = tokens
        .iter()
        .filter_map(|reply| reply.into_result().ok())
        .map(|token| token.key_expr().as_str().to_owned())
        .collect();
    topics.sort();
    assert_eq!(topics.len(), 3, "{topics:?}");
    let type_and_hash = format!(
        "/MP/%/%/robot_cell/%joint_states/sensor_msgs::msg::dds_::JointState_/{}/",
        JointState::HASH
    );
    assert!(
        topics.iter().any(|topic| topic.contains(&type_and_hash)),
        "{topics:?}"
    );

    let goal = goal(0.04);
    let report = execute(&connect(&cell), &goal);
    let (mut states, mut trajectories) = (Vec::new(), Vec::new());
    while states.len() < report.samples.len() {
        let sample = seen.recv_timeout(SOON).unwrap().unwrap();
        let bytes = sample.payload().to_bytes();
        let attachment = sample.attachment().unwrap().to_bytes();
        assert_eq!(attachment.len(), 8 + 8 + 1 + 16);
        if sample.key_expr().as_str().contains("joint_states") {
            states.push(decode::<JointState>(&bytes));
            let number = u64::from_le_bytes(attachment[..8].try_into().unwrap());
            assert_eq!(number as usize, states.len());
        } else {
            trajectories.push(decode::<JointTrajectory>(&bytes));
        }
    }
    for (state, sample) in states.iter().zip(&report.samples) {
        assert_eq!(state.name, joints());
        assert_eq!(state.position, sample.q_rad);
    }
    assert_eq!(trajectories.len(), 1);
    assert_eq!(trajectories[0].points.len(), goal.hand.points.len());
    let (point, commanded) = (&trajectories[0].points[2], &goal.hand.points[2]);
    assert_eq!(point.positions, commanded.q_rad);
    assert_eq!(point.velocities, commanded.rates.velocity);
    assert_eq!(point.accelerations, commanded.rates.acceleration);
}
