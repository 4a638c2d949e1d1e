//! How fast the retargeting solver is and how good its answers are.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

#[path = "retargeting/problem.rs"]
mod problem;

use std::time::Instant;

use nalgebra::Point3;
use problem::{HANDS, MOTION_WEIGHT, Problem};
use stage_retarget::solver::{NoTerms, Options, Outcome, Posture, Smoothness, Solver, Task, Wrist};

fn main() {
    for (name, urdf, least) in HANDS {
        match Problem::read(name, urdf) {
            Ok(problem) => run(&problem, least),
            Err(reason) => println!("{name}: skipped, {reason}"),
        }
    }
}

fn task<'a>(
    problem: &'a Problem,
    frame: usize,
    before: &'a Posture,
    points: &'a [Point3<f64>],
) -> Task<'a> {
    Task {
        targets: &problem.targets[frame],
        loss: Problem::loss(),
        smoothness: Some(Smoothness {
            points,
            point_weight: 0.0,
            posture: before,
            joint_weight: MOTION_WEIGHT,
            root_weight: MOTION_WEIGHT,
        }),
        rest: None,
    }
}

const FAST: Options = Options {
    tolerance: 1e-3,
    least_decrease: 1e-9,
    max_iterations: 60,
    wrist: Wrist::Moves,
};
const TIGHT: Options = Options {
    tolerance: 1e-12,
    least_decrease: 1e-18,
    max_iterations: 500,
    wrist: Wrist::Moves,
};

fn median(v: &mut [f64]) -> f64 {
    v.sort_by(f64::total_cmp);
    v[v.len() / 2]
}
fn mean(v: &[f64]) -> f64 {
    v.iter().sum::<f64>() / v.len() as f64
}

fn run(p: &Problem, _least: f64) {
    let points = vec![Point3::origin(); p.links.len()];
    let mut solver = Solver::new(&p.hand);
    let n = p.targets.len();
    let mut worst: f64 = 0.0;
    for i in 0..n {
        let f = solver
            .place(
                &task(p, i, &p.peer_before[i], &points),
                &p.peer[i],
                &mut NoTerms,
            )
            .unwrap();
        let _ = f;
        let unclamped = f - p.peer_objective[i];
        worst = worst.max(unclamped.abs());
    }
    println!(
        "{}: reproduces F within {worst:e}; peer mean {:.6}",
        p.name,
        mean(&p.peer_objective)
    );
    // frame by frame from the peer's last
    for (label, options) in [("fast", FAST), ("tight", TIGHT)] {
        let mut f = vec![];
        let mut its: Vec<f64> = vec![];
        let mut bad = 0;
        for i in 0..n {
            let before = &p.peer_before[i];
            let mut x = before.clone();
            let o: Outcome = solver
                .minimize(&task(p, i, before, &points), &mut x, &options, &mut NoTerms)
                .unwrap();
            f.push(o.cost);
            its.push(o.iterations as f64);
            if !o.converged {
                bad += 1;
            }
        }
        println!(
            "  from peer's last, {label}: mean F {:.7} iterations mean {:.2} median {} max {} unconverged {bad}",
            mean(&f),
            mean(&its),
            median(&mut its.clone()),
            its.iter().copied().fold(0.0, f64::max)
        );
    }
    for (label, options) in [("fast", FAST), ("tight", TIGHT)] {
        let mut f = vec![];
        let mut its: Vec<f64> = vec![];
        let mut us = vec![];
        let mut excess: f64 = 0.0;
        let mut path = vec![];
        for rep in 0..5 {
            let mut before = p.hand.within_limits(&p.peer_before[0]);
            f.clear();
            its.clear();
            path.clear();
            for i in 0..n {
                let mut x = before.clone();
                let t = Instant::now();
                let o = solver
                    .minimize(
                        &task(p, i, &before, &points),
                        &mut x,
                        &options,
                        &mut NoTerms,
                    )
                    .unwrap();
                let dt = t.elapsed().as_secs_f64() * 1e6;
                if rep > 0 {
                    us.push(dt);
                }
                f.push(o.cost);
                its.push(o.iterations as f64);
                excess = excess.max(p.excess_rad(&x));
                path.push(p.coordinates(&x));
                before = x;
            }
        }
        let ddq: Vec<f64> = path
            .windows(3)
            .map(|w| {
                (0..w[0].len())
                    .map(|k| (w[2][k] - 2.0 * w[1][k] + w[0][k]).powi(2))
                    .sum::<f64>()
                    .sqrt()
            })
            .collect();
        its.sort_by(f64::total_cmp);
        println!(
            "  sequence, {label}: mean F {:.7} us median {:.2} mean {:.2} iterations median {} mean {:.2} p95 {} p99 {} max {} excess {excess:e} ddq {:.4}",
            mean(&f),
            median(&mut us.clone()),
            mean(&us),
            its[n / 2],
            mean(&its),
            its[n * 95 / 100],
            its[n * 99 / 100],
            its[n - 1],
            mean(&ddq)
        );
    }
}
