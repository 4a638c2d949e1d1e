//! Writes one chart of each kind to a folder, to be looked at.
//!
//! ```sh
//! cargo run --release --workspace --example gallery -- /tmp/gallery
//! ```

use std::{env, error::Error, fs::File, io::Write, path::PathBuf};

use charts::{
    Bars, Captions, Estimate, Estimates, Sample, Scale, Series, bars, histogram, intervals, lines,
    scatter,
};

const OBJECTS: [&str; 6] = [
    "002_master_chef_can",
    "003_cracker_box",
    "006_mustard_bottle",
    "011_banana",
    "025_mug",
    "052_extra_large_clamp",
];

fn main() -> Result<(), Box<dyn Error>> {
    let folder: PathBuf = env::args_os().nth(1).ok_or("which folder?")?.into();
    for (name, svg) in [
        ("lines", curves(Scale::Linear)),
        ("lines_log", curves(Scale::Log)),
        ("few", few()),
        ("many", many()),
        ("bars", errors(1)),
        ("bars_grouped", errors(3)),
        ("bars_signed", signed()),
        ("intervals", rates(1)),
        ("intervals_grouped", rates(2)),
        ("scatter", spread()),
        ("histogram", spread_of_one()),
    ] {
        let svg = svg.ok_or("nothing to draw")?;
        File::create(folder.join(format!("{name}.svg")))?.write_all(svg.as_bytes())?;
    }
    Ok(())
}

/// A wave that looks irregular and is the same every time.
fn wave(number: usize) -> f64 {
    let x = number as f64;
    ((x * 1.7).sin() + (x * 0.61).cos() + (x * 13.37).sin()) / 3.0
}

fn curves(scale: Scale) -> Option<String> {
    let captions = Captions {
        title: "Training of the continuous grasping function",
        x: "epoch",
        y: "loss",
    };
    let series = [
        ("training", 0.02),
        ("held-out sequences", 0.06),
        ("unseen objects", 0.1),
    ];
    let series = series.map(|(name, floor)| Series {
        name: name.to_owned(),
        points: (1..=200_usize)
            .map(|epoch| {
                let falls = 2.0 * (-(epoch as f64) / 18.0).exp() + floor;
                [epoch as f64, falls * (1.0 + 0.08 * wave(epoch))]
            })
            .collect(),
    });
    lines(&captions, scale, &series)
}

fn few() -> Option<String> {
    let captions = Captions {
        title: "Learning rate",
        x: "epoch",
        y: "learning rate",
    };
    let points = (0..10).map(|step| {
        [
            f64::from(step),
            if step == 4 {
                f64::NAN
            } else {
                1e-4 / f64::from(1 + step / 3)
            },
        ]
    });
    let series = Series {
        name: "rate".to_owned(),
        points: points.collect(),
    };
    lines(&captions, Scale::Linear, &[series])
}

fn many() -> Option<String> {
    let captions = Captions {
        title: "Loss terms <weighted> & summed",
        x: "epoch",
        y: "share of the loss",
    };
    let series: Vec<Series> = (0..10_usize)
        .map(|term| Series {
            name: format!("term {term}"),
            points: (0..100_usize)
                .map(|epoch| {
                    let x = epoch as f64;
                    [
                        x,
                        (10.0 - term as f64) * (1.0 + 0.1 * wave(epoch + term)) - 3.0,
                    ]
                })
                .collect(),
        })
        .collect();
    lines(&captions, Scale::Linear, &series)
}

fn errors(n_series: usize) -> Option<String> {
    let captions = Captions {
        title: "Reconstruction by object",
        x: "mean error at the fingertips [mm]",
        y: "",
    };
    let names = OBJECTS.map(str::to_owned);
    let series: Vec<Bars> = ["training", "held out", "unseen"]
        .iter()
        .take(n_series)
        .enumerate()
        .map(|(idx, name)| Bars {
            name: (*name).to_owned(),
            values: (0..OBJECTS.len())
                .filter(|object| idx < 2 || *object >= 3)
                .map(|object| {
                    let error = 5.0 + 4.0 * idx as f64 + 3.0 * wave(object * 3 + idx);
                    (names[object].clone(), error)
                })
                .collect(),
        })
        .collect();
    bars(&captions, &names, &series)
}

fn signed() -> Option<String> {
    let captions = Captions {
        title: "Difference to the preset of the paper",
        x: "difference in success [percentage points]",
        y: "object",
    };
    let objects = OBJECTS.iter().enumerate();
    let values = objects.map(|(idx, name)| ((*name).to_owned(), 12.0 * wave(idx * 5 + 2)));
    let series = Bars {
        name: "difference".to_owned(),
        values: values.collect(),
    };
    bars(&captions, &OBJECTS.map(str::to_owned), &[series])
}

fn rates(n_series: usize) -> Option<String> {
    let captions = Captions {
        title: "Success by object",
        x: "success rate, 95 % interval [%]",
        y: "",
    };
    let series = ["cgf", "interpolate"].iter().take(n_series).enumerate();
    let series = series.map(|(idx, name)| Estimates {
        name: (*name).to_owned(),
        values: (0..OBJECTS.len())
            .filter(|object| idx + object != 4)
            .map(|object| {
                let value = 60.0 - 30.0 * idx as f64 + 25.0 * wave(object * 3 + idx);
                let estimate = Estimate {
                    value,
                    low: value - 8.0,
                    high: value + 9.0,
                };
                (OBJECTS[object].to_owned(), estimate)
            })
            .collect(),
    });
    intervals(
        &captions,
        &OBJECTS.map(str::to_owned),
        &series.collect::<Vec<_>>(),
    )
}

fn spread() -> Option<String> {
    let captions = Captions {
        title: "Palms at the grasp",
        x: "x in the object's frame [m]",
        y: "z in the object's frame [m]",
    };
    let series = ["recorded", "sampled"].map(|name| {
        let offset = name.len();
        Series {
            name: name.to_owned(),
            points: (0..150)
                .map(|number| {
                    let shift = if offset == 8 { 0.0 } else { 0.04 };
                    [
                        0.1 * wave(number * 7 + offset) + shift,
                        0.08 * wave(number * 11 + 3 * offset) + 0.1,
                    ]
                })
                .collect(),
        }
    });
    scatter(&captions, &series)
}

fn spread_of_one() -> Option<String> {
    let captions = Captions {
        title: "Spread of sampled grasps",
        x: "distance from the mean palm [mm]",
        y: "share [%]",
    };
    let samples =
        [("prior", 40.0, 400_usize), ("posterior", 15.0, 90)].map(|(name, scale, count)| Sample {
            name: name.to_owned(),
            values: (0..count)
                .map(|number| scale * (1.0 + wave(number * 3) + 0.5 * wave(number * 17 + 5)))
                .collect(),
        });
    histogram(&captions, 24, &samples)
}
