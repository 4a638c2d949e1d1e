"""Makes `golden.safetensors`: what PyTorch computes, for the same weights and inputs.

Run with torch 2.15.0 (PyPI), in this folder: `python make.py`. Everything is computed in float64 and
stored in float32. The networks are written as the released code writes them, with inputs put side by
side; only the names and the cut of the first matrices are this crate's.
"""

import json
import struct
from pathlib import Path
from xml.etree import ElementTree

import torch
from torch import nn

torch.manual_seed(0)
torch.set_default_dtype(torch.float64)
arrays = {}


def put(name, tensor):
    arrays[name] = tensor.detach().to(torch.float32).clone()


def exact(*shape):
    """Normal numbers that float32 holds exactly, so that both sides see the same."""
    return torch.randn(*shape).to(torch.float32).to(torch.float64)


def round_parameters(module):
    with torch.no_grad():
        for parameter in module.parameters():
            parameter.copy_(parameter.to(torch.float32))


class PointNet(nn.Module):
    WIDTHS = [3, 8, 16, 32]

    def __init__(self):
        super().__init__()
        pairs = list(zip(self.WIDTHS, self.WIDTHS[1:]))
        # No bias: batch normalization takes it away again.
        self.convolutions = nn.ModuleList(nn.Conv1d(a, b, 1, bias=False) for a, b in pairs)
        self.norms = nn.ModuleList(nn.BatchNorm1d(b) for _, b in pairs)
        for norm in self.norms:
            # Gains of both signs, statistics other than 0 and 1.
            norm.weight.data = exact(norm.num_features)
            norm.bias.data = exact(norm.num_features)
            norm.running_mean.data = exact(norm.num_features)
            norm.running_var.data = exact(norm.num_features).abs() + 0.5

    def forward(self, x):
        for idx, (convolution, norm) in enumerate(zip(self.convolutions, self.norms)):
            x = norm(convolution(x))
            if idx < 2:
                x = x.relu()
        return x.max(2)[0]

    def learned(self):
        for idx, (convolution, norm) in enumerate(zip(self.convolutions, self.norms)):
            yield f"{idx}.weight", convolution.weight
            yield f"{idx}.gain", norm.weight
            yield f"{idx}.shift", norm.bias

    def measured(self):
        for idx, norm in enumerate(self.norms):
            yield f"{idx}.mean", norm.running_mean
            yield f"{idx}.variance", norm.running_var


def point_net():
    net = PointNet()
    round_parameters(net)
    with torch.no_grad():
        for norm in net.norms:
            norm.running_var.copy_(norm.running_var.to(torch.float32))
    clouds, by = exact(4, 64, 3), exact(4, 32)
    put("point_net/xyz", clouds.reshape(-1, 3))
    put("point_net/by", by)
    for name, array in [*net.learned(), *net.measured()]:
        put(f"point_net/weights/{name}", array.squeeze(-1) if array.dim() == 3 else array)
    for mode in ["stored", "measured"]:
        net.train(mode == "measured")
        net.zero_grad()
        features = net(clouds.transpose(1, 2))
        (features * by).sum().backward()
        put(f"point_net/{mode}/features", features)
        for name, parameter in net.learned():
            gradient = parameter.grad
            put(
                f"point_net/{mode}/gradient/{name}",
                gradient.squeeze(-1) if gradient.dim() == 3 else gradient,
            )
    for name, array in net.measured():
        put(f"point_net/running/{name}", array)


OUTPUTS, STEPS, LATENT, FEATURE = 12, 4, 3, 32
HAND, TRUNK, DECODER = [8, 5], [7, 6], [9, 11]


def linears(*widths):
    return nn.ModuleList(nn.Linear(a, b) for a, b in zip(widths, widths[1:]))


