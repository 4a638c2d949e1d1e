//! Choice of one draw of a motion by a score.

/// Draws of one motion, of which one is chosen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Choice<T> {
    /// Index in `draws` of the chosen one: that with the least score, the first among equals.
    pub chosen: usize,
    /// All draws, in their order.
    pub draws: Vec<T>,
}

/// Groups consecutive draws with the same resting pose into motions; the resting pose is not chosen. A pose's draws are
/// shared out evenly, at least `per_motion` to each motion; a pose with fewer has one motion. Choices are in the order
/// of their chosen draws.
///
/// `score` returns what is least of the best draw, or `None` of one that could not be refined, which any other beats.
///
/// ```
/// let draws = vec![("lying", 0.3), ("upright", 0.2), ("lying", 0.1)];
/// let choices = refinement::choose(draws, 2, |draw| draw.0, |draw| Some(draw.1));
/// assert_eq!(choices[0].draws, [("upright", 0.2)]);
/// assert_eq!((choices[1].chosen, choices[1].draws.len()), (1, 2));
/// ```
pub fn choose<T, P: PartialEq, S: PartialOrd>(
    draws: Vec<T>,
    per_motion: usize,
    resting_pose: impl Fn(&T) -> P,
    score: impl Fn(&T) -> Option<S>,
) -> Vec<Choice<T>> {
    let mut by_rest: Vec<(P, Vec<(usize, T)>)> = Vec::new();
    for (number, draw) in draws.into_iter().enumerate() {
        let rest = resting_pose(&draw);
        match by_rest.iter_mut().find(|(other, _)| *other == rest) {
            Some((_, alike)) => alike.push((number, draw)),
            None => by_rest.push((rest, vec![(number, draw)])),
        }
    }
    let mut choices: Vec<(usize, Choice<T>)> = Vec::new();
    for (_, alike) in by_rest {
        let motions_n = (alike.len() / per_motion.max(1)).max(1);
        let [least_n, more_n] = [alike.len() / motions_n, alike.len() % motions_n];
        let mut alike = alike.into_iter();
        for motion in 0..motions_n {
            let draws_n = least_n + usize::from(motion < more_n);
            let of_motion: Vec<(usize, T)> = alike.by_ref().take(draws_n).collect();
            let chosen = least(of_motion.iter().map(|(_, draw)| score(draw)));
            let number = of_motion
                .get(chosen)
                .map_or(usize::MAX, |(number, _)| *number);
            let draws = of_motion.into_iter().map(|(_, draw)| draw).collect();
            choices.push((number, Choice { chosen, draws }));
        }
    }
    choices.sort_by_key(|(number, _)| *number);
    choices.into_iter().map(|(_, choice)| choice).collect()
}

/// Returns the index of the least score, the first among equals; 0 of none.
fn least<S: PartialOrd>(scores: impl Iterator<Item = Option<S>>) -> usize {
    let refined = scores
        .enumerate()
        .filter_map(|(idx, score)| Some((idx, score?)));
    let least = refined.reduce(|best, other| if other.1 < best.1 { other } else { best });
    least.map_or(0, |(idx, _)| idx)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Chooses among draws with these resting poses and scores; returns the chosen draw and all of each choice.
    fn check(draws: &[(u8, Option<f64>)], per_motion: usize, expected: &[(usize, &[usize])]) {
        let numbers = (0..draws.len()).collect();
        let choices = choose(
            numbers,
            per_motion,
            |&number: &usize| draws[number].0,
            |&number| draws[number].1,
        );
        let found: Vec<(usize, &[usize])> = choices
            .iter()
            .map(|choice| (choice.draws[choice.chosen], &choice.draws[..]))
            .collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn the_least_score_of_consecutive_draws_is_chosen_the_first_among_equals() {
        let draws = [
            (0, Some(2.0)),
            (0, Some(1.0)),
            (0, Some(3.0)),
            (0, Some(3.0)),
            (0, Some(0.0)),
        ];
        check(&draws[..4], 2, &[(1, &[0, 1]), (2, &[2, 3])]);
        check(
            &draws,
            1,
            &[(0, &[0]), (1, &[1]), (2, &[2]), (3, &[3]), (4, &[4])],
        );
        check(&[], 2, &[]);
    }

    #[test]
    fn a_pose_shares_its_draws_out_evenly_and_one_with_fewer_has_one_motion() {
        let falling = |n: u8| -> Vec<(u8, Option<f64>)> {
            (0..n).map(|number| (0, Some(-f64::from(number)))).collect()
        };
        check(&falling(5), 2, &[(2, &[0, 1, 2]), (4, &[3, 4])]);
        check(&falling(7), 4, &[(6, &[0, 1, 2, 3, 4, 5, 6])]);
        check(&falling(3), 4, &[(2, &[0, 1, 2])]);
    }

    #[test]
    fn draws_compete_only_with_the_same_resting_pose() {
        let draws = [
            (0, Some(9.0)),
            (1, Some(9.0)),
            (0, Some(1.0)),
            (1, Some(1.0)),
        ];
        check(&draws, 2, &[(2, &[0, 2]), (3, &[1, 3])]);
    }

    #[test]
    fn a_draw_that_could_not_be_refined_is_chosen_only_among_its_like() {
        let draws = [(0, None), (0, Some(5.0)), (0, None), (0, None)];
        check(&draws, 2, &[(1, &[0, 1]), (2, &[2, 3])]);
    }
}
