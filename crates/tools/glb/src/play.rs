//! Playback of a file as the specification defines it: poses and sizes at a time.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

use crate::{
    GlbError,
    file::{FLOAT, Root, SHORT},
    write::{BIN, JSON, MAGIC},
};

/// A file being played.
#[derive(Debug)]
pub struct Player {
    nodes: Vec<PlayedNode>,
    /// Key times, path and values of each channel.
    channels: Vec<PlayedChannel>,
    duration_s: f64,
}

#[derive(Debug)]
struct PlayedNode {
    name: String,
    parent: Option<usize>,
    parent_from_node: Isometry3<f64>,
    scale: f64,
}

#[derive(Debug)]
struct PlayedChannel {
    node: usize,
    path: String,
    is_step: bool,
    times_s: Vec<f64>,
    /// 3 or 4 numbers for each time.
    values: Vec<Vec<f64>>,
}

impl Player {
    /// Reads a file.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are not a binary glTF file with one buffer and an animation.
    pub fn read(bytes: &[u8]) -> Result<Self, GlbError> {
        let malformed = |what: &str| GlbError::Malformed(what.to_owned());
        let word = |at: usize| -> Result<u32, GlbError> {
            let four = bytes.get(at..at + 4).and_then(|four| four.try_into().ok());
            four.map(u32::from_le_bytes)
                .ok_or_else(|| malformed("it ends early"))
        };
        if word(0)? != MAGIC || word(4)? != 2 || word(8)? as usize != bytes.len() {
            return Err(malformed("its header is another"));
        }
        let json_n = word(12)? as usize;
        if word(16)? != JSON || word(20 + json_n + 4)? != BIN {
            return Err(malformed("its chunks are others"));
        }
        let json = bytes.get(20..20 + json_n);
        let json = json.ok_or_else(|| malformed("it ends early"))?;
        let root: Root =
            serde_json::from_slice(json).map_err(|err| GlbError::Malformed(err.to_string()))?;
        let buffer = bytes.get(20 + json_n + 8..).unwrap_or_default();
        let mut player = Self {
            nodes: nodes(&root),
            channels: Vec::new(),
            duration_s: 0.0,
        };
        for animation in &root.animations {
            for channel in &animation.channels {
                let sampler = animation.samplers.get(channel.sampler);
                let sampler = sampler.ok_or_else(|| malformed("a sampler is missing"))?;
                let times = numbers(&root, buffer, sampler.input)?;
                let times_s: Vec<f64> = times.into_iter().flatten().collect();
                player.duration_s = times_s
                    .last()
                    .copied()
                    .unwrap_or(0.0)
                    .max(player.duration_s);
                player.channels.push(PlayedChannel {
                    node: channel.target.node,
                    path: channel.target.path.clone(),
                    is_step: sampler.interpolation == "STEP",
                    times_s,
                    values: numbers(&root, buffer, sampler.output)?,
                });
            }
        }
        Ok(player)
    }

    /// Time of the last key, in seconds.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Names of the nodes, in the order of the file.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.nodes.iter().map(|node| node.name.as_str())
    }

    /// Returns the pose of a node in the table's frame (z up) at a time; `None` if there is no such node.
    pub fn table_from(&self, name: &str, time_s: f64) -> Option<Isometry3<f64>> {
        let mut at = Some(self.nodes.iter().position(|node| node.name == name)?);
        let mut pose = Isometry3::identity();
        while let Some(node) = at.and_then(|idx| self.nodes.get(idx)) {
            // The world's own turn leads from z up to y up.
            if node.parent.is_none() {
                break;
            }
            pose = self.local(at.unwrap_or_default(), time_s)? * pose;
            at = node.parent;
        }
        Some(pose)
    }

    /// Returns the size of a node at a time, 1 unless it is animated.
    pub fn scale_of(&self, name: &str, time_s: f64) -> Option<f64> {
        let idx = self.nodes.iter().position(|node| node.name == name)?;
        let mut scales = self.channels.iter().filter(|channel| channel.node == idx);
        let scale = scales.find(|channel| channel.path == "scale");
        match scale {
            Some(channel) => channel.at(time_s)?.first().copied(),
            None => self.nodes.get(idx).map(|node| node.scale),
        }
    }

    fn local(&self, idx: usize, time_s: f64) -> Option<Isometry3<f64>> {
        let mut pose = self.nodes.get(idx)?.parent_from_node;
        for channel in self.channels.iter().filter(|channel| channel.node == idx) {
            let value = channel.at(time_s)?;
            match (channel.path.as_str(), value.as_slice()) {
                ("translation", &[x, y, z]) => pose.translation = Translation3::new(x, y, z),
                ("rotation", &[x, y, z, w]) => pose.rotation = unit([x, y, z, w]),
                _ => {}
            }
        }
        Some(pose)
    }
}