class Network(nn.Module):
    """Encoder and decoder; every motion comes with its own object feature."""

    def __init__(self, activation, inputs, outputs):
        super().__init__()
        self.act = {"relu": nn.functional.relu, "silu": nn.functional.silu}[activation]
        self.hand = linears(inputs, *HAND)
        self.trunk = linears(STEPS * HAND[-1] + FEATURE, *TRUNK)
        self.mean, self.log_variance = nn.Linear(TRUNK[-1], LATENT), nn.Linear(TRUNK[-1], LATENT)
        self.decoder = linears(1 + LATENT + FEATURE, *DECODER, outputs)
        round_parameters(self)

    def encode(self, motions, features):
        x = motions
        for layer in self.hand:
            x = self.act(layer(x))
        x = torch.cat([x.reshape(len(x), -1), features], 1)
        for layer in self.trunk:
            x = self.act(layer(x))
        return self.mean(x), self.log_variance(x)

    def decode(self, times, latents, features):
        """Everything of `(motions, times, ...)`, side by side."""
        x = torch.cat([times.unsqueeze(-1), latents, features], -1).flatten(0, 1)
        for layer in self.decoder[:-1]:
            x = self.act(layer(x))
        return self.decoder[-1](x)

    def named(self, get):
        for idx, layer in enumerate(self.hand):
            yield f"encoder.hand.{idx}.weight", get(layer.weight)
            yield f"encoder.hand.{idx}.bias", get(layer.bias)
        for idx, layer in enumerate(self.trunk):
            weight = get(layer.weight)
            if idx == 0:
                yield "encoder.trunk.0.motion", weight[:, : STEPS * HAND[-1]]
                yield "encoder.trunk.0.feature", weight[:, STEPS * HAND[-1] :]
            else:
                yield f"encoder.trunk.{idx}.weight", weight
            yield f"encoder.trunk.{idx}.bias", get(layer.bias)
        for name, layer in [("mean", self.mean), ("log_variance", self.log_variance)]:
            yield f"encoder.{name}.weight", get(layer.weight)
            yield f"encoder.{name}.bias", get(layer.bias)
        for idx, layer in enumerate(self.decoder):
            weight = get(layer.weight)
            if idx == 0:
                yield "decoder.0.time", weight[:, :1]
                yield "decoder.0.latent", weight[:, 1 : 1 + LATENT]
                yield "decoder.0.feature", weight[:, 1 + LATENT :]
            else:
                yield f"decoder.{idx}.weight", weight
            yield f"decoder.{idx}.bias", get(layer.bias)


def at_every_time(of_motions, n_times):
    return of_motions.unsqueeze(1).expand(-1, n_times, -1)


def network(activation):
    net = Network(activation, OUTPUTS, OUTPUTS)
    batch, n_times = 5, 6
    views = torch.tensor([0, 1, 1, 2, 3])
    motions, times = exact(batch, STEPS, OUTPUTS), exact(batch, n_times)
    features = exact(4, FEATURE).requires_grad_()
    latents = exact(batch, LATENT).requires_grad_()
    mu, log_var = net.encode(motions, features[views])
    repeated = [at_every_time(x, n_times) for x in (latents, features[views])]
    decoded = net.decode(times, *repeated)

    bys = [exact(*out.shape) for out in (mu, log_var, decoded)]
    sum((by * out).sum() for by, out in zip(bys, (mu, log_var, decoded))).backward()
    for name, array in net.named(lambda parameter: parameter):
        put(f"{activation}/weights/{name}", array)
    for name, array in net.named(lambda parameter: parameter.grad):
        put(f"{activation}/gradient/{name}", array)
    for name, array in [
        ("motions", motions),
        ("times", times),
        ("features", features),
        ("latents", latents),
        ("views", views),
        ("mean", mu),
        ("log_variance", log_var),
        ("decoded", decoded),
        ("by_mean", bys[0]),
        ("by_log_variance", bys[1]),
        ("by_decoded", bys[2]),
        ("by_features", features.grad),
        ("by_latents", latents.grad),
    ]:
        put(f"{activation}/{name}", array)


def loss(name, value, **arguments):
    value.backward()
    put(f"loss/{name}/value", value)
    for key, argument in arguments.items():
        put(f"loss/{name}/{key}", argument)
        if argument.requires_grad:
            put(f"loss/{name}/by_{key}", argument.grad)


