"""What the two sides check of each other's messages; the order of a cell's refusals is the page's."""
import sys, time
import numpy as np
from wire import PHASES, PROTOCOL, Goal, between, goal_text, hex_digest, parts, split, verifies

MOST_S, STEP_S, ROUNDING = 600.0, 0.001, 1 + 1e-4
PALM = {"speed_m_per_s": 3.0, "acceleration_m_per_s2": 60.0, "turn_rad_per_s": 12.0,
        "turn_acceleration_rad_per_s2": 250.0, "workspace_m": [[-2, -2, -0.5], [2, 2, 2]]}


def text(value):
    return isinstance(value, str) and value == value.encode(errors="replace").decode()


def texts(value):
    return isinstance(value, list) and all(map(text, value))


def truth(value):
    return isinstance(value, bool)


def count(value, most=2**64 - 1):
    return type(value) is int and 0 <= value <= most


def small(value):
    return count(value, 2**32 - 1)


def number(value):
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


def pose(value):
    return isinstance(value, list) and len(value) == 7 and all(map(number, value)) and is_turn(np.array(value[3:]))


def is_turn(quaternions):
    return bool((abs(np.linalg.norm(quaternions, axis=-1) - 1) < 1e-3).all())


def named(value):
    return isinstance(value, dict)


def two(value):
    return isinstance(value, list) and len(value) == 2 and all(map(named, value))


SEAL = {"protocol": count, "digest": text, "signature": text}
ADDRESS = {**dict.fromkeys(("cell", "journal", "goal_id", "dispatcher", "dispatcher_key"), text),
           "simulated_only": truth, "sent_unix_ms": count, "valid_until_unix_ms": count}
MOTION = {**dict.fromkeys(("candidate_id", "object", "robot"), text), "attempt": small, "resumed": small,
          "table_from_object": pose, "start_tolerance_rad": number, "grasp": named, "controllers": two}
TOLERANCES = ["lift_m", "lifted_m", "max_slip_m_per_s", "knocked_m", "knocked_rad", "limit_tolerance_rad",
              "table_tolerance_m", "early_tolerance_m"]
GRASP = {**dict.fromkeys((*PHASES, "close_fraction", "open_rad", "squeeze_rad", *TOLERANCES), number),
         "approach": text, "flexion_joints": texts, "min_links": count, "strict": named, "trial": text, "pull": named}
CONTROLLERS = {"palm": {"controller": text, "points_n": count}}
CONTROLLERS["arm"] = CONTROLLERS["hand"] = {**CONTROLLERS["palm"], "joints": texts}
CAPABILITIES = {"protocol": count, "cell": text, "journal": text, "clock_unix_ms": count, "simulated": truth,
                "stopped": truth, "executing": text, "robot": text, "controllers": two, "palm": named,
                "table_from_base": pose, "max_goal_bytes": count, "gap": text, "real_time": truth,
                "silence_s": lambda value: value is None or number(value)}
REPORT = {"goal_id": text, "outcome": text, "message": text, "lift_m": number, "joints": texts, "samples_n": count}


def fits(found, fields, may_lack=(), may_have_others=False):
    """Fails unless an object has these fields, and no others."""
    others = [] if may_have_others else found.keys() - fields.keys()
    wrong = [name for name in fields if not (fields[name](found[name]) if name in found else name in may_lack)]
    if others or wrong:
        raise ValueError(f"fields missing or not of their type: {wrong}; not on the page: {sorted(others)}")


def opened(data, refuse):
    """Returns the goal of a message that is whole and that its dispatcher signed."""
    try:
        seal, rest = split(data)
        version = seal["protocol"]
        if not count(version):
            raise ValueError("`protocol` is not a whole number")
        if version != PROTOCOL:
            older = "dispatcher" if version < PROTOCOL else "cell"
            refuse("protocol", f"the cell speaks version {PROTOCOL}, the goal {version}: update the {older}")
        fits(seal, SEAL)
        if seal["digest"] != hex_digest(rest):
            refuse("digest", "the digest is not that of the bytes")
        address, motion = split(rest)
        if address["goal_id"] != hex_digest(motion)[:32]:
            refuse("digest", "the id is not that of the motion")
        fits(address, ADDRESS)
        head, _ = split(motion)
        fits(head, MOTION, may_lack=["resumed"])
        fits(head["grasp"], GRASP, may_lack=["strict", "trial", "pull"])
        kinds = [controller.get("controller") for controller in head["controllers"]]
        if kinds not in (["palm", "hand"], ["arm", "hand"]):
            raise ValueError(f"its controllers are {kinds}")
        for kind, controller in zip(kinds, head["controllers"]):
            fits(controller, CONTROLLERS[kind])
        goal = Goal(data)
        if goal.carrier == "palm" and not is_turn(goal.carried[:, 4:8]):
            raise ValueError("a turn of the palm is not a quaternion of length 1")
    except (ValueError, KeyError, TypeError) as err:
        refuse("malformed", f"this is not a goal: {err!r}")
    if not verifies(address["dispatcher_key"], goal_text(seal["digest"]), seal["signature"]):
        refuse("dispatcher", "the signature is not that of the dispatcher's key")
    return goal


