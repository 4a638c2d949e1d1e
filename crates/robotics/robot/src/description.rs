//! Canonical form of a URDF: two that differ by comments, spaces or the order of attributes have the same.

use quick_xml::{
    Reader,
    events::{BytesStart, Event},
};

use crate::RobotModel;

/// Serializes the model that is read from a URDF's bytes: links, joints, masses, shapes and the meshes
/// that the robot collides with, by name; `None` if they are not a URDF that can be used.
///
/// URDFs that give equal bytes are the same robot to every computation, however it is drawn.
pub fn canonical_model(urdf: &[u8]) -> Option<Vec<u8>> {
    let mut model = RobotModel::from_urdf_bytes(urdf).ok()?;
    // They contain line numbers, and do not affect the model.
    model.findings.clear();
    for link in &mut model.links {
        link.meshes.retain(|mesh| mesh.is_collision);
    }
    // Every number has as many digits as distinguish it from all others.
    Some(format!("{model:?}").into_bytes())
}

/// Returns the bytes of [`plain_urdf`]; `None` if they are not a URDF that can be used.
///
/// URDFs that give equal bytes are the same robot to viewers, too.
pub fn canonical_urdf(urdf: &[u8]) -> Option<Vec<u8>> {
    RobotModel::from_urdf_bytes(urdf).ok()?;
    let text = std::str::from_utf8(urdf).ok()?;
    Some(plain_urdf(text).into_bytes())
}

/// Writes a URDF without comments and with its attributes in order, each element on a line of its own;
/// a text that is not XML is returned as it is.
pub fn plain_urdf(urdf: &str) -> String {
    plain(urdf).unwrap_or_else(|| urdf.to_owned())
}

fn plain(urdf: &str) -> Option<String> {
    let mut reader = Reader::from_str(urdf.strip_prefix('\u{feff}').unwrap_or(urdf));
    let mut text = String::new();
    let mut depth = 0_usize;
    // Whether the last thing written is the start of an element that holds nothing yet.
    let mut is_open = false;
    loop {
        let event = reader.read_event().ok()?;
        let written = match &event {
            Event::Start(start) | Event::Empty(start) => start_of(start)?,
            Event::End(_) => {
                depth = depth.checked_sub(1)?;
                if is_open {
                    text.push_str("/>\n");
                } else {
                    let name = event_text(&event)?;
                    text.push_str(&format!("{}</{}>\n", indent(depth), name.trim()));
                }
                is_open = false;
                continue;
            }
            Event::Eof => return (depth == 0).then_some(text),
            Event::Text(_) => {
                let words = event_text(&event)?;
                let words: Vec<&str> = words.split_whitespace().collect();
                if words.is_empty() {
                    continue;
                }
                words.join(" ")
            }
            Event::CData(_) => format!("<![CDATA[{}]]>", event_text(&event)?),
            Event::GeneralRef(_) => format!("&{};", event_text(&event)?),
            Event::Comment(_) | Event::Decl(_) | Event::PI(_) | Event::DocType(_) => continue,
        };
        if is_open {
            text.push_str(">\n");
        }
        text.push_str(&indent(depth));
        text.push_str(&written);
        is_open = false;
        match event {
            Event::Start(_) => {
                depth += 1;
                is_open = true;
            }
            Event::Empty(_) => text.push_str("/>\n"),
            _ => text.push('\n'),
        }
    }
}

/// The spaces before an element: of elements in each other without end, no more than of a few.
fn indent(depth: usize) -> String {
    "  ".repeat(depth.min(32))
}

/// The start of an element up to its bracket, its attributes by name.
fn start_of(start: &BytesStart) -> Option<String> {
    let mut attributes: Vec<(String, String)> = Vec::new();
    // The parser compares every name with all before it; here equal ones come side by side.
    for attribute in start.attributes().with_checks(false) {
        let attribute = attribute.ok()?;
        let key = std::str::from_utf8(attribute.key.as_ref()).ok()?;
        // A value between single quotes may contain double ones.
        let value = std::str::from_utf8(&attribute.value).ok()?;
        attributes.push((key.to_owned(), value.replace('"', "&quot;")));
    }
    attributes.sort();
    if attributes
        .windows(2)
        .any(|two| matches!(two, [a, b] if a.0 == b.0))
    {
        return None;
    }
    let mut text = format!("<{}", std::str::from_utf8(start.name().as_ref()).ok()?);
    for (key, value) in attributes {
        text.push_str(&format!(" {key}=\"{value}\""));
    }
    Some(text)
}

