"""One training step of the CGF as its released code runs it, in PyTorch, step by step on request.

Usage: released_model.py HAND.urdf CLOUDS POINTS
Reads a line for each step and answers `wall seconds, CPU seconds, loss`; `peak` is answered with
the process's peak memory in kB. The first line is answered with `ready`.

What the released code does (jianglongye/cgf): point convolutions 3-64-128-1024 with batch
normalization, a maximum over the points, hand features of 20 frames, the encoder run once for each of
a motion's 25 frames with the same input, noise drawn per frame, a decoder 1281-256-512-256-25, errors
of outputs, translation, link origins and link rotations, a contact term without a gradient, Adam.
"""

import resource
import sys
import time
import xml.etree.ElementTree as ElementTree

import torch
from torch import nn

FRAMES, SEEN, LATENT, TIPS = 25, 20, 256, 4


def numbers(text, default):
    return [float(x) for x in (text or default).split()]


def rpy(roll, pitch, yaw):
    r, p, y = (torch.tensor(a) for a in (roll, pitch, yaw))
    one, zero = torch.tensor(1.0), torch.tensor(0.0)
    x = torch.stack([one, zero, zero, zero, r.cos(), -r.sin(), zero, r.sin(), r.cos()]).view(3, 3)
    yy = torch.stack([p.cos(), zero, p.sin(), zero, one, zero, -p.sin(), zero, p.cos()]).view(3, 3)
    z = torch.stack([y.cos(), -y.sin(), zero, y.sin(), y.cos(), zero, zero, zero, one]).view(3, 3)
    return z @ yy @ x


class Hand:
    """Forward kinematics of a URDF whose joints come after their parents."""

    def __init__(self, path):
        joints = []
        for joint in ElementTree.parse(path).getroot().findall("joint"):
            origin, axis = joint.find("origin"), joint.find("axis")
            get = lambda node, key: None if node is None else node.get(key)
            joints.append(
                dict(
                    parent=joint.find("parent").get("link"),
                    child=joint.find("child").get("link"),
                    moves=joint.get("type") != "fixed",
                    offset=torch.tensor(numbers(get(origin, "xyz"), "0 0 0")),
                    turn=rpy(*numbers(get(origin, "rpy"), "0 0 0")),
                    axis=torch.tensor(numbers(get(axis, "xyz"), "1 0 0")),
                )
            )
        children = {joint["child"] for joint in joints}
        known = [joint["parent"] for joint in joints if joint["parent"] not in children][:1]
        self.root, self.joints = known[0], []
        while len(self.joints) < len(joints):
            for joint in joints:
                if joint["parent"] in known and joint["child"] not in known:
                    known.append(joint["child"])
                    self.joints.append(joint)
        self.dof = sum(joint["moves"] for joint in self.joints)

    def links(self, translation, rotation, q):
        """Origins (rows, links, 3) and rotations (rows, links, 3, 3) of all links."""
        at = {self.root: (rotation, translation)}
        k = 0
        for joint in self.joints:
            r, t = at[joint["parent"]]
            t = t + r @ joint["offset"]
            r = r @ joint["turn"]
            if joint["moves"]:
                angle = q[:, k, None, None]
                k += 1
                x, y, z = joint["axis"]
                cross = torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]])
                r = r @ (torch.eye(3) + angle.sin() * cross + (1 - angle.cos()) * cross @ cross)
            at[joint["child"]] = (r, t)
        rotations, origins = zip(*at.values())
        return torch.stack(origins, 1), torch.stack(rotations, 1)


def rotation(six):
    """The matrix whose first two rows are made of six numbers (Zhou et al. 2019)."""
    x = nn.functional.normalize(six[:, :3], dim=-1)
    y = six[:, 3:] - (x * six[:, 3:]).sum(-1, keepdim=True) * x
    y = nn.functional.normalize(y, dim=-1)
    return torch.stack([x, y, torch.linalg.cross(x, y)], -2)


def layers(*widths, last=None):
    stack = []
    for a, b in zip(widths, widths[1:]):
        stack += [nn.Linear(a, b), nn.ReLU()]
    return nn.Sequential(*(stack[:-1] if last is None else stack))


