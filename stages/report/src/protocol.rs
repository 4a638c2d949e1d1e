//! The screening protocol in words.

use schemas::{Table, rates::SuccessRates, rollouts::Rollouts};
use serde_json::Value;

use crate::{
    PageData,
    table::{Cell, DataTable},
};

/// Returns the protocol of the screen as a table of facts; `None` if nothing was screened.
pub(crate) fn protocol(gathered: &PageData) -> Option<DataTable> {
    let rate = gathered.rates.first();
    let options = ScreenOptions::of(gathered);
    if rate.is_none() && options.is_none() {
        return None;
    }
    let mut table = DataTable::new(
        "protocol",
        "How a motion is judged",
        &[("setting", "Setting"), ("value", "Value")],
    );
    let rows = [
        ("protocol", rate.map(|rate| rate.protocol.clone())),
        ("approach", rate.map(|rate| rate.approach.clone())),
        (
            "scripted squeeze",
            rate.map(|rate| squeeze(rate.squeeze_rad)),
        ),
        (
            "friction of hand and object",
            rate.map(|rate| rate.friction.to_string()),
        ),
        (
            "torque limit of a finger's joint",
            rate.map(|rate| format!("{} Nm", rate.torque_limit_nm)),
        ),
        (
            "different fingers",
            options.and_then(ScreenOptions::fingers),
        ),
        ("objects' masses", rate.map(|rate| rate.object_mass.clone())),
        ("lift", options.and_then(ScreenOptions::lift)),
        ("hold", options.and_then(ScreenOptions::hold)),
        ("success", options.and_then(ScreenOptions::success)),
        (
            "control step",
            options.and_then(ScreenOptions::control_step),
        ),
    ];
    for (setting, value) in rows {
        if let Some(value) = value {
            table.row([Cell::text(setting), Cell::text(value)]);
        }
    }
    Some(table)
}

/// Returns the angle in radians of the scripted squeeze in words.
fn squeeze(angle_rad: f64) -> String {
    if angle_rad > 0.0 {
        format!("{angle_rad} rad")
    } else {
        "none".to_owned()
    }
}

/// Options of the screen, each in words where it is set.
#[derive(Clone, Copy)]
struct ScreenOptions<'a>(&'a Value);

impl<'a> ScreenOptions<'a> {
    /// Returns the options of the screen, or of what it is rated by, where they are known.
    fn of(gathered: &'a PageData) -> Option<Self> {
        let facts = &gathered.facts;
        let options = facts.options_of(Rollouts::NAME);
        let options = options.or_else(|| facts.options_of(SuccessRates::NAME));
        options.map(Self)
    }

    fn number(self, path: &str) -> Option<f64> {
        self.0.pointer(path)?.as_f64()
    }

    /// Says whether different fingers touch each other in the screen's physics.
    fn fingers_touch(self) -> Option<bool> {
        let name = self.0.pointer("/protocol/name");
        if name.is_some_and(|name| name == "full_contact") {
            return Some(true);
        }
        self.0.pointer("/scene/fingers_touch")?.as_bool()
    }

    fn fingers(self) -> Option<String> {
        let fingers = if self.fingers_touch()? {
            "touch each other"
        } else {
            "pass through each other: a rate with contact between them is lower"
        };
        Some(fingers.to_owned())
    }

    fn lift(self) -> Option<String> {
        let lift_m = self.number("/protocol/lift_m")?;
        let lift_s = self.number("/protocol/lift_s")?;
        Some(format!("{lift_m} m in {lift_s} s"))
    }

    fn hold(self) -> Option<String> {
        let hold_s = self.number("/protocol/hold_s")?;
        Some(format!("{hold_s} s"))
    }

    /// Returns the tests that a motion passes to succeed.
    fn success(self) -> Option<String> {
        let tests = [
            self.number("/protocol/lifted_m")
                .map(|m| format!("lifted by more than {m} m")),
            self.number("/protocol/min_links")
                .map(|n| format!("{n} links in contact at the end")),
            self.number("/protocol/strict/min_fingers")
                .map(|n| format!("{n} fingers, or one and the palm")),
            self.number("/protocol/max_slip_m_per_s")
                .map(|v| format!("slip below {v} m/s")),
            self.number("/max_penetration_m")
                .map(|m| format!("at most {m} m deep in the object")),
        ];
        let tests: Vec<String> = tests.into_iter().flatten().collect();
        (!tests.is_empty()).then(|| tests.join("; "))
    }

    fn control_step(self) -> Option<String> {
        let step_s = self.number("/scene/time_step_s")?;
        let n = self.number("/scene/steps_per_control")?;
        Some(format!(
            "{:.0} ms, {n:.0} physics steps of {} ms",
            1e3 * step_s * n,
            1e3 * step_s
        ))
    }
}

/// Returns the protocol in a line, for the headline; `None` if no rates are wired.
pub(crate) fn line(gathered: &PageData) -> Option<String> {
    let rate = gathered.rates.first()?;
    let mass = &rate.object_mass;
    let mass = if mass == "measured" {
        "measured masses"
    } else {
        mass
    };
    let fingers = match ScreenOptions::of(gathered).and_then(ScreenOptions::fingers_touch) {
        Some(false) => ", fingers pass through each other",
        Some(true) => ", fingers touch each other",
        None => "",
    };
    Some(format!(
        "judged by {}: friction {}, torque limit {} Nm, {mass}, approach {}{fingers}",
        rate.protocol, rate.friction, rate.torque_limit_nm, rate.approach
    ))
}
