//! Causes of failed requests, in words: a store's client wraps them in its addresses, retries and XML.

use std::error::Error;

use crate::store::Boxed;

/// Address at which machines of a cloud ask for their role; it is asked where the environment has no credentials.
const ROLES: &str = "169.254.169.254";

/// Cause of a failed request.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error("{text}")]
pub(crate) struct Cause {
    text: String,
    /// Suggested fix.
    pub(crate) hint: Option<String>,
    /// Whether it is no matter of time.
    pub(crate) is_lasting: bool,
}

impl Cause {
    /// Finds the cause of an error in the answers that it quotes.
    pub(crate) fn of(err: &Boxed, bucket: &str, url: &str) -> Self {
        let quoted = chain(&**err);
        let code = between(&quoted, "<Code>", "</Code>");
        let is = |codes: &[&str]| code.is_some_and(|code| codes.contains(&code));
        let said = between(&quoted, "<Message>", "</Message>").map(str::to_owned);
        let status = quoted.split_once("status code: ").map(|(_, rest)| {
            let end = rest.find([':', '<']).unwrap_or(rest.len());
            format!("it answers `{}`", rest[..end].trim())
        });
        let lasting = |text: String, hint: String| Self {
            text,
            hint: Some(hint),
            is_lasting: true,
        };
        if quoted.contains("NoSuchBucket") {
            return lasting(
                format!("there is no bucket `{bucket}`"),
                format!("make it, or correct `{url}`, and see `AWS_REGION` and `AWS_ENDPOINT_URL`"),
            );
        }
        if quoted.contains(ROLES) {
            return lasting(
                "there are no credentials: the environment has none, and this machine no role"
                    .to_owned(),
                "set `AWS_ACCESS_KEY_ID` and `AWS_SECRET_ACCESS_KEY`".to_owned(),
            );
        }
        if is(&["InvalidAccessKeyId", "SignatureDoesNotMatch"]) {
            return lasting(
                said.unwrap_or_else(|| "the credentials are wrong".to_owned()),
                "correct `AWS_ACCESS_KEY_ID` and `AWS_SECRET_ACCESS_KEY`".to_owned(),
            );
        }
        if is(&["PermanentRedirect", "AuthorizationHeaderMalformed"]) {
            return lasting(
                said.unwrap_or_else(|| "the region is another".to_owned()),
                format!("set `AWS_REGION` to that of the bucket `{bucket}`"),
            );
        }
        let is_refused = is(&["AccessDenied"]) || quoted.contains("403 Forbidden");
        let hint = if is(&["ExpiredToken", "RequestTimeTooSkewed"]) {
            Some("renew the credentials, and see the clock of this machine".to_owned())
        } else {
            is_refused.then(|| {
                format!(
                    "the credentials need the rights to list, read, write and delete in `{url}`"
                )
            })
        };
        Self {
            text: said.or(status).unwrap_or_else(|| innermost(&**err)),
            hint,
            is_lasting: false,
        }
    }
}

/// An error with all its causes.
fn chain(err: &(dyn Error + 'static)) -> String {
    causes(err).map(|err| err.to_string() + "\n").collect()
}

/// The innermost cause of an error.
fn innermost(err: &(dyn Error + 'static)) -> String {
    causes(err)
        .last()
        .map_or_else(String::new, ToString::to_string)
}

fn causes<'e>(err: &'e (dyn Error + 'static)) -> impl Iterator<Item = &'e (dyn Error + 'static)> {
    let mut next = Some(err);
    std::iter::from_fn(move || {
        let err = next?;
        next = err.source();
        Some(err)
    })
}

fn between<'t>(text: &'t str, before: &str, after: &str) -> Option<&'t str> {
    let (_, rest) = text.split_once(before)?;
    rest.split_once(after).map(|(found, _)| found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cause(text: &str) -> Cause {
        Cause::of(&Boxed::from(text), "lab", "s3://lab/ours")
    }

    #[test]
    fn a_cause_is_in_the_words_of_the_store_without_its_xml() {
        let answer = "Error performing GET http://x/lab?list-type=2 in 12ms, after 2 retries - Server returned \
                      non-2xx status code: 403 Forbidden: <?xml version=\"1.0\"?><Error><Code>AccessDenied</Code>\
                      <Message>Access Denied</Message></Error>";
        let found = cause(answer);
        assert_eq!(found.to_string(), "Access Denied");
        assert!(found.hint.unwrap().contains("`s3://lab/ours`"));
        assert!(!found.is_lasting, "a refusal may be over in a minute");
        let found =
            cause("non-2xx status code: 404 Not Found: <Error><Code>NoSuchBucket</Code></Error>");
        assert_eq!(found.to_string(), "there is no bucket `lab`");
        assert!(found.is_lasting);
        let found = cause("Error performing PUT http://169.254.169.254/latest/api/token in 1s");
        assert!(found.to_string().contains("no credentials"));
        assert!(found.hint.unwrap().contains("AWS_ACCESS_KEY_ID"));
        let found = cause("Server returned non-2xx status code: 503 Slow Down: ");
        assert_eq!(found.to_string(), "it answers `503 Slow Down`");
    }
}
