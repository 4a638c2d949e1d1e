//! Both networks are trained one after the other, on the last steps of demonstrations.

use std::{collections::BTreeMap, f64::consts::PI, sync::Arc};

use candle_core::Tensor;
use motion::HandState;
use nalgebra::{UnitQuaternion, Vector3};
use options::Options;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use spatial::{Pose, Table};

use super::{
    GraspDescription, GraspNetworkConfig, GraspNetworks, GraspTerms, GraspTrainingConfig,
    HandSurface, TermWeights,
    loss::{contact_map, grasp_loss},
    nearest::Cloud,
    networks::{self, CONTACT_NETS, GENERATOR_NETS, Tape, hand_cloud, point_inputs},
};
use crate::{
    CgfError, Normalization, RestingObject,
    adam::Adam,
    config::{InputFrame, Outputs},
    data::View,
    hand_numbers,
    loss::kl_divergence,
    network::constant,
    penetration::RowFunction,
    point_net::{self, Clouds, Measured, Statistics},
    precision::{narrow, narrow_all},
    random::Random,
    training::equal_chunks,
    weights::{WeightTensors, Weights},
};

/// Weight of the measured statistics in the update of the stored ones after every step.
const MOMENTUM: f32 = 0.1;
/// Share of the epochs after which the point networks' statistics stay, as in a grasping function's training.
const FIXED_AFTER: f64 = 0.5;
/// Most grasps over which they are measured then.
const MEASURED_N: usize = 64;
/// Streams of the random numbers of the epochs of both networks.
const GENERATOR_EPOCHS: u64 = 1 << 32;
const CONTACT_EPOCHS: u64 = 2 << 32;

/// Grasps to learn from, and the objects that they hold.
#[derive(Debug, Clone, Default)]
pub struct GraspSet {
    /// Objects in their resting poses.
    pub objects: Vec<RestingObject>,
    /// The grasps.
    pub grasps: Vec<DemonstratedGrasp>,
}

/// A grasp that was demonstrated.
#[derive(Debug, Clone, PartialEq)]
pub struct DemonstratedGrasp {
    /// Index of the object that it holds, in the set.
    pub object: usize,
    /// The hand above the table, its joints in the hand's order.
    pub hand: HandState<Table>,
}

/// One pass over the demonstrated grasps: mean losses before they are weighted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspEpoch {
    /// Weighted sum.
    pub total: f64,
    /// Squared errors of the hand's numbers, in the network's units.
    pub numbers: f64,
    /// Squared distances of the hand's surface points, in m².
    pub points_m2: f64,
    /// Divergence of the latent codes from the standard normal, in nats.
    pub kl: f64,
    /// Contact, consistency with the demonstrated contact map, and penetration.
    pub terms: GraspTerms,
}

/// Options for training networks.
#[derive(Debug, Clone, PartialEq)]
pub struct GraspOptions {
    /// Their shapes.
    pub network: GraspNetworkConfig,
    /// Their training options.
    pub training: GraspTrainingConfig,
    /// Weights of contact, consistency and penetration against each other.
    pub terms: TermWeights,
}

/// A grasp as it is seen once: turned about the vertical with its object.
struct TurnedGrasp {
    object: Vec<f32>,
    points: Cloud,
    row: Vec<f32>,
    /// Positions of the hand's surface points, in meters.
    surface: Vec<[f32; 3]>,
    /// The contact map of the hand.
    map: Vec<f32>,
}

