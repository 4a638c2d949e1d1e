//! Options of `kind = "register"`.

use options::options;
use registration::RegistrationOptions;

/// Options of `kind = "register"`.
#[options]
pub struct RegisterConfig {
    /// How a pose is found, and when it is refused
    #[option(flatten)]
    pub registration: RegistrationOptions,
}
