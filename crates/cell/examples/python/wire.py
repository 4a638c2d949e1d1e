"""What both sides of the dispatch protocol need: messages, signatures and the way between two rows."""
import hashlib, json
import blake3, numpy as np, zenoh

PROTOCOL = 4


def hex_digest(data):
    return blake3.blake3(data).hexdigest()


def line(value):
    return json.dumps(value, separators=(",", ":")).encode() + b"\n"


def split(data):
    """Takes a line of JSON off the front; numbers of JSON are finite."""
    first, _, rest = data.partition(b"\n")

    def refuse(constant):
        raise ValueError(f"{constant} is not a number of JSON")

    return json.loads(first, parse_constant=refuse), rest


def rows(data, width):
    numbers = np.frombuffer(data, "<f8").reshape(-1, width)
    if not np.isfinite(numbers).all():
        raise ValueError("a number is not finite")
    return numbers


def session(endpoint, listens=False):
    config = zenoh.Config()
    where = {"mode": '"router"', "listen/endpoints": json.dumps([endpoint])} if listens else {
        "mode": '"client"', "connect/endpoints": json.dumps([endpoint])}
    for key, value in {**where, "scouting/multicast/enabled": "false"}.items():
        config.insert_json5(key, value)
    return zenoh.open(config)


def between(times, q, v, a, time):
    """Returns each number at a time: on the quintic through the rows before and after it."""
    i = int(np.clip(np.searchsorted(times, time, "right") - 1, 0, len(times) - 2))
    h = times[i + 1] - times[i]
    s = np.clip((time - times[i]) / h, 0, 1)
    way = q[i + 1] - q[i] - v[i] * h - a[i] * h * h / 2
    speed, bend = (v[i + 1] - v[i] - a[i] * h) * h, (a[i + 1] - a[i]) * h * h
    c = 10 * way - 4 * speed + bend / 2, -15 * way + 7 * speed - bend, 6 * way - 3 * speed + bend / 2
    return q[i] + s * h * v[i] + (s * h) ** 2 / 2 * a[i] + s**3 * (c[0] + s * (c[1] + s * c[2]))


class Goal:
    """A goal: its two lines and its controllers' rows."""

    def __init__(self, data):
        self.seal, self.content = split(data)
        self.head, numbers = split(self.content)
        carrier, hand = self.head["controllers"]
        self.carrier, self.joints, self.id = carrier["controller"], hand["joints"], self.seal["goal_id"]
        arm = carrier.get("joints", [])
        self.joints = arm + self.joints
        size = carrier["points_n"] * (1 + 3 * len(arm) if arm else 20) * 8
        self.palm = rows(numbers[:size], 1 + 3 * len(arm) if arm else 20)
        self.hand = rows(numbers[size:], 1 + 3 * len(hand["joints"]))
        if [len(self.palm), len(self.hand)] != [carrier["points_n"], hand["points_n"]]:
            raise ValueError("the rows are not as many as the controllers say")


# Ed25519, as RFC 8032 has it in section 6.
P, L = 2**255 - 19, 2**252 + 27742317777372353535851937790883648493
D = -121665 * pow(121666, -1, P) % P


def _add(p, q):
    a, b = (p[1] - p[0]) * (q[1] - q[0]) % P, (p[1] + p[0]) * (q[1] + q[0]) % P
    c, d = 2 * p[3] * q[3] * D % P, 2 * p[2] * q[2] % P
    e, f, g, h = b - a, d - c, d + c, b + a
    return e * f % P, g * h % P, f * g % P, e * h % P


def _times(s, p):
    q = 0, 1, 1, 0
    while s:
        q, p, s = _add(q, p) if s & 1 else q, _add(p, p), s >> 1
    return q


def _point(data):
    y = int.from_bytes(data, "little")
    sign, y = y >> 255, y & (1 << 255) - 1
    square = (y * y - 1) * pow(D * y * y + 1, -1, P) % P
    x = pow(square, (P + 3) // 8, P)
    if (x * x - square) % P:
        x = x * pow(2, (P - 1) // 4, P) % P
    if (x * x - square) % P or y >= P or (x == 0 and sign):
        raise ValueError("no point of the curve")
    x = P - x if x & 1 != sign else x
    return x, y, 1, x * y % P


def _bytes(p):
    inverse = pow(p[2], -1, P)
    return (p[1] * inverse % P | (p[0] * inverse % P & 1) << 255).to_bytes(32, "little")


BASE = _point((4 * pow(5, -1, P) % P).to_bytes(32, "little"))


def _hash(*parts):
    return int.from_bytes(hashlib.sha512(b"".join(parts)).digest(), "little")


class Key:
    """A cell's key pair."""

    def __init__(self, seed):
        half = hashlib.sha512(seed).digest()
        self.number = int.from_bytes(half[:32], "little") & (1 << 254) - 8 | 1 << 254
        self.prefix, self.public = half[32:], _bytes(_times(self.number, BASE))

    def sign(self, text):
        r = _hash(self.prefix, text) % L
        point = _bytes(_times(r, BASE))
        s = (r + _hash(point, self.public, text) * self.number) % L
        return point + s.to_bytes(32, "little")


def verifies(public, text, signature):
    try:
        key, point = _point(public), _point(signature[:32])
        s = int.from_bytes(signature[32:], "little")
        left = _times(s, BASE)
        right = _add(point, _times(_hash(signature[:32], public, text) % L, key))
        return s < L and _bytes(left) == _bytes(right)
    except ValueError:
        return False


def signed_text(key, nonce, body):
    return f"cgf cell answer\n{key}\n{nonce}\n{hex_digest(body)}".encode()