/// Trains both networks, and reports progress (share done) and the loss after each epoch.
///
/// # Errors
///
/// Fails if there are fewer than two grasps, an object has too few points, a hand has another number of joints, or a
/// loss is no longer a number.
pub fn train_grasps(
    set: &GraspSet,
    surface: &HandSurface,
    options: &GraspOptions,
    seed: u64,
    progress: &mut dyn FnMut(f64, &str),
) -> Result<GraspNetworks, CgfError> {
    let trainer = Trainer::new(set, surface, options)?;
    let GraspOptions {
        network, training, ..
    } = options;
    let mut weights = networks::initialize(network, surface.width(), seed);
    let epochs_n = (training.epochs + training.contact_epochs) as f64;
    let mut generator_curve = Vec::with_capacity(training.epochs);
    let mut tell = |epoch: &GraspEpoch| {
        generator_curve.push(*epoch);
        let share = generator_curve.len() as f64 / epochs_n;
        progress(share, &format!("generator, loss {:.4}", epoch.total));
    };
    trainer.fit(&GENERATOR, &mut weights, seed, &mut tell)?;
    let mut contact_curve = Vec::with_capacity(training.contact_epochs);
    let mut tell = |epoch: &GraspEpoch| {
        contact_curve.push(epoch.total);
        let share = (training.epochs + contact_curve.len()) as f64 / epochs_n;
        progress(share, &format!("contact network, loss {:.4}", epoch.total));
    };
    trainer.fit(&CONTACT, &mut weights, seed, &mut tell)?;
    let mut objects: Vec<String> = set.objects.iter().map(|one| one.object.clone()).collect();
    objects.sort();
    objects.dedup();
    let description = GraspDescription {
        version: schemas::grasp_networks::VERSION.to_owned(),
        joints: surface.hand.joint_names(),
        network: network.clone(),
        training: training.clone(),
        seed,
        normalization: trainer.normalization,
        objects,
        grasps: set.grasps.len(),
        generator_curve,
        contact_curve,
    };
    GraspNetworks::new(description, weights)
}

/// Computes the loss of a batch.
type PhaseLoss =
    fn(&Trainer, &Tape, &[TurnedGrasp], Statistics, &mut Random) -> Result<Loss, CgfError>;

/// Differences between the trainings of the two networks.
struct Phase {
    nets: [&'static str; 2],
    stream: u64,
    epochs: fn(&GraspTrainingConfig) -> usize,
    loss: PhaseLoss,
}

const GENERATOR: Phase = Phase {
    nets: GENERATOR_NETS,
    stream: GENERATOR_EPOCHS,
    epochs: |training| training.epochs,
    loss: |trainer, tape, seen, statistics, random| {
        trainer.generator_loss(tape, seen, statistics, random)
    },
};
const CONTACT: Phase = Phase {
    nets: CONTACT_NETS,
    stream: CONTACT_EPOCHS,
    epochs: |training| training.contact_epochs,
    loss: |trainer, tape, seen, statistics, random| {
        trainer.contact_loss(tape, seen, statistics, random)
    },
};

/// The loss of a batch, on the tape and in numbers, and the statistics that the point networks measured.
struct Loss {
    total: Tensor,
    epoch: GraspEpoch,
    measured: Measured,
}

struct Trainer<'a> {
    set: &'a GraspSet,
    views: Vec<View>,
    surface: &'a HandSurface,
    network: &'a GraspNetworkConfig,
    training: &'a GraspTrainingConfig,
    terms: &'a TermWeights,
    normalization: Normalization,
}

impl<'a> Trainer<'a> {
    fn new(
        set: &'a GraspSet,
        surface: &'a HandSurface,
        options: &'a GraspOptions,
    ) -> Result<Self, CgfError> {
        let GraspOptions {
            network,
            training,
            terms,
        } = options;
        network.check()?;
        training.check()?;
        terms.check()?;
        let found = set.grasps.len();
        if found < 2 {
            return Err(CgfError::TooFewTrajectories { found });
        }
        let views = set.objects.iter();
        let views = views.map(|object| View::of(object, InputFrame::Resting));
        let rows: Vec<Vec<f64>> = set
            .grasps
            .iter()
            .map(|one| hand_numbers::of(&one.hand))
            .collect();
        for (grasp, row) in set.grasps.iter().zip(&rows) {
            let name = || set.objects[grasp.object].object.clone();
            if row.len() != surface.width() {
                return Err(CgfError::WrongDof {
                    name: name(),
                    expected: surface.hand.dof(),
                    found: grasp.hand.q_rad.len(),
                });
            }
            if row.iter().any(|x| !x.is_finite()) {
                return Err(CgfError::NotFinite {
                    name: name(),
                    what: "a demonstrated hand",
                });
            }
        }
        Ok(Self {
            views: views.collect::<Result<_, _>>()?,
            normalization: Normalization::measure(Outputs::Standardized, &rows),
            set,
            surface,
            network,
            training,
            terms,
        })
    }

