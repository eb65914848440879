"""Forms of a scene: its sections as lists of fields, made from the parameter classes, and back to a mapping.

A form is a plain mapping that a page can hold. The text of a field is what stands right of "=" in a scene file; text
that is no TOML is a word without its quotes. An empty field keeps the default.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from voxgran._base.config import Parameter, kinds_of, parameters_of
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.containers.model import container_registry
from voxgran.geometry.orientations import KINDS as TURNS
from voxgran.packing.method import method_registry
from voxgran.scene.checked_sections import parsed_toml
from voxgran.scene.keys import AnyShape, Listed, Packed, Settled, ShapeOfFamily, ShapeOfFile, Twinned
from voxgran.scene.sections import General, Output
from voxgran.scene.twins.section import ALONE
from voxgran.scene.twins.twin import PROTOCOLS
from voxgran.settling.material import Material
from voxgran.settling.parameters import Compression, Settling
from voxgran.shapes.family import families
from voxgran.shapes.formats.tables import rows_in
from voxgran.shapes.sizes import KINDS

Form = dict[str, Any]

#: the family under which a shape is read from a file
FROM_FILE = "file"
#: type of the fields that a column of a table is pasted into
COLUMN = "a list, each entry a number"


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A section of a scene: its title, the key that names its kind, the kinds, and the parameters of each."""

    title: str
    key: str = ""
    kinds: Callable[[], Sequence[str]] = tuple
    parameters: Callable[[str], Iterable[Parameter]]
    needed: bool = False
    many: bool = False


def _of(*classes: type) -> Callable[[str], list[Parameter]]:
    """Return a function that gives the parameters of classes, whatever the kind."""
    return lambda _: [item for cls in classes for item in parameters_of(cls)]


def _shape(kind: str) -> list[Parameter]:
    """Return the keys of a shape that is read from a file, or of a family."""
    own = parameters_of(ShapeOfFile) if kind == FROM_FILE else parameters_of(families().get(kind).parameters)
    rest = () if kind == FROM_FILE else parameters_of(ShapeOfFamily)
    return _without([*own, *rest, *parameters_of(AnyShape)], "family")


def _container(kind: str) -> list[Parameter]:
    """Return the keys of a kind of containers, whose types its class does not say."""
    keys = container_registry().get(kind).keys
    return [Parameter(name=name, type=Any, default=MISSING if must else None) for name, must in keys.items()]


def _packed(cls: type, key: str) -> Callable[[str], list[Parameter]]:
    """Return a function that gives the parameters of a class without the key of the kind, and those of the method of
    this kind.
    """
    return lambda kind: [
        *_without(parameters_of(cls), key),
        *(parameters_of(method_registry().get(kind).parameters) if kind else ()),
    ]


def _without(items: Iterable[Parameter], *names: str) -> list[Parameter]:
    """Return the parameters but those of some names."""
    return [item for item in items if item.name not in names]


#: sections in the order of the page
SECTIONS: dict[str, Section] = {
    "shape": Section(
        title="Shape", key="family", kinds=lambda: (*families().names(), FROM_FILE), parameters=_shape, many=True
    ),
    "sizes": Section(
        title="Sizes", key="kind", kinds=lambda: sorted(KINDS), parameters=lambda kind: parameters_of(KINDS[kind])
    ),
    "grains": Section(title="List of grains", parameters=_of(Listed)),
    "container": Section(
        title="Container", key="kind", kinds=lambda: container_registry().names(), parameters=_container, needed=True
    ),
    "packing": Section(
        title="Packing",
        key="method",
        kinds=lambda: method_registry().names(),
        parameters=_packed(Packed, "method"),
        needed=True,
    ),
    "twin": Section(
        title="Twin of a sample",
        key="protocol",
        kinds=lambda: ("", *PROTOCOLS),
        parameters=_packed(Twinned, "protocol"),
    ),
    "orientations": Section(
        title="Orientations",
        key="kind",
        kinds=lambda: sorted(TURNS),
        parameters=lambda kind: parameters_of(TURNS[kind]),
    ),
    "settle": Section(title="Settling", parameters=_of(Settled, Settling)),
    "compress": Section(title="Compression", parameters=_of(Compression)),
    "material": Section(title="Material", parameters=_of(Material)),
    "scene": Section(title="Seed and unit", parameters=_of(General), needed=True),
    "output": Section(title="Files", parameters=_of(Output), needed=True),
}


def forms_of(mapping: Mapping[str, Any]) -> list[Form]:
    """Return the forms of a scene; a section that it lacks is switched off."""
    made = []
    for name, section in SECTIONS.items():
        given = mapping.get(name)
        entries = given if isinstance(given, list) else [given]
        for number, entry in enumerate(entries):
            made.append(_form(name, section, entry, number if section.many else -1))
    return made


