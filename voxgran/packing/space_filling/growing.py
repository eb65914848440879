"""Spheres that grow at constant rates until they touch, event by event.

Two growing spheres touch at a time in closed form, and so do a growing and a resting one; what is growing stops at its
first contact. Each growing sphere is listed in the cells that its reach touches, which it will fill until the reach is
doubled: spheres that touch before both have filled their reaches share a cell. A heap holds for each growing sphere a
time before which it touches nothing: that of the earliest contact among the spheres of its cells, or the one at which
its reach is filled. A partner that has stopped meanwhile makes a contact later, never earlier, so that the entry is
made anew when its turn comes; what arrives or reaches farther may make it earlier, and does so at once.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers, Words
from voxgran._base.kernels import bare_kernel, kernel
from voxgran._base.seeds import philox_block, unit_float
from voxgran.containers.kernel_container import KernelContainer, clearance
from voxgran.packing.space_filling.reach_cells import ReachCells, cell_of, distance, gap_to, list_sphere, near

#: what is counted: nuclei that were accepted, arrivals, those in a row that were lost, spheres in the heap
NUCLEI, ARRIVED, LOST, GROWING = 0, 1, 2, 3
#: arrivals in a row that are lost, after which the container is full
PATIENCE = 5_000
#: partners that are no sphere: a wall or an own image, and the end of the reach
WALL, REACH = -1, -2
#: how a part of a run ends: events made or all at rest, solid fraction reached, no room for entries
MADE, REACHED, NO_ROOM = 0, 1, 2


class Spheres(NamedTuple):
    """Spheres that grow.

    spheres: (n, 4) centers, and radii of those that stopped.  born, rate: (n,) time of birth, and growth of the radius
    per time; a rate of 0 stands for a sphere that stopped.  room: (n,) largest radius that the walls allow.  reach:
    (n,) radius up to which a sphere is listed.  volume: (n,) of a grain in its bounding sphere of radius 1.  powers:
    (5,) volume of those that stopped, and of the growing ones as a polynomial of the time.  tally: (4,).  clock: (1,)
    time of the last event.
    """

    spheres: Floats
    born: Floats
    rate: Floats
    room: Floats
    reach: Floats
    volume: Floats
    powers: Floats
    tally: Integers
    clock: Floats


class Heap(NamedTuple):
    """Growing spheres by their next events, the earliest first.

    sphere: (n,) by place in the heap.  place: (n,) of each sphere, -1 if it does not grow.  time, partner: (n,) next
    event of each sphere.
    """

    sphere: Integers
    place: Integers
    time: Floats
    partner: Integers


class Arrivals(NamedTuple):
    """Nuclei that arrive at random points.

    every: time between two of them.  slowest: of the rates, of which the largest is 1.  speed: growth of the radius per
    time at rate 1.  first_reach: of a nucleus.  key: of the random numbers.
    """

    every: float
    slowest: float
    speed: float
    first_reach: float
    key: Words


@kernel
def run_events(
    walls: KernelContainer,
    cells: ReachCells,
    growth: Spheres,
    heap: Heap,
    arrivals: Arrivals,
    asked: float,
    done: int,
    last: int,
) -> tuple[int, int]:
    """Let events happen up to number `last`; return the number after the last one, and how this part ends.

    Contacts and arrivals are events. The volume `asked` ends the growth, and so does rest after all spheres have
    arrived.
    """
    tally = growth.tally
    while done < last:
        coming = math.inf
        if tally[NUCLEI] < len(growth.rate) and tally[LOST] < PATIENCE:
            coming = _arrival(arrivals, tally[ARRIVED])
        time = heap.time[heap.sphere[0]] if tally[GROWING] > 0 else math.inf
        now = min(coming, time)
        if now == math.inf:
            return done, MADE
        if _volume_at(growth, walls.dimension, now) >= asked:
            return done, REACHED
        if coming <= time:
            if not _arrive(walls, cells, growth, heap, arrivals, coming):
                return done, NO_ROOM
            done += 1
        else:
            outcome = _meet(cells, growth, heap, walls.dimension)
            if outcome < 0:
                return done, NO_ROOM
            done += outcome
        growth.clock[0] = now
    return done, MADE


@bare_kernel
def _arrival(arrivals, number):  # type: ignore[no-untyped-def]
    """Return when a nucleus arrives: once in each interval, at a random time of it."""
    if arrivals.every == 0.0:
        return 0.0
    word = philox_block(arrivals.key[0], arrivals.key[1], np.uint64(number), np.uint64(0))[3]
    return (number + unit_float(word)) * arrivals.every


@bare_kernel
def _arrive(walls, cells, growth, heap, arrivals, now):  # type: ignore[no-untyped-def]
    """Let a nucleus arrive, which is lost where the point is taken; return whether there was room for it."""
    tally, n = growth.tally, growth.tally[NUCLEI]
    words = philox_block(arrivals.key[0], arrivals.key[1], np.uint64(tally[ARRIVED]), np.uint64(0))
    word = philox_block(arrivals.key[0], arrivals.key[1], np.uint64(tally[ARRIVED]), np.uint64(1))[0]
    x, y = unit_float(words[0]) * walls.lengths[0], unit_float(words[1]) * walls.lengths[1]
    z = unit_float(words[2]) * walls.lengths[2] if walls.dimension == 3 else 0.0
    room = clearance(walls, x, y, z)
    if room <= 0.0 or _is_taken(cells, growth, x, y, z, now):
        tally[ARRIVED] += 1
        tally[LOST] += 1
        return True
    reach = min(arrivals.first_reach, room)
    if not list_sphere(cells, n, x, y, z, reach, -1.0):
        return False
    growth.spheres[n, 0], growth.spheres[n, 1], growth.spheres[n, 2], growth.spheres[n, 3] = x, y, z, 0.0
    growth.born[n], growth.room[n], growth.reach[n] = now, room, reach
    growth.rate[n] = arrivals.speed * (arrivals.slowest + (1.0 - arrivals.slowest) * unit_float(word))
    _count_volume(growth, n, walls.dimension, 1.0)
    tally[NUCLEI] += 1
    tally[ARRIVED] += 1
    tally[LOST] = 0
    look_ahead(cells, growth, heap, n)
    return True


@bare_kernel
def _is_taken(cells, growth, x, y, z, now):  # type: ignore[no-untyped-def]
    """Return whether a sphere holds a point."""
    i, j, k = near(cells, 0, x, 0.0)[0], near(cells, 1, y, 0.0)[0], near(cells, 2, z, 0.0)[0]
    entry = cells.head[cell_of(cells, i, j, k)]
    while entry >= 0:
        sphere = cells.item[entry]
        if distance(cells, growth.spheres, sphere, x, y, z) <= radius_at(growth, sphere, now):
            return True
        entry = cells.after[entry]
    return False


@bare_kernel
def radius_at(growth: Spheres, sphere: int, now: float) -> float:
    """Return the radius of a sphere at a time."""
    if growth.rate[sphere] == 0.0:
        return growth.spheres[sphere, 3]
    return growth.rate[sphere] * (now - growth.born[sphere])


@bare_kernel
def _meet(cells, growth, heap, dimension):  # type: ignore[no-untyped-def]
    """Let the first event happen; return 1 for a contact, 0 for another one, -1 if room is lacking."""
    a = heap.sphere[0]
    now, b = heap.time[a], heap.partner[a]
    if b == WALL:
        _stop(growth, heap, a, growth.room[a], dimension)
        return 1
    if b >= 0 and now == _contact_time(cells, growth, a, b):
        x, y, z = growth.spheres[a, 0], growth.spheres[a, 1], growth.spheres[a, 2]
        apart = distance(cells, growth.spheres, b, x, y, z)
        # radii that have the distance as their sum, whatever the rounding of times
        if growth.rate[b] > 0.0:
            _stop(growth, heap, b, min(radius_at(growth, b, now), apart), dimension)
        _stop(growth, heap, a, apart - growth.spheres[b, 3], dimension)
        return 1
    if b == REACH:
        reach = min(2.0 * growth.reach[a], growth.room[a])
        x, y, z = growth.spheres[a, 0], growth.spheres[a, 1], growth.spheres[a, 2]
        if not list_sphere(cells, a, x, y, z, reach, growth.reach[a]):
            return -1
        growth.reach[a] = reach
    look_ahead(cells, growth, heap, a)
    return 0


@bare_kernel
def _stop(growth, heap, sphere, radius, dimension):  # type: ignore[no-untyped-def]
    """Let a sphere keep its radius."""
    _count_volume(growth, sphere, dimension, -1.0)
    growth.spheres[sphere, 3], growth.rate[sphere] = radius, 0.0
    growth.powers[4] += growth.volume[sphere] * radius**dimension
    _remove(growth, heap, sphere)


@bare_kernel
def _contact_time(cells, growth, a, b):  # type: ignore[no-untyped-def]
    """Return when the growing sphere a touches the sphere b, the same value for both orders of two growing ones."""
    apart = distance(cells, growth.spheres, b, growth.spheres[a, 0], growth.spheres[a, 1], growth.spheres[a, 2])
    if growth.rate[b] == 0.0:
        return growth.born[a] + (apart - growth.spheres[b, 3]) / growth.rate[a]
    rates = growth.rate[a] + growth.rate[b]
    return (apart + (growth.rate[a] * growth.born[a] + growth.rate[b] * growth.born[b])) / rates


@bare_kernel
def look_ahead(cells: ReachCells, growth: Spheres, heap: Heap, a: int) -> None:
    """Enter the earliest contact of a growing sphere into the heap, or the time at which its reach is filled.

    Partners for which this contact is earlier than their own events get it as well.
    """
    x, y, z, reach = growth.spheres[a, 0], growth.spheres[a, 1], growth.spheres[a, 2], growth.reach[a]
    end, partner = growth.born[a] + reach / growth.rate[a], WALL if reach >= growth.room[a] else REACH
    low_x, high_x = near(cells, 0, x, reach)
    low_y, high_y = near(cells, 1, y, reach)
    low_z, high_z = near(cells, 2, z, reach)
    for i in range(low_x, high_x + 1):
        gap_x = gap_to(cells, 0, i, x)
        for j in range(low_y, high_y + 1):
            gap_y = gap_to(cells, 1, j, y)
            for k in range(low_z, high_z + 1):
                gap_z = gap_to(cells, 2, k, z)
                if gap_x * gap_x + gap_y * gap_y + gap_z * gap_z > reach * reach:
                    continue
                entry = cells.head[cell_of(cells, i, j, k)]
                while entry >= 0:
                    b = cells.item[entry]
                    entry = cells.after[entry]
                    if b == a:
                        continue
                    time = _contact_time(cells, growth, a, b)
                    if time < end:
                        end, partner = time, b
                    if heap.place[b] >= 0 and time < heap.time[b]:
                        heap.time[b], heap.partner[b] = time, a
                        _rise(heap, heap.place[b])
    heap.time[a], heap.partner[a] = end, partner
    if heap.place[a] < 0:
        heap.place[a], heap.sphere[growth.tally[GROWING]] = growth.tally[GROWING], a
        growth.tally[GROWING] += 1
    _sink(growth, heap, _rise(heap, heap.place[a]))


@bare_kernel
def _remove(growth, heap, sphere):  # type: ignore[no-untyped-def]
    """Remove a sphere from the heap."""
    growth.tally[GROWING] -= 1
    at, last = heap.place[sphere], heap.sphere[growth.tally[GROWING]]
    heap.place[sphere] = -1
    if last != sphere:
        heap.sphere[at], heap.place[last] = last, at
        _sink(growth, heap, _rise(heap, at))


@bare_kernel
def _rise(heap, at):  # type: ignore[no-untyped-def]
    """Move the sphere at a place of the heap up to where it belongs, and return this place."""
    sphere = heap.sphere[at]
    time = heap.time[sphere]
    while at > 0:
        above = heap.sphere[(at - 1) // 2]
        if heap.time[above] <= time:
            break
        heap.sphere[at], heap.place[above] = above, at
        at = (at - 1) // 2
    heap.sphere[at], heap.place[sphere] = sphere, at
    return at


@bare_kernel
def _sink(growth, heap, at):  # type: ignore[no-untyped-def]
    """Move the sphere at a place of the heap down to where it belongs."""
    count, sphere = growth.tally[GROWING], heap.sphere[at]
    time = heap.time[sphere]
    while 2 * at + 1 < count:
        below = 2 * at + 1
        if below + 1 < count and heap.time[heap.sphere[below + 1]] < heap.time[heap.sphere[below]]:
            below += 1
        if heap.time[heap.sphere[below]] >= time:
            break
        heap.sphere[at] = heap.sphere[below]
        heap.place[heap.sphere[at]] = at
        at = below
    heap.sphere[at], heap.place[sphere] = sphere, at


@kernel
def enter_all(cells: ReachCells, growth: Spheres, heap: Heap) -> None:
    """Enter all growing spheres into the heap."""
    for sphere in range(growth.tally[NUCLEI]):
        if growth.rate[sphere] > 0.0:
            look_ahead(cells, growth, heap, sphere)


@bare_kernel
def _count_volume(growth, sphere, dimension, sign):  # type: ignore[no-untyped-def]
    """Add the volume of a growing sphere to the polynomial of the time, or subtract it."""
    born, lead = growth.born[sphere], sign * growth.volume[sphere] * growth.rate[sphere] ** dimension
    if dimension == 3:
        growth.powers[0] -= lead * born**3
        growth.powers[1] += 3.0 * lead * born**2
        growth.powers[2] -= 3.0 * lead * born
        growth.powers[3] += lead
    else:
        growth.powers[0] += lead * born**2
        growth.powers[1] -= 2.0 * lead * born
        growth.powers[2] += lead


@bare_kernel
def _volume_at(growth, dimension, now):  # type: ignore[no-untyped-def]
    """Return the volume of all spheres at a time, of those of a start none."""
    powers = growth.powers
    return powers[4] + powers[0] + now * (powers[1] + now * (powers[2] + now * powers[3]))
