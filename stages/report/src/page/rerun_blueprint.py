"""Makes `rollout.rbl`, the panels in which Rerun shows a recording of a rollout.

`pip install rerun-sdk==0.41.0 && python rerun_blueprint.py`, in this folder; then, with any recording:
`rerun mcap convert 025_mug-00000.mcap --application-id pipeline -o motion.rrd && rerun motion.rrd rollout.rbl`.
"""

import rerun.blueprint as rrb

rrb.Blueprint(
    rrb.Horizontal(
        rrb.Spatial3DView(
            name="Motion",
            origin="/",
            contents=["$origin/**"],
            spatial_information=rrb.SpatialInformation(target_frame="table"),
        ),
        rrb.Vertical(
            rrb.TimeSeriesView(name="Joint positions [rad]", origin="/joint_states/position"),
            rrb.TimeSeriesView(name="Contact forces by link [N]", origin="/contact_forces/effort"),
        ),
        column_shares=[3, 2],
    ),
    collapse_panels=True,
).save("pipeline", "rollout.rbl")
