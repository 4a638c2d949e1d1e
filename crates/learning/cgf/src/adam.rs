//! The optimizer: Adam (Kingma and Ba 2015, algorithm 1).

use std::collections::BTreeMap;

use crate::{CgfError, precision::narrow, weights::Weights};

const BETA_1: f64 = 0.9;
const BETA_2: f64 = 0.999;
const EPSILON: f32 = 1e-8;

/// Adam with running moments per array.
#[derive(Debug, Clone, Default)]
pub(crate) struct Adam {
    step: i32,
    moments: BTreeMap<String, Vec<[f32; 2]>>,
}

impl Adam {
    /// Returns how many steps it has made.
    pub(crate) fn steps(&self) -> i32 {
        self.step
    }

    /// Returns the running means of the gradients and of their squares, under the arrays' names.
    pub(crate) fn moments(&self) -> [Weights; 2] {
        [0, 1].map(|which| {
            let mut moments = Weights::default();
            for (name, values) in &self.moments {
                let values: Vec<f32> = values.iter().map(|pair| pair[which]).collect();
                moments.set(name, &[values.len()], values);
            }
            moments
        })
    }

    /// Goes on after so many steps with these moments of arrays like `weights`.
    pub(crate) fn restore(
        &mut self,
        step: i32,
        [first, second]: [Weights; 2],
        weights: &Weights,
    ) -> Result<(), CgfError> {
        let mut moments = BTreeMap::new();
        for (name, array) in first.iter() {
            let (first, second) = (&array.values, &second.array(name)?.values);
            let expected = weights.array(name)?.values.len();
            if first.len() != expected || second.len() != expected {
                return Err(CgfError::Tensor {
                    name: name.to_owned(),
                    found: format!("{} and {} moments", first.len(), second.len()),
                    expected: format!("{expected} each"),
                });
            }
            let pairs = first.iter().zip(second).map(|(&m, &v)| [m, v]);
            moments.insert(name.to_owned(), pairs.collect());
        }
        *self = Self { step, moments };
        Ok(())
    }

    /// Moves every learned array that has a gradient.
    pub(crate) fn step(
        &mut self,
        weights: &mut Weights,
        gradients: &BTreeMap<String, Vec<f32>>,
        learning_rate: f64,
    ) {
        self.step += 1;
        let unbias_1 = 1.0 - BETA_1.powi(self.step);
        let unbias_2 = 1.0 - BETA_2.powi(self.step);
        let rate = narrow(learning_rate / unbias_1);
        let root = narrow(1.0 / unbias_2.sqrt());
        let [keep_1, keep_2] = [narrow(BETA_1), narrow(BETA_2)];
        let [take_1, take_2] = [narrow(1.0 - BETA_1), narrow(1.0 - BETA_2)];
        for (name, array) in weights.learned_mut() {
            let Some(gradient) = gradients.get(name) else {
                continue;
            };
            let moments = self
                .moments
                .entry(name.to_owned())
                .or_insert_with(|| vec![[0.0; 2]; gradient.len()]);
            for ((x, &g), [m, v]) in array.values.iter_mut().zip(gradient).zip(moments) {
                *m = keep_1 * *m + take_1 * g;
                *v = keep_2 * *v + take_2 * g * g;
                *x -= rate * *m / (v.sqrt() * root + EPSILON);
            }
        }
    }
}

/// Shortens all gradients together to the Euclidean length `max_norm` if they are longer
/// (Pascanu et al., *On the difficulty of training recurrent neural networks*, 2013, algorithm 1).
pub(crate) fn shorten(gradients: &mut BTreeMap<String, Vec<f32>>, max_norm: f64) {
    let squares: f64 = gradients
        .values()
        .flatten()
        .map(|&g| f64::from(g).powi(2))
        .sum();
    let factor = max_norm / squares.sqrt();
    if factor < 1.0 {
        for g in gradients.values_mut().flatten() {
            *g *= narrow(factor);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::{Adam, Weights, shorten};

    #[test]
    fn first_step_has_the_length_of_the_learning_rate() {
        let mut weights = Weights::default();
        weights.set("a", &[2], vec![1.0, 1.0]);
        let gradients = BTreeMap::from([("a".to_owned(), vec![3.0, -0.01])]);
        Adam::default().step(&mut weights, &gradients, 0.1);
        let values = &weights.array("a").unwrap().values;
        assert!(
            (values[0] - 0.9).abs() < 1e-5 && (values[1] - 1.1).abs() < 1e-5,
            "{values:?}"
        );
    }

    #[test]
    fn only_long_gradients_are_shortened() {
        let mut gradients =
            BTreeMap::from([("a".to_owned(), vec![3.0]), ("b".to_owned(), vec![4.0])]);
        shorten(&mut gradients, 10.0);
        assert_eq!(gradients["b"], [4.0]);
        shorten(&mut gradients, 1.0);
        assert!((gradients["a"][0] - 0.6).abs() < 1e-6 && (gradients["b"][0] - 0.8).abs() < 1e-6);
    }
}
