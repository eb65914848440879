"""Signed distance of points from smooth solids in their own axes.

The nearest point of an ellipsoid satisfies a secular equation with one root above minus the least squared semi-axis
(Hart 1994, Distance to an ellipsoid, doi:10.1016/B978-0-12-336156-1.50022-0). Cylinders and cones are profiles of
straight segments about their axis.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.wall_bodies import CONE, ELLIPSOID, SPHEROCYLINDER
from voxgran.geometry.vectors import Vector

#: halvings of the bracket of a root
HALVINGS = 70


@bare_kernel
def smooth_distance(
    kind: int, size: Floats, x: float, y: float, z: float,
) -> tuple[float, float, float, float, float, float, float]:  # fmt: skip
    """Return the distance of a point from a smooth solid, negative inside, its nearest point, and the normal there."""
    if kind == ELLIPSOID:
        qx, qy, qz = _on_ellipsoid(size[0], size[1], size[2], x, y, z)
        nx, ny, nz = qx / size[0] ** 2, qy / size[1] ** 2, qz / size[2] ** 2
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / length, ny / length, nz / length
        return (x - qx) * nx + (y - qy) * ny + (z - qz) * nz, qx, qy, qz, nx, ny, nz
    if kind == SPHEROCYLINDER:
        at = min(max(z, -0.5 * size[1]), 0.5 * size[1])
        away = math.sqrt(x * x + y * y + (z - at) ** 2)
        nx, ny, nz = (x / away, y / away, (z - at) / away) if away > 0.0 else (1.0, 0.0, 0.0)
        return away - size[0], size[0] * nx, size[0] * ny, at + size[0] * nz, nx, ny, nz
    flat = math.sqrt(x * x + y * y)
    distance, r, h, nr, nh = _on_profile(kind, size[0], size[1], flat, z)
    ux, uy = (x / flat, y / flat) if flat > 0.0 else (1.0, 0.0)
    return distance, r * ux, r * uy, h, nr * ux, nr * uy, nh


@bare_kernel
def _on_ellipsoid(a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return the point of an ellipsoid that is nearest to (x, y, z)."""
    u, v, t = foot_on_ellipsoid(a, b, c, (x, y, z), 1.0)
    return (a * u if x >= 0.0 else -a * u), (b * v if y >= 0.0 else -b * v), (c * t if z >= 0.0 else -c * t)


@bare_kernel
def foot_on_ellipsoid(a: float, b: float, c: float, place: Vector, sign: float) -> Vector:
    """Return the point of the unit sphere, without signs, that becomes the nearest point of an ellipsoid to a place
    (sign 1) or the point that is farthest from the opposite place (sign -1), by stretching with the semi-axes.

    With a multiplier k it is a x / (k + sign a^2) and so on.
    """
    la, lb, lc = a * abs(place[0]), b * abs(place[1]), c * abs(place[2])
    aa, bb, cc = sign * a * a, sign * b * b, sign * c * c
    least = min(aa, bb, cc)
    low, high = -least, -least + math.sqrt(la * la + lb * lb + lc * lc)
    for _ in range(HALVINGS):
        k = 0.5 * (low + high)
        if k <= low or k >= high:
            break
        # no division: k may be at a pole
        square = (
            (0.0 if la == 0.0 else (la / (k + aa)) ** 2)
            + (0.0 if lb == 0.0 else (lb / (k + bb)) ** 2)
            + (0.0 if lc == 0.0 else (lc / (k + cc)) ** 2)
        )
        if square <= 1.0:
            high = k
        else:
            low = k
    u = la / (high + aa) if la > 0.0 and high > -aa else 0.0
    v = lb / (high + bb) if lb > 0.0 and high > -bb else 0.0
    t = lc / (high + cc) if lc > 0.0 and high > -cc else 0.0
    # what is missing from unit length lies along the shortest axis, of the farthest point the longest
    if aa == least:
        u = math.sqrt(max(1.0 - v * v - t * t, 0.0))
    elif bb == least:
        v = math.sqrt(max(1.0 - u * u - t * t, 0.0))
    else:
        t = math.sqrt(max(1.0 - u * u - v * v, 0.0))
    return u, v, t


@bare_kernel
def _on_profile(kind, radius, height, r, h):  # type: ignore[no-untyped-def]
    """Return the distance from the profile of a cylinder or cone, negative inside, and its nearest point and normal."""
    low = -0.25 * height if kind == CONE else -0.5 * height
    top = 0.0 if kind == CONE else radius
    best, inside, fr, fh, fnr, fnh = math.inf, True, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        # base, mantle and upper face, from the first end to the second, with the solid to the left
        ar, ah = (0.0 if k == 0 else (radius if k == 1 else top)), (low if k < 2 else low + height)
        br, bh = (radius if k == 0 else (top if k == 1 else 0.0)), (low if k == 0 else low + height)
        ur, uh = br - ar, bh - ah
        square = ur * ur + uh * uh
        if square == 0.0:
            continue
        share = min(max(((r - ar) * ur + (h - ah) * uh) / square, 0.0), 1.0)
        qr, qh = ar + share * ur, ah + share * uh
        if ur * (h - ah) - uh * (r - ar) < 0.0:
            inside = False
        distance = math.sqrt((r - qr) ** 2 + (h - qh) ** 2)
        if distance < best:
            length = math.sqrt(square)
            best, fr, fh, fnr, fnh = distance, qr, qh, uh / length, -ur / length
    if inside:
        return -best, fr, fh, fnr, fnh
    if best > 1e-12 * (radius + height):
        fnr, fnh = (r - fr) / best, (h - fh) / best
    return best, fr, fh, fnr, fnh
