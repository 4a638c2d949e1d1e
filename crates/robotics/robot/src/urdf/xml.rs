//! From text to elements with their lines, within limits, and back to text.
//!
//! `urdf-rs` bounds neither size nor depth, reads a document type, and tells no line of the file.

use std::fmt;

use quick_xml::{
    Reader,
    escape::escape,
    events::{BytesStart, Event},
};

use crate::RobotError;

/// Longest URDF that is read, in bytes: a hundred times that of a hand with an arm.
pub const MAX_BYTES: usize = 16 << 20;
/// Maximum number of elements that are kept.
const MAX_ELEMENTS: usize = 200_000;
/// Maximum number of attributes of one element; more are left out.
const MAX_ATTRIBUTES: usize = 32;
/// Elements deeper than this are passed over: `robot/link/collision/geometry/box` is 5.
const MAX_DEPTH: usize = 6;

/// An element with what it holds; text between elements has no meaning in a URDF.
#[derive(Debug, Clone)]
pub(super) struct Element {
    pub(super) name: String,
    /// Line of the text on which it begins, from 1.
    pub(super) line: usize,
    pub(super) attributes: Vec<(String, String)>,
    pub(super) children: Vec<Self>,
}

impl Element {
    /// Makes an element that holds nothing.
    pub(super) fn new(name: &str, line: usize) -> Self {
        Self {
            name: name.to_owned(),
            line,
            attributes: Vec::new(),
            children: Vec::new(),
        }
    }

    /// Returns the value of an attribute.
    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes
            .iter()
            .find_map(|(key, value)| (key == name).then_some(value.as_str()))
    }

    /// Returns the children of this name.
    pub(super) fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Self> {
        self.children.iter().filter(move |child| child.name == name)
    }

    /// Returns the first child of this name: further ones are passed over, as `urdfdom` does.
    pub(super) fn first(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|child| child.name == name)
    }
}

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "<{}", self.name)?;
        for (key, value) in &self.attributes {
            write!(f, " {key}=\"{}\"", escape(value))?;
        }
        f.write_str(">")?;
        self.children.iter().try_for_each(|child| child.fmt(f))?;
        write!(f, "</{}>", self.name)
    }
}

/// Reads the elements of a text whose root element is `<robot>`.
///
/// Nothing is looked up or expanded: a document type declaration, through which a short text can
/// become an endless one or name a file, is refused.
pub(super) fn read(text: &str) -> Result<Element, RobotError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    if text.len() > MAX_BYTES {
        return Err(RobotError::TooLarge {
            what: "bytes",
            limit: MAX_BYTES,
        });
    }
    let mut reader = Reader::from_str(text);
    let mut lines = Lines::new(text);
    let mut n_elements = 0;
    // Elements that are open: the root first. Of those deeper than what is kept, only the number.
    let mut open: Vec<Element> = Vec::new();
    let mut n_passed_over = 0_usize;
    let mut root = None;
    loop {
        let line = lines.at(reader.buffer_position());
        let event = reader.read_event().map_err(|source| RobotError::NotXml {
            line: lines.at(reader.error_position()),
            source,
        })?;
        let (start, is_empty) = match event {
            Event::Start(start) => (start, false),
            Event::Empty(start) => (start, true),
            Event::End(_) => {
                if n_passed_over > 0 {
                    n_passed_over -= 1;
                } else if let Some(done) = open.pop() {
                    close(done, &mut open, &mut root)?;
                }
                continue;
            }
            Event::DocType(_) => return Err(RobotError::DocumentType { line }),
            Event::Eof => break,
            Event::Text(_)
            | Event::CData(_)
            | Event::Comment(_)
            | Event::Decl(_)
            | Event::PI(_)
            | Event::GeneralRef(_) => continue,
        };
        // Wherever it stands: a link would silently lack what the macro makes.
        if start.name().as_ref().starts_with(b"xacro:") {
            return Err(RobotError::Xacro {
                element: String::from_utf8_lossy(start.name().as_ref()).into_owned(),
                line,
            });
        }
        if open.len() >= MAX_DEPTH {
            n_passed_over += usize::from(!is_empty);
            continue;
        }
        n_elements += 1;
        if n_elements > MAX_ELEMENTS {
            return Err(RobotError::TooLarge {
                what: "elements",
                limit: MAX_ELEMENTS,
            });
        }
        let element = element(&start, line)?;
        if is_empty {
            close(element, &mut open, &mut root)?;
        } else {
            open.push(element);
        }
    }
    if let Some(unclosed) = open.last() {
        return Err(RobotError::Unclosed {
            line: unclosed.line,
            name: unclosed.name.clone(),
        });
    }
    root.ok_or(RobotError::NoRobot { found: None })
}

/// Puts an element that has ended where it belongs.
fn close(
    element: Element,
    open: &mut [Element],
    root: &mut Option<Element>,
) -> Result<(), RobotError> {
    match open.last_mut() {
        Some(parent) => parent.children.push(element),
        None if element.name != "robot" || root.is_some() => {
            return Err(RobotError::NoRobot {
                found: Some(element.name),
            });
        }
        None => *root = Some(element),
    }
    Ok(())
}

fn element(start: &BytesStart<'_>, line: usize) -> Result<Element, RobotError> {
    let mut element = Element::new(&String::from_utf8_lossy(start.name().as_ref()), line);
    for attribute in start.attributes().take(MAX_ATTRIBUTES) {
        let attribute = attribute.map_err(|source| RobotError::NotXml {
            line,
            source: source.into(),
        })?;
        let value = attribute
            .unescape_value()
            .map_err(|source| RobotError::NotXml { line, source })?;
        let key = String::from_utf8_lossy(attribute.key.as_ref()).into_owned();
        if value.contains("${") || value.contains("$(") {
            return Err(RobotError::XacroValue {
                element: element.name,
                attribute: key,
                text: value.into_owned(),
                line,
            });
        }
        element.attributes.push((key, value.into_owned()));
    }
    Ok(element)
}

/// Counts lines up to places that follow each other in a text.
struct Lines<'a> {
    text: &'a [u8],
    offset: usize,
    line: usize,
}

impl<'a> Lines<'a> {
    fn new(text: &'a str) -> Self {
        Self {
            text: text.as_bytes(),
            offset: 0,
            line: 1,
        }
    }

    /// Returns the line of a byte; one before the last that was asked for is on the last's line.
    fn at(&mut self, offset: u64) -> usize {
        let offset = usize::try_from(offset).unwrap_or(usize::MAX);
        if let Some(passed) = self.text.get(self.offset..offset.min(self.text.len())) {
            self.line += passed.split(|&byte| byte == b'\n').count() - 1;
            self.offset += passed.len();
        }
        self.line
    }
}
