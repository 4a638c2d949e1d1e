//! Options of `kind = "sample"`.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::SampleError;

/// Options of `kind = "sample"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SampleConfig {
    /// URDF of the robot hand; its collision shapes are what is measured against object and table
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// Which of the checkpoint's weights are used
    pub epoch: Epoch,
    /// Objects to draw motions for, by name; empty: all
    pub objects: Vec<String>,
    /// Motions per object; paper: 10000
    pub per_object: usize,
    /// Steps of each motion, at equal times, at least 2; paper: 40
    pub steps: usize,
    /// Time from the first step to the grasp, s
    pub duration_s: f64,
    /// Share of the motions whose latent code is drawn about a demonstration, in 0..=1, the others
    /// from the standard normal distribution; paper: 0
    pub demonstrated_share: f64,
    /// Names of these demonstrations, of whichever object; empty: all of the same object that were
    /// learned from
    #[serde(default)]
    pub demonstrations: Vec<String>,
    /// Factor on the standard deviation of what is drawn; paper: 1
    pub spread: f64,
    /// Latent codes drawn for a motion until its hand stays out of object and table; of them all the
    /// least deep if none does; paper: 1
    pub draws: usize,
    /// Depth in object or table up to which a hand stays out of them, m; unused if `draws` is 1
    pub max_depth_m: f64,
    /// Names of two demonstrations: instead of drawing, latent codes go from the one's mean to the
    /// other's in equal steps, the object lying as in the first; empty: they are drawn
    #[serde(default)]
    pub path: Vec<String>,
    /// Which resting orientations the object is put in
    pub rests: Rests,
    /// Unit vector against gravity, object frame, for `rests = "given"`
    #[serde(default)]
    pub rest_up: Option<[f64; 3]>,
    /// How much the object's points are off, for a study: by normally distributed lengths, whose
    /// deviation along each axis of the object is this share of its extent there (0); paper: 0 to 1
    #[serde(default)]
    pub point_noise: f64,
    /// Motions per object that are shown side by side in one recording for a viewer (0)
    #[serde(default)]
    pub recorded_per_object: usize,
}

/// Which resting orientations an object is put in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Rests {
    /// Those of its demonstrations, as often as they were seen; the most probable one if there are
    /// none.
    Seen,
    /// Those that are stable, as probable as they are by the mesh.
    Stable,
    /// The one of `rest_up`, with the mesh's lowest point on the table.
    Given,
}

impl SampleConfig {
    /// Says whether motions are drawn anew because of what their hand is in.
    pub(crate) fn chooses(&self) -> bool {
        self.draws > 1 && self.path.is_empty()
    }

    /// Checks what can be checked without the lake.
    pub(crate) fn check(&self) -> Result<(), SampleError> {
        let at_least = if self.path.is_empty() { 1 } else { 2 };
        check(
            "per_object",
            self.per_object,
            self.per_object >= at_least,
            "at least 1, or 2 along a `path`",
        )?;
        check("steps", self.steps, self.steps > 1, "at least 2")?;
        let duration_s = self.duration_s;
        let usable = duration_s.is_finite() && duration_s > 0.0;
        check("duration_s", duration_s, usable, "more than 0")?;
        let usable = self.spread.is_finite() && self.spread >= 0.0;
        check("spread", self.spread, usable, "0 or more")?;
        let noise = self.point_noise;
        let usable = noise.is_finite() && noise >= 0.0;
        check("point_noise", noise, usable, "0 or more")?;
        let share = self.demonstrated_share;
        let usable = (0.0..=1.0).contains(&share);
        check("demonstrated_share", share, usable, "from 0 to 1")?;
        check("draws", self.draws, self.draws > 0, "at least 1")?;
        let depth_m = self.max_depth_m;
        let usable = depth_m.is_finite() && depth_m >= 0.0;
        check("max_depth_m", depth_m, usable, "0 or more")?;
        let names = format!("{:?}", self.path);
        let usable = matches!(self.path.len(), 0 | 2);
        check("path", names, usable, "two names or none")?;
        let up = format!("{:?}", self.rest_up.unwrap_or_default());
        match (self.rests, self.rest_up) {
            (Rests::Given, None) => {
                let expected = "a unit vector, as `rests = \"given\"` asks for one";
                check("rest_up", "missing", false, expected)
            }
            (Rests::Given, Some([x, y, z])) => {
                let length = (x * x + y * y + z * z).sqrt();
                // A length that is no number is not near 1 either.
                check("rest_up", up, (length - 1.0).abs() < 1e-3, "a unit vector")
            }
            (Rests::Seen | Rests::Stable, Some(_)) => check(
                "rest_up",
                up,
                false,
                "to be left out without `rests = \"given\"`",
            ),
            (Rests::Seen | Rests::Stable, None) => Ok(()),
        }
    }
}

fn check(
    key: &'static str,
    value: impl std::fmt::Display,
    usable: bool,
    expected: &'static str,
) -> Result<(), SampleError> {
    if usable {
        return Ok(());
    }
    Err(SampleError::Config {
        key,
        value: value.to_string(),
        expected,
    })
}

/// Which of a checkpoint's weights are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Epoch {
    /// Those with the least loss on held-out motions.
    Best,
    /// Those after the last epoch.
    Last,
}
