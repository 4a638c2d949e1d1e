"""Makes `golden.safetensors`: what PyTorch computes, for the same weights and inputs.

Run with torch 2.15.0 (PyPI), in this folder: `python make.py`. Everything is computed in float64 and
stored in float32. The networks are written as the released code writes them, with inputs put side by
side; only the names and the cut of the first matrices are this crate's.
"""

import json
import struct
from pathlib import Path

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


def network(activation):
    hand = linears(OUTPUTS, *HAND)
    trunk = linears(STEPS * HAND[-1] + FEATURE, *TRUNK)
    mean, log_variance = nn.Linear(TRUNK[-1], LATENT), nn.Linear(TRUNK[-1], LATENT)
    decoder = linears(1 + LATENT + FEATURE, *DECODER, OUTPUTS)
    modules = nn.ModuleList([hand, trunk, mean, log_variance, decoder])
    round_parameters(modules)
    act = {"relu": nn.functional.relu, "silu": nn.functional.silu}[activation]
    batch, n_times = 5, 6
    views = torch.tensor([0, 1, 1, 2, 3])
    motions, times = exact(batch, STEPS, OUTPUTS), exact(batch, n_times)
    features = exact(4, FEATURE).requires_grad_()
    latents = exact(batch, LATENT).requires_grad_()

    x = motions
    for layer in hand:
        x = act(layer(x))
    x = torch.cat([x.reshape(batch, -1), features[views]], 1)
    for layer in trunk:
        x = act(layer(x))
    mu, log_var = mean(x), log_variance(x)

    repeat = lambda x: x.unsqueeze(1).repeat(1, n_times, 1).reshape(batch * n_times, -1)
    x = torch.cat([times.reshape(-1, 1), repeat(latents), repeat(features[views])], 1)
    for layer in decoder[:-1]:
        x = act(layer(x))
    decoded = decoder[-1](x)

    bys = [exact(*out.shape) for out in (mu, log_var, decoded)]
    sum((by * out).sum() for by, out in zip(bys, (mu, log_var, decoded))).backward()

    def named(get):
        for idx, layer in enumerate(hand):
            yield f"encoder.hand.{idx}.weight", get(layer.weight)
            yield f"encoder.hand.{idx}.bias", get(layer.bias)
        for idx, layer in enumerate(trunk):
            weight = get(layer.weight)
            if idx == 0:
                yield "encoder.trunk.0.motion", weight[:, : STEPS * HAND[-1]]
                yield "encoder.trunk.0.feature", weight[:, STEPS * HAND[-1] :]
            else:
                yield f"encoder.trunk.{idx}.weight", weight
            yield f"encoder.trunk.{idx}.bias", get(layer.bias)
        for name, layer in [("mean", mean), ("log_variance", log_variance)]:
            yield f"encoder.{name}.weight", get(layer.weight)
            yield f"encoder.{name}.bias", get(layer.bias)
        for idx, layer in enumerate(decoder):
            weight = get(layer.weight)
            if idx == 0:
                yield "decoder.0.time", weight[:, :1]
                yield "decoder.0.latent", weight[:, 1 : 1 + LATENT]
                yield "decoder.0.feature", weight[:, 1 + LATENT :]
            else:
                yield f"decoder.{idx}.weight", weight
            yield f"decoder.{idx}.bias", get(layer.bias)

    for name, array in named(lambda parameter: parameter):
        put(f"{activation}/weights/{name}", array)
    for name, array in named(lambda parameter: parameter.grad):
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
write(Path(__file__).with_name("golden.safetensors"))
