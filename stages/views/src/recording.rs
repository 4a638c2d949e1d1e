//! Depth images and clouds of a recording of ROS 2 in MCAP format.
//!
//! It is read twice, so that no more than the chosen images is in memory: for its topics, and for the images with the
//! cameras and transforms of their times.

use std::{ops::ControlFlow, path::Path};

use dataflow::SourceFile;
use depth_view::DepthView;
use lake::recording::{ScannedMessage, scan};
use schemas::ros2::{CameraInfo, Message, TfMessage};
use spatial::{Pose, World};

use crate::{
    camera_info::{self, ImageOf},
    cloud, cloud_message,
    config::ViewsConfig,
    depth_message,
    error::Fault,
    file, object,
    recording_topics::{Chosen, Content, Topic, Topics, header, unread},
    transforms::{Place, Transforms, nanoseconds},
    world::{self, Image},
};

/// Most bytes of the chosen images together: they are in memory.
const MAX_CHOSEN_BYTES: usize = 1 << 29;

/// What is chosen of a recording.
pub(crate) struct Choice<'a> {
    /// The topic; `None` for the only one that there is.
    pub(crate) topic: Option<&'a str>,
    /// Numbers of images, from 0 in the order of time; empty for the first one.
    pub(crate) images: Vec<u32>,
}

/// The images of a recording.
pub(crate) struct Recorded {
    pub(crate) images: Vec<Image>,
    /// Number of chosen images that have no place in the world of these.
    pub(crate) unused_n: usize,
    /// What is to be known of them, a line each.
    pub(crate) notes: Vec<String>,
}

/// Reads the chosen images of a recording; the reasons for those that cannot be used are added to `left_out`.
///
/// # Errors
///
/// Fails if the recording is damaged, or has no such images.
pub(crate) fn read(
    file: &SourceFile,
    choice: &Choice<'_>,
    config: &ViewsConfig,
    left_out: &mut Vec<String>,
) -> Result<Recorded, Fault> {
    let in_file = |fault: Fault| fault.in_file(&file.name);
    let all = Topics::list_file(&file.path).map_err(in_file)?;
    let chosen = ChosenImages::of(&all, choice).map_err(in_file)?;
    let messages = Messages::read(&file.path, &chosen).map_err(in_file)?;
    let mut notes = Vec::new();
    let mut places = Vec::new();
    for (idx, image) in chosen.images.iter().enumerate() {
        match messages.place(idx) {
            Ok(place) => {
                if let Place::Unknown(fault) = &place
                    && all.has_transforms()
                {
                    notes.push(fault.of_image(image.number));
                }
                places.push((idx, place));
            }
            Err(fault) => left_out.push(fault.of_image(image.number)),
        }
    }
    let listed_n = places.len();
    let used = of_one_world(places);
    let unused_n = listed_n - used.len();
    let mut images = Vec::new();
    for (idx, world_from_frame) in used {
        match messages.image(idx, &chosen, &world_from_frame, config) {
            Ok(image) => images.push(image),
            Err(fault) => left_out.push(fault.of_image(chosen.images[idx].number)),
        }
        world::check_pixels(&images)?;
    }
    Ok(Recorded {
        images,
        unused_n,
        notes,
    })
}

impl Topics {
    /// Lists the topics of what must be a file.
    fn list_file(path: &Path) -> Result<Self, Fault> {
        file::look(path, u64::MAX)?;
        Self::list(path)
    }
}

/// The chosen images, and the topics that they are read from.
struct ChosenImages<'a> {
    name: &'a str,
    topic: &'a Topic,
    /// The topic of the cameras of depth images.
    camera: Option<&'a str>,
    /// In the order of time.
    images: Vec<Chosen>,
}

impl<'a> ChosenImages<'a> {
    fn of(topics: &'a Topics, choice: &Choice<'_>) -> Result<Self, Fault> {
        let (name, topic) = topics.choose(choice.topic)?;
        let camera = match topic.content {
            Content::Depths => Some(topics.camera_of(name)?),
            _ => None,
        };
        let images = topic.chosen(&choice.images)?;
        Ok(Self {
            name,
            topic,
            camera,
            images,
        })
    }
}

/// The messages that chosen images are made of.
struct Messages {
    /// Those of the images.
    images: Vec<Vec<u8>>,
    /// The camera of the nearest time for each, with its distance in nanoseconds.
    cameras: Vec<Option<(u64, CameraInfo)>>,
    transforms: Transforms,
}

impl Messages {
    fn read(path: &Path, chosen: &ChosenImages<'_>) -> Result<Self, Fault> {
        let stamps_ns: Vec<i64> = chosen.images.iter().map(|image| image.stamp_ns).collect();
        let mut messages = Self {
            images: vec![Vec::new(); stamps_ns.len()],
            cameras: vec![None; stamps_ns.len()],
            transforms: Transforms::new(stamps_ns),
        };
        let mut place = 0;
        let mut fault = None;
        let read = scan(path, |message| {
            match messages.take(message, chosen, &mut place) {
                Ok(()) => ControlFlow::Continue(()),
                Err(found) => {
                    fault = Some(found);
                    ControlFlow::Break(())
                }
            }
        });
        read.map_err(|err| unread(path, &err))?;
        fault.map_or(Ok(messages), Err)
    }