def losses():
    batch, first, others, weight = 2, 2, 3, 4.0
    rows, links = batch * (first + others), 5
    row = torch.tensor(([weight] * first + [1.0] * others) * batch).unsqueeze(1)
    mean_of_rows = lambda per_row: (per_row * row.squeeze(1)).sum() / row.sum()

    x, y = exact(rows, 7).requires_grad_(), exact(rows, 7)
    per_row = nn.functional.mse_loss(x, y, reduction="none").mean(1)
    loss("squared_error", mean_of_rows(per_row), x=x, y=y)

    x, y = exact(rows, 3 * links).requires_grad_(), exact(rows, 3 * links)
    per_row = (x - y).view(rows, links, 3).norm(dim=2).square().mean(1)
    loss("squared_distance", mean_of_rows(per_row), x=x, y=y)

    mean, log_variance = exact(4, 6).requires_grad_(), exact(4, 6).requires_grad_()
    posterior = torch.distributions.Normal(mean, (0.5 * log_variance).exp())
    prior = torch.distributions.Normal(torch.zeros(4, 6), torch.ones(4, 6))
    kl = torch.distributions.kl_divergence(posterior, prior).sum(1).mean()
    loss("kl", kl, mean=mean, log_variance=log_variance)

    surface = exact(20, 3)
    for name, radius in [("touch_center", None), ("touch_surface", 0.4)]:
        tips = exact(6, 3).requires_grad_()
        nearest = torch.cdist(tips, surface).min(1)[0]
        value = (nearest if radius is None else nearest - radius).square().mean()
        loss(name, value, tips=tips, surface=surface)


def numbers(element, key):
    return torch.tensor([float(x) for x in element.get(key).split()])


def about(axis, angles):
    """Rotations about an axis by the formula of Rodrigues: `(rows, 3, 3)`."""
    x, y, z = axis / axis.norm()
    cross = torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angles = angles.view(-1, 1, 1)
    return torch.eye(3) + angles.sin() * cross + (1 - angles.cos()) * (cross @ cross)


class Hand:
    """Where the links of a URDF are, one after another in the order of the file."""

    def __init__(self, path):
        robot = ElementTree.parse(path).getroot()
        self.links = [link.get("name") for link in robot.findall("link")]
        self.joint_to = {joint.find("child").get("link"): joint for joint in robot.findall("joint")}
        joints = [self.joint_to[link] for link in self.links[1:]]
        moves = lambda joint: joint.get("type") != "fixed" and joint.find("mimic") is None
        moving = [joint for joint in joints if moves(joint)]
        self.joints = [joint.get("name") for joint in moving]
        limits = lambda name: torch.tensor([float(joint.find("limit").get(name)) for joint in moving])
        self.lower, self.upper = limits("lower"), limits("upper")

    def within_limits(self, rows):
        """Keeps the joint positions within their limits."""
        middle, half = (self.lower + self.upper) / 2, (self.upper - self.lower) / 2
        q = middle + half * ((rows[:, 9:] - middle) / half).tanh()
        return torch.cat([rows[:, :9], q], 1)

    def position(self, joint, q):
        mimic = joint.find("mimic")
        if mimic is None:
            return q[:, self.joints.index(joint.get("name"))]
        followed = q[:, self.joints.index(mimic.get("joint"))]
        return float(mimic.get("multiplier")) * followed + float(mimic.get("offset"))

    def poses(self, rows):
        """Takes translation, two columns, joint positions to `(rows, links, 9)`: origin, two columns."""
        t, a, b, q = rows[:, :3], rows[:, 3:6], rows[:, 6:9], rows[:, 9:]
        x = nn.functional.normalize(a, dim=1)
        y = nn.functional.normalize(b - (x * b).sum(1, keepdim=True) * x, dim=1)
        placed = {self.links[0]: (torch.stack([x, y, torch.linalg.cross(x, y)], 2), t)}
        for link in self.links[1:]:
            joint = self.joint_to[link]
            rotation, origin = placed[joint.find("parent").get("link")]
            origin = origin + rotation @ numbers(joint.find("origin"), "xyz")
            # Roll, pitch, yaw about the axes of the parent.
            for axis, angle in reversed(list(zip(torch.eye(3), numbers(joint.find("origin"), "rpy")))):
                rotation = rotation @ about(axis, angle)
            if joint.get("type") == "revolute":
                axis = numbers(joint.find("axis"), "xyz")
                rotation = rotation @ about(axis, self.position(joint, q))
            elif joint.get("type") == "prismatic":
                axis = numbers(joint.find("axis"), "xyz")
                along = self.position(joint, q).unsqueeze(1) * axis / axis.norm()
                origin = origin + (rotation @ along.unsqueeze(2)).squeeze(2)
            placed[link] = (rotation, origin)
        poses = [torch.cat([t, r[:, :, 0], r[:, :, 1]], 1) for r, t in map(placed.get, self.links)]
        return torch.stack(poses, 1)