def check_motion(goal, robot, limits, objects, refuse):
    """Checks that a robot with this digest, limits of its joints and objects before it can execute a goal."""
    if goal.head["robot"] != robot:
        refuse("robot", f"this robot is {robot}")
    grasp = goal.head["grasp"]
    if grasp.get("trial", "lift") != "lift" or grasp["approach"] not in ("open", "follow"):
        refuse("malformed", "this cell lifts what it grasps, with the approach `open` or `follow`")
    if min(grasp[name] for name in PHASES) < 0 or goal.end_s > MOST_S:
        refuse("times", f"the motion lasts {goal.end_s} s, or a part of it less than none")
    if min(goal.head["start_tolerance_rad"], *(grasp[name] for name in TOLERANCES)) < 0:
        refuse("limits", "a tolerance is below 0")
    if not 0 <= grasp["close_fraction"] <= 1:
        refuse("limits", "`close_fraction` is not from 0 to 1")
    if goal.carrier != "palm" or sorted(goal.joints) != sorted(limits):
        refuse("joints", f"a palm that flies and these joints: {list(limits)}")
    check_times(goal.hand, refuse)
    lower, upper, speed = np.array([limits[name] for name in goal.joints]).T
    most = min(grasp["limit_tolerance_rad"], 0.1) + 1e-6
    q = goal.positions(np.arange(0, goal.hand[-1, 0] + STEP_S, STEP_S))
    if (q < lower - most).any() or (q > upper + most).any():
        refuse("limits", "a joint would leave its limits")
    rates = np.concatenate([abs(np.diff(q, axis=0)) / STEP_S, abs(parts(goal.hand)[2])])
    if (rates > speed * ROUNDING).any():
        refuse("limits", "a joint would be faster than it can")
    check_times(goal.carried, refuse)
    check_palm(goal.carried, PALM, refuse)
    if objects and goal.head["object"] not in objects:
        refuse("object", f"here lie {objects}")


def check_times(table, refuse):
    times = table[:, 0]
    if len(times) < 2 or times[0] != 0 or (np.diff(times) <= 0).any() or times[-1] > MOST_S:
        refuse("times", f"the times of a controller are {times}: two or more that increase from 0 were expected")


def check_palm(table, limits, refuse):
    """Checks the rows of a palm that flies, and its way between them."""
    looks = np.arange(0, table[-1, 0] + STEP_S, STEP_S)
    way = between(table[:, 0], table[:, 1:4], table[:, 8:11], table[:, 14:17], looks)
    low, high = np.array(limits["workspace_m"], float)
    if (way < low).any() or (way > high).any():
        refuse("limits", f"the palm would leave its workspace, {limits['workspace_m']}")
    speeds = np.linalg.norm(np.concatenate([np.diff(way, axis=0) / STEP_S, table[:, 8:11]]), axis=1)
    sizes = [speeds.max(), *(np.linalg.norm(table[:, i:i + 3], axis=1).max() for i in (14, 11, 17))]
    for name, size in zip(list(PALM)[:4], sizes):
        if size > limits[name] * ROUNDING:
            refuse("limits", f"the palm would have {size}, its `{name}` is {limits[name]}")


def check_clock(address, refuse):
    now, sent, until = int(time.time() * 1000), address["sent_unix_ms"], address["valid_until_unix_ms"]
    if sent > now + 1000 or not 0 <= until - sent <= 86_400_000 or now - until > until - sent + 1000:
        refuse("clock", f"sent at {sent} ms by its clock, valid until {until} ms, it is {now} ms by this one")
    if now > until:
        refuse("expired", f"it came {now - until} ms too late")
