//! A scene's folder in BOP layout: which images show which object.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use dataflow::SourceFile;
use serde_json::Value;

use crate::{
    config::ViewsConfig,
    error::{Fault, ViewsError},
    file::{self, MAX_IMAGE_BYTES, MAX_LIST_BYTES},
    scene_camera::has_pose,
};

/// The file that lists a scene's images and their cameras.
pub(crate) const CAMERAS: &str = "scene_camera.json";
/// The file that names the objects of each image, in the order of their masks.
const OBJECTS: &str = "scene_gt.json";
/// Folders of masks, of which the first that is there is used: of what is seen of an object, and of all of it.
const MASKS: [&str; 2] = ["mask_visib", "mask"];
/// Most views of an object.
pub(crate) const MAX_VIEWS: usize = 64;

/// An object of a scene.
#[derive(Debug)]
pub(crate) struct SceneObject {
    /// Its name.
    pub(crate) name: String,
    /// The images that are read.
    pub(crate) shown: Vec<Shown>,
    /// Number of further chosen images that show it and have no place in the world of these.
    pub(crate) unused_n: usize,
}

/// An image of an object.
#[derive(Debug, Clone)]
pub(crate) struct Shown {
    /// Its number.
    pub(crate) image: u32,
    /// Name of the file of the object's mask, if there are masks.
    mask: Option<String>,
}

impl Shown {
    /// Lists the files that it is read from.
    ///
    /// # Errors
    ///
    /// Fails if one is missing or is none.
    pub(crate) fn files(&self, scene: &Path) -> Result<Vec<SourceFile>, Fault> {
        let names = [Some(depth_file(self.image)), self.mask.clone()];
        let file = |name: String| {
            let path = scene.join(&name);
            file::look(&path, MAX_IMAGE_BYTES).map_err(|fault| fault.in_file(&name))?;
            Ok(SourceFile::new(name, path))
        };
        names.into_iter().flatten().map(file).collect()
    }
}

/// Returns the name of an image's depths.
pub(crate) fn depth_file(image: u32) -> String {
    format!("depth/{image:06}.png")
}

/// Lists the objects of a scene's chosen images, in the order of their names.
///
/// # Errors
///
/// Fails if the images cannot be listed, or none shows an object.
pub(crate) fn objects(config: &ViewsConfig) -> Result<Vec<SceneObject>, ViewsError> {
    let scene = &config.path;
    let cameras = entries(&scene.join(CAMERAS)).map_err(|fault| unlisted(scene, fault))?;
    let images = chosen(config, &cameras)?;
    let is_posed = |shown: &Shown| cameras.get(&shown.image).is_some_and(has_pose);
    let mut objects = Vec::new();
    for named in named(config, &images)? {
        let mut shown = named.shown.clone();
        shown.retain(is_posed);
        if shown.is_empty() {
            // Each image is a world of its own.
            shown.extend(named.shown.first().cloned());
        }
        if named.has_twin {
            shown.truncate(1);
        }
        if shown.len() > MAX_VIEWS {
            let step = shown.len().div_ceil(8);
            return Err(ViewsError::ManyImages {
                found: shown.len(),
                most: MAX_VIEWS,
                spread: shown.iter().step_by(step).map(|it| it.image).collect(),
            });
        }
        objects.push(SceneObject {
            name: named.name,
            unused_n: named.shown.len() - shown.len(),
            shown,
        });
    }
    if objects.is_empty() {
        return Err(ViewsError::NoObjects {
            folder: scene.clone(),
            found: images.len(),
        });
    }
    Ok(objects)
}

/// Reads a file that has an entry for each image, by its number.
pub(crate) fn entries(path: &Path) -> Result<BTreeMap<u32, Value>, Fault> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let bytes = file::read(path, MAX_LIST_BYTES);
    let entries = bytes.and_then(|bytes| parse_entries(&bytes));
    entries.map_err(|fault| fault.in_file(&name))
}

