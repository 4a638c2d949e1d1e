//! A model of the states of goals: one dispatcher, two cells that answer under one name, what is lost between
//! them, and what people do.
//!
//! All orders of steps are in it, and so few states that a checker can search them all.
//! A dispatcher that stops and one that crashes are the same here: the ledger is what is left of a run.
//! So are a cell that is down and one that no query reaches.
//! Any number of messages is lost; one goal at a time is late, for as long as it likes.
//! Nobody has permitted that a real cell moves.

use rand::{SeedableRng, seq::IndexedRandom};
use rand_chacha::ChaCha8Rng;
use stateright::{Model, Property};

/// Goals of at most two motions and two attempts.
const GOALS: usize = 4;

pub(crate) const ONCE: &str = "a goal is executed at most once over all cells";
pub(crate) const PERMITTED: &str = "nothing real moves without permission";
pub(crate) const SUCCEEDED: &str = "a success was executed once, by the cell in the ledger";
pub(crate) const REFUSED: &str = "nothing that was refused was executed";
pub(crate) const UNKNOWN: &str = "nothing is sent while an outcome is unknown";

/// The protocol, and the extent of its model.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Protocol {
    /// Motions of a run, sent in this order.
    pub(crate) motions: usize,
    /// Values of `attempt`.
    pub(crate) attempts: usize,
    /// Starts of each cell.
    pub(crate) starts: u8,
    pub(crate) fault: Option<Fault>,
}

/// A fault of the dispatcher or the cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    /// Permission is looked at once in a run, and goals do not say it.
    PermissionOfRun,
    /// The ledger is kept by the options of a run.
    LedgerOfOptions,
    /// `never_taken` frees even a goal that was accepted, or sent to another journal.
    AcceptedFreed,
    /// Goals do not name a journal.
    NoAddress,
    /// After `never_taken` a goal may be sent to another journal.
    OtherJournal,
    /// A refusal frees even a goal that was transmitted before.
    RepeatFreed,
    /// An open goal is asked about when it is its motion's turn.
    OpenInTurn,
    /// A run goes on after an unknown outcome.
    UnknownIgnored,
    /// A cell that has lost its goals keeps its key.
    KeyKept,
}

/// A step; numbers are those of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Action {
    // Of people.
    Run,
    RaiseAttempt,
    /// An option that is not in the goals.
    ChangeOption,
    CollectGarbage,
    /// A cell crashes and starts again; the second cell joins when it first starts.
    Start(usize, Memory, Machine),
    // Of faults.
    /// Or its patience ends.
    CrashDispatcher,
    LoseGoal,
    LoseAnswer,
    DelayGoal,
    DeliverLate(usize),
    /// For a reason outside of this model, which a cell may look for before it looks whether it knows the goal.
    Refuse(usize),
    // Of the programs.
    Capabilities(usize),
    Transmit,
    Deliver(usize),
    Answer,
    End(usize),
    Result(usize),
    /// A motion with an unknown outcome is named.
    Tell,
}

/// Memory of a cell that starts again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Memory {
    Journal,
    KeyAlone,
    /// It begins another journal.
    Nothing,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub(crate) enum Machine {
    #[default]
    Simulated,
    Real,
}

/// The state of everything; at first one simulated cell runs.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub(crate) struct State {
    cells: [Cell; 2],
    ledger: [Entry; GOALS],
    attempt: usize,
    phase: Phase,
    /// The motion that the run has come to.
    motion: usize,
    /// The first answer of the run.
    first: Option<(Journal, Machine)>,
    /// The late goal, and whom it is for.
    late: Option<(usize, Journal)>,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
struct Cell {
    starts: u8,
    machine: Machine,
    journal: u8,
    goals: [Taken; GOALS],
    /// How often each motion has begun, whatever the journal says; 2 stands for more, too.
    executions: [u8; GOALS],
}

/// One of the journals that a cell has had.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Journal {
    cell: usize,
    number: u8,
}

/// A goal in the journal of a cell.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
enum Taken {
    #[default]
    Never,
    Executing,
    Succeeded,
    Unknown,
}

/// A goal in the ledger of the dispatcher.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
enum Entry {
    #[default]
    New,
    Sent {
        to: Journal,
        again: bool,
    },
    NeverTaken(Journal),
    Accepted(Journal),
    Refused,
    Succeeded(Journal),
    Unknown {
        told: bool,
    },
}

/// What the dispatcher does next.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
enum Phase {
    #[default]
    Stopped,
    /// Query the result of an open goal.
    Recover,
    /// Query capabilities.
    Check,
    Transmit(Journal),
    /// Wait for the answer to its goal: none yet, or whether it is accepted.
    Await(Option<bool>),
    Tell,
}

