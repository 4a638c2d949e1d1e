//! Follows a person's hand, frame by frame.

use posture::{NoTerms, Posture, RootMotion, RootPose, SearchOptions, SearchOutcome, Solver};

use crate::{
    LANDMARKS, Problem, ProblemError,
    aim::{Aim, Near},
};

/// When a search ends: where a further iteration would lower the objective by no more than 0.4 µm. Objectives are 0.5 mm
/// and more; of those of vectors, up to 0.3 m, most is out of reach, and a share of them would be too coarse.
const SEARCH: SearchOptions = SearchOptions {
    relative_tolerance: 0.0,
    min_decrease: 4e-7,
    max_iterations: 100,
    root_motion: RootMotion::Free,
};
/// A frame of a free hand that is followed worse than usual by this much, in meters, is searched afresh: the search may
/// have followed the motion into a poor minimum.
const SUSPICIOUS_ERROR_M: f64 = 0.010;
/// Frames within which a better minimum has to pay for the motion to it.
const PAYS_WITHIN: f64 = 4.0;
/// Share of a frame in the usual error.
const USUAL_SHARE: f64 = 0.02;

/// Follows a stream of frames: each is solved from the one before.
#[derive(Debug)]
pub struct Follower<'a> {
    problem: &'a Problem,
    solver: Solver<'a>,
    aim: Aim,
    /// The answer to the frame before, or where a stream starts.
    before: Posture,
    answer: Posture,
    /// What the filter returned, if there was a frame.
    filtered: Posture,
    has_filtered: bool,
    references: Vec<[f64; 3]>,
    errors_m: Vec<f64>,
    /// Running mean of the root mean square errors, in meters; 0 before the first frame.
    usual_error_m: f64,
}

/// The robot hand at a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Followed<'f> {
    /// The root link in the landmarks' frame, and the positions of the joints in the model's order; filtered.
    pub posture: &'f Posture,
    /// Distance of each point or vector from what it follows, before the filter, in meters.
    pub errors_m: &'f [f64],
    /// Their root mean square, in meters.
    pub error_m: f64,
    /// The objective before the filter, in meters.
    pub objective_m: f64,
    /// Postures tried.
    pub iterations: usize,
}

impl<'a> Follower<'a> {
    /// Returns a follower that has seen nothing yet.
    pub fn new(problem: &'a Problem) -> Self {
        Self {
            solver: Solver::new(&problem.hand),
            aim: Aim::new(&problem.objective),
            before: problem.start.clone(),
            answer: problem.start.clone(),
            filtered: problem.start.clone(),
            has_filtered: false,
            references: Vec::new(),
            errors_m: Vec::new(),
            usual_error_m: 0.0,
            problem,
        }
    }

