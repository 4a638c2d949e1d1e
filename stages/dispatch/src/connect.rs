//! Connection to the configured cell.

use std::{
    collections::BTreeMap,
    fs,
    sync::{Arc, Mutex, PoisonError},
};

use cell::{
    Capabilities, CellArm, CellClient, CellError, ControllerInfo, Goal, ModelMismatch,
    PalmTrajectory, ServiceConfig, SigningKey, SimulatedCell, SimulatedCellConfig, Terms,
};
use dataflow::BoxedDiagnostic;
use options::OptionFault;
use planning::{ArmConfig, MAX_HZ};
use schemas::objects::Object;
use simulation::ObjectShape;

use crate::{
    DispatchConfig, DispatchError,
    config::{SIMULATED, SimulatedConfig},
    error::ControllerMismatch,
    robots::Robots,
};

/// The simulated cell of this process: it outlives the units, so that watchers can stay connected,
/// and it remembers its goals as a real one does.
static RUNNING: Mutex<Option<Running>> = Mutex::new(None);

/// What cells that outlive this process said of themselves first, by endpoint and name: a change ends the run, in
/// whichever of its units it shows.
static FIRST: Mutex<BTreeMap<(String, String), Capabilities>> = Mutex::new(BTreeMap::new());

/// Largest difference between an arm's base pose and the planned one, in meters and in quaternion
/// components.
const SAME_PLACE: f64 = 1e-6;

struct Running {
    requested: CellSetup,
    cell: Arc<SimulatedCell>,
}

/// Configuration of a running simulated cell.
#[derive(PartialEq)]
struct CellSetup {
    config: SimulatedCellConfig,
    robot: String,
}

/// A connected cell.
pub(crate) struct ConnectedCell {
    pub(crate) client: Arc<CellClient>,
    /// The terms under which goals may be sent to it.
    pub(crate) terms: Terms,
    /// Keeps the simulated cell alive.
    _simulated: Option<Arc<SimulatedCell>>,
}

/// Connects to the configured cell, with `object` in front of it; starts the simulated one if it
/// does not run yet. Checks that the cell accepts goals like `goal`, which are signed with `key`.
pub(crate) fn connect(
    config: &DispatchConfig,
    robots: &Robots,
    object: &Object,
    goal: &Goal,
    key: Option<SigningKey>,
) -> Result<ConnectedCell, BoxedDiagnostic> {
    let simulated = if config.cell == SIMULATED {
        let cell = simulated(config, robots)?;
        cell.put_object(&object.name, ObjectShape::from_artifact(object));
        Some(cell)
    } else {
        None
    };
    let endpoint = simulated
        .as_ref()
        .map_or(config.cell.as_str(), |cell| cell.endpoint());
    let client = CellClient::connect_as(
        config.credentials().map_err(DispatchError::from)?.as_ref(),
        endpoint,
        &config.cell_name,
        config.answer_timeout(),
    )
    .map_err(DispatchError::from)?;
    let client = match key {
        Some(key) => client.signing_with(key),
        None => client,
    };
    let capabilities = client
        .capabilities(config.answer_timeout())
        .map_err(DispatchError::from)?;
    if capabilities.robot != robots.digest() {
        return Err(DispatchError::OtherRobot {
            cell: capabilities.cell,
            hand: config.hand.clone(),
        }
        .into());
    }
    check_controllers(&capabilities, goal)?;
    let planned = config.arm.as_ref();
    let planned = planned
        .map(ArmConfig::table_from_base)
        .transpose()
        .map_err(DispatchError::from)?;
    let planned = planned.map(|pose| pose.to_array());
    if let (Some(planned), Some(there)) = (planned, capabilities.table_from_base) {
        let is_there = planned
            .iter()
            .zip(&there)
            .all(|(a, b)| (a - b).abs() < SAME_PLACE);
        if !is_there {
            let problem =
                format!("{planned:?}, but the cell says that its arm stands at {there:?}");
            let fault = OptionFault::new("arm.table_from_base", problem);
            return Err(DispatchError::from(fault).into());
        }
    }
    let first = match &simulated {
        Some(_) => capabilities,
        None => first_of_run(config, capabilities)?,
    };
    Ok(ConnectedCell {
        client: Arc::new(client),
        terms: Terms::new(first, config.execute),
        _simulated: simulated,
    })
}

/// Returns a cell's first answer in this run, if the present one says nothing else.
fn first_of_run(
    config: &DispatchConfig,
    now: Capabilities,
) -> Result<Capabilities, BoxedDiagnostic> {
    let mut first = FIRST.lock().unwrap_or_else(PoisonError::into_inner);
    let key = (config.cell.clone(), config.cell_name.clone());
    let first = first.entry(key).or_insert_with(|| now.clone());
    match now.change_since(first) {
        None => Ok(Capabilities {
            clock_unix_ms: now.clock_unix_ms,
            ..first.clone()
        }),
        Some(change) => {
            let cell = now.cell;
            Err(DispatchError::from(CellError::Changed { cell, change }).into())
        }
    }
}