impl Entry {
    /// Returns whom a goal was sent to whose end is not known.
    fn open(self) -> Option<Journal> {
        match self {
            Self::Sent { to, .. } | Self::Accepted(to) => Some(to),
            _ => None,
        }
    }
}

impl State {
    fn stop(&mut self) {
        (self.phase, self.motion, self.first) = (Phase::Stopped, 0, None);
    }

    fn journal(&self, cell: usize) -> Journal {
        let number = self.cells[cell].journal;
        Journal { cell, number }
    }

    fn executions(&self, goal: usize) -> u8 {
        self.cells.iter().map(|cell| cell.executions[goal]).sum()
    }
}

impl Protocol {
    fn has(&self, fault: Fault) -> bool {
        self.fault == Some(fault)
    }

    /// Returns the ledger of the present attempt, by motion.
    fn entries<'a>(&self, state: &'a State) -> &'a [Entry] {
        &state.ledger[state.attempt * self.motions..][..self.motions]
    }

    /// Returns the goal of the motion that the run has come to.
    fn goal(&self, state: &State) -> usize {
        state.attempt * self.motions + state.motion
    }

    /// Returns the first goal of this attempt that was sent and has not ended, and whom it was sent to.
    fn open(&self, state: &State) -> Option<(usize, Journal)> {
        let first = state.attempt * self.motions;
        let mut goals = first..first + self.motions;
        goals.find_map(|goal| Some((goal, state.ledger[goal].open()?)))
    }

    /// Goes to the next motion without an end, once no outcome is open or untold.
    fn proceed(&self, state: &mut State) {
        let entries = self.entries(state);
        let is_ended = |entry| matches!(entry, Entry::Succeeded(_) | Entry::Unknown { .. });
        let next = (state.motion..self.motions).find(|&motion| !is_ended(entries[motion]));
        let untold = entries.contains(&Entry::Unknown { told: false });
        let open = match next {
            Some(motion) if self.has(Fault::OpenInTurn) => entries[motion].open(),
            _ => self.open(state).map(|(_, to)| to),
        };
        match (open, next) {
            _ if untold && !self.has(Fault::UnknownIgnored) => state.phase = Phase::Tell,
            (Some(_), _) => state.phase = Phase::Recover,
            (None, Some(motion)) => (state.phase, state.motion) = (Phase::Check, motion),
            (None, None) => state.stop(),
        }
    }

    /// The dispatcher hears capabilities.
    fn check(&self, state: &mut State, cell: usize) {
        let now = (state.journal(cell), state.cells[cell].machine);
        let first = *state.first.get_or_insert(now);
        let is_permitted = match (first.1, now.1) {
            (Machine::Simulated, Machine::Real) => self.has(Fault::PermissionOfRun),
            (first, _) => first == Machine::Simulated,
        };
        let is_addressee = match state.ledger[self.goal(state)] {
            Entry::NeverTaken(to) | Entry::Sent { to, .. } => to == now.0,
            _ => true,
        };
        if first.0 == now.0 && is_permitted && is_addressee {
            state.phase = Phase::Transmit(now.0);
        } else {
            state.stop();
        }
    }

    /// A goal reaches a cell; returns whether it is accepted, and none if it is for another journal.
    fn deliver(&self, state: &mut State, sent: (usize, Journal), cell: usize) -> Option<bool> {
        let (goal, to) = sent;
        let is_addressee = to == state.journal(cell) || self.has(Fault::NoAddress);
        let cell = &mut state.cells[cell];
        if !is_addressee || cell.starts == 0 {
            return None;
        }
        let is_permitted = cell.machine == Machine::Simulated || self.has(Fault::PermissionOfRun);
        let is_known = cell.goals[goal] != Taken::Never;
        if !is_known && is_permitted && !cell.goals.contains(&Taken::Executing) {
            cell.goals[goal] = Taken::Executing;
            cell.executions[goal] = (cell.executions[goal] + 1).min(2);
        }
        Some(cell.goals[goal] != Taken::Never)
    }

    /// The dispatcher hears about an open goal.
    fn result(&self, state: &mut State, cell: usize) -> Option<()> {
        let (goal, to) = self.open(state)?;
        let is_there = to == state.journal(cell);
        let is_free = is_there && matches!(state.ledger[goal], Entry::Sent { .. });
        state.ledger[goal] = match state.cells[cell].goals[goal] {
            // The answer comes when the motion is over.
            Taken::Executing => return None,
            Taken::Never if self.has(Fault::AcceptedFreed) => Entry::New,
            Taken::Never if is_free && self.has(Fault::OtherJournal) => Entry::New,
            Taken::Never if is_free => Entry::NeverTaken(to),
            Taken::Succeeded if is_there => Entry::Succeeded(to),
            Taken::Unknown if is_there => Entry::Unknown { told: false },
            Taken::Never | Taken::Succeeded | Taken::Unknown => {
                state.stop();
                return Some(());
            }
        };
        self.proceed(state);
        Some(())
    }

    /// The dispatcher hears whether its goal is accepted.
    fn answer(&self, state: &mut State, is_accepted: bool) {
        let goal = self.goal(state);
        let entry = &mut state.ledger[goal];
        match *entry {
            Entry::Sent { to, .. } if is_accepted => *entry = Entry::Accepted(to),
            // Another copy may have been accepted, or may be late.
            Entry::Sent { again: true, .. } if !self.has(Fault::RepeatFreed) => {
                return state.stop();
            }
            _ => {
                *entry = Entry::Refused;
                state.motion += 1;
            }
        }
        self.proceed(state);
    }

    fn start(&self, cell: &mut Cell, memory: Memory, machine: Machine) -> Option<()> {
        let is_possible = match memory {
            Memory::Journal => true,
            Memory::KeyAlone => self.has(Fault::KeyKept),
            Memory::Nothing => cell.starts > 0,
        };
        if !is_possible || cell.starts == self.starts {
            return None;
        }
        (cell.starts, cell.machine) = (cell.starts + 1, machine);
        cell.journal += u8::from(memory == Memory::Nothing);
        cell.goals = cell.goals.map(|goal| match goal {
            _ if memory != Memory::Journal => Taken::Never,
            Taken::Executing => Taken::Unknown,
            Taken::Never | Taken::Succeeded | Taken::Unknown => goal,
        });
        Some(())
    }
}

