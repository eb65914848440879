"""Input for MercuryDPM: tables of pebbles, table of grains, and a driver that is compiled against its declarations."""

import dataclasses
import math
import shutil
import subprocess

import numpy as np
import pytest
from engine_cases import assert_holds, mixed, rocks, sand_and_steel, spheres

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError
from voxgran.decks.engine import Held, program_part
from voxgran.decks.engines import mercury

HERTZ = {"law": "hertz", "young_modulus": 1e8, "restitution": 0.6}

#: what the driver uses of MercuryDPM, as its headers declare it; instead of a run, `solve` prints what it was given
STUBS = """
#pragma once
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>
typedef double Mdouble;
struct Vec3D {
    double X, Y, Z;
    Vec3D(double x = 0, double y = 0, double z = 0) : X(x), Y(y), Z(z) {}
    static double dot(const Vec3D& a, const Vec3D& b) { return a.X * b.X + a.Y * b.Y + a.Z * b.Z; }
    friend Vec3D operator*(Mdouble a, const Vec3D& v) { return Vec3D(a * v.X, a * v.Y, a * v.Z); }
};
inline std::ostream& operator<<(std::ostream& os, const Vec3D& v) { return os << v.X << ' ' << v.Y << ' ' << v.Z; }
struct Matrix3D {
    double XX, XY, XZ, YX, YY, YZ, ZX, ZY, ZZ;
    Matrix3D(double xx, double xy, double xz, double yx, double yy, double yz, double zx, double zy, double zz)
        : XX(xx), XY(xy), XZ(xz), YX(yx), YY(yy), YZ(yz), ZX(zx), ZY(zy), ZZ(zz) {}
};
struct MatrixSymmetric3D {
    double XX, XY, XZ, YY, YZ, ZZ;
    MatrixSymmetric3D(double xx, double xy, double xz, double yy, double yz, double zz)
        : XX(xx), XY(xy), XZ(xz), YY(yy), YZ(yz), ZZ(zz) {}
    friend Vec3D operator*(const MatrixSymmetric3D& m, const Vec3D& v) {
        return Vec3D(m.XX * v.X + m.XY * v.Y + m.XZ * v.Z, m.XY * v.X + m.YY * v.Y + m.YZ * v.Z,
                     m.XZ * v.X + m.YZ * v.Y + m.ZZ * v.Z);
    }
};
enum Level { ERROR };
struct Logger {
    void operator()(Level, const char*, const std::string& s) { std::cerr << s << std::endl; std::abort(); }
};
static Logger logger;
struct BaseSpecies { virtual ~BaseSpecies() {} std::string label; };
struct LinearViscoelasticNormalSpecies {
    double dissipation = -1;
    virtual ~LinearViscoelasticNormalSpecies() {}
    void setDissipation(double v) { dissipation = v; std::cout << "dissipation " << v << "\\n"; }
};
struct ParticleSpecies : BaseSpecies {
    unsigned index = 0;
    void setDensity(double v) { std::cout << "density " << v << "\\n"; }
    unsigned getIndex() const { return index; }
};
// the mixed species of two has the functions of a species, but the density
template <class S> struct Sliding : S {
    void setSlidingFrictionCoefficient(double v) { std::cout << "friction " << v << "\\n"; }
};
template <class S> struct Linear : Sliding<S>, LinearViscoelasticNormalSpecies {
    void setStiffness(double v) { std::cout << "stiffness " << v << "\\n"; }
    void setSlidingStiffness(double v) { std::cout << "shear " << v << "\\n"; }
};
template <class S> struct Hertz : Sliding<S> {
    void setEffectiveElasticModulusAndRestitutionCoefficient(double e, double r) {
        std::cout << "modulus " << e << "\\nrestitution " << r << "\\n";
    }
    void setEffectiveShearModulus(double v) { std::cout << "shear " << v << "\\n"; }
};
template <class S> struct Rolling : S {
    void setRollingDissipation(double v) { std::cout << "rolling_dissipation " << v << "\\n"; }
    void setRollingFrictionCoefficient(double v) { std::cout << "rolling " << v << "\\n"; }
};
template <class S> struct RollingSpring : Rolling<S> {
    void setRollingStiffness(double v) { std::cout << "rolling_stiffness " << v << "\\n"; }
};
struct LinearViscoelasticSlidingFrictionSpecies : Linear<ParticleSpecies> {
    typedef Linear<BaseSpecies> MixedSpeciesType;
};
struct LinearViscoelasticFrictionSpecies : RollingSpring<Linear<ParticleSpecies>> {
    typedef RollingSpring<Linear<BaseSpecies>> MixedSpeciesType;
};
struct HertzianViscoelasticMindlinSpecies : Hertz<ParticleSpecies> { typedef Hertz<BaseSpecies> MixedSpeciesType; };
struct HertzianViscoelasticMindlinRollingTorsionSpecies : Rolling<Hertz<ParticleSpecies>> {
    typedef Rolling<Hertz<BaseSpecies>> MixedSpeciesType;
};
struct Base {
    const ParticleSpecies* species = nullptr;
    Vec3D force, torque;
    void setSpecies(const ParticleSpecies* s) { species = s; }
    unsigned getIndSpecies() const { return species ? species->getIndex() : 0; }
    const Vec3D& getForce() const { return force; }
    void addForce(const Vec3D& v) { force = v; }
    void addTorque(const Vec3D& v) { torque = v; }
};
struct BaseWall : Base {
    Vec3D goal, gain;
    void setForceControl(Vec3D forceGoal, Vec3D gainFactor, Vec3D = Vec3D(0, 0, 0)) {
        goal = forceGoal;
        gain = gainFactor;
        std::cout << "servo " << goal << ' ' << gain << "\\n";
        // what the grains press with is the goal at once
        force = goal;
    }
};
struct InfiniteWall : BaseWall {
    Vec3D normal, point;
    void set(Vec3D n, Vec3D p) { normal = n; point = p; }
    void print() const { std::cout << "plane " << normal << ' ' << point << ' ' << getIndSpecies() << "\\n"; }
};
struct TriangleWall : BaseWall {
    Vec3D a, b, c;
    void setVertices(Vec3D p, Vec3D q, Vec3D r) { a = p; b = q; c = r; }
    void print() const { std::cout << "triangle " << a << ' ' << b << ' ' << c << "\\n"; }
};
struct AxisymmetricIntersectionOfWalls : BaseWall {
    Vec3D position, axis, normal, point;
    void setPosition(const Vec3D& v) { position = v; }
    void setAxis(Vec3D v) { axis = v; }
    void addObject(Vec3D n, Vec3D p) { normal = n; point = p; }
    void print() const {
        std::cout << "cylinder " << position << ' ' << axis << ' ' << normal << ' ' << point << "\\n";
    }
};
struct PeriodicBoundary {
    Vec3D normal; double low, high;
    void set(Vec3D n, Mdouble l, Mdouble h) { normal = n; low = l; high = h; }
    void setPlanewiseShift(Vec3D) {}
    void print() const { std::cout << "periodic " << normal << ' ' << low << ' ' << high << "\\n"; }
};
struct BaseParticle : Base {
    double invMass = 0;
    Vec3D position, velocity, spin;
    virtual ~BaseParticle() {}
    MatrixSymmetric3D inertia{1, 0, 0, 1, 0, 1};
    virtual bool isPebble() const { return false; }
    virtual BaseParticle* getClump() const { return nullptr; }
    bool isFixed() const { return invMass == 0; }
    void fixParticle() { invMass = 0; }
    MatrixSymmetric3D getInertia() const { return inertia; }
    double getInvMass() const { return invMass; }
    void setRadius(double v) { std::cout << "radius " << v << "\\n"; }
    void setPosition(const Vec3D& v) { position = v; }
    void setVelocity(const Vec3D& v) { velocity = v; }
    void setAngularVelocity(const Vec3D& v) { spin = v; }
    const Vec3D& getPosition() const { return position; }
    const Vec3D& getVelocity() const { return velocity; }
    const Vec3D& getAngularVelocity() const { return spin; }
    virtual double getKineticEnergy() const { return 0; }
    virtual double getRotationalEnergy() const { return 0; }
};
struct ClumpParticle final : BaseParticle {
    Matrix3D axes{1, 0, 0, 0, 1, 0, 0, 0, 1};
    MatrixSymmetric3D first{1, 0, 0, 1, 0, 1};
    std::vector<Vec3D> pebbles;
    std::vector<double> radii;
    double mass = 1;
    void setClump() {}
    void setDamping(Mdouble) {}
    void addPebble(Vec3D p, Mdouble r) { pebbles.push_back(p); radii.push_back(r); }
    void setClumpMass(Mdouble v) { mass = v; invMass = 1 / v; }
    void setInitInertia(MatrixSymmetric3D v) { first = inertia = v; }
    void setPrincipalDirections(Matrix3D v) { axes = v; }
    Vec3D getPrincipalDirections_e1() const { return Vec3D(axes.XX, axes.YX, axes.ZX); }
    Vec3D getPrincipalDirections_e2() const { return Vec3D(axes.XY, axes.YY, axes.ZY); }
    Vec3D getPrincipalDirections_e3() const { return Vec3D(axes.XZ, axes.YZ, axes.ZZ); }
    void rotateTensorOfInertia() {
        const double q[3][3] = {{axes.XX, axes.XY, axes.XZ}, {axes.YX, axes.YY, axes.YZ}, {axes.ZX, axes.ZY, axes.ZZ}};
        const double m[3][3] = {{first.XX, first.XY, first.XZ}, {first.XY, first.YY, first.YZ},
                                {first.XZ, first.YZ, first.ZZ}};
        double t[3][3] = {};
        for (int i = 0; i < 3; ++i) for (int j = 0; j < 3; ++j) for (int k = 0; k < 3; ++k) for (int l = 0; l < 3; ++l)
            t[i][j] += q[i][k] * m[k][l] * q[j][l];
        inertia = MatrixSymmetric3D(t[0][0], t[0][1], t[0][2], t[1][1], t[1][2], t[2][2]);
    }
    double getKineticEnergy() const override { return 1e-30; }
    double getRotationalEnergy() const override { return 1e-30; }
    void print() const {
        std::cout << "clump " << mass << ' ' << position << ' ' << inertia.XX << ' ' << inertia.XY << ' ' << inertia.XZ
                  << ' ' << inertia.YY << ' ' << inertia.YZ << ' ' << inertia.ZZ << "\\n";
        const Vec3D a = getPrincipalDirections_e1(), b = getPrincipalDirections_e2(), c = getPrincipalDirections_e3();
        for (std::size_t n = 0; n < radii.size(); ++n) {
            const Vec3D& p = pebbles[n];
            std::cout << "pebble " << position.X + a.X * p.X + b.X * p.Y + c.X * p.Z << ' '
                      << position.Y + a.Y * p.X + b.Y * p.Y + c.Y * p.Z << ' '
                      << position.Z + a.Z * p.X + b.Z * p.Y + c.Z * p.Z << ' ' << radii[n] << "\\n";
        }
    }
};
struct Handler {
    template <class T> T* copyAndAddObject(const T& object) { object.print(); return new T(object); }
};
struct ParticleHandler : std::vector<BaseParticle*> {
    ClumpParticle* copyAndAddObject(const ClumpParticle& object) {
        object.print();
        ClumpParticle* made = new ClumpParticle(object);
        push_back(made);
        return made;
    }
};
struct SpeciesHandler {
    std::vector<BaseSpecies*> own;
    std::map<std::pair<unsigned, unsigned>, BaseSpecies*> mixed;
    template <class T> T* copyAndAddObject(const T& object) {
        T* made = new T(object);
        made->index = own.size();
        for (unsigned k = 0; k < own.size(); ++k) mixed[{k, made->index}] = new typename T::MixedSpeciesType();
        own.push_back(made);
        std::cout << "species " << made->index << "\\n";
        return made;
    }
    BaseSpecies* getMixedObject(const unsigned a, const unsigned b) {
        return a == b ? own[a] : mixed[{std::min(a, b), std::max(a, b)}];
    }
    template <class U> typename U::MixedSpeciesType* getMixedObject(const U* a, const U* b) {
        std::cout << "mixed " << a->index << ' ' << b->index << "\\n";
        return dynamic_cast<typename U::MixedSpeciesType*>(getMixedObject(a->index, b->index));
    }
};
class Mercury3Dclump {
public:
    ParticleHandler particleHandler;
    Handler wallHandler, boundaryHandler;
    SpeciesHandler speciesHandler;
    virtual ~Mercury3Dclump() {}
    virtual void setupInitialConditions() {}
    virtual void computeExternalForces(BaseParticle*) {}
    virtual void computeInternalForce(BaseParticle*, BaseParticle*) {}
    virtual void computeForcesDueToWalls(BaseParticle*, BaseWall*) {}
    virtual void actionsAfterTimeStep() {}
    virtual bool continueSolve() const { return true; }
    void setName(const std::string&) { std::cout.precision(17); }
    void setGravity(Vec3D v) { std::cout << "gravity " << v << "\\n"; }
    void setMin(Vec3D v) { std::cout << "min " << v << "\\n"; }
    void setMax(Vec3D v) { std::cout << "max " << v << "\\n"; }
    void setTimeStep(Mdouble v) { step_ = v; }
    void setTimeMax(Mdouble v) { most_ = v; }
    void setSaveCount(unsigned v) { std::cout << "save " << v << "\\n"; }
    unsigned getNumberOfTimeSteps() const { return steps_; }
    double getTime() const { return steps_ * step_; }
    void solve() {
        setupInitialConditions();
        for (BaseParticle* p : particleHandler) if (p->isFixed()) std::cout << "fixed " << p->getPosition() << "\\n";
        BaseParticle one, two;
        BaseWall wall;
        one.invMass = 1e6; two.invMass = 3e6;
        computeInternalForce(&one, &two);
        computeForcesDueToWalls(&one, &wall);
        one.setVelocity(Vec3D(1, 0, 0));
        one.setAngularVelocity(Vec3D(0, 2, 0));
        computeExternalForces(&one);
        std::cout << "drag " << one.force << ' ' << one.torque << "\\n";
        one.fixParticle(); two.fixParticle();
        std::cout << "fixed_pair\\n";
        computeInternalForce(&one, &two);
        computeForcesDueToWalls(&one, &wall);
        std::cout << "end\\n";
        for (steps_ = 1; getTime() < most_; ++steps_) { actionsAfterTimeStep(); if (!continueSolve()) break; }
        std::cout << "time " << getTime() << "\\n";
    }
private:
    unsigned steps_ = 0;
    double step_ = 0, most_ = 0;
};
"""


