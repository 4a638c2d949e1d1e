//! The messages of cameras as structs, field by field in the order of their definitions.

use serde::Serialize;

use super::{
    CompressedImage, Header, Message, Part,
    cdr::{Cdr, CdrError, CdrReader, CdrWriter},
    definitions as text,
    messages::{fields, root},
};

/// `sensor_msgs/Image`: an image as a camera's driver publishes it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Image {
    /// Time, and the camera's optical frame: x right, y down, z forward.
    pub header: Header,
    /// Number of rows.
    pub height: u32,
    /// Pixels of a row.
    pub width: u32,
    /// What a pixel is, e.g. `16UC1`: a depth in millimeters (REP 118).
    pub encoding: String,
    /// Whether the highest byte of a number comes first: 0 or 1.
    pub is_bigendian: u8,
    /// Bytes from a row to the next.
    pub step: u32,
    /// The rows.
    pub data: Vec<u8>,
}
fields!(Image {
    header,
    height,
    width,
    encoding,
    is_bigendian,
    step,
    data
});

/// `sensor_msgs/RegionOfInterest`: a part of an image; the whole where its sides are 0.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct RegionOfInterest {
    /// Its leftmost pixel.
    pub x_offset: u32,
    /// Its topmost pixel.
    pub y_offset: u32,
    /// Number of rows.
    pub height: u32,
    /// Pixels of a row.
    pub width: u32,
    /// Whether a rectified image shows this part only.
    pub do_rectify: bool,
}
fields!(RegionOfInterest {
    x_offset,
    y_offset,
    height,
    width,
    do_rectify
});

/// `sensor_msgs/CameraInfo`: how a camera projects, in pixels of its image at full resolution.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct CameraInfo {
    /// Time, and the camera's optical frame: x right, y down, z forward.
    pub header: Header,
    /// Number of rows.
    pub height: u32,
    /// Pixels of a row.
    pub width: u32,
    /// How `d` distorts, e.g. `plumb_bob`.
    pub distortion_model: String,
    /// Parameters of the lens's distortion.
    pub d: Vec<f64>,
    /// Intrinsics of the image as it is taken, 3 × 3 row by row.
    pub k: [f64; 9],
    /// Rotation that rectifies, 3 × 3 row by row.
    pub r: [f64; 9],
    /// Projection to the rectified image, 3 × 4 row by row.
    pub p: [f64; 12],
    /// Columns of the full resolution that a pixel of the image stands for; 0 is 1.
    pub binning_x: u32,
    /// Rows of the full resolution that a pixel of the image stands for; 0 is 1.
    pub binning_y: u32,
    /// The part of the full resolution that the image shows.
    pub roi: RegionOfInterest,
}
fields!(CameraInfo {
    header,
    height,
    width,
    distortion_model,
    d,
    k,
    r,
    p,
    binning_x,
    binning_y,
    roi
});

/// `sensor_msgs/PointField`: where a cloud's points have a number.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct PointField {
    /// Its name, e.g. `x`.
    pub name: String,
    /// Bytes from the start of a point.
    pub offset: u32,
    /// Its type: [`PointField::FLOAT32`], [`PointField::FLOAT64`] or another.
    pub datatype: u8,
    /// How many numbers it has.
    pub count: u32,
}
fields!(PointField {
    name,
    offset,
    datatype,
    count
});

impl PointField {
    /// A number of 32 bits.
    pub const FLOAT32: u8 = 7;
    /// A number of 64 bits.
    pub const FLOAT64: u8 = 8;
}

/// `sensor_msgs/PointCloud2`: points, in rows if they are those of an image's pixels.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct PointCloud2 {
    /// Time, and the frame of the points.
    pub header: Header,
    /// Number of rows: 1 if the points are in no order.
    pub height: u32,
    /// Points of a row.
    pub width: u32,
    /// What a point has.
    pub fields: Vec<PointField>,
    /// Whether the highest byte of a number comes first.
    pub is_bigendian: bool,
    /// Bytes from a point to the next.
    pub point_step: u32,
    /// Bytes from a row to the next.
    pub row_step: u32,
    /// The rows.
    pub data: Vec<u8>,
    /// Whether every point was measured.
    pub is_dense: bool,
}
fields!(PointCloud2 {
    header,
    height,
    width,
    fields,
    is_bigendian,
    point_step,
    row_step,
    data,
    is_dense
});

root!(
    Image,
    "sensor_msgs/msg/Image",
    "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    [IMAGE, HEADER, TIME]
);
root!(
    CompressedImage,
    "sensor_msgs/msg/CompressedImage",
    "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
    [COMPRESSED_IMAGE, HEADER, TIME]
);
root!(
    CameraInfo,
    "sensor_msgs/msg/CameraInfo",
    "RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
    [CAMERA_INFO, HEADER, TIME, REGION_OF_INTEREST]
);
root!(
    PointCloud2,
    "sensor_msgs/msg/PointCloud2",
    "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    [POINT_CLOUD2, HEADER, TIME, POINT_FIELD]
);
