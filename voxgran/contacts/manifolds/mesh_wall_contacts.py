"""Points of a grain near the walls of a closed mesh.

Corners and centers of spheres are compared with the triangles of the wall: besides the nearest one, with those that
bound the free space about a point by themselves, as the sides of a groove do. Edges of the wall that are reentrant,
seen from inside, may protrude into faces of a grain: along them the signed distance of the grain is searched for
minima.
"""

import math

import numpy as np

from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.candidates import add_candidate, is_candidate
from voxgran.contacts.manifolds.rows import Grains
from voxgran.contacts.manifolds.smooth_distance import smooth_distance
from voxgran.contacts.manifolds.wall_bodies import ELLIPSOID, POINTS, SAGITTA, WallBodies
from voxgran.contacts.manifolds.wall_candidates import rings_of, set_frame, support_arm
from voxgran.containers.kernel_container import MeshWalls
from voxgran.geometry.tree import is_behind, search_triangles, square_to_box
from voxgran.geometry.triangles import closest_on_triangle
from voxgran.geometry.vectors import add, along, corner_of, dot, rotate, rotate_back, row_of, sub, times, vector_at

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
def near_mesh(bodies: WallBodies, walls: MeshWalls, grains: Grains, g: int, reach: float) -> int:
    """Write the points of a grain within reach of a closed mesh; return how many there are."""
    shape, scale, m, radius = grains.shape[g], grains.scale[g], grains.matrix[g], grains.radius[g]
    place = add(row_of(grains.position, g), vector_at(walls.shift, 0))
    x, y, z = place
    square, triangle, feature, qx, qy, qz = search_triangles(
        walls.corners, walls.low, walls.high, walls.start, x, y, z, np.inf, walls.stack
    )
    depth = math.sqrt(square)
    if is_behind(walls.normals, triangle, feature, x - qx, y - qy, z - qz):
        if depth > radius + reach:
            return 0
    else:
        depth = -depth
    far = np.inf if depth < DEEP * radius else reach + DEEP * radius
    c, free, known, wide = 0, bodies.mesh.free, 0, reach
    if bodies.kind[shape] != POINTS:
        # a wall may be nearer to the rim than to any of its points
        wide += SAGITTA * scale * bodies.size[shape, 0]
    for k in range(bodies.start[shape], bodies.start[shape + 1]):
        point, r = row_of(bodies.point, k), scale * bodies.margin[k]
        length = scale * math.sqrt(dot(point, point))
        if depth - length - r > wide:
            continue
        arm = times(rotate(m, point), scale)
        if _is_free(free, known, arm, r + wide):
            continue
        # the wall that is nearest to the centroid is no farther than this
        most = (abs(depth) + length) * (1.0 + 1e-9)
        c, room = _near_point(bodies, walls, c, place, arm, r, wide, far, most)
        known = _remember(free, known, arm, room)
    if bodies.kind[shape] != POINTS:
        c = _near_supports(bodies, walls, c, grains, g, place, reach, far)
    # where an edge of the wall is reentrant
    if len(bodies.mesh.edge) > 0:
        first = bodies.mesh.triangle
        if bodies.kind[shape] != POINTS or first[shape + 1] > first[shape]:
            c = _near_edges(bodies, c, grains, g, reach)
    return c


@bare_kernel
def _is_free(free, known, arm, distance):  # type: ignore[no-untyped-def]
    """Return whether a sphere about an arm lies in one of the known spheres without a wall."""
    for k in range(known):
        way, room = sub(arm, row_of(free, k)), free[k, 3] - distance
        if room > 0.0 and dot(way, way) < room * room:
            return True
    return False


@bare_kernel
def _remember(free, known, arm, room):  # type: ignore[no-untyped-def]
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
    free[place, 0], free[place, 1], free[place, 2] = arm
    free[place, 3] = room
    return max(known, place + 1)


@bare_kernel
def _near_point(bodies, walls, c, place, arm, r, reach, far, most):  # type: ignore[no-untyped-def]
    """Add the contacts of a sphere, or point, of radius r at an arm from a place in the frame of the walls.

    Some wall is no farther than `most`. Also return the distance of the nearest one where the point is inside and out
    of reach, else 0.
    """
    px, py, pz = add(place, arm)
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
        c = add_candidate(bodies.found, c, along(arm, r, (nx, ny, nz)), (nx, ny, nz), gap)
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
def _near_supports(bodies, walls, c, grains, g, place, reach, far):  # type: ignore[no-untyped-def]
    """Add the support points of a smooth solid along the normals of its corners, and drop corners out of reach.

    Those of the polyhedron that stands for an ellipsoid are no points of it, and are all dropped.
    """
    shape, scale, found, last = grains.shape[g], grains.scale[g], bodies.found, c
    kind = bodies.kind[shape]
    set_frame(bodies, shape, grains.matrix[g])
    for k in range(last):
        normal = vector_at(found[k], 3)
        for ring in range(rings_of(kind)):
            arm = support_arm(bodies, shape, scale, ring, normal)
            new = True
            for other in range(last, c):
                x, y, z = sub(row_of(found, other), arm)
                new = new and abs(x) + abs(y) + abs(z) > 1e-6 * scale * bodies.size[shape, 0]
            if new:
                c = _near_point(bodies, walls, c, place, arm, 0.0, reach, far, far)[0]
    kept = 0
    for k in range(c):
        if k >= last or (kind != ELLIPSOID and found[k, 6] <= reach):
            for column in range(7):
                found[kept, column] = found[k, column]
            kept += 1
    return kept


