//! Contents of a chart: every point, name and caption, inside the picture, and nothing else.

use charts::{
    Bars, Captions, Estimate, Estimates, Sample, Scale, Series, bars, histogram, intervals, lines,
    scatter,
};
use quick_xml::{Reader, events::Event};

const CAPTIONS: Captions = Captions {
    title: "Errors <by> \"object\" & joint\u{7}",
    x: "epoch",
    y: "error [mm]",
};

/// One element: its name, its attributes, its text.
#[derive(Debug, Default)]
struct Element {
    name: String,
    attributes: Vec<(String, String)>,
    text: String,
}

impl Element {
    fn number(&self, name: &str) -> f64 {
        self.attribute(name).parse().unwrap()
    }

    fn attribute(&self, name: &str) -> &str {
        let found = self.attributes.iter().find(|(known, _)| known == name);
        found.map_or("", |(_, value)| value)
    }
}

/// Parses a chart: fails if it is not well-formed. Leaves out what is not drawn: titles, which
/// [`titles`] has, what they are for, and the colors in the dark.
fn elements(svg: &str) -> Vec<Element> {
    let mut all = all_elements(svg);
    all.retain(|element| {
        let is_drawn = !["g", "title", "style"].contains(&element.name.as_str());
        is_drawn && element.attribute("fill-opacity") != "0"
    });
    all
}

/// Returns the titles that a viewer shows for the points and bars of a chart.
fn titles(svg: &str) -> Vec<String> {
    let all = all_elements(svg).into_iter();
    let titles = all.filter(|element| element.name == "title");
    titles.map(|title| title.text).collect()
}

fn all_elements(svg: &str) -> Vec<Element> {
    let mut reader = Reader::from_str(svg);
    let mut elements: Vec<Element> = Vec::new();
    loop {
        match reader.read_event().unwrap() {
            Event::Start(start) | Event::Empty(start) => {
                let attributes = start.attributes().map(|attribute| {
                    let attribute = attribute.unwrap();
                    let name = String::from_utf8(attribute.key.0.to_vec()).unwrap();
                    (name, String::from_utf8(attribute.value.to_vec()).unwrap())
                });
                elements.push(Element {
                    name: String::from_utf8(start.name().0.to_vec()).unwrap(),
                    attributes: attributes.collect(),
                    text: String::new(),
                });
            }
            Event::Text(text) => {
                elements.last_mut().unwrap().text += &text.decode().unwrap();
            }
            Event::GeneralRef(name) => {
                let name = name.decode().unwrap();
                let text = quick_xml::escape::resolve_predefined_entity(&name).unwrap();
                elements.last_mut().unwrap().text += text;
            }
            Event::Eof => return elements,
            _ => {}
        }
    }
}

fn texts(elements: &[Element]) -> Vec<&str> {
    let texts = elements.iter().filter(|element| element.name == "text");
    texts.map(|element| element.text.trim_end()).collect()
}

/// The numbers of a path.
fn path_of(element: &Element) -> Vec<[f64; 2]> {
    let points = element.attribute("d").split(['M', 'L']).skip(1);
    points
        .map(|point| {
            let (x, y) = point.split_once(' ').unwrap();
            [x.parse().unwrap(), y.parse().unwrap()]
        })
        .collect()
}

/// Everything lies within the picture.
fn assert_inside(elements: &[Element]) {
    let (width, height) = (elements[0].number("width"), elements[0].number("height"));
    let is_inside = |[x, y]: [f64; 2]| {
        assert!((0.0..=width).contains(&x), "{x} of {width}");
        assert!((0.0..=height).contains(&y), "{y} of {height}");
    };
    for element in &elements[2..] {
        match element.name.as_str() {
            "path" => path_of(element).into_iter().for_each(is_inside),
            "circle" => is_inside([element.number("cx"), element.number("cy")]),
            "rect" => {
                let corner = [element.number("x"), element.number("y")];
                is_inside(corner);
                let size = [element.number("width"), element.number("height")];
                is_inside([corner[0] + size[0], corner[1] + size[1]]);
            }
            "text" if element.attribute("transform").is_empty() => {
                let (x, y) = (element.number("x"), element.number("y"));
                let size = element.number("font-size");
                // A sans-serif font is about this wide at most.
                let width = 0.5 * size * element.text.chars().count() as f64;
                let from = match element.attribute("text-anchor") {
                    "start" => x,
                    "middle" => x - width / 2.0,
                    _ => x - width,
                };
                is_inside([from, y]);
                is_inside([from + width, y]);
            }
            _ => {}
        }
    }
}

