"""What both sides of the dispatch protocol need: messages, signatures, files and the way between two rows."""
import json, math, os
import blake3, numpy as np, zenoh
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

PROTOCOL, MOST_REPORT = 5, 64 << 20
PHASES = "reach_s", "squeeze_s", "pause_s", "lift_s", "hold_s"


def hex_digest(data):
    return blake3.blake3(data).hexdigest()


def line(value):
    return json.dumps(value, separators=(",", ":")).encode() + b"\n"


def split(data):
    """Takes a line off the front: an object of JSON, whose numbers are finite."""
    first, _, rest = data.partition(b"\n")

    def number(text):
        if not math.isfinite(float(text)):
            raise ValueError(f"{text} is not a number of JSON")
        return float(text)

    try:
        found = json.loads(first.decode(), parse_constant=number, parse_float=number)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if not isinstance(found, dict):
        raise ValueError("it is not an object of JSON")
    return found, rest


def rows(data, width):
    numbers = np.frombuffer(data, "<f8").reshape(-1, width)
    if not np.isfinite(numbers).all():
        raise ValueError("a number is not finite")
    return numbers


def plain(text):
    """Returns the start of others' text: without characters that move a cursor, or turn what people read."""
    return repr(str(text)[:500])[1:-1]


def write(path, data):
    """Writes a file that only its owner may read, whole or not at all, and waits for the disk."""
    new = path.with_name(path.name + ".new")
    with open(new, "wb", opener=lambda name, flags: os.open(name, flags, 0o600)) as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    os.replace(new, path)
    folder = os.open(path.parent, os.O_RDONLY)
    os.fsync(folder)
    os.close(folder)


class Key:
    """An Ed25519 key pair, kept in a file, its public part also beside it in a `.pub`."""

    def __init__(self, path):
        if not path.exists():
            write(path, Ed25519PrivateKey.generate().private_bytes_raw())
        self.pair = Ed25519PrivateKey.from_private_bytes(path.read_bytes())
        self.public = self.pair.public_key().public_bytes_raw().hex()
        write(path.with_name(path.name + ".pub"), f"{self.public}\n".encode())

    def sign(self, text):
        return self.pair.sign(text).hex()


def verifies(public, text, signature):
    try:
        key, name = bytes.fromhex(public), bytes.fromhex(signature)
        Ed25519PublicKey.from_public_bytes(key).verify(name, text)
    except (ValueError, TypeError, InvalidSignature):
        return False
    return [public, signature] == [key.hex(), name.hex()]  # lower-case digits


def answer_text(key, parameters, asked, content):
    """Returns what the signature of an answer signs."""
    return f"cgf cell answer\n{key}\n{parameters}\n{asked}\n{hex_digest(content)}".encode()


def goal_text(digest):
    """Returns what the signature of a goal signs."""
    return f"cgf cell goal\n{digest}".encode()


def session(endpoint, listens=False):
    config = zenoh.Config()
    where = {"mode": '"router"', "listen/endpoints": json.dumps([endpoint])} if listens else {
        "mode": '"client"', "connect/endpoints": json.dumps([endpoint])}
    where["transport/link/rx/max_message_size"] = str(MOST_REPORT + (64 << 10))
    for key, value in {**where, "scouting/multicast/enabled": "false"}.items():
        config.insert_json5(key, value)
    return zenoh.open(config)


def parts(table):
    """Returns the columns of joints' rows: times, positions, velocities, accelerations."""
    n = table.shape[1] // 3
    return table[:, 0], table[:, 1:n + 1], table[:, n + 1:2 * n + 1], table[:, 2 * n + 1:]


def around(times, time):
    """Returns the rows before times, the time to the next row, and which part of it has passed."""
    i = np.clip(np.searchsorted(times, time, "right") - 1, 0, len(times) - 2)
    h = times[i + 1] - times[i]
    return i, h[..., None], np.clip((time - times[i]) / h, 0, 1)[..., None]


def between(times, q, v, a, time):
    """Returns each number at a time, or at each of many: on the quintic through the rows before and after it."""
    i, h, s = around(times, time)
    way = q[i + 1] - q[i] - v[i] * h - a[i] * h * h / 2
    speed, bend = (v[i + 1] - v[i] - a[i] * h) * h, (a[i + 1] - a[i]) * h * h
    c = 10 * way - 4 * speed + bend / 2, -15 * way + 7 * speed - bend, 6 * way - 3 * speed + bend / 2
    return q[i] + s * h * v[i] + (s * h) ** 2 / 2 * a[i] + s**3 * (c[0] + s * (c[1] + s * c[2]))


def palm_at(table, time):
    """Returns a flying palm's pose at a time, or at each of many; its turn between rows is a simple mean."""
    i, _, s = around(table[:, 0], time)
    before, after = table[i, 4:8], table[i + 1, 4:8]
    turn = before * (1 - s) + after * s * np.where((before * after).sum(-1) < 0, -1, 1)[..., None]
    place = between(table[:, 0], table[:, 1:4], table[:, 8:11], table[:, 14:17], time)
    return np.concatenate([place, turn / np.linalg.norm(turn, axis=-1)[..., None]], -1)


class Goal:
    """A goal: its three lines, whoever sent it to whomever, and its controllers' rows."""

    def __init__(self, data):
        self.seal, rest = split(data)
        self.address, self.motion = split(rest)
        self.head, numbers = split(self.motion)
        self.id, self.data = hex_digest(self.motion)[:32], data
        carrier, hand = self.head["controllers"]
        arm, self.carrier = carrier.get("joints", []), carrier["controller"]
        self.joints, width = arm + hand["joints"], 20 if self.carrier == "palm" else 1 + 3 * len(arm)
        size = carrier["points_n"] * width * 8
        self.carried, self.hand = rows(numbers[:size], width), rows(numbers[size:], 1 + 3 * len(hand["joints"]))
        if [len(self.carried), len(self.hand)] != [carrier["points_n"], hand["points_n"]]:
            raise ValueError("the rows are not as many as the controllers say")
        self.end_s = sum(self.head["grasp"][name] for name in PHASES)

    def sent_by(self, key, **address):
        """Returns a message with the same motion, of another sender to another address."""
        rest = line({**address, "goal_id": self.id, "dispatcher_key": key.public}) + self.motion
        digest = hex_digest(rest)
        return line({"protocol": PROTOCOL, "digest": digest, "signature": key.sign(goal_text(digest))}) + rest

    def positions(self, time):
        """Returns the joints' commanded positions at a time, or at each of many."""
        tables = [self.hand] if self.carrier == "palm" else [self.carried, self.hand]
        return np.concatenate([between(*parts(table), time) for table in tables], -1)