@bare_kernel
def _near_edges(bodies, c, grains, g, reach):  # type: ignore[no-untyped-def]
    """Add where reentrant edges of the wall are nearest to a grain, or deepest in it."""
    place, side, near = row_of(grains.position, g), bodies.mesh, grains.radius[g] + reach
    x, y, z = place
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
            ux, uy, uz = sub(corner_of(side.edge, e, 1), corner_of(side.edge, e, 0))
            start = sub(corner_of(side.edge, e, 0), place)
            length = math.sqrt(ux * ux + uy * uy + uz * uz)
            if length == 0.0:
                c = _add_edge_point(bodies, c, grains, g, start, reach)
                continue
            way = ux / length, uy / length, uz / length
            # the part of the edge within the bounding sphere
            middle = -dot(start, way)
            square = near * near - (dot(start, start) - middle * middle)
            if square <= 0.0:
                continue
            half = math.sqrt(square)
            low, high = max(middle - half, 0.0), min(middle + half, length)
            if low < high:
                c = _along_edge(bodies, c, grains, g, start, way, low, high, reach)
    return c


@bare_kernel
def _along_edge(bodies, c, grains, g, start, way, low, high, reach):  # type: ignore[no-untyped-def]
    """Add the minima of the signed distance of a grain along a line from `start`, relative to its centroid."""
    step = bodies.spread[grains.shape[g]] * grains.scale[g]
    before, s, r = low, low, low
    value = _grain_distance(bodies, grains, g, along(start, s, way))[0]
    last = math.inf
    while True:
        r = min(s + max(step, value - reach), high)
        after = _grain_distance(bodies, grains, g, along(start, r, way))[0]
        end = r == s
        if value <= last and (value <= after or end) and value <= reach + step:
            # a minimum lies between the neighbours of this point
            a, b, best, deepest = before, r, s, value
            one, two, left, right, turn = b - GOLDEN * (b - a), a + GOLDEN * (b - a), math.inf, math.inf, 0
            for trip in range(GOLDEN_STEPS):
                t = one if turn == 0 else two
                d = _grain_distance(bodies, grains, g, along(start, t, way))[0]
                if d < deepest:
                    best, deepest = t, d
                if turn == 0:
                    left = d
                else:
                    right = d
                if trip == 0:
                    turn = 1
                elif left <= right:
                    b, two, right, turn = two, one, left, 0
                    one = b - GOLDEN * (b - a)
                else:
                    a, one, left, turn = one, two, right, 1
                    two = a + GOLDEN * (b - a)
            c = _add_edge_point(bodies, c, grains, g, along(start, best, way), reach)
        if value <= reach and (s == low or end or last > reach or after > reach):
            # where the edge comes into reach and leaves it: a face that lies on it is held at both ends
            c = _add_edge_point(bodies, c, grains, g, along(start, s, way), reach)
        if end:
            return c
        before, s, last, value = s, r, value, after


@bare_kernel
def _add_edge_point(bodies, c, grains, g, point, reach):  # type: ignore[no-untyped-def]
    """Add a point of the wall, relative to the centroid, that is near the surface of a grain or inside it."""
    gap, arm, normal = _grain_distance(bodies, grains, g, point)
    near = 1e-6 * bodies.spread[grains.shape[g]] * grains.scale[g]
    if gap > reach or is_candidate(bodies.found, c, arm, normal, near):
        return c
    return add_candidate(bodies.found, c, arm, normal, gap)


@bare_kernel
def _grain_distance(bodies, grains, g, point):  # type: ignore[no-untyped-def]
    """Return the distance of a point from a grain, negative inside, its nearest point, and the normal there.

    Points are relative to the centroid.
    """
    shape, scale, m = grains.shape[g], grains.scale[g], grains.matrix[g]
    x, y, z = rotate_back(m, point)
    x, y, z = x / scale, y / scale, z / scale
    if bodies.kind[shape] == POINTS:
        distance, near, normal = _mesh_distance(bodies.mesh, shape, x, y, z)
    else:
        turn = bodies.turn[shape]
        x, y, z = rotate_back(turn, (x, y, z))
        distance, qx, qy, qz, nx, ny, nz = smooth_distance(bodies.kind[shape], bodies.size[shape], x, y, z)
        near, normal = rotate(turn, (qx, qy, qz)), rotate(turn, (nx, ny, nz))
    return distance * scale, times(rotate(m, near), scale), rotate(m, normal)


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
    return sign * distance, (qx, qy, qz), (vx / length, vy / length, vz / length)