fn series(name: &str, points: &[[f64; 2]]) -> Series {
    Series {
        name: name.to_owned(),
        points: points.to_vec(),
    }
}

/// Curves in the colors of series, not the lines of the grid, which are thinner.
fn curves(elements: &[Element]) -> Vec<&Element> {
    let paths = elements.iter().filter(|element| element.name == "path");
    paths
        .filter(|path| path.number("stroke-width") > 1.0)
        .collect()
}

fn count(elements: &[Element], name: &str) -> usize {
    elements
        .iter()
        .filter(|element| element.name == name)
        .count()
}

#[test]
fn a_line_goes_through_every_point_and_breaks_where_one_has_no_place() {
    let points: Vec<[f64; 2]> = (0..100_u32)
        .map(|x| [f64::from(x), f64::from(x) * 0.5])
        .collect();
    let svg = lines(&CAPTIONS, Scale::Linear, &[series("a", &points)]).unwrap();
    let whole = elements(&svg);
    let drawn = curves(&whole);
    assert_eq!(drawn.len(), 1, "no legend for one line");
    let drawn = path_of(drawn[0]);
    assert_eq!(drawn.len(), points.len());
    assert!(drawn.is_sorted_by(|a, b| a[0] < b[0] && a[1] > b[1]));
    assert_inside(&whole);

    let mut broken = points.clone();
    broken[40][1] = f64::NAN;
    broken[42][1] = f64::NEG_INFINITY;
    broken[60][0] = f64::NAN;
    let broken = elements(&lines(&CAPTIONS, Scale::Linear, &[series("a", &broken)]).unwrap());
    let pieces: Vec<usize> = curves(&broken)
        .iter()
        .map(|piece| path_of(piece).len())
        .collect();
    assert_eq!(pieces, [40, 17, 39]);
    assert_eq!(count(&broken, "circle"), 1, "a point on its own is a dot");
    assert_inside(&broken);
}

#[test]
fn a_logarithmic_axis_shows_factors_as_lengths_and_leaves_out_what_is_not_positive() {
    let points = [
        [0.0, 1.0],
        [1.0, 10.0],
        [2.0, 100.0],
        [3.0, 0.0],
        [4.0, -5.0],
    ];
    let svg = lines(&CAPTIONS, Scale::Log, &[series("a", &points)]).unwrap();
    let whole = elements(&svg);
    let drawn = curves(&whole);
    let [low, middle, high] = path_of(drawn[0])[..] else {
        panic!("{svg}");
    };
    assert!((low[1] - middle[1] - (middle[1] - high[1])).abs() < 0.05);
    assert!(texts(&whole).contains(&"10"));
    assert_inside(&whole);
}

#[test]
fn captions_are_there_as_they_were_given() {
    let whole = elements(&scatter(&CAPTIONS, &[series("a", &[[0.0, 1.0], [1.0, 2.0]])]).unwrap());
    let texts = texts(&whole);
    for text in ["Errors <by> \"object\" & joint?", CAPTIONS.x, CAPTIONS.y] {
        assert!(texts.contains(&text), "{texts:?}");
    }
    assert!(!texts.contains(&"a"), "one series needs no legend");
}

