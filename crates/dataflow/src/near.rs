//! "Did you mean": the nearest of some names.

/// Returns the candidate nearest to `word`, if it is near enough to be a misspelling of it.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let largest = word.chars().count().max(3) / 3;
    candidates
        .into_iter()
        .map(|candidate| (distance(word, candidate), candidate))
        .filter(|&(distance, _)| distance <= largest.max(1))
        .min()
        .map(|(_, candidate)| candidate)
}

/// Number of insertions, deletions, replacements and swaps of neighbors between two words
/// (optimal string alignment; Boytsov, *Indexing methods for approximate dictionary searching*,
/// 2011, §2.2).
fn distance(a: &str, b: &str) -> usize {
    let a: Vec<char> = a.chars().collect();
    let b: Vec<char> = b.chars().collect();
    let mut rows: Vec<Vec<usize>> = vec![(0..=b.len()).collect()];
    for (i, &x) in a.iter().enumerate() {
        let mut row = vec![i + 1];
        for (j, &y) in b.iter().enumerate() {
            let replaced = rows[i][j] + usize::from(x != y);
            let mut least = replaced.min(rows[i][j + 1] + 1).min(row[j] + 1);
            if i > 0 && j > 0 && x == b[j - 1] && a[i - 1] == y {
                least = least.min(rows[i - 1][j - 1] + 1);
            }
            row.push(least);
        }
        rows.push(row);
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_a_misspelling() {
        let keys = ["kl_weight", "epochs", "latent_dim"];
        assert_eq!(nearest("kl_wieght", keys), Some("kl_weight"));
        assert_eq!(nearest("epoch", keys), Some("epochs"));
    }

    #[test]
    fn does_not_guess_at_a_stranger() {
        assert_eq!(nearest("root", ["kl_weight", "epochs"]), None);
    }
}