fn parse_entries(bytes: &[u8]) -> Result<BTreeMap<u32, Value>, Fault> {
    let expected = "an object with an entry for each image, by its number";
    let listed = serde_json::from_slice(bytes);
    let listed = listed.map_err(|err| Fault::unsupported(err, expected))?;
    let Value::Object(listed) = listed else {
        return Err(Fault::unsupported("no object", expected));
    };
    let mut entries = BTreeMap::new();
    for (key, entry) in listed {
        let image = key.parse().ok();
        let image = image.filter(|image| !entries.contains_key(image));
        let image = image.ok_or_else(|| Fault::unsupported(format!("`{key}`"), expected))?;
        entries.insert(image, entry);
    }
    if entries.is_empty() {
        return Err(Fault::unsupported("no entry", expected));
    }
    Ok(entries)
}

fn unlisted(scene: &Path, fault: Fault) -> ViewsError {
    ViewsError::List {
        folder: scene.to_owned(),
        problem: fault.to_string(),
        hint: fault.hint,
    }
}

/// Returns the images that are read, in the order of their numbers.
fn chosen(config: &ViewsConfig, cameras: &BTreeMap<u32, Value>) -> Result<Vec<u32>, ViewsError> {
    let mut images = config.images.clone();
    images.sort_unstable();
    images.dedup();
    let is_known = |image: &u32| cameras.contains_key(image);
    if let Some(&image) = images.iter().find(|image| !is_known(image)) {
        let ends = [cameras.keys().next(), cameras.keys().next_back()];
        let range = ends.map(|image| image.copied().unwrap_or_default());
        return Err(ViewsError::NoImage { image, range });
    }
    if images.is_empty() {
        images = cameras.keys().copied().collect();
    }
    Ok(images)
}

/// An object and the chosen images that show it.
struct Named {
    name: String,
    shown: Vec<Shown>,
    /// Whether an image has several of it: then nothing says which is which in another.
    has_twin: bool,
}

/// Names the objects of the images: by the entries of `scene_gt.json`, by the numbers of the masks, or the only one if there
/// are no masks.
fn named(config: &ViewsConfig, images: &[u32]) -> Result<Vec<Named>, ViewsError> {
    let scene = &config.path;
    let ids = ids(scene, images)?;
    let Some(folder) = MASKS.into_iter().find(|folder| scene.join(folder).is_dir()) else {
        let all: BTreeSet<u32> = ids.into_iter().flatten().flatten().collect();
        let name = match (all.first(), all.len()) {
            (Some(id), 1) if config.name.is_none() => format!("obj_{id:06}"),
            _ => config.object_name(),
        };
        let shown = images.iter().map(|&image| Shown { image, mask: None });
        return Ok(vec![Named {
            name,
            shown: shown.collect(),
            has_twin: false,
        }]);
    };
    let is_numbered = ids.is_some();
    let (masks, prefix) = match ids {
        Some(ids) => (numbered(images, ids), "obj".to_owned()),
        None => (listed(&scene.join(folder), images)?, config.object_name()),
    };
    // By the object's number, and by which of an image's objects of this number it is.
    let mut objects: BTreeMap<(u32, usize), Vec<Shown>> = BTreeMap::new();
    let mut in_image: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for Mask { image, number, id } in masks {
        let nth = in_image.entry((image, id)).or_default();
        *nth += 1;
        objects.entry((id, *nth)).or_default().push(Shown {
            image,
            mask: Some(format!("{folder}/{image:06}_{number:06}.png")),
        });
    }
    let twins: BTreeSet<u32> = objects
        .keys()
        .filter(|key| key.1 > 1)
        .map(|key| key.0)
        .collect();
    let is_alone = objects.len() == 1 && !is_numbered;
    let named = objects.into_iter().map(|((id, nth), shown)| {
        let has_twin = twins.contains(&id);
        let name = match (is_alone, has_twin) {
            (true, _) => prefix.clone(),
            (false, false) => format!("{prefix}_{id:06}"),
            (false, true) => format!("{prefix}_{id:06}-{nth}"),
        };
        Named {
            name,
            shown,
            has_twin,
        }
    });
    Ok(named.collect())
}