def hand(model):
    rows = exact(4, 9 + len(model.joints)).requires_grad_()
    poses = model.poses(rows)
    by = exact(*poses.shape)
    put("hand/rows", rows)
    put("hand/poses", poses)
    put("hand/by", by)
    for name, part in [("origins", slice(0, 3)), ("columns", slice(3, 9))]:
        (gradient,) = torch.autograd.grad((by * poses)[:, :, part].sum(), rows, retain_graph=True)
        put(f"hand/by_rows_of_{name}", gradient)


# Three totals: of the terms that the default, the paper and the released code have, with weights that make
# each of them count.
FIRST, OTHERS = 2, 3
TOUCH_RADIUS = 0.05
CASES = {
    "default": {
        "activation": "silu",
        "statistics": "measured",
        "inputs": "columns",
        "noise": "per_motion",
        "reduction": "mean",
        "contact": "touch_surface",
        "variance": "below_prior",
        "joints": "within_limits",
        "grasp_weight": 5.0,
        "weights": {"q": 1.0, "origins": 2.0, "kl": 10.0, "contact": 10.0},
    },
    "paper": {
        "activation": "relu",
        "statistics": "measured",
        "inputs": "columns",
        "noise": "per_motion",
        "reduction": "sum",
        "contact": "touch_center",
        "variance": "free",
        "joints": "free",
        "grasp_weight": 1.0,
        "weights": {"q": 0.02, "origins": 0.05, "kl": 20.0, "contact": 2.0},
    },
    "released": {
        "activation": "relu",
        "statistics": "stored",
        "inputs": "axis_angle",
        "noise": "per_time",
        "reduction": "mean",
        "contact": "demonstrated",
        "variance": "free",
        "joints": "free",
        "grasp_weight": 1.0,
        "weights": {
            "q": 1.0,
            "translation": 0.4,
            "origins": 2.0,
            "rotations": 15.0,
            "kl": 5.0,
            "contact": 2.0,
        },
    },
}