class PointNet(nn.Module):
    def __init__(self):
        super().__init__()
        widths = [3, 64, 128, 1024]
        self.convolutions = nn.ModuleList(nn.Conv1d(a, b, 1) for a, b in zip(widths, widths[1:]))
        self.norms = nn.ModuleList(nn.BatchNorm1d(b) for b in widths[1:])

    def forward(self, x):
        x = self.norms[0](self.convolutions[0](x)).relu()
        x = self.norms[1](self.convolutions[1](x)).relu()
        return self.norms[2](self.convolutions[2](x)).max(2)[0]


class Cgf(nn.Module):
    def __init__(self, dof):
        super().__init__()
        self.points = PointNet()
        self.hand = layers(6 + dof, 256, 256, 64)
        self.trunk = layers(SEEN * 64 + 1024, 256, 256, last="relu")
        self.mean, self.log_variance = nn.Linear(256, LATENT), nn.Linear(256, LATENT)
        self.decoder = layers(1 + LATENT + 1024, 256, 512, 256, 9 + dof)

    def forward(self, clouds, hands, times):
        batch = len(clouds)
        feature = self.points(clouds)
        code = self.hand(hands).reshape(batch, -1)
        # Before the encoder, as the released code does.
        feature = feature.unsqueeze(1).repeat(1, FRAMES, 1).view(batch * FRAMES, -1)
        code = code.unsqueeze(1).repeat(1, FRAMES, 1).view(batch * FRAMES, -1)
        x = self.trunk(torch.cat([code, feature], 1))
        mean, log_variance = self.mean(x), self.log_variance(x)
        z = torch.randn(batch * FRAMES, LATENT) * (0.5 * log_variance).exp() + mean
        return self.decoder(torch.cat([times, z, feature], 1)), mean, log_variance


def main():
    path, clouds_n, points_n = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    torch.manual_seed(0)
    hand = Hand(path)
    model = Cgf(hand.dof)
    adam = torch.optim.Adam(model.parameters(), lr=5e-4)
    rows = clouds_n * FRAMES
    clouds = (torch.rand(clouds_n, 3, points_n) - 0.5) * 0.2
    side = torch.randint(0, 3, (clouds_n, 1, points_n))
    clouds.scatter_(1, side, clouds.gather(1, side).sign() * 0.05)
    hands = torch.randn(clouds_n, SEEN, 6 + hand.dof) * 0.3
    times = torch.rand(rows, 1)
    target = torch.randn(rows, 9 + hand.dof) * 0.3
    with torch.no_grad():
        wanted_origins, wanted_rotations = hand.links(
            target[:, :3], rotation(target[:, 3:9]), target[:, 9:]
        )
    mse = nn.functional.mse_loss

    def step():
        adam.zero_grad()
        out, mean, log_variance = model(clouds, hands, times)
        origins, rotations = hand.links(out[:, :3], rotation(out[:, 3:9]), out[:, 9:])
        kl = -0.5 * (1 + log_variance - mean.square() - log_variance.exp()).sum(1).mean()
        with torch.no_grad():
            tips = wanted_origins.view(clouds_n, FRAMES, -1, 3)[:, 4, -TIPS:]
            contact = torch.cdist(tips, clouds.transpose(1, 2)).min(2)[0].square().sum() / clouds_n
        loss = (
            mse(out, target)
            + 10 * mse(out[:, :3], target[:, :3])
            + 10 * mse(origins, wanted_origins)
            + 0.5 * mse(rotations[:, :, :2], wanted_rotations[:, :, :2])
            + 1e-3 * kl
            + 50 * contact
        )
        loss.backward()
        adam.step()
        return loss.item()

    sys.stdin.readline()
    print("ready", flush=True)
    for line in sys.stdin:
        if line.strip() == "peak":
            print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, flush=True)
            continue
        wall, cpu = time.perf_counter(), time.process_time()
        loss = step()
        print(time.perf_counter() - wall, time.process_time() - cpu, loss, flush=True)


if __name__ == "__main__":
    main()
