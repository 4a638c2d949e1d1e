//! Options of stages, each declared once: its meaning, default, range and the reason for it.
//!
//! ```
//! use options::{Options, above, options};
//!
//! /// Most steps of a motion: ten seconds at a controller's 1000 Hz.
//! const MAX_STEPS: usize = 10_000;
//!
//! /// Options of a stage.
//! #[options(also = Self::combined_faults)]
//! pub struct Config {
//!     /// File of the robot hand.
//!     #[option(path)]
//!     pub hand: std::path::PathBuf,
//!     /// Number of steps: the paper's.
//!     #[option(default = 40, range = 2..=MAX_STEPS, why = "a motion has a beginning and an end")]
//!     pub steps: usize,
//!     /// The reach.
//!     #[option(default, table)]
//!     pub reach: Reach,
//!     /// The filter.
//!     #[option(flatten)]
//!     pub filter: Filter,
//! }
//!
//! /// The reach.
//! #[options]
//! pub struct Reach {
//!     /// Duration, in seconds.
//!     #[option(default = 1.5, range = above(0.0, 3600.0), why = "reaching takes seconds")]
//!     pub duration_s: f64,
//! }
//!
//! /// The filter.
//! #[options]
//! pub struct Filter {
//!     /// Its order.
//!     #[option(default = 2, range = 1..=8, why = "filters of higher orders ring")]
//!     pub filter_order: u32,
//! }
//!
//! impl Config {
//!     fn combined_faults(&self, faults: &mut options::OptionFaults) {
//!         if self.steps as f64 > 1000.0 * self.reach.duration_s {
//!             faults.note("steps", "is more than 1000 per second");
//!         }
//!     }
//! }
//!
//! let config = serde_json::json!({
//!     "hand": "hand.urdf",
//!     "reach": {"duration_s": -1.0},
//!     "filter_order": 9,
//! });
//! let config: Config = serde_json::from_value(config).unwrap();
//! assert_eq!(config.steps, 40);
//! let faults: Vec<String> = config.faults().iter().map(ToString::to_string).collect();
//! assert_eq!(
//!     faults,
//!     [
//!         "`reach.duration_s` is -1.0, and must be more than 0 and at most 3600: reaching takes seconds",
//!         "`filter_order` is 9, and must be from 1 to 8: filters of higher orders ring",
//!         "`steps` is more than 1000 per second",
//!     ]
//! );
//! let written = serde_json::to_string(&config).unwrap();
//! assert_eq!(written, r#"{"steps":40,"reach":{"duration_s":-1.0},"filter_order":9}"#);
//! let unknown = serde_json::json!({"hand": "hand.urdf", "order": 2});
//! assert!(serde_json::from_value::<Config>(unknown).is_err());
//! let schema = schemars::schema_for!(Config);
//! assert!(schema.pointer("/properties/filter_order/maximum").is_some());
//! assert_eq!(schema.get("additionalProperties"), Some(&serde_json::json!(false)));
//! ```
//!
//! `#[options]` derives `Debug`, `Clone`, `Serialize`, `Deserialize` without unknown fields, and
//! `JsonSchema`, whose schema has the ranges and their reasons; where every option has a default, it
//! implements `Default` too. `also` names a function that is called after the ranges are checked, for
//! conditions over several options. An option may have
//!
//! | `#[option(…)]` | Meaning |
//! |---|---|
//! | `default`, `default = VALUE` | may be left out, and is then `Default::default()` or the value |
//! | `range = RANGE, why = REASON` | must be in the range: `0..=MAX`, `0.0..1.0`, [`above`]; of an `Option`, where it is set |
//! | `table` | is a table of options, checked as such |
//! | `flatten` | is a struct of options, each of which stands among the others under its own key |
//! | `path` | is a file that counts by its content, and no part of the serialized form |
//!
//! The crate that uses it depends on `options`, `schemars` and `serde`.
//!
//! What it deliberately leaves out: where an option stands in a file, which `dataflow` knows.

mod faults;
mod range;

pub use faults::{OptionFault, OptionFaults, Options};
pub use options_macro::options;
pub use range::{above, describe, range_in};
