//! Settings in the environment that nobody reads: misspelt ones.

use std::collections::BTreeSet;

use object_store::aws::AmazonS3ConfigKey;

/// Start of the names that are read.
const PREFIX: &str = "AWS_";
/// Settings that a depot needs most.
const MEANT: [&str; 10] = [
    "AWS_ACCESS_KEY_ID",
    "AWS_SECRET_ACCESS_KEY",
    "AWS_SESSION_TOKEN",
    "AWS_REGION",
    "AWS_DEFAULT_REGION",
    "AWS_ENDPOINT_URL",
    "AWS_ENDPOINT_URL_S3",
    "AWS_ALLOW_HTTP",
    "AWS_ROLE_ARN",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
];
/// Names that other programs have for them.
const OTHERS: [(&str, &str); 8] = [
    ("AWS_ACCESS_KEY", "AWS_ACCESS_KEY_ID"),
    ("AWS_ACCESS_ID", "AWS_ACCESS_KEY_ID"),
    ("AWS_KEY_ID", "AWS_ACCESS_KEY_ID"),
    ("AWS_SECRET_KEY", "AWS_SECRET_ACCESS_KEY"),
    ("AWS_SECRET", "AWS_SECRET_ACCESS_KEY"),
    ("AWS_SECURITY_TOKEN", "AWS_SESSION_TOKEN"),
    ("AWS_S3_ENDPOINT", "AWS_ENDPOINT_URL_S3"),
    ("AWS_URL", "AWS_ENDPOINT_URL"),
];
/// Endpoints of other services, which AWS's own tools read.
const SERVICES: &str = "AWS_ENDPOINT_URL_";
/// Letters that differ in a misspelling.
const MISSPELT: usize = 2;

/// Returns what is misspelt among the names of the environment, each with the name that is meant: only names that
/// nothing reads, instead of which the right one is not set.
pub(crate) fn misspelt<'a>(names: impl Iterator<Item = &'a str>) -> Vec<(&'a str, String)> {
    let names: BTreeSet<&str> = names.collect();
    let unread = names.iter().filter(|name| !is_read(name));
    let found = unread.filter_map(|name| Some((*name, meant(name)?)));
    found
        .filter(|(_, meant)| !names.contains(meant.as_str()))
        .collect()
}

/// Whether the client reads a variable.
fn is_read(name: &str) -> bool {
    name.starts_with(PREFIX) && is_setting(name)
}

fn is_setting(name: &str) -> bool {
    let key: Result<AmazonS3ConfigKey, _> = name.to_ascii_lowercase().parse();
    key.is_ok()
}

/// The setting that a name may stand for.
fn meant(name: &str) -> Option<String> {
    let upper = name.to_uppercase().replace(['-', '.'], "_");
    if !upper.starts_with("AWS") {
        return None;
    }
    if upper.starts_with(PREFIX) && is_setting(&upper) {
        return Some(upper);
    }
    if let Some((_, meant)) = OTHERS.iter().find(|(other, _)| *other == upper) {
        return Some((*meant).to_owned());
    }
    if upper.starts_with(SERVICES) {
        return None;
    }
    let letters = |name: &str| name.replace('_', "");
    let distance = |setting: &str| strsim::osa_distance(&letters(&upper), &letters(setting));
    let (nearest, meant) = MEANT
        .map(|setting| (distance(setting), setting))
        .into_iter()
        .min()?;
    (nearest <= MISSPELT).then(|| meant.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_setting_names_the_one_that_is_meant() {
        for (name, meant) in [
            ("aws_access_key_id", "AWS_ACCESS_KEY_ID"),
            ("Aws_Region", "AWS_REGION"),
            ("AWS-REGION", "AWS_REGION"),
            ("AWS_ACESS_KEY_ID", "AWS_ACCESS_KEY_ID"),
            ("AWS_ACCESSKEY_ID", "AWS_ACCESS_KEY_ID"),
            ("AWS_ACCESS_KEYID", "AWS_ACCESS_KEY_ID"),
            ("AWS_ACCESS_KEY", "AWS_ACCESS_KEY_ID"),
            ("AWS_SECRET_KEY", "AWS_SECRET_ACCESS_KEY"),
            ("AWS_SECRET_ACCES_KEY", "AWS_SECRET_ACCESS_KEY"),
            ("AWS_SECRET_ACCESS_KEYS", "AWS_SECRET_ACCESS_KEY"),
            ("AWS_SESION_TOKEN", "AWS_SESSION_TOKEN"),
            ("AWS_REIGON", "AWS_REGION"),
            ("AWSREGION", "AWS_REGION"),
            ("AWS_ENDPOINT_URI", "AWS_ENDPOINT_URL"),
            ("aws_endpoint_url", "AWS_ENDPOINT_URL"),
            ("AWS_ENDPIONT_URL", "AWS_ENDPOINT_URL"),
            ("AWS_ALLOWHTTP", "AWS_ALLOW_HTTP"),
            ("aws_allow_http", "AWS_ALLOW_HTTP"),
        ] {
            assert_eq!(misspelt([name].into_iter()), [(name, meant.to_owned())]);
            // Where the right one is set, the other is somebody else's.
            assert_eq!(misspelt([name, meant].into_iter()), []);
        }
    }

    #[test]
    fn what_is_read_here_or_by_the_tools_of_aws_is_no_misspelling() {
        for name in [
            "AWS_REGION",
            "AWS_region",
            "AWS_ENDPOINT",
            "AWS_TOKEN",
            "AWS_PROXY_URL",
            "AWS_PROFILE",
            "AWS_DEFAULT_PROFILE",
            "AWS_DEFAULT_OUTPUT",
            "AWS_CONFIG_FILE",
            "AWS_SHARED_CREDENTIALS_FILE",
            "AWS_CA_BUNDLE",
            "AWS_PAGER",
            "AWS_EXECUTION_ENV",
            "AWS_MAX_ATTEMPTS",
            "AWS_RETRY_MODE",
            "AWS_ROLE_SESSION_NAME",
            "AWS_ENDPOINT_URL_STS",
            "AWS_ENDPOINT_URL_SSO",
            "AWS_STS_REGIONAL_ENDPOINTS",
            "AWS_USE_FIPS_ENDPOINT",
            "AWS_ACCOUNT_ID",
            "AWS_VAULT",
            "AWS_SDK_LOAD_CONFIG",
            "PATH",
            "REGION",
            "LAWS_REGION",
        ] {
            assert_eq!(misspelt([name].into_iter()), [], "{name}");
        }
    }
}
