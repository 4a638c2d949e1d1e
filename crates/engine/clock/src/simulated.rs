//! Worlds of simulated processes: one thread runs at a time, and time passes only while all of them wait.

use std::{
    any::Any,
    cell::RefCell,
    collections::BTreeMap,
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant, SystemTime},
};

use crate::{threads::spawn, time::sleep};

thread_local! {
    /// The simulated thread that this one is.
    static HERE: RefCell<Option<Arc<Thread>>> = const { RefCell::new(None) };
}

/// Returns the simulated thread that this one is, if it is one.
pub(crate) fn here() -> Option<Arc<Thread>> {
    // None where a thread ends.
    HERE.try_with(|here| here.borrow().clone()).ok().flatten()
}

/// Does `work` as a simulated thread, or as none.
pub(crate) fn enter<R>(thread: Option<Arc<Thread>>, work: impl FnOnce() -> R) -> R {
    let before = HERE.replace(thread);
    let done = catch_unwind(AssertUnwindSafe(work));
    HERE.set(before);
    done.unwrap_or_else(|panic| resume_unwind(panic))
}

/// A world with a clock of its own, in which processes run.
pub struct World {
    clock: Arc<Clock>,
}

/// A simulated process.
pub struct Process {
    state: Arc<ProcessState>,
    clock: Arc<Clock>,
}

struct ProcessState {
    name: String,
    is_killed: AtomicBool,
    is_over: AtomicBool,
}

/// A thread of a simulated process.
pub(crate) struct Thread {
    clock: Arc<Clock>,
    process: Arc<ProcessState>,
    /// Whether it is this thread that runs.
    turn: Mutex<bool>,
    turned: Condvar,
    is_over: AtomicBool,
    /// When the answer must come that it waits for, and whether it has not.
    answer_by: Mutex<(Option<Duration>, bool)>,
}

struct Clock {
    state: Mutex<State>,
    began: (Instant, SystemTime),
}

/// State of a world.
struct State {
    /// Time since it began.
    now: Duration,
    /// The threads that wait, by the time until which they do and by number, each with what wakes it before.
    waiting: BTreeMap<(Duration, u64), (Arc<Thread>, Option<usize>)>,
    n_waits: u64,
    n_threads: usize,
    n_processes: u64,
    random: u64,
}

/// What unwinds a thread of a process that was killed.
struct Killed;

impl World {
    /// Runs `main` in a new world, then kills all processes that are left in it.
    pub fn simulate<R>(seed: u64, main: impl FnOnce(&Self) -> R) -> R {
        let clock = Arc::new(Clock::new(seed));
        let own = clock.process("world");
        let thread = Arc::new(Thread::new(&clock, &own));
        lock(&clock.state).n_threads = 1;
        let world = Self { clock };
        enter(Some(Arc::clone(&thread)), || {
            let done = catch_unwind(AssertUnwindSafe(|| main(&world)));
            world.clock.kill(|process| !Arc::ptr_eq(process, &own));
            while lock(&world.clock.state).n_threads > 1 {
                thread.sleep(Duration::from_millis(1));
                world.clock.kill(|process| !Arc::ptr_eq(process, &own));
            }
            done.unwrap_or_else(|panic| resume_unwind(panic))
        })
    }

    /// Starts a process on a machine; it ends with `main`, whatever its other threads do.
    pub fn start(&self, machine: &str, main: impl FnOnce() + Send + 'static) -> Process {
        let state = self.clock.process(machine);
        let thread = Arc::new(Thread::new(&self.clock, &state));
        let process = Process {
            state: Arc::clone(&state),
            clock: Arc::clone(&self.clock),
        };
        let ending = process.clone();
        enter(Some(thread), || {
            spawn(move || {
                let done = catch_unwind(AssertUnwindSafe(main));
                ending.state.is_over.store(true, Ordering::Relaxed);
                ending
                    .clock
                    .kill(|process| Arc::ptr_eq(process, &ending.state));
                done.unwrap_or_else(|panic| resume_unwind(panic));
            });
        });
        process
    }

    /// Returns the time since the world began.
    pub fn time(&self) -> Duration {
        lock(&self.clock.state).now
    }
}

impl Process {
    /// Returns its name, as [`crate::process`] gives it in the process.
    pub fn name(&self) -> &str {
        &self.state.name
    }

    /// Ends it at once.
    pub fn kill(&self) {
        self.state.is_over.store(true, Ordering::Relaxed);
        self.clock.kill(|process| Arc::ptr_eq(process, &self.state));
        // Its threads end before this one goes on.
        sleep(Duration::from_nanos(1));
    }

    /// Whether it has ended.
    pub fn is_over(&self) -> bool {
        self.state.is_over.load(Ordering::Relaxed)
    }

    fn clone(&self) -> Self {
        Self {
            state: Arc::clone(&self.state),
            clock: Arc::clone(&self.clock),
        }
    }
}

