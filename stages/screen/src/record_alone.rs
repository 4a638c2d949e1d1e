//! One candidate alone, as its unit executes it.

use dataflow::{BoxedDiagnostic, Context, Inputs};
use schemas::rollouts::Rollout as Row;
use simulation::TraceMode;

use crate::{
    ScreenConfig,
    recording::{RecordingContext, record},
    screening_inputs::ScreeningInputs,
};

/// Executes one candidate of a unit alone, which gives the same rollout as among the others, and writes its
/// recording, `<candidate_id>.mcap`, into the context's folder. Returns whether there is one: not of a candidate
/// that is not among the unit's, that is refused on geometry alone, or whose simulation diverges.
///
/// # Errors
///
/// Fails if the inputs cannot be read or the recording not be written, or where a unit would fail.
pub fn record_alone(
    config: &ScreenConfig,
    inputs: &Inputs,
    cx: &Context,
    candidate_id: &str,
) -> Result<bool, BoxedDiagnostic> {
    let Some(screened) = ScreeningInputs::read(inputs, cx)? else {
        return Ok(false);
    };
    let config = &config.resolved();
    let mut candidates = screened.candidates.candidates.iter();
    let Some(idx) = candidates.position(|one| one.candidate_id == candidate_id) else {
        return Ok(false);
    };
    let screening = screened.screening(config, cx.seed());
    let rollout = screening
        .scenes(&config.scene, &[idx])
        .and_then(|scenes| screening.rollout(&scenes, idx, TraceMode::Trace));
    let rollout = match rollout {
        Ok(rollout) => rollout,
        Err(source) => return screened.skip_or_fail::<()>(source).map(|_skipped| false),
    };
    let candidate = &screened.candidates.candidates[idx];
    let row = Row::unsimulated(candidate, config.screening(cx.seed()).verdict(&rollout));
    let context = RecordingContext {
        urdf: &screened.xml,
        model: &screened.hand,
        object: &screened.object,
    };
    record(&context, &row, &rollout, cx.folder())?;
    Ok(rollout.trace.is_some())
}
