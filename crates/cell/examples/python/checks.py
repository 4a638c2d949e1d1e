"""What a cell checks of a goal before it takes it."""
import time
import numpy as np
from wire import between

MOST_S = 600.0
PALM = {"speed_m_per_s": 3.0, "acceleration_m_per_s2": 60.0, "turn_rad_per_s": 12.0,
        "turn_acceleration_rad_per_s2": 250.0, "workspace_m": [[-2, -2, -0.5], [2, 2, 2]]}


class Checks:
    """Needs `robot`, `limits` of the hand's joints and `args.object`."""

    def check(self, goal, refuse):
        if goal.head["robot"] != self.robot:
            refuse("robot", f"this robot is {self.robot}")
        grasp = goal.head["grasp"]
        if grasp.get("trial", "lift") != "lift":
            refuse("malformed", "this cell lifts what it grasps")
        lengths = [grasp[name] for name in ("reach_s", "squeeze_s", "pause_s", "lift_s", "hold_s")]
        if min(lengths) < 0 or sum(lengths) > MOST_S:
            refuse("times", f"the motion lasts {sum(lengths)} s")
        if min(v for k, v in grasp.items() if "tolerance" in k) < 0 or goal.head["start_tolerance_rad"] < 0:
            refuse("limits", "a tolerance is below 0")
        if goal.carrier != "palm" or sorted(goal.joints) != sorted(self.limits):
            refuse("joints", f"a palm that flies and these joints: {list(self.limits)}")
        for who, table in ("hand", goal.hand), ("palm", goal.palm):
            times = table[:, 0]
            if len(table) < 2 or times[0] != 0 or (np.diff(times) <= 0).any() or times[-1] > MOST_S:
                refuse("times", f"the times of the {who} do not increase from 0")
        n, most = len(goal.joints), min(grasp["limit_tolerance_rad"], 0.1) + 1e-6
        lower, upper, speed = np.array([self.limits[name] for name in goal.joints]).T
        parts = goal.hand[:, 0], goal.hand[:, 1:n + 1], goal.hand[:, n + 1:2 * n + 1], goal.hand[:, 2 * n + 1:]
        looks = np.arange(0, parts[0][-1], 0.001)
        q = np.array([between(*parts, t) for t in looks])
        if (q < lower - most).any() or (q > upper + most).any():
            refuse("limits", "a joint would leave its limits")
        if (abs(np.diff(q, axis=0)) > 0.001 * speed * (1 + 1e-4)).any():
            refuse("limits", "a joint would be faster than it can")
        palm, limits = goal.palm, np.array([PALM[k] for k in list(PALM)[:4]])
        sizes = [np.linalg.norm(palm[:, i:i + 3], axis=1).max() for i in (8, 14, 11, 17)]
        low, high = np.array(PALM["workspace_m"])
        if (sizes > limits).any() or (palm[:, 1:4] < low).any() or (palm[:, 1:4] > high).any():
            refuse("limits", f"the palm can do {PALM}")
        if self.args.object and goal.head["object"] not in self.args.object:
            refuse("object", f"here lie {self.args.object}")

    def check_time(self, sending, refuse):
        if sending:
            now, sent, until = int(time.time() * 1000), sending["sent_unix_ms"], sending["valid_until_unix_ms"]
            if sent > now + 1000 or not 0 <= until - sent <= 86_400_000 or now - until > until - sent + 1000:
                refuse("clock", f"sent at {sent} ms by its clock, it is {now} ms by this one")
            if now > until:
                refuse("expired", f"it came {now - until} ms too late")
