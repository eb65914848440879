"""The section [twin] of a scene: the grains, their number and how they come together are those of a sample."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from voxgran._base.config import from_mapping
from voxgran._base.errors import InputError
from voxgran._base.files import existing_file
from voxgran._base.progress import OnStep
from voxgran._base.units import NO_UNIT
from voxgran.containers.model import Container, make_container
from voxgran.io.files import load
from voxgran.packing.method import method_registry
from voxgran.packing.model import Packing
from voxgran.scene.checked_sections import general_section, measure_section, refuse_engines, section_of, with_file
from voxgran.scene.entries import given_values, material_section
from voxgran.scene.keys import Twinned, names_of, refuse_unknown
from voxgran.scene.sections import Output
from voxgran.scene.twins.page import written
from voxgran.scene.twins.twin import TwinRequest, twin_of
from voxgran.shapes.learning.model import ShapeModel

#: sections of which a twin has its own, or that are for other grains
ALONE = ("shape", "sizes", "orientations", "grains", "layer", "obstacle", "packing", "settle", "compress")


@dataclass(frozen=True, slots=True)
class TwinEntry:
    """The section [twin]: its values as the scene file has them, what is asked, and the voxel of the comparison."""

    given: Mapping[str, Any]
    request: TwinRequest = field(compare=False)
    voxel_size: float | None
    held: bool  # whether the scene says the container
    compares: bool = True  # whether a run is compared with the sample

    def told(self, packings: list[Packing], folder: Path, output: Output, on_step: OnStep | None) -> dict[str, Any]:
        """Write how nearly packings equal the sample into a folder, and return the main numbers for the summary;
        nothing is compared where nothing is to be written.
        """
        if not (self.compares and (output.statistics or output.report)):
            return {}
        made = twin_of(self.request, packings, self.voxel_size)
        return {"twin": written(made, folder, page=output.report, on_step=on_step)}


def twin_scene(mapping: Mapping[str, Any], place: Path) -> dict[str, Any]:
    """Return the values of a scene with the section [twin].

    Raises
    ------
    InputError
        If no twin can be made of the sample, a value breaks a rule, or a section is there that a twin has of its own.
    UnknownNameError
        If a key is unknown.
    """
    for name in ALONE:
        if name in mapping:
            raise InputError(f"[{name}] and [twin]: a twin has the grains of its sample; leave [{name}] out")
    general = general_section(mapping.get("scene", {}))
    walls = make_container(with_file(mapping["container"], place)) if "container" in mapping else None
    twin = _twin_entry(mapping["twin"], place, walls, general.seed)
    asked, unit = twin.request, twin.request.sample.unit
    if general.unit not in (NO_UNIT, unit):
        raise InputError(f"[scene] unit is {general.unit} and the sample has {unit}: a twin has that of its sample")
    material = material_section(mapping.get("material", {}), (), None)
    output: Output = section_of(Output, mapping.get("output", {}), "[output]")
    refuse_engines(output, material, asked.container)
    return {
        "general": replace(general, unit=unit),
        "shapes": (),
        "sizes": None,
        "share_by": "number",
        "container": asked.container,
        "method": asked.protocol,
        "count": asked.count,
        "solid_fraction": asked.solid_fraction,
        "start": None,
        "parameters": dict(asked.parameters),
        "twin": twin,
        "material": material,
        "which": measure_section(mapping.get("measure", {})),
        "output": output,
    }


def _twin_entry(section: Mapping[str, Any], folder: Path, container: Container | None, seed: int) -> TwinEntry:
    """Return the checked section [twin]; files are relative to the folder."""
    own = {key: section[key] for key in names_of(Twinned) if key in section}
    checked = from_mapping(Twinned, own, "[twin]")
    files = {key: str(existing_file(folder / str(own[key]))) for key in own if key in ("sample", "model")}
    sample = load(files["sample"])
    usual = "gravity" if checked.protocol is None and sample.gravity is not None else "compress"
    method = method_registry().get(checked.protocol or usual).parameters
    rest = {key: value for key, value in section.items() if key not in own}
    refuse_unknown(rest, "[twin]", method, beside=names_of(Twinned))
    request = TwinRequest.of(
        sample,
        container,
        count=checked.count,
        solid_fraction=checked.solid_fraction,
        protocol=checked.protocol,
        model=ShapeModel.load(files["model"]) if "model" in files else None,
        faces=checked.faces,
        forms=checked.forms,
        seed=seed,
        **given_values(method, rest, "[twin]"),
    )
    return TwinEntry({**section, **files}, request, checked.voxel_size, container is not None)