def deck(folder, packing, **asked):
    """Write a deck and return it with what its files hold."""
    made = vg.write_deck(packing, folder, "mercury", **asked)
    return made, mercury.registration.read(folder)


def run(folder, *arguments, compiled=False):
    """Compile the driver against the declarations, if it is not, and return what it prints as (word, numbers)."""
    if not compiled:
        compile_driver(folder)
    done = subprocess.run([str(folder / "bed"), *arguments], cwd=folder, check=True, capture_output=True, text=True)
    return [(line.split()[0], [float(word) for word in line.split()[1:]]) for line in done.stdout.splitlines()]


def compile_driver(folder):
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("g++ is not installed: the driver is compiled by it")
    headers = folder / "headers"
    for line in program_part("mercury_includes.cpp").splitlines():
        if '"' in line:
            path = headers / "here" / line.split('"')[1]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text('#include "stubs.h"\n')
    (headers / "stubs.h").write_text(STUBS)
    source = folder / "compiled.cpp"
    source.write_text((folder / mercury.RUN).read_text())
    flags = ["-std=c++14", "-Wall", "-Werror", f"-I{headers / 'here'}", f"-I{headers}"]
    subprocess.run([compiler, *flags, "-o", str(folder / "bed"), str(source)], check=True)


def loaded(lines):
    """Return what the driver loaded."""
    clumps = np.array([numbers for word, numbers in lines if word == "clump"])
    pebbles = np.array([numbers for word, numbers in lines if word == "pebble"])
    xx, xy, xz, yy, yz, zz = clumps[:, 4:].T
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
    return Held(clumps[:, 0], clumps[:, 1:4], inertia, pebbles[:, :3], pebbles[:, 3])


