//! Watching a cell without loss: after joining late, after gaps, and after a router outage.

use std::{
    collections::VecDeque,
    sync::mpsc::{self, Receiver, SyncSender},
    thread,
    time::{Duration, Instant},
};

use zenoh::{
    Session, Wait,
    pubsub::Subscriber,
    qos::{CongestionControl, Priority},
    query::{ConsolidationMode, QueryTarget},
    sample::SampleKind,
};

use crate::{
    Access, CellError, Goal, GoalMessage, GoalOutcome, Keys, State,
    client::MAX_ANSWER_BYTES,
    outcome::Outcomes,
    session,
    signature::{Answer, Question},
    state::States,
};

/// Messages buffered for a slow watcher before others are dropped.
const BACKLOG: usize = 4096;
/// Poll period for outcomes that may have been missed.
const POLL: Duration = Duration::from_secs(1);
/// Timeout of a query for missed messages.
const ANSWER: Duration = Duration::from_secs(1);
/// Timeout after which missed samples count as lost.
const RECOVERY_TIMEOUT: Duration = Duration::from_secs(3);
/// Pause between two unanswered queries: right after a router restarts it may not know the cell
/// yet.
const PAUSE: Duration = Duration::from_millis(100);

/// A watcher of a cell.
///
/// Delivers samples in the order of their numbers, each once, and outcomes likewise. Queries missed
/// ones: samples of the last thirty seconds, and every outcome in the cell's journal.
///
/// Messages must be fetched: beyond 4096 unfetched ones others are dropped, and queried later as
/// missed.
pub struct Watcher {
    events: Receiver<Event>,
    keys: Keys,
    ready: VecDeque<WatchEvent>,
    stream: Option<StreamPosition>,
    list: Option<StreamPosition>,
    polled: Option<Instant>,
    /// Whether a motion has ended, of which the last samples may have been missed.
    may_lack_samples: bool,
    counts: Counts,
    session: Session,
    _subscribers: Vec<Subscriber<()>>,
}

/// An event that a watcher receives.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum WatchEvent {
    /// A measurement of the cell.
    State(State),
    /// The outcome of a goal.
    Outcome(GoalOutcome),
    /// A dispatcher's publication of an accepted goal, with its id. It may be lost.
    Motion(String, Box<Goal>),
    /// The cell is reachable, again or for the first time.
    Alive,
    /// The cell, or the connection to it, is lost.
    Gone,
}

/// Counts of received and missed messages.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Samples received.
    pub states_n: u64,
    /// Of these, the ones recovered by a query.
    pub recovered_n: u64,
    /// Samples lost for good, not counting those before the watcher started.
    pub gaps_n: u64,
    /// Outcomes received.
    pub outcomes_n: u64,
    /// Of these, the ones recovered by a query.
    pub recovered_outcomes_n: u64,
    /// Restarts of the cell.
    pub restarts_n: u64,
    /// Messages that could not be read.
    pub unreadable_n: u64,
    /// Queries that other parties answered too.
    pub foreign_n: u64,
}

/// Next expected number of a stream or journal.
struct StreamPosition {
    /// Name of the stream or journal.
    of: String,
    next: u64,
}

enum Event {
    State(Vec<u8>),
    Outcome(Vec<u8>),
    Motion(Vec<u8>),
    Alive(SampleKind),
}

/// Status of samples that were published before the received ones.
#[derive(Clone, Copy, PartialEq, Eq)]
enum MissingSamples {
    /// Lost while watching.
    Missed,
    /// Published before the watcher started.
    Unwatched,
}

impl Watcher {
    /// Watches the cell `name` at an endpoint, its own or its router's.
    ///
    /// # Errors
    ///
    /// Fails if nothing listens there within `timeout`, or the name or endpoint is invalid.
    pub fn start(
        access: Option<&Access>,
        endpoint: &str,
        name: &str,
        timeout: Duration,
    ) -> Result<Self, CellError> {
        let keys = Keys::new(name)?;
        let session = session::connect(endpoint, access, timeout)?;
        let (sender, events) = mpsc::sync_channel(BACKLOG);
        let subscribers =
            subscribe(&session, &keys, &sender).map_err(|source| CellError::Zenoh {
                action: "watch the robot cell",
                source: source.into(),
            })?;
        Ok(Self {
            events,
            keys,
            ready: VecDeque::new(),
            stream: None,
            list: None,
            polled: None,
            may_lack_samples: false,
            counts: Counts::default(),
            session,
            _subscribers: subscribers,
        })
    }

