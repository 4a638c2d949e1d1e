//! The cell that the options ask for.

use std::sync::{Arc, Mutex, PoisonError};

use cell::{
    Access, Capabilities, CellClient, CellError, ObjectError, Service, SimulatedCell,
    SimulatedCellConfig, robot_digest,
};
use schemas::objects::Object;
use serde::{Deserialize, Deserializer};
use simulation::ObjectShape;

use crate::{
    DispatchConfig, DispatchError,
    config::{SIMULATED, SimulatedConfig},
};

/// The simulated cell of this process: it outlives the units, so that whoever watches can stay
/// connected, and it remembers its goals as a real one does.
static RUNNING: Mutex<Option<Running>> = Mutex::new(None);

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
    urdf: &str,
    object: &Object,
) -> Result<Connected, DispatchError> {
    let simulated = if config.cell == SIMULATED {
        let cell = simulated(config, urdf)?;
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
    if capabilities.robot != robot_digest(urdf) {
        return Err(DispatchError::OtherRobot {
            cell: capabilities.cell,
            hand: config.hand.clone(),
        });
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
    } = Options::deserialize(options)?;
    Ok(setup(cell_name, listen, simulated))
}

/// The options that describe the simulated cell.
#[derive(Deserialize)]
struct Options {
    cell_name: String,
    simulated: SimulatedConfig,
}

fn setup(name: String, listen: String, config: SimulatedConfig) -> SimulatedCellConfig {
    SimulatedCellConfig {
        name,
        listen,
        scene: config.scene,
        object_error: ObjectError {
            position_m: config.object_error_m,
            yaw_rad: config.object_error_rad,
        },
        service: Service::default(),
    }
}

fn simulated(config: &DispatchConfig, urdf: &str) -> Result<Arc<SimulatedCell>, CellError> {
    let (name, listen) = (config.cell_name.clone(), config.listen.clone());
    let asked = Asked {
        config: setup(name, listen, config.simulated.clone()),
        robot: robot_digest(urdf),
    };
    let mut running = RUNNING.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(running) = running.as_ref().filter(|running| running.asked == asked) {
        return Ok(Arc::clone(&running.cell));
    }
    // One with other options stops first: it may hold the port.
    *running = None;
    let cell = Arc::new(SimulatedCell::start(asked.config.clone(), urdf)?);
    *running = Some(Running {
        asked,
        cell: Arc::clone(&cell),
    });
    Ok(cell)
}
