//! What cameras saw of each object, and the shape that was estimated from it or found in it.

use schemas::{
    Table,
    completions::CompletedObject,
    rollouts::{Rollouts, Verdict},
    views::Views,
};

use crate::{
    EstimatedObject, PageData,
    estimates::PICTURED,
    numbers::{count, percent, signed},
    table::{Cell, DataTable, Picture, Section, Tile},
};

/// The kind of the stages that put motions before true objects.
const GROUND_TRUTH: &str = "ground_truth";
/// The kind of the stages that find objects of known shape.
const REGISTER: &str = "register";

/// Whence a run has the shapes of its objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ShapeSource {
    /// They are estimated from views.
    Estimated,
    /// They are known, and found in views.
    Known,
}

impl ShapeSource {
    fn of(gathered: &PageData) -> Self {
        let facts = &gathered.facts;
        let stage = facts.stage_of(CompletedObject::NAME);
        match stage.and_then(|stage| facts.run.kinds.get(stage)) {
            Some(kind) if kind == REGISTER => Self::Known,
            _ => Self::Estimated,
        }
    }

    /// Says what pictures show.
    fn about(self) -> &'static str {
        match self {
            Self::Estimated => {
                "Each object as the camera saw it, first view, and its estimated shape from there and from the \
                 opposite side. In the depth image near is light, the object is orange, and black has no depth. Of the \
                 shape, what is within 5 mm of a point that a view shows is orange; the rest was not seen and is blue. \
                 Its hull is free where a view shows that nothing is there."
            }
            Self::Known => {
                "Each object as the camera saw it, first view, and its mesh in the pose that was found, from there and \
                 from the opposite side. In the depth image near is light, the object is orange, and black has no \
                 depth. Of the mesh, what is within 5 mm of a point that a view shows is orange; the rest was not seen \
                 and is blue."
            }
        }
    }

    /// Says what motions and verdicts are about.
    fn about_motions(self, has_truth: bool) -> &'static str {
        match (self, has_truth) {
            (Self::Estimated, true) => {
                "Motions are planned for the estimated shapes, and simulated with the true objects."
            }
            (Self::Estimated, false) => {
                "No true shape is known in this run: verdicts are on the estimated shapes."
            }
            (Self::Known, true) => {
                "Motions are planned for the poses that were found, and simulated with the objects in their true poses."
            }
            (Self::Known, false) => {
                "No true pose is known in this run: verdicts are on the poses that were found."
            }
        }
    }

    /// Returns the name of a shape, and the captions of its pictures.
    fn words(self) -> (&'static str, [&'static str; 2]) {
        match self {
            Self::Estimated => (
                "Estimated shape",
                ["estimate, near side", "estimate, far side"],
            ),
            Self::Known => ("Mesh", ["mesh, near side", "mesh, far side"]),
        }
    }
}

/// Returns the section; `None` without views and estimates, in runs that need none.
pub(crate) fn section(gathered: &PageData) -> Option<Section> {
    let run = &gathered.facts.run;
    let is_wired = |input: &str| run.wired.contains_key(input);
    if !is_wired(Views::NAME) && !is_wired(CompletedObject::NAME) {
        return None;
    }
    let mut section = Section::new("views", "Depth images");
    let left_out = gathered.facts.left_out.get(CompletedObject::NAME);
    for (reason, n) in left_out.into_iter().flatten() {
        section.say(format!("{n} left out: {reason}."));
    }
    if gathered.estimated.is_empty() {
        section.say("No completions are wired to this report.");
        return Some(section);
    }
    let source = ShapeSource::of(gathered);
    section.tiles = tiles(gathered, source);
    if !section.tiles.is_empty() {
        section.say(source.about());
        if section.tiles.iter().any(|tile| tile.has_motion) {
            section.say("A click on an object shows its motions.");
        }
    }
    let others_n = gathered.estimated.len().saturating_sub(PICTURED);
    if others_n > 0 && !section.tiles.is_empty() {
        section.say(format!("{others_n} more are in the table alone."));
    }
    let has_truth = run.kinds.values().any(|kind| kind == GROUND_TRUTH);
    if is_wired(Rollouts::NAME) {
        section.say(source.about_motions(has_truth));
    }
    section.tables.push(table(gathered, source));
    Some(section)
}