    /// Trains one of the networks.
    fn fit(
        &self,
        phase: &Phase,
        weights: &mut Weights,
        seed: u64,
        tell: &mut dyn FnMut(&GraspEpoch),
    ) -> Result<(), CgfError> {
        let mut random = Random::new(seed, phase.stream);
        self.center(phase, weights, &mut random)?;
        let epochs_n = (phase.epochs)(self.training);
        let mut adam = Adam::default();
        let mut statistics = Statistics::Measured;
        for number in 0..epochs_n {
            let mut random = Random::new(seed, phase.stream + 1 + number as u64);
            let share = number as f64 / epochs_n as f64;
            if statistics == Statistics::Measured && share >= FIXED_AFTER {
                self.fix_statistics(phase, weights, &mut random)?;
                statistics = Statistics::Stored;
            }
            let rate = self.training.learning_rate * 0.5 * (1.0 + (PI * share).cos());
            let order = random.permutation(self.set.grasps.len());
            let mut epoch = GraspEpoch::default();
            for chunk in equal_chunks(&order, self.training.batch) {
                let batch = self.seen(chunk, &mut random);
                let leaves = weights.variables(&candle_core::Device::Cpu)?;
                let tape = self.tape(&leaves);
                let loss = (phase.loss)(self, &tape, &batch, statistics, &mut random)?;
                epoch.add(&loss.epoch, chunk.len() as f64 / order.len() as f64);
                if !loss.epoch.total.is_finite() {
                    return Err(CgfError::Diverged {
                        epoch: number + 1,
                        loss: narrow(loss.epoch.total),
                    });
                }
                let by = loss.total.backward()?;
                let mut gradients = BTreeMap::new();
                for (name, variable) in &leaves {
                    if let Some(gradient) = by.get(variable) {
                        gradients.insert(name.clone(), gradient.flatten_all()?.to_vec1()?);
                    }
                }
                adam.step(weights, &gradients, rate);
                if statistics == Statistics::Measured {
                    point_net::store(&loss.measured, MOMENTUM, weights)?;
                }
            }
            tell(&epoch);
        }
        Ok(())
    }

    fn tape<'t>(&'t self, leaves: &'t WeightTensors) -> Tape<'t> {
        Tape {
            config: self.network,
            leaves,
        }
    }

    /// Starts with features of mean 0.
    fn center(
        &self,
        phase: &Phase,
        weights: &mut Weights,
        random: &mut Random,
    ) -> Result<(), CgfError> {
        let clouds = self.some_clouds(random);
        for (prefix, clouds) in phase.nets.iter().zip(clouds) {
            let mut net = weights.part(prefix);
            point_net::center(&mut net, self.network.point_widths.len(), &clouds)?;
            weights.add_part(prefix, net);
        }
        Ok(())
    }

    /// Measures the point networks' statistics once and for all.
    fn fix_statistics(
        &self,
        phase: &Phase,
        weights: &mut Weights,
        random: &mut Random,
    ) -> Result<(), CgfError> {
        let clouds = self.some_clouds(random);
        let leaves = weights.constants()?;
        for (prefix, clouds) in phase.nets.iter().zip(clouds) {
            let tape = self.tape(&leaves);
            let (_, measured) = tape.features(prefix, &clouds, Statistics::Measured)?;
            point_net::store(&measured, 1.0, weights)?;
        }
        Ok(())
    }

    /// Returns the clouds of objects and hands of some grasps.
    fn some_clouds(&self, random: &mut Random) -> [Arc<Clouds>; 2] {
        let mut some = random.permutation(self.set.grasps.len());
        some.truncate(MEASURED_N);
        let seen = self.seen(&some, random);
        [self.object_clouds(&seen), self.hand_clouds(&seen)]
    }