/// Checks that a cell has the goals' controllers.
fn check_controllers(cell: &Capabilities, goal: &Goal) -> Result<(), BoxedDiagnostic> {
    let wrong = |problem| DispatchError::Controllers {
        cell: cell.cell.clone(),
        problem,
    };
    let [carrier, hand] = cell.controllers.as_slice() else {
        let found = cell.controllers.len();
        return Err(wrong(ControllerMismatch::Count { found }).into());
    };
    if matches!(goal.carrier, PalmTrajectory::Palm(_)) && cell.palm.is_none() {
        return Err(wrong(ControllerMismatch::NoPalmLimits).into());
    }
    let none = Vec::new();
    let moved = match &goal.carrier {
        PalmTrajectory::Palm(_) => ("palm", &none),
        PalmTrajectory::Arm(arm) => ("arm", &arm.joints),
    };
    for (offer, (controller, joints)) in [(carrier, moved), (hand, ("hand", &goal.hand.joints))] {
        check_controller(offer, controller, joints).map_err(wrong)?;
    }
    Ok(())
}

fn check_controller(
    offer: &ControllerInfo,
    expected: &'static str,
    joints: &[String],
) -> Result<(), ControllerMismatch> {
    let ControllerInfo {
        controller,
        joints: offered,
        rate_hz,
    } = offer;
    let controller = controller.clone();
    if controller != expected {
        let found = controller;
        return Err(ControllerMismatch::Kind { found, expected });
    }
    if !(1.0..=MAX_HZ).contains(rate_hz) {
        let rate_hz = *rate_hz;
        return Err(ControllerMismatch::Rate {
            controller,
            rate_hz,
        });
    }
    if let Some(joint) = joints.iter().find(|&joint| !offered.contains(joint)) {
        let joint = joint.clone();
        return Err(ControllerMismatch::MissingJoint { controller, joint });
    }
    if let Some(joint) = offered.iter().find(|&joint| !joints.contains(joint)) {
        let joint = joint.clone();
        return Err(ControllerMismatch::UncommandedJoint { controller, joint });
    }
    if offered.len() != joints.len() {
        return Err(ControllerMismatch::JointTwice { controller });
    }
    Ok(())
}

/// Returns the configuration of a `dispatch` stage's simulated cell that listens at `listen`.
///
/// # Errors
///
/// Fails if the arm's URDF cannot be read, or the pose of its base is invalid.
pub fn simulated_cell(
    config: &DispatchConfig,
    listen: String,
) -> Result<SimulatedCellConfig, BoxedDiagnostic> {
    let arm = config.arm.as_ref().map(|options| {
        let urdf = fs::read_to_string(&options.robot).map_err(|source| {
            robot_meshes::LoadError::ReadUrdf {
                path: options.robot.clone(),
                source,
            }
        })?;
        Ok::<_, BoxedDiagnostic>(arm_of(options, urdf)?)
    });
    let (name, simulated) = (config.cell_name.clone(), config.resolved().simulated);
    Ok(setup(name, listen, simulated, arm.transpose()?))
}

/// Returns the arm of a simulated cell.
fn arm_of(options: &ArmConfig, urdf: String) -> Result<CellArm, DispatchError> {
    Ok(CellArm {
        urdf,
        palm: options.palm.clone(),
        table_from_base: options.table_from_base()?,
    })
}

fn setup(
    name: String,
    listen: String,
    config: SimulatedConfig,
    arm: Option<CellArm>,
) -> SimulatedCellConfig {
    SimulatedCellConfig {
        name,
        listen,
        scene: config.scene,
        arm,
        mismatch: ModelMismatch {
            errors: Some(config.errors),
            latency_s: config.latency_s,
            encoder_noise_rad: config.encoder_noise_rad,
        },
        service: ServiceConfig::default(),
    }
}

fn simulated(
    config: &DispatchConfig,
    robots: &Robots,
) -> Result<Arc<SimulatedCell>, DispatchError> {
    let arm = match (&config.arm, &robots.arm) {
        (Some(options), Some(arm)) => Some(arm_of(options, arm.urdf.clone())?),
        _ => None,
    };
    let (name, listen) = (config.cell_name.clone(), config.listen.clone());
    let requested = CellSetup {
        config: setup(name, listen, config.simulated.clone(), arm),
        robot: robots.digest(),
    };
    let mut running = RUNNING.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(running) = running
        .as_ref()
        .filter(|running| running.requested == requested)
    {
        return Ok(Arc::clone(&running.cell));
    }
    // Stop a cell with other options first: it may hold the port.
    *running = None;
    let cell = Arc::new(SimulatedCell::start_with(
        requested.config.clone(),
        &robots.hand_urdf,
        robots.hand.clone(),
    )?);
    *running = Some(Running {
        requested,
        cell: Arc::clone(&cell),
    });
    Ok(cell)
}
