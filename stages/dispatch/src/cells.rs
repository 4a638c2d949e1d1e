//! The cell that the options ask for.

use std::{
    fs,
    sync::{Arc, Mutex, PoisonError},
};

use cell::{
    Access, Capabilities, CellArm, CellClient, Gap, ObjectError, Service, SimulatedCell,
    SimulatedCellConfig,
};
use schemas::objects::Object;
use serde::{Deserialize, Deserializer, de::Error as _};
use simulation::ObjectShape;

use crate::{
    ArmConfig, DispatchConfig, DispatchError,
    config::{SIMULATED, SimulatedConfig},
    robots::Robots,
};

/// The simulated cell of this process: it outlives the units, so that whoever watches can stay
/// connected, and it remembers its goals as a real one does.
static RUNNING: Mutex<Option<Running>> = Mutex::new(None);

/// How near an arm must stand to where it was planned, in meters and in a quaternion's numbers.
const SAME_PLACE: f64 = 1e-6;

struct Running {
    asked: Asked,
    cell: Arc<SimulatedCell>,
}

/// What a simulated cell was started with.
#[derive(PartialEq)]
struct Asked {
    config: SimulatedCellConfig,
    robot: String,
}

/// A cell that answered.
pub(crate) struct Connected {
    pub(crate) client: CellClient,
    pub(crate) capabilities: Capabilities,
    /// Keeps the simulated cell alive.
    _simulated: Option<Arc<SimulatedCell>>,
}

/// Connects to the cell that the options ask for, with `object` lying before it; starts the
/// simulated one if it does not run yet.
pub(crate) fn connect(
    config: &DispatchConfig,
    robots: &Robots,
    object: &Object,
) -> Result<Connected, DispatchError> {
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
    // The simulated cell is of this process: nobody has to say who they are.
    let access = config.access.as_deref().filter(|_| simulated.is_none());
    let access = access.map(Access::read).transpose()?;
    let client = CellClient::connect_as(
        access.as_ref(),
        endpoint,
        &config.cell_name,
        config.answer_timeout(),
    )?;
    let capabilities = client.capabilities(config.answer_timeout())?;
    if capabilities.robot != robots.digest() {
        return Err(DispatchError::OtherRobot {
            cell: capabilities.cell,
            hand: config.hand.clone(),
        });
    }
    let planned = config.arm.as_ref();
    let planned = planned.map(ArmConfig::table_from_base).transpose()?;
    let planned = planned.map(|pose| pose.to_array());
    if let (Some(planned), Some(there)) = (planned, capabilities.table_from_base) {
        let is_there = planned
            .iter()
            .zip(&there)
            .all(|(a, b)| (a - b).abs() < SAME_PLACE);
        if !is_there {
            return Err(DispatchError::BadOption {
                key: "arm.table_from_base",
                problem: format!("{planned:?}, but the cell says that its arm stands at {there:?}"),
            });
        }
    }
    Ok(Connected {
        client,
        capabilities,
        _simulated: simulated,
    })
}

/// Returns how the simulated cell of a `dispatch` stage is set up, which listens at `listen`, from the
/// stage's options.
///
/// # Errors
///
/// Fails if they are not the options of a `dispatch` stage.
pub fn simulated_cell<'de, D: Deserializer<'de>>(
    options: D,
    listen: String,
) -> Result<SimulatedCellConfig, D::Error> {
    let Options {
        cell_name,
        simulated,
        arm,
    } = Options::deserialize(options)?;
    let arm = arm.map(|options| {
        let urdf = fs::read_to_string(&options.robot).map_err(|err| {
            D::Error::custom(format!(
                "cannot read the arm's URDF `{}`: {err}",
                options.robot.display()
            ))
        })?;
        arm_of(&options, urdf).map_err(D::Error::custom)
    });
    Ok(setup(cell_name, listen, simulated, arm.transpose()?))
}

/// Returns the arm of a simulated cell.
fn arm_of(options: &ArmConfig, urdf: String) -> Result<CellArm, DispatchError> {
    Ok(CellArm {
        urdf,
        palm: options.palm.clone(),
        table_from_base: *options.table_from_base()?.isometry(),
    })
}

/// The options that describe the simulated cell.
#[derive(Deserialize)]
struct Options {
    cell_name: String,
    simulated: SimulatedConfig,
    #[serde(default)]
    arm: Option<ArmConfig>,
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
        gap: Gap {
            object: ObjectError {
                position_m: config.object_error_m,
                yaw_rad: config.object_error_rad,
            },
            latency_s: config.latency_s,
            encoder_noise_rad: config.encoder_noise_rad,
        },
        service: Service::default(),
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
    let asked = Asked {
        config: setup(name, listen, config.simulated.clone(), arm),
        robot: robots.digest(),
    };
    let mut running = RUNNING.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(running) = running.as_ref().filter(|running| running.asked == asked) {
        return Ok(Arc::clone(&running.cell));
    }
    // One with other options stops first: it may hold the port.
    *running = None;
    let cell = Arc::new(SimulatedCell::start(
        asked.config.clone(),
        &robots.hand_urdf,
    )?);
    *running = Some(Running {
        asked,
        cell: Arc::clone(&cell),
    });
    Ok(cell)
}
