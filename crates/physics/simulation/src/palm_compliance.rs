//! A palm that contact pushes off its path.

use nalgebra::{UnitQuaternion, Vector3};
use spatial::{Palm, Pose};

use crate::{
    config::{PalmComplianceConfig, SceneConfig},
    contact::{self, PalmLoad},
    hand::HandBodies,
    units::{EngineFrame, engine_pose, real},
    world::World,
};

/// A palm on its path, and how far contact has pushed it off it.
///
/// In each physics step the palm's displacement and rotation are integrated with the load of the step before. The
/// engine's contacts, of 60 Hz and critical damping, resist a palm's velocity by 750 Ns/m for each kilogram of the object:
/// in a step of 4 ms they take away less than the velocity that it has as long as the object is lighter than the
/// effective mass, and no filter is needed.
#[derive(Debug, Clone)]
pub(crate) struct CompliantPalm {
    config: PalmComplianceConfig,
    /// Pose on the path at the end of the latest physics step.
    on_path: Pose<EngineFrame, Palm>,
    /// Displacement from the path, along the engine's axes.
    displacement: Deviation,
    /// Rotation vector from the path, along the engine's axes.
    rotation: Deviation,
}

/// Deviation from a path and its rate, in m and m/s or in rad and rad/s.
#[derive(Debug, Clone, Copy)]
struct Deviation {
    position: Vector3<f64>,
    rate: Vector3<f64>,
}

/// A spring and a damper with a limited effort, in meters, newtons and kilograms, or in radians, newton meters and kg m².
struct Holder {
    stiffness: f64,
    damping: f64,
    limit: f64,
    inertia: f64,
}

impl CompliantPalm {
    /// Takes a palm at rest on its path; none where the scene's palm does not yield.
    pub(crate) fn at_rest(
        scene: &SceneConfig,
        engine_from_palm: Pose<EngineFrame, Palm>,
    ) -> Option<Self> {
        Some(Self {
            config: scene.palm_compliance?,
            on_path: engine_from_palm,
            displacement: Deviation::NONE,
            rotation: Deviation::NONE,
        })
    }

    /// Moves a hand for the first of `steps_left` physics steps, at whose end the path is at `end`.
    pub(crate) fn move_hand(
        &mut self,
        world: &mut World,
        hand: &HandBodies,
        end: &Pose<EngineFrame, Palm>,
        steps_left: usize,
    ) {
        self.continue_path(end, steps_left);
        let load = contact::load_on_palm(world, &hand.engine_from_palm(world));
        let step_s = world.step_s();
        self.yield_to(&load, step_s);
        let turn = UnitQuaternion::from_scaled_axis(self.rotation.position);
        let engine_from_palm: Pose<EngineFrame, Palm> = Pose::from_parts(
            self.on_path.translation.vector + self.displacement.position,
            turn * self.on_path.rotation,
        );
        hand.move_palm_in_engine(world, &engine_pose(&engine_from_palm), real(step_s));
    }

    /// Whether it is too far off its path.
    pub(crate) fn is_overloaded(&self) -> bool {
        self.displacement.position.norm() > self.config.max_deviation_m
            || self.rotation.position.norm() > self.config.max_deviation_rad
    }

    /// Goes on for one of `steps_left` even steps to the `end`.
    fn continue_path(&mut self, end: &Pose<EngineFrame, Palm>, steps_left: usize) {
        let (from, share) = (&self.on_path, 1.0 / steps_left as f64);
        let way = end.translation.vector - from.translation.vector;
        let turn = (end.rotation * from.rotation.inverse()).scaled_axis();
        self.on_path = Pose::from_parts(
            from.translation.vector + share * way,
            UnitQuaternion::from_scaled_axis(share * turn) * from.rotation,
        );
    }

    fn yield_to(&mut self, load: &PalmLoad, step_s: f64) {
        let config = &self.config;
        let along = Holder {
            stiffness: config.stiffness_n_per_m,
            damping: config.damping_ns_per_m,
            limit: config.force_limit_n,
            inertia: config.mass_kg,
        };
        let about = Holder {
            stiffness: config.stiffness_nm_per_rad,
            damping: config.damping_nms_per_rad,
            limit: config.torque_limit_nm,
            inertia: config.inertia_kg_m2,
        };
        self.displacement = along.integrate(self.displacement, &load.force_n, step_s);
        self.rotation = about.integrate(self.rotation, &load.torque_nm, step_s);
    }
}