    fn object_clouds(&self, seen: &[TurnedGrasp]) -> Arc<Clouds> {
        Arc::new(Clouds {
            points: self.network.points,
            xyz: seen.iter().flat_map(|one| &one.object).copied().collect(),
        })
    }

    fn hand_clouds(&self, seen: &[TurnedGrasp]) -> Arc<Clouds> {
        Arc::new(Clouds {
            points: self.surface.len(),
            xyz: seen.iter().flat_map(|one| one.surface.concat()).collect(),
        })
    }

    /// Turns grasps and their objects about the vertical, each by an angle of its own.
    fn seen(&self, grasps: &[usize], random: &mut Random) -> Vec<TurnedGrasp> {
        let turns: Vec<(usize, f64)> = grasps
            .iter()
            .map(|&grasp| (grasp, self.training.turn_rad * random.uniform()))
            .collect();
        let seen = |&(grasp, angle): &(usize, f64)| {
            let grasp = &self.set.grasps[grasp];
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            let object = self.views[grasp.object].cloud(self.network.points, &turn);
            let turned: Pose<Table, Table> = Pose::from_parts([0.0; 3], turn);
            let row = narrow_all(&hand_numbers::of(&grasp.hand.clone().expressed_in(&turned)));
            let points = Cloud::new(&object);
            let hand = self.surface.placed(&row);
            let (_, map) = contact_map(&points, &hand);
            TurnedGrasp {
                surface: hand.narrowed(),
                map: narrow_all(&map),
                object,
                points,
                row,
            }
        };
        turns.par_iter().map(seen).collect()
    }

    /// Encodes grasps, decodes them again, and compares hands and contacts.
    fn generator_loss(
        &self,
        tape: &Tape,
        seen: &[TurnedGrasp],
        statistics: Statistics,
        random: &mut Random,
    ) -> Result<Loss, CgfError> {
        let (batch, width) = (seen.len(), self.surface.width());
        let nets = GENERATOR_NETS;
        let (object, mut measured) =
            tape.features(nets[0], &self.object_clouds(seen), statistics)?;
        let (hand, of_hand) = tape.features(nets[1], &self.hand_clouds(seen), statistics)?;
        measured.extend(of_hand);
        let (mean, log_variance) = tape.encode(&object, &hand)?;
        let noise = (0..batch * self.network.latent_dim).map(|_| narrow(random.normal()));
        let noise = constant(noise.collect(), &[batch, self.network.latent_dim])?;
        let latents = (&mean + ((&log_variance * 0.5)?.exp()? * noise)?)?;
        let decoded = tape.decode(&latents, &object)?;
        let wanted = seen.iter().flat_map(|one| {
            let row: Vec<f64> = one.row.iter().copied().map(f64::from).collect();
            self.normalization.normalize(&row)
        });
        let wanted = constant(wanted.collect(), &[batch, width])?;
        let numbers = (&decoded - wanted)?.sqr()?.mean_all()?;
        let kl = kl_divergence(&mean, &log_variance)?;
        let units = |values: &[f64]| constant(narrow_all(values), &[width]);
        let rows = decoded
            .broadcast_mul(&units(&self.normalization.scale)?)?
            .broadcast_add(&units(&self.normalization.mean)?)?;
        let (physical, points_m2, terms) = self.physical(&rows, seen)?;
        let total = ((&numbers + (&kl * self.training.kl_weight)?)? + physical)?;
        let number = |scalar: &Tensor| Ok::<_, CgfError>(f64::from(scalar.to_scalar::<f32>()?));
        Ok(Loss {
            epoch: GraspEpoch {
                total: number(&total)?,
                numbers: number(&numbers)?,
                points_m2,
                kl: number(&kl)?,
                terms,
            },
            total,
            measured,
        })
    }