def numbers_of(lines, word):
    """Return the numbers of all lines that begin with a word."""
    return [numbers for first, numbers in lines if first == word]


@pytest.mark.parametrize(
    "packing",
    [spheres(), mixed(), mixed(periodic=True), mixed(unit=None), mixed(container=vg.Cylinder(3, 7))],
    ids=["spheres", "clumps", "periodic", "no unit", "cylinder"],
)
def test_files_hold_the_simulation(tmp_path, packing):
    made, held = deck(tmp_path, packing)
    assert_holds(held, made.simulation)


def test_rocks_become_clumps_with_their_true_mass_and_inertia(tmp_path):
    made, held = deck(tmp_path, rocks(), clump=5)
    assert_holds(held, made.simulation)
    assert "intersection over union" in (tmp_path / mercury.RUN).read_text()


def test_tables_are_in_the_layout_of_mclump(tmp_path):
    made, _ = deck(tmp_path, mixed())
    template = next(one for one in made.simulation.bodies.templates if one.kind == "clump")
    texts = {key: (tmp_path / f"mercury_{template.name}_{key}.txt").read_text() for key in mercury.TABLES}
    pebbles = np.array([line.split(",") for line in texts["pebbles"].splitlines()], dtype=float)
    assert pebbles.shape == (3, 4)
    assert float(texts["mass"]) == pytest.approx(2650 * template.shape.volume)
    tensor = np.array([line.split(",") for line in texts["toi"].splitlines()], dtype=float)
    np.testing.assert_allclose(np.diag(tensor), 2650 * template.principal.moments, rtol=1e-12)
    assert texts["pd"] == "1.0,0.0,0.0\n0.0,1.0,0.0\n0.0,0.0,1.0\n"


