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
    let options = gathered
        .facts
        .options_of(Rollouts::NAME)
        .or_else(|| gathered.facts.options_of(SuccessRates::NAME));
    if rate.is_none() && options.is_none() {
        return None;
    }
    let mut table = DataTable::new(
        "protocol",
        "How a motion is judged",
        &[("setting", "Setting"), ("value", "Value")],
    );
    let mut put = |setting: &str, value: Option<String>| {
        if let Some(value) = value {
            table.row([Cell::text(setting), Cell::text(value)]);
        }
    };
    let option = |path: &str| options.and_then(|options| options.pointer(path));
    let number = |path: &str| option(path).and_then(Value::as_f64);
    put("protocol", rate.map(|rate| rate.protocol.clone()));
    put("approach", rate.map(|rate| rate.approach.clone()));
    put(
        "scripted squeeze",
        rate.map(|rate| {
            if rate.squeeze_rad > 0.0 {
                format!("{} rad", rate.squeeze_rad)
            } else {
                "none".to_owned()
            }
        }),
    );
    put(
        "friction of hand and object",
        rate.map(|rate| rate.friction.to_string()),
    );
    put(
        "torque limit of a finger's joint",
        rate.map(|rate| format!("{} Nm", rate.torque_limit_nm)),
    );
    put(
        "different fingers",
        fingers_touch(gathered).map(|touch| {
            if touch {
                "touch each other"
            } else {
                "pass through each other: a rate with contact between them is lower"
            }
            .to_owned()
        }),
    );
    put("objects' masses", rate.map(|rate| rate.object_mass.clone()));
    put(
        "lift",
        number("/protocol/lift_m")
            .zip(number("/protocol/lift_s"))
            .map(|(lift_m, lift_s)| format!("{lift_m} m in {lift_s} s")),
    );
    put(
        "hold",
        number("/protocol/hold_s").map(|hold_s| format!("{hold_s} s")),
    );
    let mut test = Vec::new();
    test.extend(number("/protocol/lifted_m").map(|m| format!("lifted by more than {m} m")));
    test.extend(number("/protocol/min_links").map(|n| format!("{n} links in contact at the end")));
    test.extend(
        number("/protocol/strict/min_fingers").map(|n| format!("{n} fingers, or one and the palm")),
    );
    test.extend(number("/protocol/max_slip_m_per_s").map(|v| format!("slip below {v} m/s")));
    test.extend(number("/max_penetration_m").map(|m| format!("at most {m} m deep in the object")));
    put("success", (!test.is_empty()).then(|| test.join("; ")));
    put(
        "control step",
        number("/scene/time_step_s")
            .zip(number("/scene/steps_per_control"))
            .map(|(step_s, n)| {
                format!(
                    "{:.0} ms, {n:.0} physics steps of {} ms",
                    1e3 * step_s * n,
                    1e3 * step_s
                )
            }),
    );
    Some(table)
}

/// Says whether different fingers touch each other in the screen's physics, where its options are known.
fn fingers_touch(gathered: &PageData) -> Option<bool> {
    let facts = &gathered.facts;
    let options = facts.options_of(Rollouts::NAME);
    let options = options.or_else(|| facts.options_of(SuccessRates::NAME))?;
    options.pointer("/scene/fingers_touch")?.as_bool()
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
    let fingers = match fingers_touch(gathered) {
        Some(false) => ", fingers pass through each other",
        Some(true) => ", fingers touch each other",
        None => "",
    };
    Some(format!(
        "judged by {}: friction {}, torque limit {} Nm, {mass}, approach {}{fingers}",
        rate.protocol, rate.friction, rate.torque_limit_nm, rate.approach
    ))
}