    /// Compares the surface points of hands with the demonstrated ones, and their contacts: the weighted mean, with its
    /// gradient by `rows`, `(batch, 9 + dof)`, and the means of its parts.
    fn physical(
        &self,
        rows: &Tensor,
        seen: &[TurnedGrasp],
    ) -> Result<(Tensor, f64, GraspTerms), CgfError> {
        let width = self.surface.width();
        let numbers = rows.flatten_all()?.to_vec1::<f32>()?;
        let one = |(row, seen): (&[f32], &TurnedGrasp)| {
            let mut gradient = vec![0.0; width];
            let (object, map) = (&seen.points, &seen.map);
            let terms = grasp_loss(self.surface, self.terms, row, object, map, &mut gradient);
            for by in &mut gradient {
                *by *= narrow(self.training.terms_weight);
            }
            let points_m2 = self.points_error(row, seen, &mut gradient);
            (points_m2, terms, gradient)
        };
        let all: Vec<(f64, GraspTerms, Vec<f32>)> =
            numbers.par_chunks_exact(width).zip(seen).map(one).collect();
        let share = 1.0 / all.len() as f64;
        let (mut points_m2, mut terms) = (0.0, GraspTerms::default());
        let mut values = Vec::with_capacity(all.len());
        for (one_m2, one, _) in &all {
            points_m2 += share * one_m2;
            terms.add(one, share);
            let value =
                self.training.points_weight * one_m2 + self.training.terms_weight * one.total;
            values.push(narrow(value));
        }
        let known = RowFunction {
            values,
            gradients: all
                .into_iter()
                .flat_map(|(.., gradient)| gradient)
                .collect(),
            width,
        };
        let mean = rows.contiguous()?.apply_op1(known)?.mean_all()?;
        Ok((mean, points_m2, terms))
    }

    /// Returns the mean squared distance of a hand's surface points from the demonstrated ones, in m², and adds its
    /// weighted gradient.
    fn points_error(&self, row: &[f32], seen: &TurnedGrasp, gradient: &mut [f32]) -> f64 {
        let hand = self.surface.placed(row);
        let n = self.surface.len() as f64;
        let factor = 2.0 * self.training.points_weight / n;
        let mut sum = 0.0;
        let by_points: Vec<Vector3<f64>> = hand
            .points
            .iter()
            .zip(&seen.surface)
            .map(|(point, wanted)| {
                let off = point - Vector3::from(wanted.map(f64::from));
                sum += off.norm_squared();
                off * factor
            })
            .collect();
        let mut by_row = vec![0.0; row.len()];
        hand.gradient(&by_points, &mut by_row);
        for (sum, by) in gradient.iter_mut().zip(by_row) {
            *sum += by;
        }
        sum / n
    }

    /// Predicts the contact maps of demonstrated hands from hands that are displaced.
    fn contact_loss(
        &self,
        tape: &Tape,
        seen: &[TurnedGrasp],
        statistics: Statistics,
        random: &mut Random,
    ) -> Result<Loss, CgfError> {
        let displaced: Vec<Vec<f32>> = seen
            .iter()
            .map(|one| self.displaced(&one.row, random))
            .collect();
        let looked: Vec<(Vec<f32>, Vec<f32>)> = displaced
            .par_iter()
            .zip(seen)
            .map(|(row, one)| {
                let hand = self.surface.placed(row);
                let (nearest, map) = contact_map(&one.points, &hand);
                let inputs = point_inputs(&one.points, &hand, &nearest, &map);
                (inputs, hand_cloud(&hand))
            })
            .collect();
        let (inputs, hands): (Vec<_>, Vec<_>) = looked.into_iter().unzip();
        let rows = seen.len() * self.network.points;
        let inputs = inputs.concat();
        let inputs_n = inputs.len() / rows;
        let inputs = constant(inputs, &[rows, inputs_n])?;
        let hands = Arc::new(Clouds {
            points: self.surface.len(),
            xyz: hands.concat(),
        });
        let nets = CONTACT_NETS;
        let (object, mut measured) =
            tape.features(nets[0], &self.object_clouds(seen), statistics)?;
        let (hand, of_hand) = tape.features(nets[1], &hands, statistics)?;
        measured.extend(of_hand);
        let predicted = tape.contact_map(&inputs, &object, &hand)?;
        let wanted = seen.iter().flat_map(|one| &one.map).copied().collect();
        let wanted = constant(wanted, &[seen.len(), self.network.points])?;
        let total = (predicted - wanted)?.sqr()?.mean_all()?;
        Ok(Loss {
            epoch: GraspEpoch {
                total: f64::from(total.to_scalar::<f32>()?),
                ..GraspEpoch::default()
            },
            total,
            measured,
        })
    }