def test_files_begin_with_the_header(tmp_path):
    made, _ = deck(tmp_path, mixed(container=vg.Sphere(3.5)))
    first = made.simulation.header("MercuryDPM")[0]
    for name, mark in {mercury.RUN: "//", mercury.GRAINS: "#", mercury.WALLS: "#"}.items():
        assert (tmp_path / name).read_text().startswith(f"{mark} {first}\n")
    assert all(path.name.startswith("mercury_") for path in made.files)


def test_the_driver_loads_the_bodies_and_the_law_and_goes_on(tmp_path):
    made, _ = deck(tmp_path, mixed(), material={"restitution": 0.4})
    simulation, law = made.simulation, made.simulation.law
    lines = run(tmp_path)
    assert_holds(loaded(lines), simulation)
    expected = {"stiffness": law.stiffness, "shear": law.shear_stiffness, "friction": 0.5, "density": 2650}
    for word, value in expected.items():
        assert numbers_of(lines, word) == [[pytest.approx(value)]]
    # the stubs let two grains of 1e-6 and 1/3e-6 kg touch, then the first a wall
    pair, wall = (numbers[0] for numbers in numbers_of(lines, "dissipation"))
    assert numbers_of(lines, "drag") == [[0.0] * 6]
    for dissipation, mass in ((pair, 1 / 4e6), (wall, 1 / 1e6)):
        ratio = dissipation / (2 * math.sqrt(law.stiffness * mass))
        assert math.exp(-math.pi * ratio / math.sqrt(1 - ratio**2)) == pytest.approx(0.4)
    # grains that do not move rest at the first output after the start
    (time,) = numbers_of(lines, "time")[0]
    output = simulation.steps_per_output * simulation.time_step
    assert 5 * simulation.time_unit <= time < 5 * simulation.time_unit + 1.01 * output
    (gravity,) = numbers_of(lines, "gravity")
    assert gravity == [0, 0, -9.81]
    state = (tmp_path / "mercury_state.csv").read_text()
    assert_holds(loaded(run(tmp_path, "mercury_state.csv", compiled=True)), simulation)
    assert (tmp_path / "mercury_state.csv").read_text() == state


