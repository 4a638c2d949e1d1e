//! `pipeline unit`

use std::{
    io::Read,
    sync::{Arc, Mutex, PoisonError},
    thread,
};

use dataflow::{Forced, Node, NodeName, Observer, make_one, nearest};
use lake::Lake;

use crate::{
    arguments::{Format, UnitArgs},
    command_line::Program,
    commands::pipeline_file,
    interrupt,
    outcome::{Outcome, Trouble},
    processes::Event,
    report,
};

/// Makes one unit whose inputs are in the lake.
pub(crate) fn unit(program: &Program, args: &UnitArgs) -> Result<Outcome, Trouble> {
    let pipeline = pipeline_file::read_with(program.kinds, &args.file, &args.values)?;
    let node = NodeName::parse(&args.artifact).ok_or_else(|| {
        let known: Vec<String> = pipeline
            .nodes
            .iter()
            .map(|node| node.name.to_string())
            .collect();
        let near = nearest(&args.artifact, known.iter().map(String::as_str));
        Trouble::usage(
            format!("`{}` is not of the form `stage.artifact`", args.artifact),
            near.map_or_else(
                || format!("its outputs are: {}", known.join(", ")),
                |near| format!("did you mean `{near}`?"),
            ),
        )
    })?;
    let lake = Arc::new(Lake::open(&program.lake));
    interrupt::drop_on_signal(&lake)?;
    if args.with_parent {
        stop_with_parent(&lake);
    }
    let forced = if args.fresh { Forced::Yes } else { Forced::No };
    let teller = Teller {
        format: args.format,
        unsaid: Mutex::new(None),
    };
    let made = make_one(
        &pipeline,
        lake.as_ref(),
        &node,
        &args.partition,
        forced,
        &teller,
    );
    lake.leave();
    if let Some(trouble) = teller.unsaid() {
        return Err(trouble);
    }
    match (made, args.format) {
        (Ok(made), format) => {
            let fingerprint = made.fingerprint.to_hex();
            let made_now = made.made_now;
            match format {
                Format::Text => report::data(format!("{fingerprint}\n").as_bytes())?,
                Format::Json => tell(&Event::Done {
                    fingerprint,
                    made_now,
                })?,
            }
            Ok(Outcome::Done)
        }
        (Err(err), Format::Text) => Err(err.into()),
        (Err(err), Format::Json) => {
            let (hint, left_out) = err.advice();
            let left_out = left_out.cloned();
            let trouble = Trouble::from(err);
            let message = match &trouble {
                Trouble::Failed { error, .. } => report::chain(error),
                Trouble::Usage { message, .. } => message.clone(),
                Trouble::File(err) => err.to_string(),
            };
            tell(&Event::Failed {
                message,
                hint,
                left_out,
            })?;
            Ok(Outcome::Told)
        }
    }
}

/// Ends this process as soon as its stdin closes: then the process that started it is gone.
fn stop_with_parent(lake: &Arc<Lake>) {
    let lake = Arc::clone(lake);
    thread::spawn(move || {
        let mut nothing = Vec::new();
        let _closed = std::io::stdin().lock().read_to_end(&mut nothing);
        interrupt::stop(&lake);
    });
}

fn tell(event: &Event) -> Result<(), Trouble> {
    let json = serde_json::to_string(event).map_err(|err| Trouble::failed(err, None))?;
    report::data(format!("{json}\n").as_bytes())
}

/// Passes on how far the unit is.
struct Teller {
    format: Format,
    /// Why something could not be passed on.
    unsaid: Mutex<Option<Trouble>>,
}

impl Teller {
    fn unsaid(self) -> Option<Trouble> {
        let unsaid = self.unsaid.into_inner();
        unsaid.unwrap_or_else(PoisonError::into_inner)
    }
}

impl Observer for Teller {
    fn unit_progress(&self, _node: &Node, _partition: &str, fraction: f64, message: &str) {
        if self.format == Format::Json {
            let message = message.to_owned();
            if let Err(trouble) = tell(&Event::Progress { fraction, message }) {
                let mut unsaid = self.unsaid.lock().unwrap_or_else(PoisonError::into_inner);
                unsaid.get_or_insert(trouble);
            }
        }
    }

    fn waiting(&self, node: &Node, partition: &str, holder: &str) {
        let name = &node.name;
        report::line(&format!(
            "wait   {name} `{partition}`: waiting for {holder}"
        ));
    }

    fn damaged(&self, node: &Node, partition: &str) {
        let name = &node.name;
        report::line(&format!(
            "mend   {name} `{partition}` is damaged in the lake and is made again"
        ));
    }
}