    /// Displaces a hand, turns it about its palm and moves its joints, all at random.
    fn displaced(&self, row: &[f32], random: &mut Random) -> Vec<f32> {
        let numbers: Vec<f64> = row.iter().copied().map(f64::from).collect();
        let Some(mut hand) = hand_numbers::to_hand::<Table>(&numbers) else {
            return row.to_vec();
        };
        let (jitter_m, jitter_rad) = (self.training.jitter_m, self.training.jitter_rad);
        let way = Vector3::from_fn(|_, _| jitter_m * random.normal());
        let turn = Vector3::from_fn(|_, _| jitter_rad * random.normal());
        let pose = &hand.frame_from_palm;
        hand.frame_from_palm = Pose::from_parts(
            pose.translation.vector + way,
            UnitQuaternion::from_scaled_axis(turn) * pose.rotation,
        );
        for (q, joint) in hand.q_rad.iter_mut().zip(self.surface.hand.joints()) {
            *q = joint.clamp(*q + jitter_rad * random.normal());
        }
        narrow_all(&hand_numbers::of(&hand))
    }
}

impl GraspEpoch {
    fn add(&mut self, other: &Self, share: f64) {
        self.total += share * other.total;
        self.numbers += share * other.numbers;
        self.points_m2 += share * other.points_m2;
        self.kl += share * other.kl;
        self.terms.add(&other.terms, share);
    }
}