/// Waits for the simulated answer to a request that is [`watched`](crate::watched()); returns whether it came before
/// the patience was over.
///
/// # Panics
///
/// Panics outside of a world.
pub fn answer_after(time: Duration) -> bool {
    let here = here();
    assert!(here.is_some(), "answers are simulated in a world only");
    here.is_some_and(|here| here.answer_after(time))
}

impl Clock {
    fn new(seed: u64) -> Self {
        let state = State {
            now: Duration::ZERO,
            waiting: BTreeMap::new(),
            n_waits: 0,
            n_threads: 0,
            n_processes: 0,
            random: seed,
        };
        // A day that files of this day are older than.
        let day = SystemTime::UNIX_EPOCH + Duration::from_hours(24 * 365 * 100);
        Self {
            state: Mutex::new(state),
            began: (Instant::now(), day),
        }
    }

    fn process(&self, machine: &str) -> Arc<ProcessState> {
        let mut state = lock(&self.state);
        state.n_processes += 1;
        Arc::new(ProcessState {
            name: format!("{}-{}-{machine}", state.n_processes, state.now.as_nanos()),
            is_killed: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
        })
    }

    /// Kills processes: their threads unwind when it is their turn, which is next.
    fn kill(&self, is_one: impl Fn(&Arc<ProcessState>) -> bool) {
        let mut state = lock(&self.state);
        let waiting = std::mem::take(&mut state.waiting);
        for ((at, number), (thread, signal)) in waiting {
            let at = if is_one(&thread.process) {
                thread.process.is_killed.store(true, Ordering::Relaxed);
                state.now
            } else {
                at
            };
            state.waiting.insert((at, number), (thread, signal));
        }
    }

    /// Gives the turn to the thread that waits for the nearest time.
    fn pass_on(&self) {
        let mut state = lock(&self.state);
        let Some(((at, _), (next, _))) = state.waiting.pop_first() else {
            return;
        };
        state.now = state.now.max(at);
        drop(state);
        *lock(&next.turn) = true;
        next.turned.notify_one();
    }
}

impl Thread {
    fn new(clock: &Arc<Clock>, process: &Arc<ProcessState>) -> Self {
        Self {
            clock: Arc::clone(clock),
            process: Arc::clone(process),
            turn: Mutex::new(false),
            turned: Condvar::new(),
            is_over: AtomicBool::new(false),
            answer_by: Mutex::new((None, false)),
        }
    }

    pub(crate) fn now(&self) -> Instant {
        self.clock.began.0 + lock(&self.clock.state).now
    }

    pub(crate) fn wall(&self) -> SystemTime {
        self.clock.began.1 + lock(&self.clock.state).now
    }

    pub(crate) fn process(&self) -> String {
        self.process.name.clone()
    }

