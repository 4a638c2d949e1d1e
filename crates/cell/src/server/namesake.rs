//! Check for another cell of the same name.

use std::time::{Duration, Instant};

use zenoh::{
    Session, Wait,
    qos::{CongestionControl, Priority},
    query::{ConsolidationMode, QueryTarget},
};

use crate::{
    CellError, Keys,
    client::MAX_ANSWER_BYTES,
    signature::{Answer, Question},
};

/// Timeout for another cell's answer.
const ANSWER: Duration = Duration::from_secs(1);

/// Checks that no running cell has this name.
///
/// Two cells that start at the same moment may both pass: dispatchers then send nothing to either.
pub(super) fn refuse(session: &Session, keys: &Keys, endpoint: &str) -> Result<(), CellError> {
    let question = Question::new(&keys.capabilities(), "", &[]).map_err(CellError::Random)?;
    let deadline = Instant::now() + ANSWER;
    let replies = session
        .get(question.selector())
        .target(QueryTarget::All)
        .consolidation(ConsolidationMode::None)
        .congestion_control(CongestionControl::Block)
        .priority(Priority::RealTime)
        .timeout(ANSWER)
        .wait()
        .map_err(|source| CellError::Zenoh {
            action: "look for another cell of the name",
            source: source.into(),
        })?;
    let answers = question.collect(&replies, MAX_ANSWER_BYTES, deadline);
    if answers.is_empty() {
        return Ok(());
    }
    let who: Vec<String> = answers.iter().map(Answer::who).collect();
    Err(CellError::NameTaken {
        name: keys.name().to_owned(),
        endpoint: endpoint.to_owned(),
        who: who.join(" and "),
    })
}