impl Model for Protocol {
    type State = State;
    type Action = Action;

    fn init_states(&self) -> Vec<State> {
        let mut state = State::default();
        state.cells[0].starts = 1;
        vec![state]
    }

    /// Lists all actions: nothing follows from those that are impossible.
    fn actions(&self, _state: &State, actions: &mut Vec<Action>) {
        use Action::*;
        actions.extend([Run, RaiseAttempt, ChangeOption, CollectGarbage]);
        actions.extend([CrashDispatcher, LoseGoal, LoseAnswer, DelayGoal]);
        actions.extend([Transmit, Answer, Tell]);
        for cell in 0..2 {
            actions.extend([DeliverLate(cell), Refuse(cell), Capabilities(cell)]);
            actions.extend([Deliver(cell), End(cell), Result(cell)]);
            for memory in [Memory::Journal, Memory::KeyAlone, Memory::Nothing] {
                let machines = [Machine::Simulated, Machine::Real];
                actions.extend(machines.map(|machine| Start(cell, memory, machine)));
            }
        }
    }

    fn next_state(&self, last: &State, action: Action) -> Option<State> {
        use Action::*;
        let mut state = last.clone();
        match (action, last.phase) {
            (Run, Phase::Stopped) => self.proceed(&mut state),
            (RaiseAttempt, Phase::Stopped) if last.attempt + 1 < self.attempts => {
                state.attempt += 1;
            }
            (ChangeOption | CollectGarbage, Phase::Stopped) => {
                if self.has(Fault::LedgerOfOptions) {
                    state.ledger = [Entry::New; GOALS];
                }
            }
            (Start(cell, memory, machine), _) => {
                self.start(&mut state.cells[cell], memory, machine)?;
            }
            (CrashDispatcher, phase) if phase != Phase::Stopped => {
                let goal = self.open(last).filter(|_| phase == Phase::Await(None));
                state.late = last.late.or(goal);
                state.stop();
            }
            (LoseGoal, Phase::Await(None)) | (LoseAnswer, Phase::Await(Some(_))) => {
                state.phase = Phase::Check;
            }
            (DelayGoal, Phase::Await(None)) if last.late.is_none() => {
                (state.late, state.phase) = (self.open(last), Phase::Check);
            }
            (DeliverLate(cell), _) => {
                let late = state.late.take()?;
                self.deliver(&mut state, late, cell)?;
            }
            (Refuse(cell), Phase::Await(None)) if self.open(last)?.1 == last.journal(cell) => {
                state.phase = Phase::Await(Some(false));
            }
            (Capabilities(cell), Phase::Check) if last.cells[cell].starts > 0 => {
                self.check(&mut state, cell);
            }
            (Transmit, Phase::Transmit(to)) => {
                let entry = &mut state.ledger[self.goal(last)];
                let again = !matches!(entry, Entry::New | Entry::Refused);
                *entry = Entry::Sent { to, again };
                state.phase = Phase::Await(None);
            }
            (Deliver(cell), Phase::Await(None)) => {
                let goal = self.open(last)?;
                let is_accepted = self.deliver(&mut state, goal, cell)?;
                state.phase = Phase::Await(Some(is_accepted));
                // Without an address it reaches the other cell, too.
                let copy = Some(goal).filter(|_| self.has(Fault::NoAddress));
                state.late = last.late.or(copy);
            }
            (Answer, Phase::Await(Some(is_accepted))) => self.answer(&mut state, is_accepted),
            (End(cell), _) => {
                let goals = &mut state.cells[cell].goals;
                *goals.iter_mut().find(|goal| **goal == Taken::Executing)? = Taken::Succeeded;
            }
            (Result(cell), Phase::Recover) if last.cells[cell].starts > 0 => {
                self.result(&mut state, cell)?;
            }
            (Tell, Phase::Tell) => {
                state.stop();
                state.ledger = state.ledger.map(|entry| match entry {
                    Entry::Unknown { .. } => Entry::Unknown { told: true },
                    entry => entry,
                });
            }
            _ => return None,
        }
        Some(state)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        let (always, sometimes) = (Property::<Self>::always, Property::<Self>::sometimes);
        vec![
            always(ONCE, |_, state| {
                (0..GOALS).all(|goal| state.executions(goal) <= 1)
            }),
            always(PERMITTED, |_, state| {
                let moves = |cell: &Cell| cell.goals.contains(&Taken::Executing);
                let is_real = |cell: &Cell| cell.machine == Machine::Real;
                !state.cells.iter().any(|cell| is_real(cell) && moves(cell))
            }),
            always(SUCCEEDED, |_, state| {
                (0..GOALS).all(|goal| match state.ledger[goal] {
                    Entry::Succeeded(by) => {
                        [
                            state.executions(goal),
                            state.cells[by.cell].executions[goal],
                        ] == [1, 1]
                    }
                    _ => true,
                })
            }),
            always(REFUSED, |_, state| {
                let is_refused = |goal| state.ledger[goal] == Entry::Refused;
                !(0..GOALS).any(|goal| is_refused(goal) && state.executions(goal) > 0)
            }),
            always(UNKNOWN, |protocol, state| {
                let is_unknown = |(motion, entry): (usize, &Entry)| match entry {
                    Entry::Unknown { told } => !told,
                    entry => entry.open().is_some() && motion != state.motion,
                };
                let mut entries = protocol.entries(state).iter().enumerate();
                !matches!(state.phase, Phase::Await(_)) || !entries.any(is_unknown)
            }),
            sometimes("all motions succeed", |protocol, state| {
                let mut entries = protocol.entries(state).iter();
                entries.all(|entry| matches!(entry, Entry::Succeeded(_)))
            }),
            sometimes("a goal is sent again", |protocol, state| {
                let is_free = matches!(state.ledger[protocol.goal(state)], Entry::NeverTaken(_));
                is_free && matches!(state.phase, Phase::Transmit(_))
            }),
            sometimes("a success comes after an unknown outcome", |_, state| {
                let [first, second, ..] = state.ledger;
                first == Entry::Unknown { told: true } && matches!(second, Entry::Succeeded(_))
            }),
            sometimes("a change stops a run", |protocol, state| {
                let capabilities = |(journal, _): (Journal, _)| Action::Capabilities(journal.cell);
                let next = state.first.map(capabilities);
                let next = next.and_then(|action| protocol.next_state(state, action));
                next.is_some_and(|next| next.phase == Phase::Stopped)
            }),
        ]
    }
}