    /// Returns the counts so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Returns the next event; none if there is none within `timeout`.
    pub fn next(&mut self, timeout: Duration) -> Option<WatchEvent> {
        let deadline = Instant::now() + timeout;
        loop {
            if let Some(seen) = self.ready.pop_front() {
                return Some(seen);
            }
            let due = self.polled.map_or(Duration::ZERO, |polled| {
                POLL.saturating_sub(polled.elapsed())
            });
            if due.is_zero() {
                self.poll();
                continue;
            }
            let left = deadline.saturating_duration_since(Instant::now());
            let wait = if self.may_lack_samples {
                Duration::ZERO
            } else {
                left.min(due)
            };
            match self.events.recv_timeout(wait) {
                Ok(event) => self.take(event),
                // Only now, for samples that came in time may be older than the cell keeps them.
                Err(_) if self.may_lack_samples => {
                    self.may_lack_samples = false;
                    self.catch_up();
                }
                Err(_) if left <= due => return None,
                Err(_) => {}
            }
        }
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::State(bytes) => match State::from_bytes(&bytes) {
                Ok(states) => states.into_iter().for_each(|state| self.state(state)),
                Err(_) => self.counts.unreadable_n += 1,
            },
            Event::Outcome(bytes) => match GoalOutcome::from_bytes(&bytes) {
                Ok(outcome) => self.outcome(outcome),
                Err(_) => self.counts.unreadable_n += 1,
            },
            Event::Motion(bytes) => match GoalMessage::decode(&bytes) {
                Ok((message, goal)) => {
                    let goal_id = message.encoded.goal_id;
                    let seen = WatchEvent::Motion(goal_id, Box::new(goal));
                    self.ready.push_back(seen);
                }
                Err(_) => self.counts.unreadable_n += 1,
            },
            Event::Alive(SampleKind::Put) => {
                self.ready.push_back(WatchEvent::Alive);
                self.poll();
            }
            Event::Alive(SampleKind::Delete) => self.ready.push_back(WatchEvent::Gone),
        }
    }

    /// Delivers a published sample, after the missed ones before it.
    fn state(&mut self, state: State) {
        let position = self.stream.as_ref();
        let (next, earlier) = match position {
            Some(position) if position.of == state.epoch => (position.next, MissingSamples::Missed),
            Some(_) => {
                self.counts.restarts_n += 1;
                (0, MissingSamples::Missed)
            }
            None => (0, MissingSamples::Unwatched),
        };
        if state.seq < next {
            return;
        }
        if state.seq > next {
            self.recover(&state.epoch, next, Some(state.seq), earlier);
        }
        self.stream = Some(StreamPosition {
            of: state.epoch.clone(),
            next: state.seq + 1,
        });
        self.counts.states_n += 1;
        self.ready.push_back(WatchEvent::State(state));
    }

    /// Delivers missed samples that no later sample reveals: after a motion, a cell that is faster than real time
    /// publishes none.
    fn catch_up(&mut self) {
        let Some(StreamPosition { of, next }) = self.stream.take() else {
            return;
        };
        let next = self.recover(&of, next, None, MissingSamples::Missed);
        self.stream = Some(StreamPosition { of, next });
    }

    /// Queries the samples from `from` to before `until`, or once for all there are; returns the number of the
    /// next one.
    fn recover(
        &mut self,
        epoch: &str,
        mut from: u64,
        until: Option<u64>,
        earlier: MissingSamples,
    ) -> u64 {
        let patience = until.map_or(Duration::ZERO, |_| RECOVERY_TIMEOUT);
        let deadline = Instant::now() + patience;
        let is_wanted = |seq: u64| until.is_none_or(|until| seq < until);
        let mut any = earlier == MissingSamples::Missed;
        while is_wanted(from) {
            let key = self.keys.history();
            let answer = self.ask(&key, from);
            let list = self.list.as_ref();
            let answer = answer.filter(|(journal, _)| list.is_none_or(|list| list.of == *journal));
            let answer = answer.map(|(_, body)| States::from_bytes(&body));
            let Some(Ok(States { header, states })) = answer else {
                if Instant::now() > deadline {
                    break;
                }
                thread::sleep(PAUSE);
                continue;
            };
            if header.epoch != epoch || states.is_empty() {
                break;
            }
            if any {
                let found = until.map_or(header.seq, |until| header.seq.min(until));
                self.counts.gaps_n += found.saturating_sub(from);
            }
            any = true;
            let requested = from;
            from = from.max(header.seq);
            for state in states {
                if state.seq == from && is_wanted(from) {
                    from += 1;
                    self.counts.states_n += 1;
                    self.counts.recovered_n += 1;
                    self.ready.push_back(WatchEvent::State(state));
                }
            }
            // A cell that answers otherwise has no more samples.
            if from == requested {
                break;
            }
        }
        if any {
            self.counts.gaps_n += until.unwrap_or(from).saturating_sub(from);
        }
        from
    }

    /// Delivers a published outcome.
    fn outcome(&mut self, outcome: GoalOutcome) {
        let known = self.list.as_ref();
        let known = known.filter(|position| position.of == outcome.journal);
        match known.map(|position| position.next) {
            Some(next) if outcome.result_n < next => {}
            Some(next) if outcome.result_n == next => self.put(outcome),
            // Some were missed, or possibly so: query them all, this one too.
            Some(_) | None => self.poll(),
        }
    }

    /// Delivers the next outcome.
    fn put(&mut self, outcome: GoalOutcome) {
        self.may_lack_samples = true;
        self.list = Some(StreamPosition {
            of: outcome.journal.clone(),
            next: outcome.result_n.saturating_add(1),
        });
        self.counts.outcomes_n += 1;
        self.ready.push_back(WatchEvent::Outcome(outcome));
    }

    /// Queries missed outcomes.
    fn poll(&mut self) {
        loop {
            self.polled = Some(Instant::now());
            let next = self.list.as_ref().map_or(0, |position| position.next);
            let key = self.keys.results();
            let Some((journal, body)) = self.ask(&key, next) else {
                return;
            };
            let found = Outcomes::from_bytes(&body).ok();
            let found = found.filter(|found| found.header.journal == journal);
            let Some(Outcomes { header, outcomes }) = found else {
                self.counts.unreadable_n += 1;
                return;
            };
            let is_new = self
                .list
                .as_ref()
                .is_none_or(|position| position.of != header.journal);
            if is_new {
                self.list = Some(StreamPosition {
                    of: header.journal,
                    next: 0,
                });
                if next > 0 {
                    continue;
                }
            }
            let mut is_more = false;
            for outcome in outcomes {
                if self
                    .list
                    .as_ref()
                    .is_some_and(|p| p.next == outcome.result_n)
                {
                    self.counts.recovered_outcomes_n += 1;
                    self.put(outcome);
                    is_more = true;
                }
            }
            let there = self.list.as_ref().map_or(0, |position| position.next);
            if !is_more || there >= header.results_n {
                return;
            }
        }
    }

    /// Queries a cell from a number on; returns its journal and its answer, if exactly one comes.
    fn ask(&mut self, key: &str, from: u64) -> Option<(String, Vec<u8>)> {
        let question = Question::new(key, &format!("from={from}"), &[]).ok()?;
        let replies = self
            .session
            .get(question.selector())
            .target(QueryTarget::All)
            .consolidation(ConsolidationMode::None)
            // Never queue before messages that move or stop a robot.
            .congestion_control(CongestionControl::Block)
            .priority(Priority::DataLow)
            .timeout(ANSWER)
            .wait()
            .ok()?;
        let mut answers = question.collect(&replies, MAX_ANSWER_BYTES, Instant::now() + ANSWER);
        match (answers.pop(), answers.is_empty()) {
            (Some(Answer::Signed { journal, body, .. }), true) => Some((journal, body)),
            (None, _) => None,
            (Some(_), _) => {
                self.counts.foreign_n += 1;
                None
            }
        }
    }
}

/// Declares the subscriptions. Keys are named one by one, as access rules are.
fn subscribe(
    session: &Session,
    keys: &Keys,
    events: &SyncSender<Event>,
) -> Result<Vec<Subscriber<()>>, zenoh::Error> {
    let listen = |key: String, event: fn(Vec<u8>) -> Event| {
        let events = events.clone();
        session
            .declare_subscriber(key)
            .callback(move |sample| {
                // Messages dropped here are missed later, and queried.
                let _taken = events.try_send(event(sample.payload().to_bytes().into_owned()));
            })
            .wait()
    };
    let alive = {
        let events = events.clone();
        session
            .liveliness()
            .declare_subscriber(keys.alive())
            .history(true)
            .callback(move |sample| {
                let _taken = events.try_send(Event::Alive(sample.kind()));
            })
            .wait()?
    };
    Ok(vec![
        alive,
        listen(keys.outcome("*"), Event::Outcome)?,
        listen(keys.motion(), Event::Motion)?,
        listen(keys.state(), Event::State)?,
    ])
}