    /// Takes a message, if an image needs it; `place` is that of the next one of the images' topic.
    fn take(
        &mut self,
        message: &ScannedMessage<'_>,
        chosen: &ChosenImages<'_>,
        place: &mut usize,
    ) -> Result<(), Fault> {
        if message.topic == chosen.name {
            if let Some(idx) = chosen.images.iter().position(|image| image.place == *place) {
                message.bytes.clone_into(&mut self.images[idx]);
            }
            *place += 1;
            let bytes = self.images.iter().map(Vec::len);
            if bytes.sum::<usize>() > MAX_CHOSEN_BYTES {
                let problem =
                    format!("its images have more than {MAX_CHOSEN_BYTES} bytes together");
                return Err(Fault::new(problem, "choose fewer `images`"));
            }
        } else if Some(message.topic) == chosen.camera {
            // One that is damaged is no camera of an image.
            if let Ok(info) = CameraInfo::from_cdr(message.bytes) {
                self.keep_nearest(&info, message, chosen);
            }
        } else if message.message_type == TfMessage::TYPE {
            let is_static = message.topic.ends_with("tf_static");
            if let Ok(transforms) = TfMessage::from_cdr(message.bytes) {
                self.transforms.add(&transforms, is_static)?;
            }
        }
        Ok(())
    }

    /// Keeps a camera for the images to which it is nearer in time than the one before.
    fn keep_nearest(
        &mut self,
        info: &CameraInfo,
        message: &ScannedMessage<'_>,
        chosen: &ChosenImages<'_>,
    ) {
        let stamp_ns = match nanoseconds(info.header.stamp) {
            0 => message.time_ns,
            stamp_ns => stamp_ns,
        };
        for (image, nearest) in chosen.images.iter().zip(&mut self.cameras) {
            let off_ns = image.stamp_ns.abs_diff(stamp_ns);
            if nearest
                .as_ref()
                .is_none_or(|(kept_ns, _)| off_ns < *kept_ns)
            {
                *nearest = Some((off_ns, info.clone()));
            }
        }
    }

    fn place(&self, idx: usize) -> Result<Place, Fault> {
        let frame = header(&self.images[idx]).map_or_else(String::new, |it| it.frame_id);
        self.transforms.place(&frame, idx)
    }

    /// Returns an image of the chosen topic, whose frame has this pose in the world.
    fn image(
        &self,
        idx: usize,
        chosen: &ChosenImages<'_>,
        world_from_frame: &Pose<World, World>,
        config: &ViewsConfig,
    ) -> Result<Image, Fault> {
        let (mut view, depth_step_m) = match chosen.camera {
            Some(camera) => self.depth_image(idx, chosen, camera, config)?,
            None => self.cloud(idx, chosen, config)?,
        };
        view.world_from_camera = *world_from_frame * view.world_from_camera;
        let (view, table) = object::found(view, None, config.known_table())?;
        Ok(Image {
            name: format!("{:06}", chosen.images[idx].number),
            view,
            depth_step_m,
            table,
        })
    }

    /// Returns an image of depths in its frame, and its depth of the number 1, in meters.
    fn depth_image(
        &self,
        idx: usize,
        chosen: &ChosenImages<'_>,
        camera: &str,
        config: &ViewsConfig,
    ) -> Result<(DepthView, f64), Fault> {
        let message_type = &chosen.topic.message_type;
        let depths = depth_message::depths(message_type, &self.images[idx], config.unit_m);
        let depths = depths.map_err(|fault| fault.on_topic(chosen.name))?;
        let image = ImageOf {
            topic: chosen.name,
            size: depths.size,
            frame: &depths.frame,
        };
        let info = self.cameras[idx].as_ref().ok_or_else(|| {
            let problem = format!("no message on `{camera}` is a CameraInfo");
            Fault::new(problem, "record anew")
        })?;
        let view = DepthView {
            intrinsics: camera_info::intrinsics(&info.1, camera, &image)?,
            world_from_camera: Pose::identity(),
            mask: vec![false; depths.depth_m.len()],
            depth_m: depths.depth_m,
        };
        Ok((view, depths.step_m))
    }

    /// Returns the image of a cloud in its frame, and its depth of the number 1, in meters.
    fn cloud(
        &self,
        idx: usize,
        chosen: &ChosenImages<'_>,
        config: &ViewsConfig,
    ) -> Result<(DepthView, f64), Fault> {
        let points = cloud_message::points(&self.images[idx]);
        let points = points.map_err(|fault| fault.on_topic(chosen.name))?;
        let points = cloud::measured(&points, config.unit_m)?;
        let view = cloud::depth_image(&points, &config.camera_in_world(), config.unit_m)?;
        Ok((view, cloud::DEPTH_STEP_M))
    }
}

/// Returns the images that are views of one world, and the poses of their frames in it: those that tf tracks to one root,
/// or else one image, if possible one that tf has.
fn of_one_world(places: Vec<(usize, Place)>) -> Vec<(usize, Pose<World, World>)> {
    let mut tracked: Vec<(usize, Pose<World, World>)> = Vec::new();
    let mut first_root = None;
    let mut fixed = None;
    let mut first = None;
    for (idx, place) in places {
        first.get_or_insert((idx, Pose::identity()));
        let Place::In {
            root,
            root_from_frame,
            is_tracked,
        } = place
        else {
            continue;
        };
        let image = (idx, Pose::new(root_from_frame));
        if !is_tracked {
            // The root may move with the camera: nothing says that another image shows the same from elsewhere.
            fixed.get_or_insert(image);
        } else if *first_root.get_or_insert_with(|| root.clone()) == root {
            tracked.push(image);
        }
    }
    if tracked.is_empty() {
        return fixed.or(first).into_iter().collect();
    }
    tracked
}
