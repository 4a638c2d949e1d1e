//! Options of the networks, their training and the adaptation.

use std::f64::consts::TAU;

use options::{OptionFaults, options};

/// Most points of an object: each is compared with every point of the hand.
const MAX_POINTS: usize = 100_000;
/// Widest layer, and most layers of one part.
const MAX_WIDTH: usize = 4096;
const MAX_LAYERS: usize = 8;
/// Most epochs, and motions per step.
const MAX_EPOCHS: usize = 1_000_000;
const MAX_BATCH: usize = 100_000;
/// Largest weight of a loss.
const MAX_WEIGHT: f64 = 1e9;
/// Reason for the bound [`MAX_WEIGHT`].
const SUMS: &str = "larger losses lose precision in a sum";
/// Reason for the bound [`MAX_WIDTH`].
const OF_WIDTHS: &str = "the number of weights grows with the square of a width";
/// Most steps of an adaptation.
const MAX_STEPS: usize = 1_000_000;
/// Widest jitter of a hand, in meters and radians.
const MAX_JITTER: f64 = 1.0;

/// Shapes of the networks.
#[options(also = Self::width_faults)]
#[derive(PartialEq)]
pub struct GraspNetworkConfig {
    /// Points of the object's surface that networks and losses see, the first ones: as many as a grasping function
    /// sees; published: 3000
    #[option(
        default = 512, range = 32..=MAX_POINTS,
        why = "each is compared with every point of the hand"
    )]
    pub points: usize,
    /// Layers of the four point networks, over object and hand of both networks; published: up to 1024, for a hundred
    /// times as many grasps
    #[option(default = vec![64, 128, 256])]
    pub point_widths: Vec<usize>,
    /// Layers of the encoder before the latent code; published: 1024, 512, 256
    #[option(default = vec![512, 256])]
    pub encoder_widths: Vec<usize>,
    /// Dimensions of the latent code: the published number
    #[option(default = 64, range = 1..=MAX_WIDTH, why = OF_WIDTHS)]
    pub latent_dim: usize,
    /// Layers of the decoder before the hand's numbers; published: 1024, 256
    #[option(default = vec![512, 256])]
    pub decoder_widths: Vec<usize>,
    /// Layers of the contact network over every point of the object, the first for each point alone; published: 64,
    /// 512, 256, 128
    #[option(default = vec![64, 128, 64])]
    pub contact_widths: Vec<usize>,
}

/// Training options of the networks.
#[options]
#[derive(PartialEq)]
pub struct GraspTrainingConfig {
    /// Passes over the demonstrated grasps that train the autoencoder: for 360 grasps 80 s of one core, with those of
    /// the contact network
    #[option(default = 40, range = 1..=MAX_EPOCHS, why = "each passes over all grasps")]
    pub epochs: usize,
    /// Passes over the demonstrated grasps that train the contact network: few, as every point of each is an
    /// example
    #[option(default = 8, range = 1..=MAX_EPOCHS, why = "each passes over all grasps")]
    pub contact_epochs: usize,
    /// Largest number of grasps in one step
    #[option(default = 8, range = 1..=MAX_BATCH, why = "all of them are in memory together")]
    pub batch: usize,
    /// Adam's learning rate at the start, which falls along half a cosine: a grasping function's;
    /// published: 1e-4, for a hundred times as many grasps
    #[option(
        default = 2e-3, range = 1e-9..=1.0,
        why = "larger steps than the weights themselves learn nothing"
    )]
    pub learning_rate: f64,
    /// Weight of the mean squared distance of the hand's surface points from the demonstrated ones (1/m²): 1 cm counts
    /// as much as a tenth of the spread of the hand's numbers
    #[option(default = 100.0, range = 0.0..=MAX_WEIGHT, why = SUMS)]
    pub points_weight: f64,
    /// Weight of the divergence of the latent codes (1/nat)
    #[option(default = 2e-3, range = 0.0..=MAX_WEIGHT, why = SUMS)]
    pub kl_weight: f64,
    /// Weight of contact, consistency and penetration together, which `terms` weighs against each other (1): less than
    /// the demonstrated grasps weigh
    #[option(default = 0.01, range = 0.0..=MAX_WEIGHT, why = SUMS)]
    pub terms_weight: f64,
    /// Object and hand are turned together about the vertical, by an angle from 0 to this (rad): all the way round, as
    /// a grasping function's are
    #[option(default = TAU, range = 0.0..=TAU, why = "a whole turn is all the way round")]
    pub turn_rad: f64,
    /// Standard deviation by which a hand is displaced for the contact network, along each axis (m): about the error of
    /// a sampled grasp
    #[option(
        default = 0.01, range = 0.0..=MAX_JITTER,
        why = "a hand that is far away touches nothing"
    )]
    pub jitter_m: f64,
    /// Standard deviation by which it is turned about each axis, and by which its joints are moved (rad): about the
    /// error of a sampled grasp
    #[option(
        default = 0.1, range = 0.0..=MAX_JITTER,
        why = "a hand that is far away touches nothing"
    )]
    pub jitter_rad: f64,
}