@pytest.mark.slow
def test_the_law_of_hertz(tmp_path):
    deck(tmp_path, mixed(), material=HERTZ)
    lines = run(tmp_path)
    assert numbers_of(lines, "modulus") == [[pytest.approx(1e8 / (2 * (1 - 0.25**2)))]]
    assert numbers_of(lines, "shear") == [[pytest.approx(1e8 / 2.5 / 3.5)]]
    assert numbers_of(lines, "restitution") == [[0.6]]


@pytest.mark.slow
def test_walls(tmp_path):
    made, _ = deck(tmp_path / "box", mixed())
    planes = numbers_of(run(tmp_path / "box"), "plane")
    assert len(planes) == 6
    middle = made.simulation.walls.bounds.mean(axis=0)
    for numbers in planes:
        normal, point = np.array(numbers[:3]), np.array(numbers[3:6])
        # normals of MercuryDPM point into the wall
        assert np.dot(normal, middle) < np.dot(normal, point)
    deck(tmp_path / "periodic", mixed(periodic=True))
    lines = run(tmp_path / "periodic")
    assert len(numbers_of(lines, "periodic")) == 3
    assert not numbers_of(lines, "plane")
    deck(tmp_path / "cylinder", mixed(container=vg.Cylinder(3, 7)))
    (cylinder,) = numbers_of(run(tmp_path / "cylinder"), "cylinder")
    assert cylinder[3:] == [0, 0, 1, 1, 0, 0, pytest.approx(3e-3), 0, 0]
    made, _ = deck(tmp_path / "sphere", mixed(container=vg.Sphere(3.5)))
    corners = np.array(numbers_of(run(tmp_path / "sphere"), "triangle")).reshape(-1, 3)
    assert np.linalg.norm(corners - made.simulation.walls.round.center, axis=1).min() >= 3.5e-3