#[test]
fn the_legend_stands_beside_the_data() {
    let names = [
        "training",
        "held-out sequences",
        "a name that is much longer than all others",
    ];
    let all = names.map(|name| series(name, &[[0.0, 1.0], [9.0, 3.0]]));
    let whole = elements(&lines(&CAPTIONS, Scale::Linear, &all).unwrap());
    // The marks of a legend are heavier than curves.
    let marks_and_curves = curves(&whole);
    let curves_only = marks_and_curves
        .iter()
        .filter(|curve| curve.attribute("stroke-width") == "2");
    let right = curves_only.map(|curve| path_of(curve)[1][0]);
    let right = right.fold(0.0, f64::max);
    for name in names {
        let name = whole
            .iter()
            .find(|element| element.text.trim_end() == name)
            .unwrap();
        assert!(right > 100.0 && name.number("x") > right, "{name:?}");
    }
    assert_inside(&whole);
    // Colors differ, and beyond the palette dashes do.
    let many: Vec<Series> = (0..20)
        .map(|number| series(&number.to_string(), &[[0.0, 1.0], [9.0, 3.0]]))
        .collect();
    let whole = elements(&lines(&CAPTIONS, Scale::Linear, &many).unwrap());
    let looks: std::collections::BTreeSet<_> = curves(&whole)
        .iter()
        .map(|curve| {
            (
                curve.attribute("stroke"),
                curve.attribute("stroke-dasharray"),
            )
        })
        .collect();
    assert_eq!(looks.len(), 20);
    assert_inside(&whole);
}

#[test]
fn bars_are_as_long_as_their_values_and_begin_at_zero() {
    let names = ["thumb", "index", "middle"].map(str::to_owned);
    let values = |name: &str, values: [f64; 3]| Bars {
        name: name.to_owned(),
        values: names.iter().cloned().zip(values).collect(),
    };
    let all = [
        values("training", [1.0, 2.0, -1.0]),
        values("unseen", [f64::NAN, 4.0, 0.5]),
    ];
    let whole = elements(&bars(&CAPTIONS, &names, &all).unwrap());
    let rectangles: Vec<&Element> = whole.iter().skip(2).filter(|e| e.name == "rect").collect();
    // Two in the legend, five of the six values.
    assert_eq!(rectangles.len(), 2 + 5);
    let width = |idx: usize| rectangles[2 + idx].number("width");
    for (idx, value) in [1.0, 2.0, 1.0, 4.0, 0.5].into_iter().enumerate() {
        assert!((width(idx) - value * width(0)).abs() < 0.1, "{idx}");
    }
    let [positive, negative] = [rectangles[2], rectangles[4]];
    let end = negative.number("x") + negative.number("width");
    assert!((end - positive.number("x")).abs() < 0.1);
    let found = texts(&whole);
    assert!(names.iter().all(|name| found.contains(&name.as_str())));
    assert_inside(&whole);
}

#[test]
fn an_estimate_is_a_dot_between_the_ends_of_its_interval() {
    let names = ["can", "box"].map(str::to_owned);
    let estimate = |name: &str, [value, low, high]: [f64; 3]| {
        let estimate = Estimate { value, low, high };
        (name.to_owned(), estimate)
    };
    let all = [
        Estimates {
            name: "cgf".to_owned(),
            values: [
                estimate("can", [50.0, 20.0, 100.0]),
                estimate("box", [0.0, 0.0, 40.0]),
            ]
            .into(),
        },
        Estimates {
            name: "interpolate".to_owned(),
            values: [estimate("box", [f64::NAN, 0.0, 1.0])].into(),
        },
    ];
    let whole = elements(&intervals(&CAPTIONS, &names, &all).unwrap());
    let dots: Vec<&Element> = whole.iter().filter(|e| e.name == "circle").collect();
    // Two in the legend, two of the four estimates.
    assert_eq!(dots.len(), 2 + 2);
    let (of_can, of_box) = (dots[2], dots[3]);
    assert!(of_box.number("cy") > of_can.number("cy"));
    let drawn = curves(&whole);
    assert_eq!(
        drawn.len(),
        2 * 3,
        "an interval and the strokes at its ends"
    );
    let zero = of_box.number("cx");
    let unit = (of_can.number("cx") - zero) / 50.0;
    let is_at = |x: f64, value: f64| assert!((x - zero - value * unit).abs() < 0.05, "{x}");
    for (line, (dot, [low, high])) in [
        (drawn[0], (of_can, [20.0, 100.0])),
        (drawn[3], (of_box, [0.0, 40.0])),
    ] {
        let ends = path_of(line);
        is_at(ends[0][0], low);
        is_at(ends[1][0], high);
        assert!(ends.iter().all(|end| end[1] == dot.number("cy")));
    }
    assert_inside(&whole);
}

