//! Scratch: timing and sharpness on made-up motions.
use std::{sync::Arc, time::Instant};
use cgf::*;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use robot::RobotModel;
use spatial::{Pose, Rest};

fn arg<T: std::str::FromStr>(name: &str, default: T) -> T {
    std::env::args().find_map(|a| a.strip_prefix(&format!("{name}=")).and_then(|v| v.parse().ok())).unwrap_or(default)
}
fn main() {
    let hand = Arc::new(RobotModel::from_urdf(&std::fs::read_to_string("data/robots/allegro_right.urdf").unwrap()).unwrap());
    let mut r = Random::new(1, 9);
    let (n_scenes, per) = (arg("scenes", 13usize), arg("per", 5usize));
    let mut set = TrainingSet { scenes: vec![], tracks: vec![] };
    for s in 0..n_scenes {
        let half = [0.02 + 0.06 * r.uniform(), 0.02 + 0.04 * r.uniform(), 0.03 + 0.09 * r.uniform()];
        let points_in_object = (0..2000).map(|k| {
            let (u, v) = (2.0 * r.uniform() - 1.0, 2.0 * r.uniform() - 1.0);
            let side = if k % 2 == 0 { 1.0 } else { -1.0 };
            let p = [[side, u, v], [u, side, v], [u, v, side]][k % 3];
            Point3::new(half[0] * p[0], half[1] * p[1], half[2] * p[2])
        }).collect();
        set.scenes.push(Scene { object: format!("o{s}"), rest: Rest { up_in_object: Vector3::z_axis(), height_m: half[2] }, points_in_object });
        for k in 0..per {
            let yaw = std::f64::consts::TAU * r.uniform();
            let tilt = 0.5 + 0.8 * r.uniform();
            let target = UnitQuaternion::from_euler_angles(0.0, tilt, yaw);
            let start = target * UnitQuaternion::from_scaled_axis(Vector3::new(r.normal(), r.normal(), r.normal()) * 0.3);
            let goal = Vector3::new(0.03 * r.normal(), 0.03 * r.normal(), half[2] * 2.0 + 0.05 + 0.03 * r.normal());
            let from = goal + Vector3::new(0.15 * r.normal(), 0.15 * r.normal(), 0.2 + 0.05 * r.normal());
            let q1: Vec<f64> = hand.joints().iter().map(|j| j.lower + (j.upper - j.lower) * (0.5 + 0.15 * r.normal())).collect();
            let q0: Vec<f64> = hand.joints().iter().map(|j| j.lower + (j.upper - j.lower) * (0.3 + 0.1 * r.normal())).collect();
            let n = 40 + r.index(30);
            let steps = (0..n).map(|i| {
                let x = i as f64 / (n - 1) as f64;
                let s = x * x * (3.0 - 2.0 * x);
                let s2 = x.powi(3);
                TimedGrasp { time_s: i as f64 / 30.0, grasp: Grasp {
                    table_from_palm: Pose::new(Isometry3::from_parts((from.lerp(&goal, s)).into(), start.slerp(&target, s))),
                    q_rad: q0.iter().zip(&q1).map(|(a, b)| a + s2 * (b - a)).collect() } }
            }).collect();
            set.tracks.push(Track { name: format!("{s}-{k}"), scene: s, steps });
        }
    }
    let list = |name: &str, d: &[usize]| -> Vec<usize> { let s: String = arg(name, String::new()); if s.is_empty() { d.to_vec() } else { s.split(',').map(|x| x.parse().unwrap()).collect() } };
    let network = NetworkConfig { points: arg("points", 512), point_widths: list("pw", &[64, 128, 256]), encoder_steps: 20, hand_widths: list("hw", &[256, 64]), encoder_widths: list("ew", &[256]), latent_dim: arg("latent", 16), decoder_widths: list("dw", &[512, 256]), activation: Activation::Silu };
    let training = TrainingConfig { epochs: arg("epochs", 300), batch: arg("batch", 32), learning_rate: arg("lr", 1e-3), schedule: if arg("sched", 0) == 0 { Schedule::Cosine } else { Schedule::Halving }, halving_epochs: 500, grasp_steps: 5, grasp_weight: arg("gw", 3.0), random_times: arg("rt", 20), augmentation: [Augmentation::None, Augmentation::Vertical, Augmentation::Any][arg("aug", 0usize)], outputs: Outputs::Standardized, q_weight: 1.0, origins_weight: arg("ow", 100.0), kl_weight: arg("kl", 1e-3), contact_weight: arg("cw", 0.0), fixed_statistics_after: arg("fix", 0.5), contact: Contact::TouchSurface, tips: ["link_3.0_tip", "link_7.0_tip", "link_11.0_tip", "link_15.0_tip"].map(str::to_owned).to_vec(), tip_radius_m: 0.012 };
    let start = Instant::now();
    let every = (training.epochs / 8).max(1);
    let cgf = train(&set, &hand, &network, &training, 7, |e, l| if e % every == 0 || e == 1 { println!("{e:5} {:6.1}s total {:.5} q {:.5} origins {:.2} mm kl {:.2} contact {:.2} mm", start.elapsed().as_secs_f64(), l.total, l.q, 1e3 * l.origins.sqrt(), l.kl, 1e3 * l.contact.sqrt()) }).unwrap();
    let d = &cgf.description().demonstrations;
    let mean = |f: fn(&GraspError) -> f64| d.iter().map(|d| f(&d.grasp_error)).sum::<f64>() / d.len() as f64;
    println!("mean code: {:.2} mm {:.2} deg {:.4} rad", 1e3 * mean(|e| e.position_m), mean(|e| e.rotation_rad).to_degrees(), mean(|e| e.joints_rad));
    let dev: Vec<f64> = (0..network.latent_dim).map(|k| d.iter().map(|d| d.latent_deviation[k]).sum::<f64>() / d.len() as f64).collect();
    println!("deviations {:.2?}", dev);
    for share in [0, 1] {
        let (mut p, mut a, mut j, mut n) = (vec![], vec![], vec![], 0);
        for (s, scene) in set.scenes.iter().enumerate() {
            let f = cgf.feature(scene).unwrap();
            let demos: Vec<_> = d.iter().filter(|d| d.object == scene.object).collect();
            let lat: Vec<Vec<f64>> = (0..100).map(|i| (0..network.latent_dim).map(|k| if share == 0 { r.normal() } else { let d = demos[i % demos.len()]; d.latent_mean[k] + d.latent_deviation[k] * r.normal() }).collect()).collect();
            for m in cgf.decode(&f, &lat, &[0.0]).unwrap() {
                let best = set.tracks.iter().filter(|t| t.scene == s).map(|t| GraspError::between(&m[0], &t.at(0.0))).min_by(|a, b| (a.position_m + 0.1 * a.rotation_rad + 0.1 * a.joints_rad).total_cmp(&(b.position_m + 0.1 * b.rotation_rad + 0.1 * b.joints_rad))).unwrap();
                p.push(1e3 * best.position_m); a.push(best.rotation_rad.to_degrees()); j.push(best.joints_rad); n += 1;
            }
        }
        let mut q = |v: &mut Vec<f64>| { v.sort_by(f64::total_cmp); format!("{:.3} {:.3} {:.3}", v[n / 10], v[n / 2], v[n * 9 / 10]) };
        println!("{} to nearest demo (10/50/90 %): mm {} deg {} rad {}", if share == 0 { "prior" } else { "posterior" }, q(&mut p), q(&mut a), q(&mut j));
    }
    println!("{:.1} s", start.elapsed().as_secs_f64());
}