impl Deviation {
    const NONE: Self = Self {
        position: Vector3::new(0.0, 0.0, 0.0),
        rate: Vector3::new(0.0, 0.0, 0.0),
    };
}

impl Holder {
    /// Returns a deviation one physics step later, by implicit Euler: the effort is that at the step's end, within its
    /// limit.
    fn integrate(&self, now: Deviation, load: &Vector3<f64>, step_s: f64) -> Deviation {
        let Deviation { position, rate } = now;
        let opposing = self.damping + self.stiffness * step_s;
        let unlimited = (self.inertia * rate + step_s * (load - self.stiffness * position))
            / (self.inertia + step_s * opposing);
        let effort =
            ((unlimited - rate) * (self.inertia / step_s) - load).cap_magnitude(self.limit);
        let rate = rate + (load + effort) * (step_s / self.inertia);
        Deviation {
            position: position + step_s * rate,
            rate,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    const STEP_S: f64 = 0.004;

    /// Lets a constant load act on a palm at rest; returns its deviations after each physics step.
    fn pushed(load: PalmLoad, steps_n: usize) -> Vec<[Deviation; 2]> {
        let scene = SceneConfig {
            palm_compliance: Some(PalmComplianceConfig::default()),
            ..fixture::scene()
        };
        let mut palm = CompliantPalm::at_rest(&scene, Pose::identity()).unwrap();
        let mut step = || {
            palm.yield_to(&load, STEP_S);
            [palm.displacement, palm.rotation]
        };
        (0..steps_n).map(|_| step()).collect()
    }

    #[test]
    fn a_load_below_the_limits_displaces_by_load_over_stiffness() {
        let load = PalmLoad {
            force_n: Vector3::new(0.0, -20.0, 40.0),
            torque_nm: Vector3::new(6.0, 3.0, -6.0),
        };
        let course = pushed(load, 250);
        let config = PalmComplianceConfig::default();
        let [displacement, rotation] = course.last().unwrap();
        let expected_m = load.force_n / config.stiffness_n_per_m;
        let expected_rad = load.torque_nm / config.stiffness_nm_per_rad;
        assert!((displacement.position - expected_m).norm() < 1e-6);
        assert!((rotation.position - expected_rad).norm() < 1e-6);
        // Critical damping: it never goes beyond.
        for [displacement, rotation] in &course {
            assert!(displacement.position.norm() < 1.001 * expected_m.norm());
            assert!(rotation.position.norm() < 1.001 * expected_rad.norm());
        }
    }

    #[test]
    fn a_load_above_the_limits_accelerates_by_the_excess_over_the_inertia() {
        let load = PalmLoad {
            force_n: Vector3::new(48.0, 64.0, 0.0),
            torque_nm: Vector3::new(0.0, 0.0, 15.0),
        };
        let config = PalmComplianceConfig::default();
        let course = pushed(load, 100);
        for two in course[50..].windows(2) {
            let rates = [0, 1].map(|which| (two[1][which].rate - two[0][which].rate) / STEP_S);
            let excess_n = Vector3::new(0.6, 0.8, 0.0) * (80.0 - config.force_limit_n);
            let excess_nm = Vector3::z() * (15.0 - config.torque_limit_nm);
            assert!(
                (rates[0] - excess_n / config.mass_kg).norm() < 1e-6,
                "{rates:?}"
            );
            assert!(
                (rates[1] - excess_nm / config.inertia_kg_m2).norm() < 1e-6,
                "{rates:?}"
            );
        }
    }

    #[test]
    fn the_path_between_two_control_steps_is_even() {
        let scene = SceneConfig {
            palm_compliance: Some(PalmComplianceConfig::default()),
            ..fixture::scene()
        };
        let mut palm = CompliantPalm::at_rest(&scene, Pose::identity()).unwrap();
        let turn = |angle: f64| UnitQuaternion::from_scaled_axis(Vector3::y() * angle);
        let end = Pose::from_parts([0.1, 0.0, 0.2], turn(1.0));
        for (steps_left, share) in [(4, 0.25), (3, 0.5), (2, 0.75), (1, 1.0), (4, 1.0)] {
            palm.continue_path(&end, steps_left);
            let on_path = palm.on_path;
            let expected = Vector3::new(0.1, 0.0, 0.2) * share;
            assert!((on_path.translation.vector - expected).norm() < 1e-12);
            assert!(on_path.rotation.angle_to(&turn(share)) < 1e-9);
        }
    }
}