#[test]
fn a_histogram_holds_every_value_once() {
    let sample = |name: &str, values: Vec<f64>| Sample {
        name: name.to_owned(),
        values,
    };
    let values: Vec<f64> = (0..=100_u32).map(f64::from).chain([f64::NAN]).collect();
    let svg = histogram(&CAPTIONS, 10, &[sample("a", values)]).unwrap();
    let whole = elements(&svg);
    let boxes: Vec<f64> = whole
        .iter()
        .skip(2)
        .filter(|element| element.name == "rect")
        .map(|element| element.number("height"))
        .collect();
    assert_eq!(boxes.len(), 10);
    // Nine of ten, and one of eleven: the largest value belongs to the last.
    let (first, last) = (boxes[0], boxes[9]);
    assert!((last / first - 1.1).abs() < 0.01, "{boxes:?}");
    assert_inside(&whole);
}

#[test]
fn empty_data_gives_no_chart() {
    for points in [&[][..], &[[f64::NAN, 1.0], [1.0, f64::INFINITY]]] {
        let empty = [series("a", points)];
        assert_eq!(lines(&CAPTIONS, Scale::Linear, &empty), None);
        assert_eq!(scatter(&CAPTIONS, &empty), None);
    }
    let negative = [series("a", &[[0.0, -1.0]])];
    assert_eq!(lines(&CAPTIONS, Scale::Log, &negative), None);
    assert_eq!(lines(&CAPTIONS, Scale::Linear, &[]), None);
    assert_eq!(histogram(&CAPTIONS, 5, &[]), None);
    assert_eq!(bars(&CAPTIONS, &[], &[]), None);
    assert_eq!(intervals(&CAPTIONS, &[], &[]), None);
    // An empty series beside one with points is in the legend alone.
    let both = [series("a", &[]), series("b", &[[0.0, 1.0], [1.0, 2.0]])];
    let whole = elements(&lines(&CAPTIONS, Scale::Linear, &both).unwrap());
    assert_eq!(curves(&whole).len(), 2 + 1);
    // No bar has nothing beside it.
    let other = Bars {
        name: "training".to_owned(),
        values: [("b".to_owned(), 1.0)].into(),
    };
    let whole = elements(&bars(&CAPTIONS, &["a".to_owned()], &[other]).unwrap());
    let boxes = whole.iter().skip(2).filter(|e| e.name == "rect");
    assert_eq!(boxes.count(), 0);
}

#[test]
fn values_are_said_where_they_are_pointed_at() {
    let svg = lines(
        &CAPTIONS,
        Scale::Linear,
        &[series("a", &[[1.0, 0.5], [2.0, 0.25]])],
    );
    assert_eq!(titles(&svg.unwrap()), ["a: 0.5000 at 1", "a: 0.2500 at 2"]);
    let names = ["can".to_owned()];
    let share = Estimates {
        name: "cgf".to_owned(),
        values: [(
            names[0].clone(),
            Estimate {
                value: 90.0,
                low: 80.5,
                high: 96.0,
            },
        )]
        .into(),
    };
    let svg = intervals(&CAPTIONS, &names, &[share]).unwrap();
    assert_eq!(titles(&svg), ["can, cgf: 90.0 (80.5 to 96.0)"]);
    assert!(svg.contains("prefers-color-scheme:dark"));
    let counts = Bars {
        name: "slipped".to_owned(),
        values: [(names[0].clone(), 3.0)].into(),
    };
    assert_eq!(
        titles(&bars(&CAPTIONS, &names, &[counts]).unwrap()),
        ["can, slipped: 3"]
    );
}

#[test]
fn equal_data_gives_equal_bytes() {
    let points: Vec<[f64; 2]> = (0..500_u32)
        .map(|x| [f64::from(x), (f64::from(x) * 0.37).sin().exp()])
        .collect();
    let draw = |points: &[[f64; 2]]| lines(&CAPTIONS, Scale::Log, &[series("a", points)]).unwrap();
    assert_eq!(draw(&points), draw(&points));
    let grown = draw(&points).len() - draw(&points[..250]).len();
    assert!(grown < 20 * 250, "{grown} bytes for 250 points");
}