def edited(forms: Sequence[Form], given: Any) -> list[Form]:
    """Return forms with the kinds, switches and texts that a page has now; nothing else is taken from it.

    Raises
    ------
    InputError
        If they are not of these forms.
    """
    made, words = [], "the forms of the page are not those of the scene: load the page again"
    try:
        for form, entry in zip(forms, given, strict=True):
            texts = {field["name"]: field["text"] for field in entry["fields"]}
            named = (entry["name"], entry["number"]) == (form["name"], form["number"])
            named = named and isinstance(entry["on"], bool) and entry["kind"] in (form["kind"], *form["kinds"])
            if not (named and all(isinstance(text, str | int | float | None) for text in texts.values())):
                raise InputError(words)
            fields = [{**field, "text": texts.get(field["name"], field["text"])} for field in form["fields"]]
            fields = [{**field, "text": "" if field["text"] is None else str(field["text"])} for field in fields]
            made.append({**form, "on": entry["on"], "kind": entry["kind"], "fields": fields})
    except (TypeError, KeyError, ValueError) as error:
        raise InputError(words) from error
    return made


def _form(name: str, section: Section, given: Mapping[str, Any] | None, number: int) -> Form:
    """Return the form of a section, or of one of its entries."""
    values, kinds = dict(given or {}), list(section.kinds())
    kind = values.pop(section.key, "") if section.key else ""
    if name == "shape" and FROM_FILE in values:
        kind = FROM_FILE
    kind = kind if kind in kinds else (kinds or [""])[0]
    own = {item.name: item for item in section.parameters(kind)}
    return {
        "name": name,
        "number": number,
        "title": section.title if number < 1 else f"{section.title} {number + 1}",
        "kinds": kinds,
        "kind": kind,
        "needed": section.needed,
        "on": section.needed or given is not None,
        # a method may have a key of the section as a parameter of its own, which it explains itself
        "fields": [_field(item, values.get(name)) for name, item in own.items()],
    }


def _field(item: Parameter, value: Any) -> Form:
    """Return the field of a parameter with its value."""
    kinds = [kind for kind in kinds_of(item.type) if kind is not NoneType]
    words = [str(word) for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)]
    choices = ["true", "false"] if kinds == [bool] else words if len(kinds) == 1 else []
    needed = item.default is MISSING
    return {
        "name": item.name,
        "meaning": item.doc,
        "unit": item.unit,
        "type": "" if item.type is Any else item.type_text,
        "choices": choices,
        "pasted": "each entry a number" in item.type_text,
        "long": any(get_origin(kind) not in (None, Literal) for kind in kinds),
        "word": kinds == [str] or bool(words),
        "default": "" if needed or item.default is None else text_of(item.default),
        "needed": needed,
        "text": "" if value is None else text_of(value),
    }


def text_of(value: Any) -> str:
    """Return a value as it stands in a scene file, words without quotes."""
    return value if isinstance(value, str) else _inline(value)


def _inline(value: Any) -> str:
    """Return a value as it stands on one line of a scene file."""
    written = load("tomli_w").dumps
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_inline, value))}]"
    if isinstance(value, Mapping):
        keys = [written({key: 0}).removesuffix(" = 0\n") for key in value]
        pairs = [f"{key} = {_inline(one)}" for key, one in zip(keys, value.values(), strict=True)]
        return f"{{ {', '.join(pairs)} }}" if pairs else "{}"
    return str(written({"v": value})).removeprefix("v = ").strip()


def value_of(field: Form) -> Any:
    """Return the value of a field that is not empty."""
    text = str(field["text"]).strip()
    if field["word"] and not text.startswith(("[", "{")):
        return text
    table = rows_in(text)
    if table is not None:
        return table[0] if len(table) == 1 else table
    try:
        return parsed_toml(f"v = {text}")["v"]
    except (ValueError, RecursionError):
        return text


def spread(form: Form) -> bool:
    """Give each column of a pasted table to a field of its own, from the one that holds it; return whether one did."""
    lists = [field for field in form["fields"] if field["type"] == COLUMN]
    for k, field in enumerate(lists):
        table = rows_in(str(field["text"])) or [0.0]
        rows = isinstance(table[0], list) and len({*map(len, table)}) == 1
        columns = list(zip(*table, strict=True)) if rows else []
        if columns and len(columns) <= len(lists) - k:
            for other, column in zip(lists[k:], columns, strict=False):
                other["text"] = "\n".join(map(str, column))
            return True
    return False


def mapping_of(forms: Iterable[Form]) -> dict[str, Any]:
    """Return the scene of forms, without the sections that are switched off."""
    made: dict[str, Any] = {}
    for form in forms:
        section = SECTIONS[form["name"]]
        if not form["on"]:
            continue
        values = {field["name"]: value_of(field) for field in form["fields"] if str(field["text"]).strip()}
        if section.key and form["kind"] not in ("", FROM_FILE):
            values = {section.key: form["kind"], **values}
        if section.many:
            made.setdefault(form["name"], []).append(values)
        elif values or not section.needed:
            made[form["name"]] = values
    return made


def scene_of(mapping: dict[str, Any]) -> dict[str, Any]:
    """Return a scene of forms, without what a twin has itself: the grains, and a container of no size."""
    if "twin" not in mapping:
        return mapping
    bare = () if len(mapping["container"]) > 1 else ("container",)
    return {name: value for name, value in mapping.items() if name not in (*ALONE, *bare)}


def rest_of(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of a scene has no form; it stays as it is."""
    made = mapping_of(forms_of(mapping))
    return {name: value for name, value in mapping.items() if name not in made}
