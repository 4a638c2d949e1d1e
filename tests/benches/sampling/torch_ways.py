"""Samples with the released model's network in PyTorch, in the ways that one can, on one thread.

Reads a line of JSON with the sizes, then one line for each request, {"way", "motions"}, and answers
each with the CPU seconds of this process that it took. Weights are random: what is measured is time.
"""

import json
import sys
import time

import torch
from torch import nn

torch.set_num_threads(1)
torch.manual_seed(0)


def say(what):
    print(json.dumps(what), flush=True)


sizes = json.loads(sys.stdin.readline())
STEPS, LATENT, POINTS = sizes["steps"], sizes["latent"], sizes["points"]
POINT_WIDTHS, WIDTHS, OUTPUTS = sizes["point_widths"], sizes["widths"], sizes["outputs"]
FEATURE = POINT_WIDTHS[-1]


class PointNet(nn.Module):
    """Layers on each point with batch normalization, ReLU on all but the last; the greatest of each."""

    def __init__(self):
        super().__init__()
        widths = [3, *POINT_WIDTHS]
        pairs = list(zip(widths, widths[1:]))
        self.layers = nn.ModuleList(nn.Conv1d(a, b, 1) for a, b in pairs)
        self.norms = nn.ModuleList(nn.BatchNorm1d(b) for _, b in pairs)

    def forward(self, x):
        for number, (layer, norm) in enumerate(zip(self.layers, self.norms)):
            x = norm(layer(x))
            if number + 1 < len(self.layers):
                x = torch.relu(x)
        return x.max(dim=2)[0]


def decoder():
    widths = [1 + LATENT + FEATURE, *WIDTHS, OUTPUTS]
    layers = []
    for a, b in zip(widths, widths[1:]):
        layers += [nn.Linear(a, b), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


point_net, decode = PointNet().eval(), decoder().eval()
cloud = torch.randn(1, 3, POINTS)
times = torch.linspace(1, 0, STEPS).reshape(-1, 1)


def released(motions):
    """One motion after the other, the object's feature each time."""
    for _ in range(motions):
        feature = point_net(cloud)
        code = torch.cat([torch.randn(1, LATENT), feature], dim=1)
        decode(torch.cat([times, code.expand(STEPS, -1)], dim=1))


def batched(motions, batch):
    """The object's feature once, many motions at once."""
    feature = point_net(cloud)
    for first in range(0, motions, batch):
        n = min(batch, motions - first)
        code = torch.cat([torch.randn(n, LATENT), feature.expand(n, -1)], dim=1)
        rows = code.unsqueeze(1).expand(n, STEPS, -1)
        decode(torch.cat([times.expand(n, STEPS, 1), rows], dim=2).reshape(n * STEPS, -1))


def factored(motions, batch):
    """The same with the first layer's parts of code and object once per motion."""
    feature = point_net(cloud)
    first_layer, rest = decode[0], decode[1:]
    by_time, by_code, by_feature = first_layer.weight.split([1, LATENT, FEATURE], dim=1)
    known = feature @ by_feature.T + first_layer.bias
    for first in range(0, motions, batch):
        n = min(batch, motions - first)
        motion = torch.randn(n, LATENT) @ by_code.T + known
        rest((motion.unsqueeze(1) + times @ by_time.T).reshape(n * STEPS, -1))


WAYS = {
    "released": released,
    "batched": lambda n: batched(n, 100),
    "batched by 25": lambda n: batched(n, 25),
    "factored": lambda n: factored(n, 100),
    "factored by 25": lambda n: factored(n, 25),
}

with torch.no_grad():
    for way in WAYS.values():
        way(2)
    say({"torch": torch.__version__})
    for line in sys.stdin:
        request = json.loads(line)
        start = time.process_time()
        WAYS[request["way"]](request["motions"])
        say({"seconds": time.process_time() - start})
