"""Measure how long steps of runs take, by which `voxgran plan` tells the time: durations.py FILE.csv

The file is voxgran/scene/durations.csv. Each line has a scene, of which the last step is measured: packing, settling or
compressing. The features of the step and its CPU seconds replace those of the line; the yardstick is that of
`voxgran._base.machine`. A further scene is a further line, in which the other cells may be empty.
"""

import csv
import json
import time

from benchmarks.model import arguments
from voxgran._base.files import written_whole
from voxgran._base.machine import yardstick
from voxgran.scene.checked_sections import compressed
from voxgran.scene.description import SceneDescription
from voxgran.scene.duration import FEATURES, Step, steps_of
from voxgran.scene.plan import stand_ins, task_of
from voxgran.scene.run import pack_scene
from voxgran.scene.scene import Scene

COLUMNS = ("step", *list(FEATURES)[1:], "seconds", "yardstick", "scene")
#: seconds from which on a run is not made twice; of the first one kernels are loaded
LONG = 10.0


def steps(scene: SceneDescription) -> list[Step]:
    """Return the steps of a scene."""
    task = task_of(scene, stand_ins(scene))
    return steps_of(scene, task, task.method.cost(task.problem))


def seconds(mapping: dict[str, object]) -> float:
    """Return the least CPU seconds of packing a scene."""
    scene, times = Scene.from_mapping(mapping), [float("inf")]
    shapes = tuple(shape for entry in scene.shapes for shape, _ in entry.grains())
    while len(times) < 3 and (len(times) == 1 or times[-1] < LONG):
        began = time.process_time()
        compressed(scene.compress, pack_scene(scene, shapes))
        times.append(time.process_time() - began)
    return min(times)


def measured(text: str) -> list[str]:
    """Return the cells of a scene that is given as JSON."""
    mapping = json.loads(text)
    found = steps(Scene.from_mapping(mapping))
    used = seconds(mapping)
    if len(found) > 1:
        last = {"settle": {"settle": {"enabled": False}}, "compress": {"compress": None}}[found[-1].name]
        former = {key: value for key, value in {**mapping, **last}.items() if value is not None}
        used -= seconds(former)
    return [
        found[-1].name,
        *(f"{one:.4g}" for one in found[-1].features[1:]),
        f"{used:.4g}",
        f"{yardstick():.4g}",
        text,
    ]


def main() -> None:
    """Measure the scenes of the file."""
    [target] = arguments(__doc__, "file")
    with target.open(encoding="utf-8", newline="") as file:
        scenes = [row["scene"] for row in csv.DictReader(file)]
    rows = []
    for text in scenes:
        rows.append(measured(text))
        print(*rows[-1][:1], *rows[-1][-3:], flush=True)  # noqa: T201
    with written_whole(target) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *sorted(rows)])


if __name__ == "__main__":
    main()