impl GraspTerms {
    fn add(&mut self, other: &Self, share: f64) {
        self.total += share * other.total;
        self.contact += share * other.contact;
        self.consistency += share * other.consistency;
        self.penetration += share * other.penetration;
        self.table += share * other.table;
        self.limits += share * other.limits;
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;
    use crate::grasp_tta::{Adaptation, AdaptationConfig, TermWeights, fixture};

    fn options() -> GraspOptions {
        GraspOptions {
            network: GraspNetworkConfig {
                points: 64,
                point_widths: vec![8, 16],
                encoder_widths: vec![16],
                latent_dim: 3,
                decoder_widths: vec![16],
                contact_widths: vec![8, 16, 8],
            },
            training: GraspTrainingConfig {
                epochs: 60,
                contact_epochs: 20,
                batch: 4,
                learning_rate: 5e-3,
                ..GraspTrainingConfig::default()
            },
            terms: TermWeights::default(),
        }
    }

    /// Returns eight grasps that come near the cube from above, each from a side of its own.
    fn set() -> GraspSet {
        let grasp = |number: u32| {
            let angle = f64::from(number) * 0.7;
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            DemonstratedGrasp {
                object: 0,
                hand: HandState {
                    frame_from_palm: Pose::from_parts([0.0, 0.0, 0.03], turn),
                    q_rad: vec![0.1, 0.03],
                },
            }
        };
        GraspSet {
            objects: vec![fixture::resting()],
            grasps: (0..8).map(grasp).collect(),
        }
    }

    #[test]
    fn a_loss_over_hands_has_the_gradient_of_its_value() {
        let (surface, options, set) = (fixture::surface(), options(), set());
        let trainer = Trainer::new(&set, &surface, &options).unwrap();
        let seen = trainer.seen(&[0, 1], &mut Random::new(1, 0));
        let row = fixture::row();
        let at = [row.clone(), row.iter().map(|x| x + 0.003).collect()].concat();
        let value = |at: &[f32]| {
            let var = Var::from_slice(at, (2, row.len()), &Device::Cpu).unwrap();
            let (mean, ..) = trainer.physical(var.as_tensor(), &seen).unwrap();
            (mean, var)
        };
        let (mean, var) = value(&at);
        let by = mean.backward().unwrap();
        let found = by
            .get(&var)
            .unwrap()
            .flatten_all()
            .unwrap()
            .to_vec1::<f32>()
            .unwrap();
        let largest = found.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
        for k in 0..at.len() {
            let moved = |by: f32| {
                let mut moved = at.clone();
                moved[k] += by;
                value(&moved).0.to_scalar::<f32>().unwrap()
            };
            let h = 2e-4;
            let expected = (moved(h) - moved(-h)) / (2.0 * h);
            assert!(
                (expected - found[k]).abs() < 0.05 * largest,
                "{k}: {expected} {}",
                found[k]
            );
        }
    }

    #[test]
    fn both_networks_learn_and_adapted_grasps_cost_less() {
        let (surface, options, set) = (fixture::surface(), options(), set());
        let mut told = Vec::new();
        let mut progress = |share: f64, _: &str| told.push(share);
        let networks = train_grasps(&set, &surface, &options, 3, &mut progress).unwrap();
        assert_eq!((told.len(), told.last()), (80, Some(&1.0)));
        let description = networks.description();
        let curve = &description.generator_curve;
        let (first, last) = (curve[0], curve[curve.len() - 1]);
        assert!(last.total < 0.5 * first.total, "{first:?} {last:?}");
        let contact = &description.contact_curve;
        assert!(contact[19] < 0.8 * contact[0], "{contact:?}");
        let adaptation = |steps| Adaptation {
            config: AdaptationConfig {
                steps,
                ..AdaptationConfig::default()
            },
            terms: TermWeights::default(),
        };
        let latents = vec![vec![0.5, -0.5, 1.0], vec![-1.0, 0.0, 0.3]];
        let grasps = |steps| {
            let object = fixture::resting();
            networks
                .grasps(&object, &surface, &latents, &adaptation(steps))
                .unwrap()
        };
        let (drawn, adapted) = (grasps(0), grasps(50));
        for (drawn, adapted) in drawn.iter().zip(&adapted) {
            assert_eq!(drawn.drawn, drawn.adapted);
            assert_eq!(drawn.drawn, adapted.drawn);
            assert!(adapted.adapted.total < drawn.adapted.total, "{adapted:?}");
        }
    }

    #[test]
    fn networks_are_read_as_they_were_written_and_refused_for_another_hand() {
        let (surface, mut options, set) = (fixture::surface(), options(), set());
        (options.training.epochs, options.training.contact_epochs) = (1, 1);
        let networks = train_grasps(&set, &surface, &options, 3, &mut |_, _| {}).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let [weights, description] = ["w", "d"].map(|name| folder.path().join(name));
        networks.save(&weights, &description).unwrap();
        let joints = surface.hand.joint_names();
        let read = GraspNetworks::load(&weights, &description, &joints).unwrap();
        assert_eq!(read.description(), networks.description());
        assert!(read.weights == networks.weights);
        let other = GraspNetworks::load(&weights, &description, &joints[..1]);
        assert!(matches!(other, Err(CgfError::AnotherHand { .. })));
        std::fs::write(&weights, b"none").unwrap();
        let damaged = GraspNetworks::load(&weights, &description, &joints);
        assert!(matches!(damaged, Err(CgfError::Weights(_))));
    }

    #[test]
    fn one_grasp_or_one_of_another_hand_is_not_learned_from() {
        let (surface, options, mut set) = (fixture::surface(), options(), set());
        set.grasps[3].hand.q_rad.push(0.0);
        let wrong = train_grasps(&set, &surface, &options, 3, &mut |_, _| {});
        assert!(matches!(wrong, Err(CgfError::WrongDof { .. })));
        set.grasps.truncate(1);
        let few = train_grasps(&set, &surface, &options, 3, &mut |_, _| {});
        assert!(matches!(
            few,
            Err(CgfError::TooFewTrajectories { found: 1 })
        ));
    }
}
