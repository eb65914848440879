"""Script of YADE after the numbers of a simulation: grains and walls from their tables, outputs, and the run."""

#: the script after its constants; YADE itself gives the names of its classes
RUN = '''\

def rows(name):
    """Return the words of each line of a file, without comments."""
    with open(name) as file:
        return [line.split() for line in file if line.strip() and not line.startswith("#")]


def numbers(words):
    """Return words as numbers."""
    return [float(word) for word in words]


def pose(body, values):
    """Give a body its true mass, centroid, orientation of the principal axes, and moments of inertia."""
    mass, x, y, z, qw, qx, qy, qz, *moments = values
    state = body.state
    state.mass, state.inertia = mass, Vector3(*moments)
    state.pos = state.refPos = Vector3(x, y, z)
    state.ori = state.refOri = Quaternion(qw, qx, qy, qz)
    body.aspherical = max(moments) - min(moments) > 1e-12 * max(moments)
    return body


def put_sphere(values, spheres, kind):
    """Add a sphere of a material."""
    x, y, z, radius = spheres[0]
    O.bodies.append(pose(utils.sphere((x, y, z), radius, material="grains%d" % kind), values))


def put_clump(values, spheres, kind):
    """Add a clump of a material.

    YADE takes mass, centroid and inertia of a clump from its members. A box without bounds, which meets nothing,
    carries the true ones among spheres without mass. The clump is made about the origin, with principal
    axes along x, y and z, as YADE 2023.02a turns the inertia of a box the wrong way; it is put in its place after that.
    The spheres get the mass of the clump, as the damping of a contact follows from the masses of its two members.
    """
    mass, *place = values
    center, turn = Vector3(*place[:3]), Quaternion(*place[3:7])
    points = [Vector3(x, y, z) for x, y, z, _ in spheres]
    members = [
        utils.sphere(turn.conjugate() * (point - center), sphere[3], material="members%d" % kind)
        for point, sphere in zip(points, spheres)
    ]
    box = utils.box((0, 0, 0), [spheres[0][3]] * 3, material="members%d" % kind, mask=2)
    carrier = pose(box, [mass, 0, 0, 0, 1, 0, 0, 0, *place[7:]])
    carrier.bounded = False
    clump, ids = O.bodies.appendClumped([*members, carrier], discretization=0)
    state = O.bodies[clump].state
    state.pos = state.refPos = center
    state.ori = state.refOri = turn * state.ori
    for number, point in zip(ids, [*points, center]):
        member = O.bodies[number].state
        member.mass, member.pos, member.refPos, member.ori, member.refOri = mass, point, point, turn, turn


def put_level_set(values, lattice, kind):
    """Add a body given by signed distances on a lattice."""
    corner, spacing, points, distances = lattice
    grid = RegularGrid(min=Vector3(*corner), nGP=Vector3i(*points), spacing=spacing)
    body = utils.levelSetBody(distField=distances, grid=grid, nSurfNodes=NODES, material="grains%d" % kind)
    O.bodies.append(pose(body, values))


def lattice_of(name, scale):
    """Return lower corner, spacing, points along each axis and distances of a scaled lattice."""
    first, *lines = rows("yade_%s.txt" % name)
    corner, spacing, points = numbers(first[:3]), float(first[3]), [int(word) for word in first[4:]]
    columns = [[scale * value for value in numbers(line)] for line in lines]
    distances = [columns[i * points[1] : (i + 1) * points[1]] for i in range(points[0])]
    return [scale * value for value in corner], scale * spacing, points, distances


def put_polyhedron(values, corners):
    """Add a convex solid.

    YADE puts the centroid of the corners at the origin, and where the products of inertia of a cubic metre are above
    1e-13 kg m^2, it turns them into principal axes of its own.
    """
    body = polyhedra_utils.polyhedra(O.materials["polyhedra"], v=corners)
    body = pose(body, values)
    own, state = body.shape.GetOri(), body.state
    turn, (first, second, third) = own.toRotationMatrix(), state.inertia
    tensor = turn.transpose() * Matrix3(first, 0, 0, 0, second, 0, 0, 0, third) * turn
    state.inertia = Vector3(tensor[0, 0], tensor[1, 1], tensor[2, 2])
    state.ori = state.refOri = state.ori * own
    O.bodies.append(body)


def load():
    """Make all grains and walls."""
    spheres = {}
    for *sphere, grain in rows("yade_spheres.txt") if SPHERES else []:
        spheres.setdefault(int(grain), []).append(numbers(sphere))
    for grain, (kind, name, scale, *values) in enumerate(rows("yade_grains.txt")):
        values, scale = numbers(values), float(scale)
        if kind == "sphere":
            put_sphere(values, spheres[grain], MATERIALS[name])
        elif kind == "clump":
            put_clump(values, spheres[grain], MATERIALS[name])
        elif kind == "polyhedron":
            points = rows("yade_%s.txt" % name)
            put_polyhedron(values, [scale * Vector3(*numbers(point)) for point in points])
        else:
            put_level_set(values, lattice_of(name, scale), MATERIALS[name])
    for level, axis, inward, kind in PLANES:
        O.bodies.append(utils.wall(level, axis=axis, sense=inward, material="walls%d" % kind))
    for row in rows("yade_facets.txt") if FACETS else []:
        *values, kind = numbers(row)
        corners = [Vector3(*values[k : k + 3]) for k in (0, 3, 6)]
        O.bodies.append(utils.facet(corners, material="walls%d" % kind))


    bodies = grains()
    for first, last in FIXED:
        for body in bodies[first - 1 : last]:
            body.dynamic = False


def grains():
    """Return the bodies that are grains, in the order of yade_grains.txt."""
    return [body for body in O.bodies if not (body.isClumpMember or isinstance(body.shape, (Wall, Facet)))]


def platens():
    """Return the walls that move, with their axis, side, force and speed, and what the grains press on them with."""
    found = [(O.bodies[WALLS[number]], *numbers) for number, *numbers in PLATENS]
    return [(*row, -row[2] * O.forces.f(row[0].id, sync=True)[row[1]]) for row in found]


def limit_moments():
    """Limit the moments of rolling friction at walls, of which YADE takes the radius for infinite."""
    for body in BOUNDARY:
        for contact in body.intrs():
            if contact.isReal:
                other = O.bodies[contact.id1 + contact.id2 - body.id]
                contact.phys.maxBendPl = ROLLING * other.shape.radius


def move_platens():
    """Let walls move as dampers that take up waves, so that the grains press on them with their forces."""
    for body, axis, inward, force, speed, pressing in platens():
        velocity = [0.0, 0.0, 0.0]
        velocity[axis] = inward * speed * (1 - pressing / force)
        body.state.vel = Vector3(*velocity)


def output():
    """Append poses and energy to the files of outputs."""
    with open("yade_poses.txt", "a") as file:
        file.write("# step %d, time %.9g s: x y z qw qx qy qz vx vy vz wx wy wz\\n" % (O.iter, O.time))
        for body in grains():
            state, turn = body.state, body.state.ori
            values = [*state.pos, turn[3], turn[0], turn[1], turn[2], *state.vel, *state.angVel]
            file.write(" ".join(map(repr, values)) + "\\n")
    with open("yade_energy.txt", "a") as file:
        file.write("%d %.9g %.9g\\n" % (O.iter, O.time, utils.kineticEnergy()))


def picture(name):
    """Write files for ParaView."""
    if SPHERES:
        VTKRecorder(fileName="yade_%s_" % name, recorders=["spheres", "facets"], mask=1)()
    if LEVEL_SETS:
        VTKRecorder(fileName="yade_%s_" % name, recorders=["lsBodies"])()
    if POLYHEDRA:
        export.VTKExporter("yade_%s" % name).exportPolyhedra()


def rests():
    """Tell whether the grains rest: by the forces on them under a stress, as grains that bear nothing spin on."""
    met = all(abs(pressing / force - 1) < STRESS_MET for *_, force, _, pressing in platens())
    return met and (utils.unbalancedForce() < UNBALANCED if UNBALANCED else utils.kineticEnergy() < REST)


def run():
    """Run until the bed rests, or for the longest time, with a file to go on from."""
    outputs = 0
    while O.iter < STEPS:
        O.run(min(EVERY, STEPS - O.iter), True)
        output()
        outputs += 1
        if outputs % 20 == 0:
            O.save("yade_checkpoint.yade.gz")
        if O.iter >= START and rests():
            break
    O.save("yade_checkpoint.yade.gz")
    picture("end")


WALLS, BOUNDARY = [], []
if len(sys.argv) > 1:
    # a file of a former run
    O.load(sys.argv[1])
else:
    for name in ("yade_poses.txt", "yade_energy.txt"):
        if os.path.exists(name):
            os.remove(name)
    load()
    output()
    picture("start")
WALLS += [body.id for body in O.bodies if isinstance(body.shape, Wall)]
BOUNDARY += [body for body in O.bodies if isinstance(body.shape, (Wall, Facet))]
run()
sys.stdout.flush()
# YADE ends with an error where it has loaded VTK
os._exit(0)
'''
