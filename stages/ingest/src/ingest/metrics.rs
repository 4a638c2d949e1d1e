//! The figures of demonstrations and shapes.

use dataflow::{Max, Mean, Sum, With};
use geometry::Repairs;

dataflow::metrics! {
    /// Metrics of an object's shape.
    pub struct ShapeMetrics {
        /// Number of its convex parts.
        convex_parts_n: Sum,
        /// Number of the orientations in which it can lie.
        rests_n: Sum,
        /// Number of watertight meshes: 1 if its own is one.
        watertight: Sum,
        /// Number of vertices of its mesh that were left out because no triangle uses them.
        unused_vertices_n: Option<Sum>,
        /// Number of triangles of its mesh that were turned outward.
        turned_triangles_n: Option<Sum>,
    }
}

impl ShapeMetrics {
    /// Returns what was mended of the meshes.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "they are counts"
    )]
    pub fn repairs(&self) -> Repairs {
        Repairs {
            unused_vertices_n: self.unused_vertices_n.unwrap_or_default() as usize,
            turned_triangles_n: self.turned_triangles_n.unwrap_or_default() as usize,
        }
    }
}

dataflow::metrics! {
    /// Metrics of a demonstration.
    pub struct DemonstrationMetrics {
        /// Number of its steps.
        steps_n: Sum,
        /// Number of those in which the hand was not seen.
        bridged_n: Sum,
        /// Number of recordings whose rate nobody gives: 1 if 30 Hz is assumed.
        assumed_rate_n: Option<Sum>,
        /// Agreement of its sources.
        agreement: With<Agreement>,
    }
}

dataflow::metrics! {
    /// Agreement of a recording's sources, where it has several.
    #[derive(Default)]
    pub struct Agreement {
        /// Number of cameras.
        cameras_n: Option<Mean>,
        /// Largest distance of a camera's landmarks from the fused ones, in meters.
        camera_spread_m: Option<Max>,
        /// Number of labels that disagree with the others and were left out.
        disagreeing_labels_n: Option<Sum>,
        /// Median distance between the object's poses in the labels and elsewhere, in meters.
        pose_difference_m: Option<Mean>,
        /// Mean distance between labeled landmarks and those of the hand model, in meters.
        mano_difference_m: Option<Mean>,
        /// Largest distance between labeled landmarks and those of the hand model, in meters.
        mano_largest_difference_m: Option<Max>,
        /// Number of objects that say where the table is.
        table_objects_n: Option<Mean>,
        /// Distance between the tables of these objects, in meters.
        table_spread_m: Option<Mean>,
        /// Angle between the tables of these objects, in radians.
        table_spread_rad: Option<Mean>,
    }
}
