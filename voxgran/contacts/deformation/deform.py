"""Grains that give way: a packing whose grains overlap a little becomes one of deformed bodies that do not.

Each grain resists with a pressure that grows with the depth below its surface. Two grains that overlap meet where both
pressures are equal, which shares the depth by their stiffnesses; the force is the integral of the pressure over that
common surface. What volume the dents take is given back as bulges around the contacts. There is no memory: a
grain without contact has its own shape, to the last bit.

References
----------
Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element Analysis of
Discontinuous Materials: deformable bodies are its outlook
Elandt, Drumwright, Sherman & Ruina 2019, A pressure field model for fast, robust approximation of net contact force and
moment between nominally rigid objects, doi:10.1109/IROS40897.2019.8968548: equal pressures as the contact surface
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, as_length, check_type, float_array
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, shown
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.broad import Pairs, grain_pairs
from voxgran.contacts.deformation.indentation import FARTHEST, SoftBody, give_way
from voxgran.contacts.deformation.refined_surface import Partner, SoftGrain, fine_surface
from voxgran.contacts.find import overlaps, pair_keys
from voxgran.contacts.inside import inner_distance, placed
from voxgran.contacts.model import Contacts
from voxgran.geometry.triangles import enclosed_volume, normals_of
from voxgran.shapes.finer import onto_surface
from voxgran.shapes.primitive import Primitive

#: radius, in diameters, from which on a contact is found on both of its grains
FOUND = 1e-6
#: depth, in diameters of the smaller grain, from which on two grains without a rim of contact coincide
COINCIDING = 0.1


@dataclass(frozen=True, eq=False, kw_only=True)
class Deformed(ExplainedAttributes):
    """Grains that have given way, as closed surfaces.

    Attributes
    ----------
    vertices : tuple of (v, 3) ndarray of float
        Of each grain, where it lies, in the unit of lengths.
    faces : tuple of (f, 3) ndarray of int
        Triangles of each grain, counterclockwise seen from outside.
    volume_before, volume_after : (n,) ndarray of float
        Volumes of the same triangles before and after they gave way.
    steepness : (n,) ndarray of float
        Bulges take this part of the distance to other grains and walls, at most 0.45; 0 where there are none.
    reach : (n,) ndarray of float
        How far bulges reach from the contacts, in radii of the contacts; 0 where there are none.
    i, j : (m,) ndarray of int
        Grains of each contact, i <= j.
    image : (m, 3) ndarray of int
        The partner is grain j shifted by `image` times the lengths of the container.
    depth : (m,) ndarray of float
        How deep the grains overlapped, in the unit of lengths.
    area : (m,) ndarray of float
        Of the common surface; 0 where the overlap was too shallow to be found.
    force : (m,) ndarray of float
        Resultant of the pressure on the common surface, in stiffness times cubed length.
    normal : (m, 3) ndarray of float
        Unit vector in which it pushes grain j.
    """

    vertices: tuple[Floats, ...]
    faces: tuple[Integers, ...]
    volume_before: Floats
    volume_after: Floats
    steepness: Floats
    reach: Floats
    i: Integers
    j: Integers
    image: Integers
    depth: Floats
    area: Floats
    force: Floats
    normal: Floats

    @property
    def count(self) -> int:
        """Number of grains."""
        return len(self.vertices)

    @property
    def volume_error(self) -> float:
        """Largest change of the volume of a grain, as a part of it."""
        return float(np.abs(self.volume_after / self.volume_before - 1).max(initial=0.0))


@explained(hint="deform(packing, stiffness=1.0)")
def deform(packing: Assembly, *, stiffness: "ArrayLike" = 1.0, spacing: float = 0.1, reach: float = 1.0) -> Deformed:
    """Let the grains of a packing give way where they overlap.

    Parameters
    ----------
    packing : Packing or Assembly
        Grains that may overlap a little, such as ``control_point`` leaves with its parameter `overlap`.
    stiffness : float or (n,) array_like of float
        Pressure per depth below the surface, of all grains or of each; infinite for rigid ones.
    spacing : float
        Longest edges of triangles at a contact, in radii of the disk that has the area of the contact.
    reach : float
        How far bulges reach from a contact, in the same radii; doubled where there is too little room.

    Returns
    -------
    Deformed
        A surface for each grain, its volume before and after, and area and force of each contact.

    Raises
    ------
    InputError
        If the packing is flat or a shape an open surface, the stiffness of a grain or another number is not above 0,
        two rigid grains overlap, or grains overlap so deep that they have no common surface or no room to bulge.
    TooLargeError
        If a grain needs more than two million vertices.

    Notes
    -----
    A vertex within another grain moves along the normal of the contact to where the depths in both, by exact
    signed distances, are in the inverse ratio of the stiffnesses. Common surfaces of two grains agree up to the square
    of the spacing, and exactly where they are flat. Bulges do not meet. Depths below the surface of clumps are those in
    their single spheres; overlaps in several places are found where they are wider than 1/64 of a diameter.

    References
    ----------
    Elandt et al. 2019, doi:10.1109/IROS40897.2019.8968548

    Examples
    --------
    >>> import voxgran as vg
    >>> sphere = vg.make_shape("sphere")
    >>> pair = vg.Packing.of([sphere], vg.Box((4, 2, 2)), position=[(1, 1, 1), (1.96, 1, 1)])
    >>> soft = vg.deform(pair)
    >>> print(f"{soft.area[0]:.4f} {soft.volume_error < 1e-9}")
    0.0616 True
    """
    check_type(packing, Assembly, "packing", "a Packing; load or pack one")
    if packing.dimension != 3:
        raise InputError("the packing is flat: only grains in three dimensions give way; use solids in a box")
    for shape in packing.shapes:
        shape.refuse_open("grains that give way")
    softness = _softness(stiffness, packing.count)
    fine, far = as_length(spacing, "spacing"), as_length(reach, "reach")
    contacts = overlaps(packing)
    rigid = (softness[contacts.i] == 0) & (softness[contacts.j] == 0)
    if rigid.any():
        k = int(rigid.argmax())
        raise InputError(
            f"grains {contacts.i[k]} and {contacts.j[k]} overlap and are both rigid: one of them has to give way; make "
            "its stiffness finite"
        )
    partners = _partners(packing, contacts, softness)
    bodies = {}
    for grain in np.union1d(contacts.i, contacts.j).tolist():
        soft = _soft_grain(packing, grain, partners[grain])
        bodies[grain] = (soft, give_way(soft, fine_surface(soft, fine), fine, far))
    _refuse_swallowed(packing, contacts, bodies)
    return _deformed(packing, contacts, softness, bodies)


def _softness(stiffness: "ArrayLike", count: int) -> Floats:
    """Return the inverse of each stiffness; 0 where it is infinite."""
    values = float_array(stiffness)
    if values is None or values.shape not in ((), (count,)):
        raise InputError(f"stiffness is {shown(stiffness)}: give one number, or one for each of the {count} grains")
    given = np.broadcast_to(values, (count,))
    with np.errstate(divide="ignore", over="ignore"):
        softness = np.asarray(1 / given)
    bad = np.flatnonzero(~((given > 0) & np.isfinite(softness)))
    if len(bad):
        raise InputError(f"stiffness is {given[bad[0]]} for grain {bad[0]}: it must be above 0; make it so")
    return softness


def _partners(packing: Assembly, contacts: Contacts, softness: Floats) -> list[list[Partner]]:
    """Return for each grain those that are near enough for its bulges, as it sees them."""
    inner = [inner_distance(shape.geometry) for shape in packing.shapes]
    convex = [isinstance(shape.geometry, Primitive) for shape in packing.shapes]
    pairs = grain_pairs(packing, FARTHEST * float(packing.diameters.max(initial=0.0)))
    keys = pair_keys(Pairs(contacts.i, contacts.j, contacts.image, contacts.normal))
    number = {key: k for k, key in enumerate(keys)}
    found: list[list[Partner]] = [[] for _ in range(packing.count)]
    for row, key in enumerate(pair_keys(pairs)):
        contact = number.get(key, -1)
        point = contacts.point[contact] - packing.position[key[0]] if contact >= 0 else np.zeros(3)
        for one, other, side in ((key[0], key[1], 1), (key[1], key[0], -1)):
            way = side * pairs.offset[row]
            both = softness[one] + softness[other]
            shape = int(packing.shape_id[other])
            found[one].append(
                Partner(
                    contact,
                    side,
                    placed(inner[shape], matrix=packing.matrices[other] * packing.scale[other], offset=way),
                    way,
                    float(packing.bounding_radii[other]),
                    float(softness[one] / both) if both > 0 else 0.0,
                    point if side > 0 else point + way,
                    convex[packing.shape_id[one]] and convex[shape],
                )
            )
    return found


def _soft_grain(packing: Assembly, grain: int, partners: list[Partner]) -> SoftGrain:
    """Return one grain with what is around it."""
    shape = packing.shapes[packing.shape_id[grain]]
    matrix = packing.matrices[grain] * packing.scale[grain]
    back = matrix / packing.scale[grain] ** 2
    place = packing.position[grain]
    return SoftGrain(
        grain,
        linear.matmul(shape.vertices, matrix.T),
        shape.faces,
        placed(inner_distance(shape.geometry), matrix=matrix, offset=np.zeros(3)),
        lambda points: linear.matmul(onto_surface(shape.geometry, linear.matmul(points, back)), matrix.T),
        float(packing.diameters[grain]),
        tuple(partner for partner in partners if partner.contact >= 0),
        tuple(partners),
        lambda points: -packing.container.signed_distance(points + place),
    )


def _refuse_swallowed(packing: Assembly, contacts: Contacts, bodies: dict[int, tuple[SoftGrain, SoftBody]]) -> None:
    """Refuse contacts in which the surface of one grain only lies in the other, but for those too small to be found."""
    entered = np.zeros((contacts.count, 2))
    for soft, body in bodies.values():
        for partner, patch in zip(soft.touching, body.patches, strict=True):
            entered[patch.contact, (1 - partner.side) // 2] = patch.radius
    smaller = np.minimum(packing.diameters[contacts.i], packing.diameters[contacts.j])
    bad = (entered.min(axis=1) == 0) & (entered.max(axis=1) > FOUND * smaller)
    # grains that nearly coincide have no rim at all
    bad |= (entered.max(axis=1) == 0) & (-contacts.gap > COINCIDING * smaller)
    if bad.any():
        k = int(bad.argmax())
        raise InputError(
            f"grain {contacts.i[k]} or {contacts.j[k]} lies wholly within the other: they have no common surface; make "
            "the overlap smaller"
        )


def _loads(
    contacts: Contacts, softness: Floats, bodies: dict[int, tuple[SoftGrain, SoftBody]]
) -> tuple[Floats, Floats]:
    """Return area (m,) and force on grain j (m, 3) of each contact, the mean of what its two grains tell."""
    area, force = np.zeros(contacts.count), np.zeros((contacts.count, 3))
    for soft, body in bodies.values():
        for partner, patch in zip(soft.touching, body.patches, strict=True):
            k, corners = patch.contact, body.faces[patch.faces]
            middle, areas = body.vertices[corners].mean(axis=1), normals_of(body.vertices[corners]) / 2
            depth = soft.inner(middle) + partner.depth(middle)
            area[k] += linear.norm(areas, axis=1).sum() / 2
            force[k] += (
                partner.side * linear.matmul(depth, areas) / (2 * (softness[contacts.i[k]] + softness[contacts.j[k]]))
            )
    return area, force


def _deformed(
    packing: Assembly, contacts: Contacts, softness: Floats, bodies: dict[int, tuple[SoftGrain, SoftBody]]
) -> Deformed:
    """Gather surfaces and contacts."""
    shapes = packing.shapes
    vertices = [packing.world_vertices(grain) for grain in range(packing.count)]
    faces = [shapes[k].faces for k in packing.shape_id.tolist()]
    own = np.array([enclosed_volume(shape.vertices, shape.faces) for shape in shapes])
    before = own[packing.shape_id] * libm.power(packing.scale, 3)
    after, steepness, reach = before.copy(), np.zeros(packing.count), np.zeros(packing.count)
    for grain, (_, body) in bodies.items():
        vertices[grain], faces[grain] = body.vertices + packing.position[grain], body.faces
        before[grain], after[grain] = body.before, body.after
        steepness[grain], reach[grain] = body.steepness, body.reach
    area, force = _loads(contacts, softness, bodies)
    total = linear.norm(force, axis=1)
    return Deformed(
        vertices=tuple(vertices),
        faces=tuple(faces),
        volume_before=before,
        volume_after=after,
        steepness=steepness,
        reach=reach,
        i=contacts.i,
        j=contacts.j,
        image=contacts.image,
        depth=-contacts.gap,
        area=area,
        force=total,
        normal=np.where(total[:, None] > 0, force / np.where(total > 0, total, 1.0)[:, None], contacts.normal),
    )
