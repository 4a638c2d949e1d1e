//! The stage: one unit per object.

use std::path::Path;

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Mean, OptionsUsed, Outcome, Output, Outputs, Scope,
    SourceFile, Stage, Sum, Unit, counted,
};
use depth_view::TablePlane;
use lake::WriteArtifact;
use schemas::{
    Table,
    views::{View, Views},
};

use crate::{
    bop::{self, CAMERAS, SceneObject},
    cloud,
    config::ViewsConfig,
    error::Fault,
    file::{self, MAX_CLOUD_BYTES},
    layout::{self, Layout},
    object, ply,
    recording::{self, Choice, Recorded},
    scene_image,
    world::{self, Image},
};

/// Number of images that are not used, for they have no place in the world of the others: a fact.
const UNUSED: &str = "unused";
/// Why images were left out while listing, a line each: a fact.
const LEFT_OUT: &str = "left out";
/// The topic that is read of a recording, and the numbers of its images: facts.
const TOPIC: &str = "topic";
const IMAGES: &str = "images";
/// File of an artifact that says why images were left out, a line each.
const LEFT_OUT_FILE: &str = "left_out.txt";
/// File of an artifact that says what is to be known of images that are used, a line each.
const NOTES_FILE: &str = "notes.txt";
/// What the poses of cameras are, for messages.
const SCENE_POSES: &str = "`cam_R_w2c` and `cam_t_w2c` take the world to the camera, in mm";
const RECORDED_POSES: &str = "choose one of the `images`, or record a tf that follows the camera";

/// Reads depth images of objects.
pub struct RecordedViews;

dataflow::metrics! {
    /// Metrics of an object's images.
    pub struct ViewsMetrics {
        /// Number of images.
        views_n: Sum,
        /// Share of the object's pixels that have a depth.
        measured_share: Mean,
        /// Number of images that cannot be used.
        left_out_n: Sum,
        /// Number of images that are not used, for nothing says where their cameras were, or which of several objects they
        /// show.
        unused_n: Sum,
    }
}

impl Stage for RecordedViews {
    type Config = ViewsConfig;

    const KIND: &'static str = "views";
    const ABOUT: &'static str = "Reads depth images of objects on a table, or clouds of points";
    const INPUTS: &'static [&'static str] = &[];
    const OUTPUTS: Outputs<Self> = &[&Self];

    fn prepare(config: &ViewsConfig) -> Result<(), BoxedDiagnostic> {
        layout::of(&config.path)?;
        Ok(())
    }
}

impl Output for RecordedViews {
    type Stage = Self;
    type Metrics = ViewsMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = Views::NAME;
    const SCHEMA: &'static str = Views::VERSION;
    const PARTITION: &'static str = Views::PARTITION;
    const LINE: Option<Line<ViewsMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        let objects = counted(summary.n_made, "object");
        let images = counted(metrics.views_n, "depth image");
        let but = |n: f64, why| match n {
            0.0 => String::new(),
            _ => format!(", {n} {why}"),
        };
        let left_out = but(metrics.left_out_n, "left out as faulty");
        let unused = but(metrics.unused_n, "not used (no poses, or several alike)");
        format!("{objects} → {images}{left_out}{unused}")
    });
    /// The others choose units, images and names.
    const OPTIONS: OptionsUsed = OptionsUsed::Only(&["table", "camera_m", "unit_m"]);

    fn units(config: &ViewsConfig, _scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let file = match layout::of(&config.path)? {
            Layout::Scene => {
                let objects = bop::objects(config)?;
                let unit = |object| scene_unit(&config.path, object);
                return Ok(objects.iter().map(unit).collect());
            }
            Layout::Cloud => config.path.clone(),
            Layout::Recording(file) => file,
        };
        let name = config.object_name();
        let mut unit = Unit::new(&name).with_label("object", &name);
        if layout::is_recording(&file) {
            let images: Vec<String> = config.images.iter().map(ToString::to_string).collect();
            unit = unit.with_fact(IMAGES, images.join(" "));
            if let Some(topic) = &config.topic {
                unit = unit.with_fact(TOPIC, topic);
            }
        }
        Ok(vec![unit.with_file(SourceFile::named_by_file(&file))])
    }

    fn make(
        config: &ViewsConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<ViewsMetrics>, BoxedDiagnostic> {
        let left_out = inputs.fact(LEFT_OUT).unwrap_or_default();
        let mut left_out: Vec<String> = left_out.lines().map(str::to_owned).collect();
        let read = read(config, inputs, &mut left_out);
        let mut notes = Vec::new();
        let mut unused_n = 0;
        let kept = read.and_then(|read| {
            notes = read.recorded.notes;
            unused_n = read.recorded.unused_n;
            world::of_one_world(read.recorded.images, read.poses, &mut left_out)
        });
        let images = match kept {
            Ok(images) => images,
            Err(fault) => return Ok(Outcome::skipped(fault.reason())),
        };
        if images.is_empty() {
            let first = left_out.first().map_or("no image", String::as_str);
            let more = match left_out.len().saturating_sub(1) {
                0 => String::new(),
                more => format!(" (and {more} more)"),
            };
            return Ok(Outcome::skipped(format!("{first}{more}")));
        }
        let metrics = ViewsMetrics {
            views_n: images.len() as f64,
            measured_share: images.iter().map(measured_share).sum::<f64>() / images.len() as f64,
            left_out_n: left_out.len() as f64,
            unused_n: unused_n as f64,
        };
        let table = config.known_table();
        let rows = images.iter().map(|image| row(image, table));
        cx.write(&rows.collect::<Views>())?;
        for (file, lines) in [(LEFT_OUT_FILE, left_out), (NOTES_FILE, notes)] {
            if !lines.is_empty() {
                cx.write_file(file, (lines.join("\n") + "\n").as_bytes())?;
            }
        }
        Ok(Outcome::Made(metrics))
    }
}

