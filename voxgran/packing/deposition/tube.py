"""A sphere that touches the wall of an upright cylinder, and rolls down along it on another sphere.

Its center is on a smaller cylinder about the same axis, and at a constant distance from the other center. At the angle
u around the axis from the other center, the square of its height above that center is ``A + B cos(u)``: it moves away
from u = 0, until it is as low as the other one or opposite to it. It touches a third sphere where the circle about both
others crosses the cylinder, which is a root of a trigonometric polynomial of second degree.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.packing.deposition.field import CENTER, FIRST, KIND, MIDDLE, REACH, SECOND, SLIGHT, TUBE, WAY, Field

#: steps to a root, at most; steps are quadratic near it
STEPS = 200
#: roots of a polynomial of second degree, of which the first may be found at both ends
ROOTS = 5
#: relative values below this are zero, and the least angle between two roots
ZERO, APART = 4e-16, 1e-7
#: columns of the row FIRST: turn (1 or -1), angle of the other center, angle of the beginning; and of SECOND: radius of
#: the cylinder of centers, A and B
TURN, ORIGIN, BEGIN = 0, 1, 2
RADIUS, CONSTANT, FACTOR = 0, 1, 2


@bare_kernel
def touch_tube(field: Field, place: Floats, row: int) -> None:
    """Write a contact with the wall of the cylinder, which no sphere that falls straight down touches."""
    contact, middle = field.contacts[row], field.walls.middle
    dx, dy = place[0] - middle[0], place[1] - middle[1]
    far = math.hypot(dx, dy)
    contact[0], contact[1], contact[2] = -dx / far, -dy / far, 0.0
    contact[REACH], contact[KIND] = 0.0, TUBE


@bare_kernel
def next_root(c: float, a1: float, b1: float, a2: float, b2: float, begin: float, end: float) -> float:
    """Return the first angle after `begin` at which ``c + a1 cos + b1 sin + a2 cos 2 + b2 sin 2`` is zero.

    Infinite where there is none up to `end`. No step leads beyond a root, as the second derivative is bounded; roots
    that are nearer to each other than `APART` may be left out.
    """
    most = math.hypot(a1, b1) + 4.0 * math.hypot(a2, b2)
    slight, t, side = ZERO * (abs(c) + most), begin, 0.0
    for _ in range(STEPS):
        cos, sin = math.cos(t), math.sin(t)
        twice, both = cos * cos - sin * sin, 2.0 * cos * sin
        value = c + a1 * cos + b1 * sin + a2 * twice + b2 * both
        slope = b1 * cos - a1 * sin + 2.0 * (b2 * twice - a2 * both)
        if side == 0.0:
            if abs(value) > slight:
                side = 1.0 if value > 0.0 else -1.0
        elif side * value <= slight:
            return t
        if most == 0.0:
            return math.inf
        if side == 0.0:
            t += APART
        else:
            t += (side * slope + math.sqrt(slope * slope + 2.0 * most * side * value)) / most
        if t > end:
            return math.inf
    return t if side != 0.0 else math.inf


@bare_kernel
def tube_on_circle(field: Field, r: float, radius: float, end: float) -> float:
    """Return the first angle up to `end` at which a sphere on a circle touches the wall, infinite where it does not."""
    vectors, middle = field.vectors, field.walls.middle
    room = field.walls.radius - r
    mx, my = vectors[MIDDLE, 0] - middle[0], vectors[MIDDLE, 1] - middle[1]
    if math.hypot(mx, my) + radius < room:
        return math.inf
    fx, fy, sx, sy = vectors[FIRST, 0], vectors[FIRST, 1], vectors[SECOND, 0], vectors[SECOND, 1]
    c, a1, b1, a2, b2 = _around_axis(mx, my, fx, fy, sx, sy, radius)
    c -= room * room
    # what touches the wall already and moves outward has reached it
    beyond = c + a1 + a2
    if beyond > -SLIGHT * room and b1 + 2.0 * b2 > 0.0:
        return 0.0
    return next_root(c - max(beyond, 0.0), a1, b1, a2, b2, 0.0, end)


@bare_kernel
def square_on_circle(
    mm: float, mf: float, ms: float, ff: float, ss: float, fs: float, radius: float
) -> tuple[float, float, float, float, float]:
    """Return the coefficients of the square of ``m + radius (f cos + s sin)``, as of :func:`next_root`, from products
    of the three vectors.
    """
    square = radius * radius
    constant = mm + 0.5 * square * (ff + ss)
    return constant, 2.0 * radius * mf, 2.0 * radius * ms, 0.5 * square * (ff - ss), square * fs


@bare_kernel
def _around_axis(mx, my, fx, fy, sx, sy, radius):  # type: ignore[no-untyped-def]
    """Return the coefficients of the square of the distance from the axis of the cylinder."""
    mf, ms, fs = mx * fx + my * fy, mx * sx + my * sy, fx * sx + fy * sy
    return square_on_circle(mx * mx + my * my, mf, ms, fx * fx + fy * fy, sx * sx + sy * sy, fs, radius)


@bare_kernel
def lay_tube(field: Field, place: Floats, r: float) -> float:
    """Write how the sphere moves along the wall and on the other one of both contacts; return the angle of its end."""
    vectors, contacts, middle = field.vectors, field.contacts, field.walls.middle
    sphere = 0 if contacts[1, KIND] == TUBE else 1
    for axis in range(3):
        vectors[MIDDLE, axis] = contacts[sphere, CENTER + axis]
    reach, room = contacts[sphere, REACH], field.walls.radius - r
    dx, dy = vectors[MIDDLE, 0] - middle[0], vectors[MIDDLE, 1] - middle[1]
    px, py = place[0] - middle[0], place[1] - middle[1]
    turn = 1.0 if px * vectors[WAY, 1] - py * vectors[WAY, 0] >= 0.0 else -1.0
    far, origin = math.hypot(dx, dy), math.atan2(dy, dx)
    begin = turn * math.atan2(dx * py - dy * px, dx * px + dy * py)
    constant, factor = reach * reach - room * room - far * far, 2.0 * room * far
    vectors[FIRST, TURN], vectors[FIRST, ORIGIN], vectors[FIRST, BEGIN] = turn, origin, begin
    vectors[SECOND, RADIUS], vectors[SECOND, CONSTANT], vectors[SECOND, FACTOR] = room, constant, factor
    return math.acos(-constant / factor) if constant < factor else math.pi


@bare_kernel
def floor_in_tube(field: Field, r: float) -> float:
    """Return the angle at which the sphere touches the floor, infinite where it leaves the other one before."""
    vectors = field.vectors
    above = r - vectors[MIDDLE, 2]
    if above <= 0.0:
        return math.inf
    cosine = (above * above - vectors[SECOND, CONSTANT]) / vectors[SECOND, FACTOR]
    return math.acos(max(cosine, -1.0)) if -1.0 <= cosine <= 1.0 else math.inf


@bare_kernel
def put_in_tube(field: Field, place: Floats, angle: float, lowest: bool) -> None:
    """Write the place at an angle; `lowest`: as low as the other sphere."""
    vectors, middle = field.vectors, field.walls.middle
    at = vectors[FIRST, ORIGIN] + vectors[FIRST, TURN] * angle
    square = vectors[SECOND, CONSTANT] + vectors[SECOND, FACTOR] * math.cos(angle)
    place[0] = middle[0] + vectors[SECOND, RADIUS] * math.cos(at)
    place[1] = middle[1] + vectors[SECOND, RADIUS] * math.sin(at)
    place[2] = vectors[MIDDLE, 2] + (0.0 if lowest else math.sqrt(max(square, 0.0)))


@bare_kernel
def meet_in_tube(field: Field, x: float, y: float, z: float, reach: float) -> float:
    """Return the angle at which the sphere on its way along the wall touches a third one; infinite for never."""
    vectors, middle, contacts = field.vectors, field.walls.middle, field.contacts
    other = contacts[0 if contacts[1, KIND] == TUBE else 1, REACH]
    dx, dy, dz = x - vectors[MIDDLE, 0], y - vectors[MIDDLE, 1], z - vectors[MIDDLE, 2]
    square = dx * dx + dy * dy + dz * dz
    room = vectors[SECOND, RADIUS]
    beside = math.hypot(x - middle[0], y - middle[1])
    if square == 0.0 or square >= (other + reach) ** 2 or abs(beside - room) >= reach:
        return math.inf
    away = math.sqrt(square)
    along = 0.5 * (other * other - reach * reach + square) / away
    radius = math.sqrt(max(other * other - along * along, 0.0))
    ex, ey, ez = dx / away, dy / away, dz / away
    # the circle about both: its level axis and the one that leads up
    flat = math.hypot(ex, ey)
    fx, fy = (-ey / flat, ex / flat) if flat > 0.0 else (1.0, 0.0)
    sx, sy = (-ez * ex / flat, -ez * ey / flat) if flat > 0.0 else (0.0, 1.0)
    mx, my = vectors[MIDDLE, 0] + along * ex - middle[0], vectors[MIDDLE, 1] + along * ey - middle[1]
    c, a1, b1, a2, b2 = _around_axis(mx, my, fx, fy, sx, sy, radius)
    best, t = math.inf, 0.0
    for _ in range(ROOTS):
        t = next_root(c - room * room, a1, b1, a2, b2, t, 2.0 * math.pi)
        if t < math.inf:
            cos, sin = math.cos(t), math.sin(t)
            px, py = mx + radius * (fx * cos + sx * sin), my + radius * (fy * cos + sy * sin)
            height = along * ez + radius * flat * sin
            angle = _angle_of_meeting(vectors, px, py, height, x - middle[0], y - middle[1], dz)
            best = min(best, angle)
        else:
            break
    return best


@bare_kernel
def _angle_of_meeting(vectors, px, py, height, x, y, dz):  # type: ignore[no-untyped-def]
    """Return the angle of a place at which three are touched, infinite where the way does not lead to it from outside.

    px, py and x, y: that place and the third center from the axis.  height, dz: of both above the other center.
    """
    if height < -SLIGHT:
        return math.inf
    turn, begin = vectors[FIRST, TURN], vectors[FIRST, BEGIN]
    angle = turn * (math.atan2(py, px) - vectors[FIRST, ORIGIN])
    angle -= 2.0 * math.pi * math.floor(angle / (2.0 * math.pi))
    if angle > 2.0 * math.pi - SLIGHT:
        angle = 0.0
    if angle < begin - SLIGHT:
        return math.inf
    # the way times the height, and its part toward the third center
    wx, wy = -py * turn * height, px * turn * height
    wz = -0.5 * vectors[SECOND, FACTOR] * math.sin(angle)
    toward = (x - px) * wx + (y - py) * wy + (dz - height) * wz
    return max(angle, begin) if toward > SLIGHT * math.sqrt(wx * wx + wy * wy + wz * wz) else math.inf