fn event_text(event: &Event) -> Option<String> {
    std::str::from_utf8(event).ok().map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HAND: &str = r#"<?xml version="1.0"?>
<!-- a hand -->
<robot name="hand">
  <link name="palm">
    <visual><geometry><mesh filename="palm &amp; more.stl"/></geometry></visual>
    <collision><geometry><box size="0.1 0.1 0.02"/></geometry></collision>
  </link>
  <link name="tip"></link>
  <joint name="j" type="revolute">
    <origin xyz="0 0 0.05"/> <parent link="palm"/> <child link="tip"/>
    <axis xyz="0 1 0"/> <limit lower="0" upper="1.6" effort="0.7" velocity="7"/>
  </joint>
  <transmission><type>simple  one</type></transmission>
</robot>"#;

    /// Returns whether an edit changes the canonical model, and the canonical URDF.
    fn changes(from: &str, to: &str) -> [bool; 2] {
        assert!(HAND.contains(from), "{from}");
        let edited = HAND.replacen(from, to, 1);
        let [read, shown] = [canonical_model, canonical_urdf];
        let of = |form: fn(&[u8]) -> Option<Vec<u8>>, text: &str| form(text.as_bytes()).unwrap();
        [read, shown].map(|form| of(form, HAND) != of(form, &edited))
    }

    #[test]
    fn comments_and_whitespace_change_no_form() {
        for (from, to) in [
            ("<!-- a hand -->", "<!-- the hand -->"),
            ("<!-- a hand -->", ""),
            ("<?xml version=\"1.0\"?>\n", ""),
            ("<link name=\"tip\"></link>", "<link name='tip' />"),
            ("lower=\"0\" upper=\"1.6\"", "upper=\"1.6\"  lower=\"0\""),
            (
                "<origin xyz=\"0 0 0.05\"/> ",
                "\n\n<origin   xyz=\"0 0 0.05\"/>",
            ),
            ("simple  one", "simple one"),
        ] {
            assert_eq!(changes(from, to), [false, false], "{from} → {to}");
        }
    }

    #[test]
    fn visuals_and_spelling_change_the_shown_form_alone() {
        assert_eq!(changes("palm &amp; more", "thumb"), [false, true]);
        assert_eq!(changes("simple", "other"), [false, true]);
        assert_eq!(changes("upper=\"1.6\"", "upper=\"1.60\""), [false, true]);
    }

    #[test]
    fn kinematics_limits_and_inertia_change_both_forms() {
        for (from, to) in [
            ("upper=\"1.6\"", "upper=\"1.7\""),
            ("0.1 0.1 0.02", "0.1 0.1 0.03"),
            (
                "\"tip\"></link>",
                "\"tip\"><inertial><mass value=\"1\"/></inertial></link>",
            ),
            ("xyz=\"0 0 0.05\"", "xyz=\"0 0 0.051\""),
        ] {
            assert_eq!(changes(from, to), [true, true], "{from} → {to}");
        }
        assert_eq!(canonical_model(b"no robot"), None);
        assert_eq!(canonical_urdf(b"<robot"), None);
    }

    #[test]
    fn a_plain_urdf_is_the_same_robot_and_stays_as_it_is() {
        for urdf in [
            HAND,
            include_str!("../../../../data/robots/allegro_right.urdf"),
            include_str!("../../../../data/robots/xarm6_allegro.urdf"),
        ] {
            let plain = plain_urdf(urdf);
            assert_eq!(plain_urdf(&plain), plain);
            assert!(
                !plain.contains("<!--") && plain.starts_with("<robot name="),
                "{plain}"
            );
            let [before, after] =
                [urdf, &plain].map(|text| canonical_model(text.as_bytes()).unwrap());
            assert!(before == after);
        }
        assert_eq!(plain_urdf("<robot"), "<robot");
        // However deep, its length is a small multiple of what is read.
        let deep = "<a>".repeat(10_000) + &"</a>".repeat(10_000);
        assert!(plain_urdf(&deep).len() < 30 * deep.len());
    }
}