/// What is read of a unit, and what the poses of its cameras are.
struct Read {
    recorded: Recorded,
    poses: &'static str,
}

/// Reads the images of a unit; the reasons for those that cannot be used are added to `left_out`.
fn read(config: &ViewsConfig, inputs: &Inputs, left_out: &mut Vec<String>) -> Result<Read, Fault> {
    let files = inputs.files();
    if let Some(list) = files.iter().find(|file| file.name == CAMERAS) {
        let unused_n = inputs.fact(UNUSED).and_then(|n| n.parse().ok());
        let recorded = Recorded {
            images: scene_images(list, config, files, left_out)?,
            unused_n: unused_n.unwrap_or(0),
            notes: Vec::new(),
        };
        let poses = SCENE_POSES;
        return Ok(Read { recorded, poses });
    }
    let poses = RECORDED_POSES;
    if let Some(file) = files.iter().find(|file| layout::is_recording(&file.path)) {
        let images = inputs.fact(IMAGES).unwrap_or_default().split_whitespace();
        let choice = Choice {
            topic: inputs.fact(TOPIC),
            images: images.flat_map(str::parse).collect(),
        };
        let recorded = recording::read(file, &choice, config, left_out)?;
        return Ok(Read { recorded, poses });
    }
    let recorded = Recorded {
        images: vec![cloud_image(config, files)?],
        unused_n: 0,
        notes: Vec::new(),
    };
    Ok(Read { recorded, poses })
}

/// Returns the unit of a scene's object.
fn scene_unit(scene: &Path, object: &SceneObject) -> Unit {
    let list = SourceFile::new(CAMERAS.to_owned(), scene.join(CAMERAS));
    let mut unit = Unit::new(&object.name)
        .with_label("object", &object.name)
        .with_fact(UNUSED, object.unused_n.to_string())
        .with_file(list);
    let mut left_out = Vec::new();
    for shown in &object.shown {
        match shown.files(scene) {
            Ok(files) => unit.files.extend(files),
            Err(fault) => left_out.push(fault.of_image(shown.image)),
        }
    }
    unit.with_fact(LEFT_OUT, left_out.join("\n"))
}

/// Reads the images of a scene's object; the reasons for those that cannot be used are added to `left_out`.
fn scene_images(
    list: &SourceFile,
    config: &ViewsConfig,
    files: &[SourceFile],
    left_out: &mut Vec<String>,
) -> Result<Vec<Image>, Fault> {
    let cameras = bop::entries(&list.path)?;
    let mut images: Vec<Image> = Vec::new();
    for (&number, entry) in &cameras {
        let named = |name: &str| files.iter().find(|file| file.name.contains(name));
        let Some(depth) = named(&bop::depth_file(number)) else {
            continue;
        };
        let mask = named(&format!("/{number:06}_"));
        match scene_image::read(format!("{number:06}"), entry, depth, mask, config) {
            Ok(image) => images.push(image),
            Err(fault) => left_out.push(fault.of_image(number)),
        }
        world::check_pixels(&images)?;
    }
    Ok(images)
}

/// Reads a cloud as an image.
fn cloud_image(config: &ViewsConfig, files: &[SourceFile]) -> Result<Image, Fault> {
    // Its unit has one.
    let file = files.first().cloned();
    let SourceFile { name, path, .. } = file.unwrap_or(SourceFile::named("", &config.path));
    let bytes = file::read(&path, MAX_CLOUD_BYTES);
    let parse = layout::cloud_format(&path).unwrap_or(ply::points);
    let points = bytes.and_then(|bytes| parse(&bytes));
    let points = points.map_err(|fault| fault.in_file(&name))?;
    let points = cloud::measured(&points, config.unit_m)?;
    let view = cloud::depth_image(&points, &config.camera_in_world(), config.unit_m)?;
    let (view, table) = object::found(view, None, config.known_table())?;
    Ok(Image {
        name,
        view,
        depth_step_m: cloud::DEPTH_STEP_M,
        table,
    })
}

/// Returns the share of an object's pixels that have a depth.
fn measured_share(image: &Image) -> f64 {
    let pixels = image.view.mask.iter().zip(&image.view.depth_m);
    let (own_n, measured_n) = pixels
        .filter(|(own, _)| **own)
        .fold((0, 0), |(n, measured), it| {
            (n + 1, measured + usize::from(*it.1 > 0.0))
        });
    measured_n as f64 / f64::from(own_n.max(1))
}

/// Returns an image as it is stored.
fn row(image: &Image, table: Option<TablePlane>) -> View {
    let table = table.map(|table| [table.up.x, table.up.y, table.up.z, table.height_m]);
    View {
        table: table.into_iter().collect(),
        ..stored_views::stored(image.name.clone(), &image.view, image.depth_step_m)
    }
}
