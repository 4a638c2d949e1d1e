//! Names that are spelled nearly alike.

/// Maximum number of near names that an error lists.
const MAX_NAMES: usize = 3;
/// Longest name in bytes that is compared: the work grows with the product of both lengths.
const MAX_LENGTH: usize = 200;

/// Returns the names that lie nearest to `name`, nearest first; none that share next to nothing, and
/// none that are too long for a person to have written.
pub fn near_names<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> Vec<String> {
    if name.len() > MAX_LENGTH {
        return Vec::new();
    }
    let mut near: Vec<(usize, &str)> = candidates
        .filter(|candidate| candidate.len() <= MAX_LENGTH)
        .map(|candidate| (edit_distance(name, candidate), candidate))
        .filter(|(distance, candidate)| 2 * distance <= name.len().max(candidate.len()))
        .collect();
    near.sort_unstable();
    near.into_iter()
        .take(MAX_NAMES)
        .map(|(_, candidate)| candidate.to_owned())
        .collect()
}

/// Returns the least number of insertions, deletions and replacements between two names
/// (Levenshtein 1966), ignoring case.
fn edit_distance(a: &str, b: &str) -> usize {
    strsim::levenshtein(&a.to_lowercase(), &b.to_lowercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_name_comes_first() {
        let names = ["link_15.0_tip", "link_15.0", "base_link"];
        assert_eq!(
            near_names("link_15_tip", names.into_iter()),
            ["link_15.0_tip", "link_15.0"]
        );
        assert_eq!(edit_distance("kitten", "sitting"), 3);
    }

    #[test]
    fn overlong_names_are_not_compared() {
        // Comparing two of these would take weeks.
        let (name, other) = ("a".repeat(1 << 24), "b".repeat(1 << 24));
        assert_eq!(
            near_names(&name, [name.as_str(), "link"].into_iter()),
            Vec::<String>::new()
        );
        let names = [other.as_str(), "link_1"];
        assert_eq!(near_names("link_2", names.into_iter()), ["link_1"]);
    }
}