    /// Returns the posture for the landmarks of a frame, in meters: the wrist; thumb, index, middle, ring and little
    /// finger, four each from base to tip.
    ///
    /// # Errors
    ///
    /// Fails if a landmark is not finite; the frame is forgotten.
    pub fn step(
        &mut self,
        landmarks_m: &[[f64; 3]; LANDMARKS],
    ) -> Result<Followed<'_>, ProblemError> {
        let mut references = std::mem::take(&mut self.references);
        let objective = &self.problem.objective;
        objective.references(landmarks_m, &mut references);
        let solved = self.solve(&references);
        self.references = references;
        let outcome = solved?;
        Ok(self.followed(&outcome))
    }

    /// Returns the posture for the library's own reference value: a point for each link, or a vector at the person's
    /// size for each pair of links, in meters.
    ///
    /// # Errors
    ///
    /// Fails if they are not as many as the objective follows, or a number is not finite; the frame is forgotten.
    pub fn step_reference(
        &mut self,
        references: &[[f64; 3]],
    ) -> Result<Followed<'_>, ProblemError> {
        let (found, expected) = (references.len(), self.problem.objective.reference_count());
        if found != expected {
            return Err(ProblemError::References { found, expected });
        }
        let outcome = self.solve(references)?;
        Ok(self.followed(&outcome))
    }

    /// Forgets the frames so far: the next one starts in the middle of the joints' ranges.
    pub fn reset(&mut self) {
        self.start_at(&self.problem.start.clone());
    }

    /// Forgets the frames so far: the next one starts at a posture, within limits.
    pub fn start_at(&mut self, posture: &Posture) {
        self.before = self.problem.hand.within_limits(posture);
        self.has_filtered = false;
        self.usual_error_m = 0.0;
        self.aim.reset();
    }

    /// Solves a frame.
    fn solve(&mut self, references: &[[f64; 3]]) -> Result<SearchOutcome, ProblemError> {
        let numbers = references.as_flattened();
        if !numbers.iter().sum::<f64>().is_finite() {
            return Err(ProblemError::NotFinite);
        }
        let objective = &self.problem.objective;
        self.aim.set(objective, references);
        let task = self.aim.task(objective, Near::Before(&self.before));
        let (solver, nothing) = (&mut self.solver, &mut NoTerms);
        self.answer.clone_from(&self.before);
        let mut outcome = solver.minimize(&task, &mut self.answer, &SEARCH, nothing)?;
        solver.place(&task, &self.answer, nothing)?;
        let ends = &self.problem.vectors;
        self.aim.measure(&solver.posed(), ends, &mut self.errors_m);
        if self.problem.has_free_root() {
            outcome = self.checked(outcome)?;
        }
        std::mem::swap(&mut self.before, &mut self.answer);
        Ok(outcome)
    }

    /// Searches a frame afresh that is followed far worse than usual, and takes what soon pays for the way there.
    fn checked(&mut self, mut outcome: SearchOutcome) -> Result<SearchOutcome, ProblemError> {
        let error_m = root_mean_square(&self.errors_m);
        if error_m <= self.usual_error_m + SUSPICIOUS_ERROR_M {
            self.usual_error_m += USUAL_SHARE * (error_m - self.usual_error_m);
            return Ok(outcome);
        }
        let followed = self.loss_m(None)?;
        if let Some((fresh, loss_m)) = self.afresh()? {
            let stayed = std::mem::replace(&mut self.answer, fresh);
            let motion_m = self.cost_m()? - loss_m;
            if motion_m > PAYS_WITHIN * (followed - loss_m) {
                self.answer = stayed;
            }
        }
        outcome.cost = self.cost_m()?;
        let ends = &self.problem.vectors;
        let posed = self.solver.posed();
        self.aim.measure(&posed, ends, &mut self.errors_m);
        // What no search betters is usual from here on.
        self.usual_error_m = root_mean_square(&self.errors_m);
        Ok(outcome)
    }

    /// Places the robot at the answer, and returns the objective.
    fn cost_m(&mut self) -> Result<f64, ProblemError> {
        let near = Near::Before(&self.before);
        let task = self.aim.task(&self.problem.objective, near);
        Ok(self.solver.place(&task, &self.answer, &mut NoTerms)?)
    }

    /// Places the robot at a posture, the answer where it is `None`, and returns the objective without motion.
    fn loss_m(&mut self, posture: Option<&Posture>) -> Result<f64, ProblemError> {
        let posture = posture.unwrap_or(&self.answer);
        let task = self
            .aim
            .task(&self.problem.objective, Near::Before(posture));
        Ok(self.solver.place(&task, posture, &mut NoTerms)?)
    }

    /// Searches a frame from several starts as if there were none before, and returns the posture of the least
    /// objective without motion, and that.
    fn afresh(&mut self) -> Result<Option<(Posture, f64)>, ProblemError> {
        let problem = self.problem;
        let rest = Near::Rest(&problem.start.q);
        let task = self.aim.task(&problem.objective, rest);
        let mut starts = self.solver.initial_postures(&task)?;
        for start in &mut starts {
            self.solver.minimize(&task, start, &SEARCH, &mut NoTerms)?;
        }
        let mut best: Option<(Posture, f64)> = None;
        for found in starts {
            let loss_m = self.loss_m(Some(&found))?;
            if best.as_ref().is_none_or(|&(_, least)| loss_m < least) {
                best = Some((found, loss_m));
            }
        }
        Ok(best)
    }

    /// Filters the answer.
    fn followed(&mut self, outcome: &SearchOutcome) -> Followed<'_> {
        match self.problem.low_pass_alpha {
            Some(alpha) if alpha < 1.0 && self.has_filtered => self.filter(alpha),
            Some(_) | None => self.filtered.clone_from(&self.before),
        }
        self.has_filtered = true;
        Followed {
            posture: &self.filtered,
            errors_m: &self.errors_m,
            error_m: root_mean_square(&self.errors_m),
            objective_m: outcome.cost,
            iterations: outcome.iterations,
        }
    }

    /// Takes what the filter returned a share of the way to the answer; angles of the root as numbers.
    fn filter(&mut self, alpha: f64) {
        let toward = |from: f64, to: f64| from + alpha * (to - from);
        for (from, &to) in self.filtered.q.iter_mut().zip(&self.before.q) {
            *from = toward(*from, to);
        }
        if self.problem.has_free_root() {
            let (from, to) = (&self.filtered.root, &self.before.root);
            let along = from.translation().zip_map(&to.translation(), toward);
            let angles = from.angles().zip_map(&to.angles(), toward);
            self.filtered.root = RootPose::from_angles(along, angles);
        }
    }
}

fn root_mean_square(errors_m: &[f64]) -> f64 {
    let squares: f64 = errors_m.iter().map(|error| error * error).sum();
    (squares / errors_m.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests;
