"""The section [settle] of a scene: its keys, what is refused, and a run that is interrupted while grains settle."""

import signal

import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import CheckpointError, InputError, Interrupted, UnknownNameError
from voxgran.settling.parameters import Lid, Settling, Shaking

SCENE = """
[scene]
seed = 1
[[shape]]
family = "sphere"
[sizes]
kind = "lognormal"
median = 1.0
sigma = 0.1
[container]
kind = "box"
lengths = [3, 3, 6]
periodic = "xy"
[packing]
method = "digital"
count = 20
voxel_size = 0.1
sweeps = 100
[settle]
friction = 0.4
[output]
vtk = false
report = false
"""

# small scenes have no bulk to speak of, which is said in a warning
pytestmark = pytest.mark.filterwarnings("ignore:the bulk holds")


@pytest.fixture
def write(tmp_path):
    def writing(old="", new=""):
        assert old in SCENE
        path = tmp_path / "scene.toml"
        path.write_text(SCENE.replace(old, new) if old else SCENE)
        return path

    return writing


def test_keys_are_those_of_the_parameters_and_come_back(write):
    more = (
        'friction = 0.4\nshaking = {acceleration = 2, duration = 5}\nlid = {weight = 0.5}\nrest = 0.9\nparts = "hulls"'
    )
    scene = vg.Scene.from_toml(write("friction = 0.4", more))
    asked = Settling(friction=0.4, shaking=Shaking(2.0, 5.0), lid=Lid(0.5), rest=0.9, parts="hulls")
    assert scene.settle == asked
    again = vg.Scene.from_mapping(scene.to_mapping())
    assert again.settle == asked
    assert again.to_mapping() == scene.to_mapping()


@pytest.mark.parametrize(
    ("section", "expected"),
    [
        ("", None),
        ("[settle]", Settling()),
        ("[settle]\nenabled = true\nrest = 0.5", Settling(rest=0.5)),
        ("[settle]\nenabled = false\nfriction = 0.2", False),
    ],
)
def test_the_section_enables_or_disables_settling(write, section, expected):
    scene = vg.Scene.from_toml(write("[settle]\nfriction = 0.4", section))
    assert scene.settle == expected
    assert vg.Scene.from_mapping(scene.to_mapping()).settle == expected
    plan = scene.plan()
    settles = any(step.startswith("settle them with friction") for step in plan.computed)
    # a bed of the method settles where the scene says nothing
    assert settles == (expected is not False)
    assert any("enabled = false" in step for step in plan.skipped) == (expected is False)


def test_the_plan_says_how_the_bed_settles_and_what_memory_it_takes(write):
    large = 'method = "control_point"\ncount = 100000\nsweeps = 1'
    path = write('method = "digital"\ncount = 20\nvoxel_size = 0.1\nsweeps = 100', large)
    text = path.read_text().replace("[3, 3, 6]", "[60, 60, 60]")
    path.write_text(text)
    plan = vg.Scene.from_toml(path).plan()
    assert "settle them with friction 0.4, until at least 95.0% of them rest" in plan.computed
    path.write_text(text.replace("friction = 0.4", "enabled = false"))
    assert plan.memory >= vg.Scene.from_toml(path).plan().memory
    path.write_text(
        text.replace('"control_point"', '"gravity"').replace("sweeps = 1\n[settle]", "").replace("sweeps = 1", "")
    )
    path.write_text(path.read_text().replace("[settle]\n", ""))
    assert any("friction 0.4" in step for step in vg.Scene.from_toml(path).plan().computed)


def test_a_plan_refuses_a_height_that_no_bed_can_have(write):
    """The container is 6 high."""
    path = write('method = "digital"\ncount = 20\nvoxel_size = 0.1\nsweeps = 100', 'method = "gravity"\nheight = 7')
    path.write_text(path.read_text().replace("[settle]\n", ""))
    with pytest.raises(InputError, match="height is 7, and the container is 6 high"):
        vg.Scene.from_toml(path).plan()


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ("[settle]", "[settel]", UnknownNameError, "did you mean 'settle'"),
        ("[settle]", "[settling]", UnknownNameError, "did you mean 'settle'"),
        ("friction = 0.4", "frction = 0.4", UnknownNameError, r"\[settle\] key 'frction'.* did you mean 'friction'"),
        ("friction = 0.4", "enable = false", UnknownNameError, "did you mean 'enabled'"),
        ("friction = 0.4", "friction = -0.4", InputError, "friction is -0.4"),
        ("friction = 0.4", "rest = 1.5", InputError, "rest is 1.5"),
        ("friction = 0.4", "enabled = 1", InputError, r"\[settle\] enabled is 1: it must be true or false"),
        (
            "friction = 0.4",
            "shaking = {durtion = 2}",
            UnknownNameError,
            r"shaking key 'durtion'.* did you mean 'duration'",
        ),
        ("friction = 0.4", "shaking = {duration = 0}", InputError, "duration is 0"),
        ("friction = 0.4", "shaking = 3", InputError, "shaking is 3: it must be a table of acceleration and duration"),
        ("friction = 0.4", 'parts = "hull"', InputError, "parts is 'hull'"),
        ("sweeps = 100", "sweeps = 100\nsettle = false", UnknownNameError, r"section \[settle\].*enabled = false"),
        ("sweeps = 100", "sweeps = 100\nfriction = 0.3", UnknownNameError, r"is a key of \[settle\]"),
        ("sweeps = 100", "sweeps = 100\nshaking = 20", UnknownNameError, r"is a key of \[settle\]"),
        (
            '"digital"\ncount = 20\nvoxel_size = 0.1\nsweeps = 100',
            '"gravity"\ncount = 20',
            InputError,
            r"in \[packing\]",
        ),
        ('"digital"\ncount = 20\nvoxel_size = 0.1\nsweeps = 100', '"rsa"\ncount = 9', InputError, "without gravity"),
    ],
)
def test_mistakes_are_named(write, old, new, error, words):
    with pytest.raises(error, match=words):
        vg.Scene.from_toml(write(old, new))