/// Returns the objects with pictures.
fn tiles(gathered: &PageData, source: ShapeSource) -> Vec<Tile> {
    let estimated = gathered.estimated.iter();
    let tile = |(name, object): (&String, &EstimatedObject)| {
        Some(Tile {
            object: name.clone(),
            pictures: pictures(name, object, source)?,
            lines: lines(gathered, name, object, source),
            has_motion: gathered.motions.iter().any(|one| one.object == *name),
        })
    };
    estimated.filter_map(tile).collect()
}

/// Returns the pictures of an object, if it has some.
fn pictures(name: &str, object: &EstimatedObject, source: ShapeSource) -> Option<Vec<Picture>> {
    let pictures = object.pictures.as_ref()?;
    let mut all = vec![Picture {
        caption: "depth image",
        about: format!("Depth image about {name}"),
        png: pictures.depth.clone(),
    }];
    if let Some([near, far]) = &pictures.shape {
        let (noun, captions) = source.words();
        let unseen = percent(object.unseen_share);
        all.push(Picture {
            caption: captions[0],
            about: format!("{noun} of {name} from the camera's side"),
            png: near.clone(),
        });
        all.push(Picture {
            caption: captions[1],
            about: format!(
                "{noun} of {name} from the opposite side; {unseen} of the whole surface was not seen"
            ),
            png: far.clone(),
        });
    }
    Some(all)
}

/// Returns what is known of a shape, and how many of the motions to it hold.
fn lines(
    gathered: &PageData,
    name: &str,
    object: &EstimatedObject,
    source: ShapeSource,
) -> Vec<String> {
    let views = if object.views_n == 1 { "view" } else { "views" };
    let views = format!("{} {views}", count(object.views_n));
    let unseen = format!("{} not seen", percent(object.unseen_share));
    let mut lines = vec![match source {
        ShapeSource::Estimated => {
            let symmetric = if object.symmetric {
                "symmetric"
            } else {
                "not symmetric"
            };
            let free = percent(object.free_share);
            format!("{views} · {symmetric} · {unseen} · {free} of its hull free")
        }
        ShapeSource::Known => format!("{views} · {unseen}"),
    }];
    if let Some(rollouts) = gathered.rollouts.get(name).filter(|all| !all.is_empty()) {
        let held = rollouts.iter().filter(|one| one.verdict == Verdict::Held);
        let (held, n) = (held.count() as f64, rollouts.len());
        let rate = percent(held / n as f64);
        lines.push(format!("{rate} of {} candidates hold", count(signed(n))));
    }
    lines
}

fn table(gathered: &PageData, source: ShapeSource) -> DataTable {
    let when_estimated = |cell: Cell| match source {
        ShapeSource::Estimated => cell,
        ShapeSource::Known => Cell::Missing,
    };
    let mut table = DataTable::new(
        "completions",
        "Objects in depth images",
        &[
            ("object", "Object"),
            ("views_n", "Views"),
            ("symmetric", "Symmetric"),
            ("free_share", "Hull free"),
            ("seen_n", "Points seen"),
            ("unseen_share", "Not seen"),
        ],
    );
    for (name, object) in &gathered.estimated {
        table.row([
            Cell::Link {
                filter: "object",
                value: name.clone(),
                shown: name.clone(),
            },
            Cell::count(object.views_n),
            when_estimated(Cell::text(if object.symmetric { "yes" } else { "no" })),
            when_estimated(Cell::share(object.free_share)),
            Cell::count(signed(object.seen_n)),
            Cell::share(object.unseen_share),
        ]);
    }
    table
}