def objective(model, case, about_case):
    outputs = 9 + len(model.joints)
    inputs = outputs - (3 if about_case["inputs"] == "axis_angle" else 0)
    batch, n_times, n_views, n_points = 3, FIRST + OTHERS, 2, 64
    point_net = PointNet()
    round_parameters(point_net)
    point_net.train(about_case["statistics"] == "measured")
    net = Network(about_case["activation"], inputs, outputs)
    views = torch.tensor([1, 0, 1])
    clouds, surfaces = exact(n_views, n_points, 3), exact(n_views, 20, 3)
    motions, times = exact(batch, STEPS, inputs), exact(batch, n_times)
    draws = n_times if about_case["noise"] == "per_time" else 1
    noise = exact(batch, draws, LATENT)
    # Far from columns that are parallel.
    shift = exact(outputs) + torch.tensor([0, 0, 0, 3, 0, 0, 0, 3, 0] + [0] * (outputs - 9))
    scale = torch.tensor([0.25] * 3 + [0.75] * 6 + [0.5] * (outputs - 9))
    physical = exact(batch * n_times, outputs) * 0.5 + shift
    physical = physical.to(torch.float32).to(torch.float64)
    targets = ((physical - shift) / scale).to(torch.float32).to(torch.float64)
    tips = [model.links.index(name) for name in ["finger_tip", "thumb_tip"]]

    row = torch.tensor(([about_case["grasp_weight"]] * FIRST + [1.0] * OTHERS) * batch)

    def over_rows(errors):
        """Puts errors `(rows, what a row has)` together."""
        if about_case["reduction"] == "sum":
            return errors.sum() / batch
        return (errors.mean(1) * row).sum() / row.sum()

    def terms(features, noise):
        features = features[views]
        mean, log_variance = net.encode(motions, features)
        if about_case["variance"] == "below_prior":
            log_variance = nn.functional.logsigmoid(log_variance)
        latents = at_every_time(mean, n_times)
        if noise is not None:
            latents = latents + at_every_time((0.5 * log_variance).exp(), n_times) * noise
        decoded = net.decode(times, latents, at_every_time(features, n_times))
        rows = decoded * scale + shift
        if about_case["joints"] == "within_limits":
            rows = model.within_limits(rows)
            decoded = (rows - shift) / scale
        reached = model.poses(rows)
        wanted = model.poses(physical)
        squares = (decoded - targets).square()
        posterior = torch.distributions.Normal(mean, (0.5 * log_variance).exp())
        prior = torch.distributions.Normal(torch.zeros_like(mean), torch.ones_like(mean))
        of_tips = wanted if about_case["contact"] == "demonstrated" else reached
        at_grasp = of_tips.view(batch, n_times, -1, 9)[:, FIRST - 1, tips, :3]
        gap = torch.cdist(at_grasp, surfaces[views]).min(2)[0]
        if about_case["contact"] == "touch_surface":
            gap = gap - TOUCH_RADIUS
        contact = gap.square()
        contact = contact.sum(1) if about_case["reduction"] == "sum" else contact.mean(1)
        found = {
            "q": over_rows(squares),
            "translation": over_rows(squares[:, :3]),
            "origins": over_rows((reached - wanted)[:, :, :3].norm(dim=2).square()),
            "rotations": over_rows((reached - wanted)[:, :, 3:].flatten(1).square()),
            "kl": torch.distributions.kl_divergence(posterior, prior).sum(1).mean(),
            "contact": contact.mean(),
        }
        if "rotations" not in about_case["weights"]:
            # Not computed without a weight.
            found["rotations"] = torch.zeros(())
        total = sum(weight * found[name] for name, weight in about_case["weights"].items())
        return total, found

    folder = f"objective/{case}"
    for name, array in [*point_net.learned(), *point_net.measured()]:
        array = array.squeeze(-1) if array.dim() == 3 else array
        put(f"{folder}/weights/point_net.{name}", array)
    for name, array in net.named(lambda parameter: parameter):
        put(f"{folder}/weights/{name}", array)
    for name, array in [
        ("clouds", clouds),
        ("surfaces", surfaces),
        ("motions", motions),
        ("times", times),
        ("noise", noise),
        ("physical", physical),
        ("targets", targets),
        ("shift", shift),
        ("scale", scale),
    ]:
        put(f"{folder}/{name}", array)

    # First with the stored statistics: the others move them.
    mode = point_net.training
    with torch.no_grad():
        total, found = terms(point_net.eval()(clouds.transpose(1, 2)), None)
    for name in found:
        put(f"{folder}/weight_of/{name}", torch.tensor(about_case["weights"].get(name, 0.0)))
    put(f"{folder}/grasp_weight", torch.tensor(about_case["grasp_weight"]))
    put(f"{folder}/tip_radius_m", torch.tensor(TOUCH_RADIUS))
    for name, number in [("total", total), *found.items()]:
        put(f"{folder}/mean_codes/{name}", number)
    point_net.train(mode)
    total, found = terms(point_net(clouds.transpose(1, 2)), noise)
    total.backward()
    for name, number in [("total", total), *found.items()]:
        put(f"{folder}/losses/{name}", number)
    for name, parameter in point_net.learned():
        gradient = parameter.grad
        gradient = gradient.squeeze(-1) if gradient.dim() == 3 else gradient
        put(f"{folder}/gradient/point_net.{name}", gradient)
    for name, array in net.named(lambda parameter: parameter.grad):
        put(f"{folder}/gradient/{name}", array)


def write(path):
    header, offset = {"__metadata__": {"torch": torch.__version__.split("+")[0]}}, 0
    for name, array in sorted(arrays.items()):
        size = 4 * array.numel()
        shape = list(array.shape) or [1]
        header[name] = {"dtype": "F32", "shape": shape, "data_offsets": [offset, offset + size]}
        offset += size
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    with open(path, "wb") as file:
        file.write(struct.pack("<Q", len(text)) + text)
        for _, array in sorted(arrays.items()):
            file.write(array.contiguous().numpy().tobytes())


point_net()
for kind in ["relu", "silu"]:
    network(kind)
losses()
model = Hand(Path(__file__).with_name("hand.urdf"))
hand(model)
for case, about_case in CASES.items():
    objective(model, case, about_case)
write(Path(__file__).with_name("golden.safetensors"))
