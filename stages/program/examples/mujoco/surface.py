"""Distance of points from a triangle mesh, negative inside."""

import numpy as np


def closest(point, a, b, c):
    """The nearest point of each triangle (C. Ericson, *Real-Time Collision Detection*, 2005, section 5.1.5)."""
    ab, ac, ap, bp, cp = b - a, c - a, point - a, point - b, point - c
    dot = lambda u, v: np.einsum("ij,ij->i", u, v)
    d1, d2, d3, d4, d5, d6 = dot(ab, ap), dot(ac, ap), dot(ab, bp), dot(ac, bp), dot(ab, cp), dot(ac, cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = a + ab * (vb / (va + vb + vc))[:, None] + ac * (vc / (va + vb + vc))[:, None]
        on_ab = a + ab * (d1 / (d1 - d3))[:, None]
        on_ac = a + ac * (d2 / (d2 - d6))[:, None]
        on_bc = b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))[:, None]
    found = inside
    for where, value in (
        ((va <= 0) & (d4 - d3 >= 0) & (d5 - d6 >= 0), on_bc),
        ((vb <= 0) & (d2 >= 0) & (d6 <= 0), on_ac),
        ((vc <= 0) & (d1 >= 0) & (d3 <= 0), on_ab),
        ((d6 >= 0) & (d5 <= d6), c), ((d3 >= 0) & (d4 <= d3), b), ((d1 <= 0) & (d2 <= 0), a),
    ):
        found = np.where(where[:, None], value, found)
    return found


class Surface:
    """The mesh of an object, in its own frame."""

    def __init__(self, vertices, triangles):
        self.a, self.b, self.c = (vertices[triangles[:, corner]] for corner in range(3))

    def distance(self, point):
        """Signed distance in meters; inside where the winding number is more than a half (A. Jacobson et al., 2013)."""
        nearest = np.linalg.norm(closest(point, self.a, self.b, self.c) - point, axis=1).min()
        a, b, c = self.a - point, self.b - point, self.c - point
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        dot = lambda u, v: np.einsum("ij,ij->i", u, v)
        solid = np.arctan2(dot(a, np.cross(b, c)), la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb)
        winding = solid.sum() / (2 * np.pi)
        return -nearest if winding > 0.5 else nearest