/// Draws `n` actions of people and faults that the protocol has to survive.
///
/// Those that follow `Run` happen during that run, each as soon as it can.
pub(crate) fn walk(seed: u64, n: usize) -> Vec<Action> {
    let protocol = Protocol {
        motions: 2,
        attempts: 2,
        starts: u8::MAX,
        fault: None,
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut states, mut actions) = (protocol.init_states(), Vec::new());
    while let Some(state) = states.pop()
        && actions.len() < n
    {
        let steps = protocol.next_steps(&state);
        if let Ok((action, next)) = steps.choose_weighted(&mut rng, |step| weight(step.0)) {
            states.push(next.clone());
            actions.extend(Some(*action).filter(|&action| weight(action) < PROGRAM));
        }
    }
    actions
}

/// Weight of the programs' own steps in a walk.
const PROGRAM: u32 = 100;

fn weight(action: Action) -> u32 {
    use Action::*;
    match action {
        Start(_, Memory::Journal, Machine::Simulated) => 6,
        Start(..) => 2,
        RaiseAttempt | ChangeOption | CollectGarbage => 5,
        CrashDispatcher | LoseGoal | LoseAnswer | DelayGoal | DeliverLate(_) | Refuse(_) => 15,
        Run => 60,
        Capabilities(_) | Transmit | Deliver(_) | Answer | End(_) | Result(_) | Tell => PROGRAM,
    }
}
