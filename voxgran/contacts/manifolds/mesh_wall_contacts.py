"""Points of a grain near the walls of a closed mesh.

Corners and centers of spheres are compared with the triangles of the wall: besides the nearest one, with those that
bound the free space about a point by themselves, as the sides of a groove do. Edges of the wall that are reentrant,
seen from inside, may protrude into faces of a grain: along them the signed distance of the grain is searched for
minima.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.candidates import add_candidate, is_candidate
from voxgran.contacts.manifolds.smooth_distance import smooth_distance
from voxgran.contacts.manifolds.wall_bodies import ELLIPSOID, POINTS, SAGITTA, WallBodies
from voxgran.contacts.manifolds.wall_candidates import rings_of, set_frame, support_arm
from voxgran.containers.kernel_container import MeshWalls
from voxgran.geometry.tree import is_behind, search_triangles, square_to_box
from voxgran.geometry.triangles import closest_on_triangle

#: walls that are looked for about one point, and spheres without a wall that are remembered of a grain, at most
WALLS, FREE = 4, 16
#: cosine of the normals of two walls above which they count as one
ONE_WALL = 0.98
#: depth of points beyond a wall, in bounding radii, up to which they are looked for while the centroid is inside
DEEP = 0.5
#: golden-section steps to a minimum along an edge
GOLDEN_STEPS = 30
GOLDEN = 0.6180339887498949


@bare_kernel
def near_mesh(
    bodies: WallBodies, walls: MeshWalls, shape: int, scale: float, m: Floats, x: float, y: float, z: float,
    radius: float, reach: float, smooth: object,
) -> int:  # fmt: skip
    """Write the points of a grain at (x, y, z) within reach of a closed mesh; return how many there are.

    smooth: None where no shape is a smooth solid.
    """
    px, py, pz = x + walls.shift[0], y + walls.shift[1], z + walls.shift[2]
    square, triangle, feature, qx, qy, qz = search_triangles(
        walls.corners, walls.low, walls.high, walls.start, px, py, pz, np.inf, walls.stack
    )
    depth = math.sqrt(square)
    if is_behind(walls.normals, triangle, feature, px - qx, py - qy, pz - qz):
        if depth > radius + reach:
            return 0
    else:
        depth = -depth
    far = np.inf if depth < DEEP * radius else reach + DEEP * radius
    c, point, known, wide = 0, bodies.point, 0, reach
    if smooth is not None and bodies.kind[shape] != POINTS:
        # a wall may be nearer to the rim than to any of its points
        wide += SAGITTA * scale * bodies.size[shape, 0]
    for k in range(bodies.start[shape], bodies.start[shape + 1]):
        bx, by, bz, r = point[k, 0], point[k, 1], point[k, 2], scale * bodies.margin[k]
        arm = scale * math.sqrt(bx * bx + by * by + bz * bz)
        if depth - arm - r > wide:
            continue
        ax = scale * (m[0, 0] * bx + m[0, 1] * by + m[0, 2] * bz)
        ay = scale * (m[1, 0] * bx + m[1, 1] * by + m[1, 2] * bz)
        az = scale * (m[2, 0] * bx + m[2, 1] * by + m[2, 2] * bz)
        if _is_free(bodies.mesh.free, known, ax, ay, az, r + wide):
            continue
        # the wall that is nearest to the centroid is no farther than this
        most = (abs(depth) + arm) * (1.0 + 1e-9)
        c, room = _near_point(bodies, walls, c, px, py, pz, ax, ay, az, r, wide, far, most)
        known = _remember(bodies.mesh.free, known, ax, ay, az, room)
    if smooth is not None and bodies.kind[shape] != POINTS:
        c = _near_supports(bodies, walls, c, shape, scale, m, px, py, pz, reach, far)
    # where an edge of the wall is reentrant
    if len(bodies.mesh.edge) > 0:
        first = bodies.mesh.triangle
        if bodies.kind[shape] != POINTS or first[shape + 1] > first[shape]:
            c = _near_edges(bodies, c, shape, scale, m, x, y, z, radius, reach)
    return c


@bare_kernel
def _is_free(free, known, ax, ay, az, distance):  # type: ignore[no-untyped-def]
    """Return whether a sphere about an arm lies in one of the known spheres without a wall."""
    for k in range(known):
        dx, dy, dz, room = ax - free[k, 0], ay - free[k, 1], az - free[k, 2], free[k, 3] - distance
        if room > 0.0 and dx * dx + dy * dy + dz * dz < room * room:
            return True
    return False


@bare_kernel
def _remember(free, known, ax, ay, az, room):  # type: ignore[no-untyped-def]
    """Remember a sphere without a wall, in place of the smallest one where there are many; return how many there are.

    A search in the tree of a wall takes far longer than a look at these spheres, and most points of a fine mesh lie in
    one.
    """
    if room <= 0.0:
        return known
    place = known
    if known == FREE:
        place = 0
        for k in range(1, FREE):
            place = k if free[k, 3] < free[place, 3] else place
        if free[place, 3] >= room:
            return known
    free[place, 0], free[place, 1], free[place, 2], free[place, 3] = ax, ay, az, room
    return max(known, place + 1)


@bare_kernel
def _near_point(bodies, walls, c, x, y, z, ax, ay, az, r, reach, far, most):  # type: ignore[no-untyped-def]
    """Add the contacts of a sphere, or point, of radius r at an arm from (x, y, z) in the frame of the walls.

    Some wall is no farther than `most`. Also return the distance of the nearest one where the point is inside and out
    of reach, else 0.
    """
    px, py, pz = x + ax, y + ay, z + az
    square, t, feature, qx, qy, qz = search_triangles(
        walls.corners, walls.low, walls.high, walls.start, px, py, pz, most, walls.stack
    )
    if t < 0:
        return c, 0.0
    inside = is_behind(walls.normals, t, feature, px - qx, py - qy, pz - qz)
    if inside and math.sqrt(square) - r > reach:
        return c, math.sqrt(square)
    if square > (far + r) ** 2:
        return c, 0.0
    seen, known = bodies.mesh.seen, 0
    while t >= 0:
        distance = math.sqrt(square)
        gap = (distance if inside else -distance) - r
        if gap > reach:
            return c, 0.0
        sign = 1.0 if inside else -1.0
        nx, ny, nz = sign * (qx - px), sign * (qy - py), sign * (qz - pz)
        if distance < 1e-12 * (1.0 + abs(px) + abs(py) + abs(pz)):
            nx, ny, nz = walls.normals[t, feature, 0], walls.normals[t, feature, 1], walls.normals[t, feature, 2]
        length = max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
        nx, ny, nz = nx / length, ny / length, nz / length
        c = add_candidate(bodies.found, c, ax + r * nx, ay + r * ny, az + r * nz, nx, ny, nz, gap)
        if not inside or known == WALLS - 1:
            return c, 0.0
        row = seen[known]
        row[0], row[1], row[2], row[3], row[4], row[5] = qx, qy, qz, nx, ny, nz
        known += 1
        square, t, feature, qx, qy, qz = _next_wall(walls, px, py, pz, reach + r, seen, known)
    return c, 0.0


@bare_kernel
def _next_wall(walls, x, y, z, reach, seen, known):  # type: ignore[no-untyped-def]
    """Return squared distance, triangle, feature and point of the nearest wall that those known do not stand for.

    A point on a known wall's plane, or beyond it, is no obstacle before that wall is.
    """
    best, found, feature, fx, fy, fz = reach * reach, -1, 0, x, y, z
    stack, low, high = walls.stack, walls.low, walls.high
    stack[0], depth, leaves = 0, 1, len(low) // 2
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if square_to_box(low, high, node, x, y, z) > best:
            continue
        if node < leaves:
            stack[depth], stack[depth + 1] = 2 * node + 2, 2 * node + 1
            depth += 2
            continue
        for t in range(walls.start[node, 0], walls.start[node, 1]):
            qx, qy, qz, part = closest_on_triangle(walls.corners, t, x, y, z)
            square = (qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2
            if square >= best or not is_behind(walls.normals, t, part, x - qx, y - qy, z - qz):
                continue
            length, new = math.sqrt(square), True
            for k in range(known):
                old = seen[k]
                before = (old[0] - qx) * old[3] + (old[1] - qy) * old[4] + (old[2] - qz) * old[5]
                along = (qx - x) * old[3] + (qy - y) * old[4] + (qz - z) * old[5]
                if before < 1e-6 * reach or along > ONE_WALL * length:
                    new = False
            if new:
                best, found, feature, fx, fy, fz = square, t, part, qx, qy, qz
    return best, found, feature, fx, fy, fz


@bare_kernel
def _near_supports(bodies, walls, c, shape, scale, m, x, y, z, reach, far):  # type: ignore[no-untyped-def]
    """Add the support points of a smooth solid along the normals of its corners, and drop corners out of reach.

    Those of the polyhedron that stands for an ellipsoid are no points of it, and are all dropped.
    """
    kind, found, last = bodies.kind[shape], bodies.found, c
    set_frame(bodies, shape, m)
    for k in range(last):
        nx, ny, nz = found[k, 3], found[k, 4], found[k, 5]
        for ring in range(rings_of(kind)):
            ax, ay, az = support_arm(bodies, shape, scale, ring, nx, ny, nz)
            new = True
            for other in range(last, c):
                apart = abs(found[other, 0] - ax) + abs(found[other, 1] - ay) + abs(found[other, 2] - az)
                new = new and apart > 1e-6 * scale * bodies.size[shape, 0]
            if new:
                c = _near_point(bodies, walls, c, x, y, z, ax, ay, az, 0.0, reach, far, far)[0]
    kept = 0
    for k in range(c):
        if k >= last or (kind != ELLIPSOID and found[k, 6] <= reach):
            for column in range(7):
                found[kept, column] = found[k, column]
            kept += 1
    return kept


@bare_kernel
def _near_edges(bodies, c, shape, scale, m, x, y, z, radius, reach):  # type: ignore[no-untyped-def]
    """Add where reentrant edges of the wall are nearest to a grain, or deepest in it."""
    side, near = bodies.mesh, radius + reach
    stack, leaves = side.stack[0], len(side.edge_low) // 2
    stack[0], depth = 0, 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if square_to_box(side.edge_low, side.edge_high, node, x, y, z) > near * near:
            continue
        if node < leaves:
            stack[depth], stack[depth + 1] = 2 * node + 2, 2 * node + 1
            depth += 2
            continue
        for e in range(side.edge_start[node, 0], side.edge_start[node, 1]):
            ux, uy, uz = (
                side.edge[e, 1, 0] - side.edge[e, 0, 0],
                side.edge[e, 1, 1] - side.edge[e, 0, 1],
                side.edge[e, 1, 2] - side.edge[e, 0, 2],
            )
            dx, dy, dz = side.edge[e, 0, 0] - x, side.edge[e, 0, 1] - y, side.edge[e, 0, 2] - z
            length = math.sqrt(ux * ux + uy * uy + uz * uz)
            if length == 0.0:
                c = _add_edge_point(bodies, c, shape, scale, m, dx, dy, dz, reach)
                continue
            ux, uy, uz = ux / length, uy / length, uz / length
            # the part of the edge within the bounding sphere
            middle = -(dx * ux + dy * uy + dz * uz)
            square = near * near - (dx * dx + dy * dy + dz * dz - middle * middle)
            if square <= 0.0:
                continue
            half = math.sqrt(square)
            low, high = max(middle - half, 0.0), min(middle + half, length)
            if low < high:
                c = _along_edge(bodies, c, shape, scale, m, dx, dy, dz, ux, uy, uz, low, high, reach)
    return c


@bare_kernel
def _along_edge(bodies, c, shape, scale, m, dx, dy, dz, ux, uy, uz, low, high, reach):  # type: ignore[no-untyped-def]
    """Add the minima of the signed distance of a grain along the line d + s u, relative to its centroid."""
    step = bodies.spread[shape] * scale
    before, s, r = low, low, low
    value = _grain_distance(bodies, shape, scale, m, dx + s * ux, dy + s * uy, dz + s * uz)[0]
    last = math.inf
    while True:
        r = min(s + max(step, value - reach), high)
        after = _grain_distance(bodies, shape, scale, m, dx + r * ux, dy + r * uy, dz + r * uz)[0]
        end = r == s
        if value <= last and (value <= after or end) and value <= reach + step:
            # a minimum lies between the neighbours of this point
            a, b, best, deepest = before, r, s, value
            one, two, f, g, turn = b - GOLDEN * (b - a), a + GOLDEN * (b - a), math.inf, math.inf, 0
            for trip in range(GOLDEN_STEPS):
                t = one if turn == 0 else two
                d = _grain_distance(bodies, shape, scale, m, dx + t * ux, dy + t * uy, dz + t * uz)[0]
                if d < deepest:
                    best, deepest = t, d
                if turn == 0:
                    f = d
                else:
                    g = d
                if trip == 0:
                    turn = 1
                elif f <= g:
                    b, two, g, turn = two, one, f, 0
                    one = b - GOLDEN * (b - a)
                else:
                    a, one, f, turn = one, two, g, 1
                    two = a + GOLDEN * (b - a)
            c = _add_edge_point(bodies, c, shape, scale, m, dx + best * ux, dy + best * uy, dz + best * uz, reach)
        if value <= reach and (s == low or end or last > reach or after > reach):
            # where the edge comes into reach and leaves it: a face that lies on it is held at both ends
            c = _add_edge_point(bodies, c, shape, scale, m, dx + s * ux, dy + s * uy, dz + s * uz, reach)
        if end:
            return c
        before, s, last, value = s, r, value, after


@bare_kernel
def _add_edge_point(bodies, c, shape, scale, m, x, y, z, reach):  # type: ignore[no-untyped-def]
    """Add a point of the wall, relative to the centroid, that is near the surface of a grain or inside it."""
    gap, ax, ay, az, nx, ny, nz = _grain_distance(bodies, shape, scale, m, x, y, z)
    if gap > reach:
        return c
    if is_candidate(bodies.found, 0, c, ax, ay, az, nx, ny, nz, 1e-6 * bodies.spread[shape] * scale):
        return c
    return add_candidate(bodies.found, c, ax, ay, az, nx, ny, nz, gap)


@bare_kernel
def _grain_distance(bodies, shape, scale, m, x, y, z):  # type: ignore[no-untyped-def]
    """Return the distance of a point from a grain, negative inside, its nearest point, and the normal there.

    Points are relative to the centroid.
    """
    bx = (m[0, 0] * x + m[1, 0] * y + m[2, 0] * z) / scale
    by = (m[0, 1] * x + m[1, 1] * y + m[2, 1] * z) / scale
    bz = (m[0, 2] * x + m[1, 2] * y + m[2, 2] * z) / scale
    if bodies.kind[shape] == POINTS:
        distance, qx, qy, qz, vx, vy, vz = _mesh_distance(bodies.mesh, shape, bx, by, bz)
    else:
        t = bodies.turn[shape]
        ux, uy, uz = (
            t[0, 0] * bx + t[1, 0] * by + t[2, 0] * bz,
            t[0, 1] * bx + t[1, 1] * by + t[2, 1] * bz,
            t[0, 2] * bx + t[1, 2] * by + t[2, 2] * bz,
        )
        distance, ux, uy, uz, wx, wy, wz = smooth_distance(bodies.kind[shape], bodies.size[shape], ux, uy, uz)
        qx, qy, qz = (
            t[0, 0] * ux + t[0, 1] * uy + t[0, 2] * uz,
            t[1, 0] * ux + t[1, 1] * uy + t[1, 2] * uz,
            t[2, 0] * ux + t[2, 1] * uy + t[2, 2] * uz,
        )
        vx, vy, vz = (
            t[0, 0] * wx + t[0, 1] * wy + t[0, 2] * wz,
            t[1, 0] * wx + t[1, 1] * wy + t[1, 2] * wz,
            t[2, 0] * wx + t[2, 1] * wy + t[2, 2] * wz,
        )
    return (
        distance * scale,
        scale * (m[0, 0] * qx + m[0, 1] * qy + m[0, 2] * qz),
        scale * (m[1, 0] * qx + m[1, 1] * qy + m[1, 2] * qz),
        scale * (m[2, 0] * qx + m[2, 1] * qy + m[2, 2] * qz),
        m[0, 0] * vx + m[0, 1] * vy + m[0, 2] * vz,
        m[1, 0] * vx + m[1, 1] * vy + m[1, 2] * vz,
        m[2, 0] * vx + m[2, 1] * vy + m[2, 2] * vz,
    )


@bare_kernel
def _mesh_distance(side, shape, x, y, z):  # type: ignore[no-untyped-def]
    """Return the distance of a point from the surface of a shape, negative inside, its nearest point and normal."""
    t0, t1, k0, k1 = side.triangle[shape], side.triangle[shape + 1], side.node[shape], side.node[shape + 1]
    normals = side.normals[t0:t1]
    square, t, feature, qx, qy, qz = search_triangles(
        side.corners[t0:t1], side.low[k0:k1], side.high[k0:k1], side.start[k0:k1], x, y, z, np.inf, side.stack[1]
    )
    distance = math.sqrt(square)
    vx, vy, vz = x - qx, y - qy, z - qz
    sign = -1.0 if side.closed[shape] == 1 and is_behind(normals, t, feature, vx, vy, vz) else 1.0
    vx, vy, vz = sign * vx, sign * vy, sign * vz
    if distance < 1e-12 * (1.0 + abs(x) + abs(y) + abs(z)):
        vx, vy, vz = normals[t, feature, 0], normals[t, feature, 1], normals[t, feature, 2]
    length = max(math.sqrt(vx * vx + vy * vy + vz * vz), 1e-300)
    return sign * distance, qx, qy, qz, vx / length, vy / length, vz / length