def test_refusals(tmp_path):
    with pytest.raises(InputError, match="cohesion"):
        vg.write_deck(mixed(), tmp_path, "mercury", material=HERTZ | {"cohesion": 0.1})
    with pytest.raises(InputError, match="has 'clump'"):
        vg.write_deck(rocks(), tmp_path, "mercury", grains="mesh")


def test_the_reader_refuses_what_mclump_does_not_have(tmp_path):
    deck(tmp_path, mixed())
    path = next(tmp_path.glob("mercury_three*_toi.txt"))
    text = path.read_text()
    path.write_text(text.replace(",", " "))
    with pytest.raises(FileFormatError, match=r"TOI\.txt"):
        mercury.registration.read(tmp_path)
    path.write_text(text)
    grains = tmp_path / mercury.GRAINS
    grains.write_text(grains.read_text() + "three_spheres_1,1.0\n")
    with pytest.raises(FileFormatError, match="2 columns"):
        mercury.registration.read(tmp_path)


def test_contacts_of_two_materials_have_the_law_of_their_pair(tmp_path):
    made, _ = deck(tmp_path, mixed(), material=sand_and_steel())
    lines = run(tmp_path)
    # 0 and 0, 0 and 1, 1 and 1
    assert numbers_of(lines, "friction") == [[0.6], [0.15], [0.3]]
    assert numbers_of(lines, "stiffness") == [[1e3], [pytest.approx(1.5e3)], [3e3]]
    assert numbers_of(lines, "mixed") == [[0, 1]]
    # the arm of rolling is twice the effective radius
    assert numbers_of(lines, "rolling") == [[0], [0.025], [0]]
    spring, dashpot = made.simulation.rolling(made.simulation.laws.laws[0][1])
    assert spring == pytest.approx(2 / 7 * 1.5e3)
    assert numbers_of(lines, "rolling_stiffness")[1] == [pytest.approx(spring / 4)]
    assert numbers_of(lines, "rolling_dissipation")[1] == [pytest.approx(dashpot / 4)]
    kinds = {tuple(numbers[:3]): numbers[6] for numbers in numbers_of(lines, "plane")}
    assert kinds[0, 0, -1] == 1
    assert set(kinds.values()) == {0, 1}
    text = (tmp_path / mercury.RUN).read_text()
    names = [one.name for one in made.simulation.bodies.templates]
    assert f'MATERIALS = {{{{"{names[0]}", 0}}, {{"{names[1]}", 1}}}};' in text


@pytest.mark.slow
def test_fixed_grains_have_no_inverse_mass(tmp_path):
    packing = dataclasses.replace(mixed(8), fixed=np.array([1, 1, 0, 0, 0, 1, 0, 0], dtype=bool))
    made, _ = deck(tmp_path, packing)
    lines = run(tmp_path)
    places = made.simulation.bodies.assembly.position[packing.fixed]
    np.testing.assert_allclose(numbers_of(lines, "fixed"), places)
    words = [word for word, _ in lines]
    # two that are fixed make no contact, nor one with a wall
    assert "dissipation" not in words[words.index("fixed_pair") : words.index("end")]


def test_walls_that_keep_a_stress_move_as_dampers(tmp_path):
    packing = dataclasses.replace(mixed(), gravity=None)
    made, _ = deck(tmp_path, packing, stress=(float("nan"), 2e3, 5e3))
    lines = run(tmp_path)
    y, z = made.simulation.platens
    # the force of the grains is outward, and a wall that bears less moves inward
    assert numbers_of(lines, "servo") == [
        [0, pytest.approx(y.force), 0, 0, pytest.approx(y.speed / y.force), 0],
        [0, 0, pytest.approx(z.force), 0, 0, pytest.approx(z.speed / z.force)],
    ]
    drag = 1 / made.simulation.time_unit
    assert numbers_of(lines, "drag") == [[pytest.approx(-drag / 1e6), 0, 0, 0, pytest.approx(-2 * drag), 0]]
    # the stubs press with the goal: the bed rests at the first output after the start
    assert numbers_of(lines, "time")[0][0] < 7 * made.simulation.time_unit


@pytest.mark.slow
def test_the_law_of_hertz_rolls(tmp_path):
    deck(tmp_path, mixed(), material=HERTZ | {"rolling_friction": 0.1})
    lines = run(tmp_path)
    assert numbers_of(lines, "rolling") == [[0.05]]
    assert not numbers_of(lines, "rolling_stiffness")