impl PlayedChannel {
    /// The value at a time: that of the nearest end before the first and after the last key.
    fn at(&self, time_s: f64) -> Option<Vec<f64>> {
        let after = self.times_s.partition_point(|key| *key <= time_s);
        let Some(before) = after.checked_sub(1) else {
            return self.values.first().cloned();
        };
        let from = self.values.get(before)?;
        let (Some(to), Some(&end_s)) = (self.values.get(after), self.times_s.get(after)) else {
            return Some(from.clone());
        };
        if self.is_step {
            return Some(from.clone());
        }
        let start_s = *self.times_s.get(before)?;
        let share = (time_s - start_s) / (end_s - start_s);
        if let (&[x, y, z, w], &[x2, y2, z2, w2]) = (from.as_slice(), to.as_slice()) {
            let (a, b) = (unit([x, y, z, w]), unit([x2, y2, z2, w2]));
            let between = a.try_slerp(&b, share, 1e-12).unwrap_or(a);
            return Some(between.coords.iter().copied().collect());
        }
        let pairs = from.iter().zip(to);
        Some(pairs.map(|(from, to)| from + share * (to - from)).collect())
    }
}

fn unit([x, y, z, w]: [f64; 4]) -> UnitQuaternion<f64> {
    let vector = Vector3::new(x, y, z);
    UnitQuaternion::from_quaternion(Quaternion::from_parts(w, vector))
}

fn nodes(root: &Root) -> Vec<PlayedNode> {
    let parent = |child: usize| {
        root.nodes
            .iter()
            .position(|node| node.children.contains(&child))
    };
    let nodes = root.nodes.iter().enumerate();
    nodes
        .map(|(idx, node)| {
            let [x, y, z] = node.translation.map(f64::from);
            PlayedNode {
                name: node.name.clone(),
                parent: parent(idx),
                parent_from_node: Isometry3::from_parts(
                    Translation3::new(x, y, z),
                    unit(node.rotation.map(f64::from)),
                ),
                scale: node.scale.map_or(1.0, |[size, ..]| f64::from(size)),
            }
        })
        .collect()
}

/// The elements of an accessor.
fn numbers(root: &Root, buffer: &[u8], accessor: usize) -> Result<Vec<Vec<f64>>, GlbError> {
    let malformed = |what: &str| GlbError::Malformed(what.to_owned());
    let accessor = root.accessors.get(accessor);
    let accessor = accessor.ok_or_else(|| malformed("an accessor is missing"))?;
    let view = root.buffer_views.get(accessor.buffer_view);
    let view = view.ok_or_else(|| malformed("a view is missing"))?;
    let bytes = buffer.get(view.byte_offset..view.byte_offset + view.byte_length);
    let bytes = bytes.ok_or_else(|| malformed("a view is outside the buffer"))?;
    let width = match accessor.shape.as_str() {
        "SCALAR" => 1,
        "VEC3" => 3,
        "VEC4" => 4,
        other => return Err(malformed(other)),
    };
    let numbers: Vec<f64> = match accessor.component_type {
        FLOAT => {
            let (words, _) = bytes.as_chunks::<4>();
            words
                .iter()
                .map(|&word| f64::from(f32::from_le_bytes(word)))
                .collect()
        }
        SHORT if accessor.normalized => {
            let (words, _) = bytes.as_chunks::<2>();
            let number =
                |&word: &[u8; 2]| (f64::from(i16::from_le_bytes(word)) / 32767.0).max(-1.0);
            words.iter().map(number).collect()
        }
        other => return Err(malformed(&format!("component type {other}"))),
    };
    if numbers.len() != width * accessor.count {
        return Err(malformed("an accessor has another length"));
    }
    Ok(numbers.chunks(width).map(<[f64]>::to_vec).collect())
}