def test_the_direction_that_is_proposed_lies_in_the_plane(tmp_path):
    walk = '"digital"\ncount = 20\nvoxel_size = 0.1\nsweeps = 100'
    flat = SCENE.replace('"sphere"', '"disk"').replace(
        '"box"\nlengths = [3, 3, 6]\nperiodic = "xy"', '"disk"\nradius = 3'
    )
    for text, axis in ((SCENE, "-z"), (flat, "-y")):
        (tmp_path / "scene.toml").write_text(text.replace(walk, '"rsa"\ncount = 9'))
        with pytest.raises(InputError, match=f"'voxgran settle out/packing.vtp --gravity {axis} -o settled.vtp'"):
            vg.Scene.from_toml(tmp_path / "scene.toml")


def test_settling_without_gravity_is_refused_before_anything_is_packed(write):
    scene = vg.Scene.from_toml(write("sweeps = 100", 'sweeps = 100\ngravity = "none"'))
    with pytest.raises(InputError, match="without gravity"):
        scene.plan()


def test_a_run_settles_and_says_how_the_grains_rest(write, tmp_path):
    scene = vg.Scene.from_toml(write())
    result = scene.run(tmp_path / "out")
    assert result.verification.ok
    assert result.packing.stop_reason == "settled"
    assert result.packing.provenance["settling"]["parameters"]["friction"] == 0.4
    assert result.summary["share_at_rest"] == pytest.approx(result.packing.forces.share_at_rest)
    assert result.summary["share_of_rattlers"] == pytest.approx(result.packing.forces.share_of_rattlers)
    assert 2.0 < result.summary["mean_coordination_number"] < 6.0
    assert -1.0 <= result.summary["segregation"] <= 1.0
    loose = vg.Scene.from_toml(write("friction = 0.4", "enabled = false")).run(tmp_path / "loose")
    assert "settling" not in loose.packing.provenance
    assert "share_at_rest" not in loose.summary
    assert loose.packing.position[:, 2].mean() > result.packing.position[:, 2].mean()
    with pytest.raises(CheckpointError, match="another scene"):
        vg.Scene.from_toml(write("friction = 0.4", "friction = 0.3")).run(tmp_path / "out", resume=True)


@pytest.mark.slow
@pytest.mark.parametrize("snapshots", [slow(0), 6])
def test_an_interrupt_while_grains_settle_changes_no_bits(write, tmp_path, snapshots):
    scene = vg.Scene.from_toml(write("[output]", f"[output]\nsnapshots = {snapshots}"))
    whole = scene.run(tmp_path / "whole").packing
    steps = []

    def interrupt(step):
        if step.stage == "settling":
            steps.append(step.done)
            if len(steps) in (3, 20):
                signal.raise_signal(signal.SIGTERM)

    for _ in range(2):
        with pytest.raises(Interrupted, match="to go on, resume from"):
            scene.run(tmp_path / "out", resume=True, on_step=interrupt)
    resumed = scene.run(tmp_path / "out", resume=True, on_step=interrupt).packing
    assert len(steps) > 20
    assert steps == sorted(steps)
    for name in ("position", "orientation"):
        assert getattr(resumed, name).tobytes() == getattr(whole, name).tobytes()
    for name in ("i", "j", "force", "residual"):
        assert getattr(resumed.forces, name).tobytes() == getattr(whole.forces, name).tobytes()
    if snapshots:
        assert (tmp_path / "out" / "snapshots.pvd").read_text() == (tmp_path / "whole" / "snapshots.pvd").read_text()


def test_each_seed_settles(write, tmp_path):
    result = vg.Scene.from_toml(write("seed = 1", "seed = 1\nseeds = 2")).run(tmp_path / "out")
    assert set(result.summary["mean"]) >= {"share_at_rest", "mean_coordination_number", "share_of_rattlers"}
    assert result.summary["mean"]["share_at_rest"] > 0.9