/// A mask of an image: its number there, and the number of its object.
struct Mask {
    image: u32,
    number: u32,
    id: u32,
}

/// Returns the masks of images whose objects are known.
fn numbered(images: &[u32], ids: Vec<Vec<u32>>) -> Vec<Mask> {
    let of_image = |(&image, ids): (&u32, Vec<u32>)| {
        (0..)
            .zip(ids)
            .map(move |(number, id)| Mask { image, number, id })
    };
    images.iter().zip(ids).flat_map(of_image).collect()
}

/// Lists the masks of images in a folder; an object's number is that of its mask.
fn listed(folder: &Path, images: &[u32]) -> Result<Vec<Mask>, ViewsError> {
    let failed = |source| ViewsError::Folder {
        path: folder.to_owned(),
        source,
    };
    let mut masks = BTreeSet::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        let numbers = |name: &str| -> Option<(u32, u32)> {
            let (image, number) = name.strip_suffix(".png")?.split_once('_')?;
            Some((image.parse().ok()?, number.parse().ok()?))
        };
        masks.extend(name.to_str().and_then(numbers));
    }
    masks.retain(|(image, _)| images.binary_search(image).is_ok());
    let mask = |(image, number)| Mask {
        image,
        number,
        id: number,
    };
    Ok(masks.into_iter().map(mask).collect())
}

/// Returns the numbers of each image's objects, in the order of its masks; `None` if no file has them.
fn ids(scene: &Path, images: &[u32]) -> Result<Option<Vec<Vec<u32>>>, ViewsError> {
    let path = scene.join(OBJECTS);
    if !path.exists() {
        return Ok(None);
    }
    let listed = entries(&path).map_err(|fault| unlisted(scene, fault))?;
    let of_entry = |entry: &Value| -> Option<Vec<u32>> {
        let id = |object: &Value| u32::try_from(object.get("obj_id")?.as_u64()?).ok();
        entry.as_array()?.iter().map(id).collect()
    };
    let of_image = |image: &u32| {
        let ids = listed.get(image).map_or(Some(Vec::new()), of_entry);
        ids.ok_or_else(|| {
            let found = format!("no list of objects with `obj_id` for image {image}");
            let fault = Fault::unsupported(found, "one for each image");
            unlisted(scene, fault.in_file(OBJECTS))
        })
    };
    let ids: Result<Vec<Vec<u32>>, _> = images.iter().map(of_image).collect();
    ids.map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{fixture::mutated, scene_camera::SceneCamera};

    #[test]
    fn no_byte_of_a_list_makes_it_panic() {
        let text = r#"{"0": {"cam_K": [572.4, 0, 325.3, 0, 573.6, 242.0, 0, 0, 1], "depth_scale": 0.1,
            "cam_R_w2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_w2c": [0, 0, 500]}, "17": {}}"#;
        let mut read_n = 0;
        for bytes in mutated(text.as_bytes(), 4000) {
            for entry in parse_entries(&bytes).unwrap_or_default().values() {
                let camera = SceneCamera::parse(entry);
                read_n += usize::from(camera.and_then(|it| it.intrinsics([640, 480])).is_ok());
            }
        }
        assert!(read_n > 20, "{read_n}");
        for (text, expected) in [
            ("", "EOF while parsing"),
            (
                "{\"0\": {\"depth_scale\": NaN}}",
                "expected value at line 1 column 23",
            ),
            ("[{}]", "has no object"),
            ("{}", "has no entry"),
            ("{\"first\": {}}", "has `first`"),
            ("{\"-1\": {}}", "has `-1`"),
            (
                "{\"1\": {}, \"01\": {}}",
                "expected an object with an entry for each image",
            ),
        ] {
            let said = parse_entries(text.as_bytes()).unwrap_err().to_string();
            assert!(said.contains(expected), "{expected}: {said}");
        }
        let deep = "[".repeat(100_000);
        assert!(parse_entries(deep.as_bytes()).is_err());
    }
}