/// Options of the adaptation of a grasp.
#[options]
#[derive(PartialEq)]
pub struct AdaptationConfig {
    /// Steps of the optimizer, published: 300; 0: grasps as sampled
    #[option(default = 300, range = 0..=MAX_STEPS, why = "each compares hand and object")]
    pub steps: usize,
    /// Adam's learning rate on the hand's numbers (m, 1, rad); published: 6.25e-6, of gradient descent with momentum
    #[option(default = 1e-3, range = 1e-9..=1.0, why = "a step of a meter leaves the object")]
    pub learning_rate: f64,
    /// Steps between two predictions of the contact map; published: 1
    #[option(default = 10, range = 1..=MAX_STEPS, why = "a map is predicted once at least")]
    pub map_steps: usize,
}

/// Weights of the terms of a grasp's loss against each other, in training and adaptation.
#[options]
#[derive(PartialEq)]
pub struct TermWeights {
    /// Weight of the contact term (1): the published one
    #[option(default = 1.0, range = 0.0..=MAX_WEIGHT, why = SUMS)]
    pub contact: f64,
    /// Weight of the consistency term (1): the published one
    #[option(default = 1.0, range = 0.0..=MAX_WEIGHT, why = SUMS)]
    pub consistency: f64,
    /// Weight of the penetration term (1): the published one
    #[option(default = 7.0, range = 0.0..=MAX_WEIGHT, why = SUMS)]
    pub penetration: f64,
    /// Weight of the depth of the hand's points in the table (1): that of penetration
    #[option(default = 7.0, range = 0.0..=MAX_WEIGHT, why = SUMS)]
    pub table: f64,
    /// Weight of the squares of joint positions beyond their limits (1/rad²): a tenth of a radian counts as much as a
    /// prior 4 mm off the object
    #[option(default = 10.0, range = 0.0..=MAX_WEIGHT, why = SUMS)]
    pub limits: f64,
}

impl GraspNetworkConfig {
    fn width_faults(&self, faults: &mut OptionFaults) {
        for (key, widths, least) in [
            ("point_widths", &self.point_widths, 1),
            ("encoder_widths", &self.encoder_widths, 1),
            ("decoder_widths", &self.decoder_widths, 1),
            // One layer for each point, one that joins it with object and hand.
            ("contact_widths", &self.contact_widths, 2),
        ] {
            let is_width = |width: &usize| (1..=MAX_WIDTH).contains(width);
            if !(least..=MAX_LAYERS).contains(&widths.len()) || !widths.iter().all(is_width) {
                let problem = format!(
                    "is {widths:?}, and must be {least} to {MAX_LAYERS} widths from 1 to {MAX_WIDTH}: \
                     {OF_WIDTHS}"
                );
                faults.note(key, problem);
            }
        }
    }
}