    /// A number of the generator `SplitMix64` (Steele, Lea and Flood, *Fast splittable pseudorandom number
    /// generators*, 2014).
    pub(crate) fn random(&self) -> u64 {
        let mut state = lock(&self.clock.state);
        state.random = state.random.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state.random;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Another thread of this process, which waits for its turn.
    pub(crate) fn sibling(self: &Arc<Self>) -> Arc<Self> {
        let sibling = Arc::new(Self::new(&self.clock, &self.process));
        let mut state = lock(&self.clock.state);
        state.n_threads += 1;
        let at = (state.now, state.next());
        state.waiting.insert(at, (Arc::clone(&sibling), None));
        sibling
    }

    /// Does `work` in a new thread of the machine.
    pub(crate) fn start(self: Arc<Self>, work: impl FnOnce() + Send + 'static) {
        thread::spawn(move || drop(self.run(work)));
    }

    /// Does `work` in this thread of the machine from its turn on, and gives the turn on.
    pub(crate) fn run(self: &Arc<Self>, work: impl FnOnce()) -> Result<(), Box<dyn Any + Send>> {
        self.wait_for_turn();
        let done = enter(Some(Arc::clone(self)), || {
            catch_unwind(AssertUnwindSafe(|| {
                self.check();
                work();
            }))
        });
        self.is_over.store(true, Ordering::Relaxed);
        lock(&self.clock.state).n_threads -= 1;
        self.clock.pass_on();
        done
    }

    /// Waits until these threads have ended, killed or not.
    pub(crate) fn join(&self, threads: &[Arc<Self>]) {
        const LOOK_EVERY: Duration = Duration::from_millis(1);
        while threads.iter().any(|it| !it.is_over.load(Ordering::Relaxed)) {
            self.sleep_even_if_killed(LOOK_EVERY);
        }
    }

    pub(crate) fn sleep(&self, time: Duration) {
        self.wait_for(time, None);
    }

    pub(crate) fn wait(&self, time: Duration, signal: usize) {
        self.wait_for(time, Some(signal));
    }

    pub(crate) fn notify(&self, signal: usize) {
        let mut state = lock(&self.clock.state);
        let is_one = |(_, by): &mut (Arc<Self>, Option<usize>)| *by == Some(signal);
        let woken: Vec<_> = state
            .waiting
            .extract_if(.., |_, thread| is_one(thread))
            .collect();
        for ((_, number), thread) in woken {
            let at = (state.now, number);
            state.waiting.insert(at, thread);
        }
    }

    fn wait_for(&self, time: Duration, signal: Option<usize>) {
        self.check();
        if !self.is_killed() {
            self.give_turn(time, signal);
            self.check();
        }
    }

    pub(crate) fn sleep_even_if_killed(&self, time: Duration) {
        self.give_turn(time, None);
    }

    fn give_turn(&self, time: Duration, signal: Option<usize>) {
        let Some(this) = here() else { return };
        let mut state = lock(&self.clock.state);
        let at = (state.now + time, state.next());
        state.waiting.insert(at, (this, signal));
        drop(state);
        self.clock.pass_on();
        self.wait_for_turn();
    }

    fn wait_for_turn(&self) {
        let mut turn = lock(&self.turn);
        while !*turn {
            let turned = self.turned.wait(turn);
            turn = turned.unwrap_or_else(PoisonError::into_inner);
        }
        *turn = false;
    }

    fn is_killed(&self) -> bool {
        self.process.is_killed.load(Ordering::Relaxed)
    }

    /// Unwinds where its process was killed.
    fn check(&self) {
        if self.is_killed() && !thread::panicking() {
            resume_unwind(Box::new(Killed));
        }
    }

    pub(crate) fn expect_answer(&self, patience: Duration) {
        let by = lock(&self.clock.state).now + patience;
        *lock(&self.answer_by) = (Some(by), false);
    }

    pub(crate) fn is_answered(&self) -> bool {
        let (_, is_late) = std::mem::take(&mut *lock(&self.answer_by));
        !is_late
    }

    fn answer_after(&self, time: Duration) -> bool {
        let (by, _) = *lock(&self.answer_by);
        let now = lock(&self.clock.state).now;
        let left = by.map(|by| by.saturating_sub(now));
        let is_late = left.is_some_and(|left| left < time);
        self.sleep(left.map_or(time, |left| left.min(time)));
        lock(&self.answer_by).1 |= is_late;
        !is_late
    }
}

impl State {
    fn next(&mut self) -> u64 {
        self.n_waits += 1;
        self.n_waits
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Condvar, all, beside, now, random, since};

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn hours_pass_at_once_and_threads_run_in_the_order_of_their_times() {
        let began = Instant::now();
        let said = Arc::new(Mutex::new(Vec::new()));
        let order = World::simulate(1, |world| {
            for (name, hours) in [("late", 3), ("early", 1), ("between", 2)] {
                let said = Arc::clone(&said);
                world.start(name, move || {
                    sleep(Duration::from_hours(hours));
                    lock(&said).push(crate::machine().unwrap());
                });
            }
            sleep(Duration::from_hours(4));
            lock(&said).clone()
        });
        assert_eq!(order, ["early", "between", "late"]);
        assert!(began.elapsed() < Duration::from_mins(1));
    }

    #[test]
    fn equal_seeds_give_equal_numbers_and_others_give_others() {
        let numbers = |seed| World::simulate(seed, |_| [random(), random()]);
        assert_eq!(numbers(7), numbers(7));
        assert_ne!(numbers(7), numbers(8));
        assert_ne!(numbers(7)[0], numbers(7)[1]);
    }

    #[test]
    fn a_killed_process_does_nothing_more_and_its_other_threads_end() {
        let said = Arc::new(Mutex::new(Vec::new()));
        World::simulate(1, |world| {
            let saying = Arc::clone(&said);
            let process = world.start("killed", move || {
                let beats = || loop {
                    sleep(SECOND);
                    lock(&saying).push(());
                };
                beside(beats, || sleep(SECOND * 100));
            });
            sleep(SECOND * 5 + SECOND / 2);
            process.kill();
            assert!(process.is_over());
            sleep(SECOND * 5);
        });
        assert_eq!(lock(&said).len(), 5);
    }

    #[test]
    fn who_waits_is_woken_and_threads_are_waited_for() {
        World::simulate(1, |_| {
            let (is_done, changed) = (Mutex::new(false), Condvar::default());
            let waits = || {
                let mut done = crate::lock(&is_done);
                while !*done {
                    done = changed.wait_timeout(done, &is_done, SECOND * 100);
                }
            };
            let began = now();
            beside(waits, || {
                sleep(SECOND);
                *crate::lock(&is_done) = true;
                changed.notify_all();
            });
            assert!(since(began) < SECOND * 2, "{:?}", since(began));
            let count = Mutex::new(0);
            all(3, || {
                sleep(SECOND);
                *crate::lock(&count) += 1;
            });
            assert_eq!(*lock(&count), 3);
        });
    }

    #[test]
    fn an_answer_that_comes_too_late_is_none() {
        World::simulate(1, |_| {
            let began = now();
            let asked = |after| {
                crate::watched(
                    SECOND * 4,
                    move |_: &mut crate::Pass<()>| answer_after(after),
                    |()| true,
                )
            };
            assert_eq!(asked(SECOND), Some(true));
            assert_eq!(asked(SECOND * 60), None);
            assert_eq!(since(began), SECOND * 5);
        });
    }
}
