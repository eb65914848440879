"""Plots of a page, with the numbers that they show."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from voxgran._base.lazy import Dataset, DataTree
from voxgran._base.seeds import stream
from voxgran.measures.describe import describe
from voxgran.measures.directions import FACTOR, traceless_2
from voxgran.measures.region import gravity_of
from voxgran.measures.registered.coordination import mean_diameter
from voxgran.measures.registered.density import main_fraction
from voxgran.measures.registered.gradation import distance_from, gradation, size_classes
from voxgran.packing.model import Packing
from voxgran.report import facts, plots, shape_plots
from voxgran.report.direction_maps import plot_direction_map
from voxgran.report.wall_law import law_applies, wall_law

#: descriptors of the form of grains that are drawn
FORM = ("elongation", "flatness", "sphericity", "roundness")
#: labels of estimates over a coordinate, the level of independent places, and whether their axes are logarithmic
ESTIMATES: dict[str, tuple[str, float | None, bool]] = {
    "radial_distribution": ("g(r)", 1.0, False),
    "structure_factor": ("S(k)", 1.0, False),
    "window_deviation": ("standard deviation of the solid fraction", None, True),
}
#: the same of the mass density, along gravity
MASS_DENSITY: tuple[str, float | None, bool] = ("mass density, in the unit given", None, False)
#: sizes drawn at random to test those of a packing, in as many draws as these limits allow
SIZES, DRAWS = 500_000, (19, 499)
#: group and title of distributions, and the label of the coordinate that their variables share
DENSITIES = (
    ("local_density", "distribution of the local solid fraction", "local_solid_fraction_bin"),
    ("voids", "distribution of the pore size", "pore_size"),
    ("voids", "distribution of the chords of the pore space", "chord_length"),
)


@dataclass(frozen=True, slots=True)
class Figure:
    """One plot."""

    #: key of the numbers of the plot
    name: str
    svg: str
    alt: str
    caption: str
    #: JSON-able data of the plot
    numbers: dict[str, Any] = field(default_factory=dict)


def figures_of(packing: Packing, statistics: "DataTree | None") -> list[Figure]:
    """Return the plots of a packing for which there are data."""
    found = []
    if packing.count:
        found.append(_gradation(packing))
    found += _curves(packing, statistics)
    if packing.count:
        found += _forms(packing)
    last = (_contact_numbers(statistics), *_directions(packing, statistics), _forces(statistics))
    last += tuple(map(partial(_density_of, statistics), DENSITIES))
    return [*found, *(figure for figure in last if figure is not None)]


def size_test(packing: Packing) -> dict[str, Any] | None:
    """Compare the placed sizes with the requested distribution, by volume as the curves of a report.

    Return the `basis`, the Kolmogorov-Smirnov ``distance``, as in :func:`voxgran.measure`, and its ``p_value``, the
    probability that as many sizes drawn independently have a larger distance, from such draws; None without a requested
    distribution or a grain.
    """
    asked, n, d = packing.asked_sizes, packing.count, packing.dimension
    if asked is None or not n:
        return None
    distance = gradation(packing).distance["volume"]
    generator, larger = stream(0, "sizes as requested"), 0
    draws = int(np.clip(SIZES // n, *DRAWS))
    for _ in range(draws):
        sizes = asked.sample(n, generator, dimension=d)
        larger += distance_from(asked, sizes, sizes**d, basis="volume", dimension=d) >= distance
    return {"basis": "volume", "distance": distance, "p_value": (1 + larger) / (1 + draws)}


def _gradation(packing: Packing) -> Figure:
    """Return the gradation, requested and placed."""
    svg = plots.svg_of(lambda axes: plots.plot_gradation(axes, packing), "gradation")
    test = size_test(packing)
    caption = "Gradation: the share by volume that passes each size."
    if test is not None:
        caption += (
            " Placed against requested: the largest difference between the two curves, by volume "
            f"(Kolmogorov\u2013Smirnov), is {test['distance']:.3g}; as many sizes drawn independently have a larger "
            f"one with a probability of {test['p_value']:.2g}."
        )
    order = np.argsort(packing.diameters, kind="stable")
    shares = np.cumsum(packing.volumes[order]) / max(float(packing.volumes.sum()), 1e-300)
    keep = np.unique(np.linspace(0, packing.count - 1, 200).astype(int))
    numbers: dict[str, Any] = {
        "diameter": packing.diameters[order][keep].tolist(),
        "passing_by_volume": shares[keep].tolist(),
        "kolmogorov_smirnov": test,
    }
    if (classes := size_classes(packing)) is not None:
        ends, asked, placed = (values.tolist() for values in classes)
        numbers["classes"] = {"ends": ends, "asked_by_volume": asked, "placed_by_volume": placed}
    return Figure("gradation", svg, "gradation", caption, numbers)


def _curves(packing: Packing, statistics: "DataTree | None") -> Iterator[Figure]:
    """Yield solid fractions over a coordinate and coordination numbers over the gap."""
    bulk = facts.scalar(statistics, "bulk_solid_fraction")
    region, fraction = main_fraction(packing, statistics)
    levels = {region: fraction, "container": packing.solid_fraction, "bulk": np.nan if bulk is None else bulk}
    for data, name in curves_of(packing, statistics):
        place = data[name][data[name].dims[0]]
        published: dict[str, Any] = {}
        if str(place.name) == "wall_distance" and law_applies(packing) and np.isfinite(levels["bulk"]):
            law = wall_law(place.values / mean_diameter(packing), bulk=levels["bulk"])
            published = {"de Klerk 2003": law}
        draw = partial(_draw_curve, data=data, name=name, levels=levels, published=published)
        title = str(data[name].attrs.get("long_name", name.replace("_", " ")))
        note = " Dashed: equal spheres in a cylinder by de Klerk 2003." if published else ""
        numbers = {str(place.name): place.values.tolist(), name: data[name].values.tolist()}
        numbers |= {key: np.asarray(curve).tolist() for key, curve in published.items()}
        svg = plots.svg_of(draw, name.replace("_", "-"))
        yield Figure(name, svg, title, f"{title[:1].upper()}{title[1:]}.{note}", numbers)


def curves_of(packing: Packing, statistics: "DataTree | None") -> "list[tuple[Dataset, str]]":
    """Return dataset and name of each curve: solid fractions over a coordinate, the mass density along gravity,
    coordination numbers over the gap, and :data:`ESTIMATES`.

    Periodic axes are omitted, since all positions along them are equivalent.
    """
    upright = packing.dimension - 1 if packing.gravity is None else int(np.abs(packing.gravity).argmax())
    periodic = [axis for axis, flag in zip("xyz", packing.container.periodic, strict=True) if flag]
    found = []
    for node in statistics.subtree if statistics is not None else ():
        data = node.to_dataset()
        for name, variable in data.data_vars.items():
            along = str(variable.dims[0]) if variable.ndim == 1 else ""
            if along not in data.coords or variable.size < 2 or along in periodic or str(name).endswith("_error"):
                continue
            # as of a packing without grains
            if variable.isnull().all():
                continue
            if (
                str(name) in (*ESTIMATES, f"mass_density_{'xyz'[upright]}")
                or str(name).startswith("solid_fraction")
                or (along == "gap" and "coordination" in str(name))
            ):
                found.append((data, str(name)))
    return found


def _draw_curve(axes: Any, *, data: "Dataset", name: str, levels: Any, published: Any) -> Any:
    """Draw one curve."""
    variable = data[name]
    place = variable[variable.dims[0]]
    label = str(place.attrs.get("long_name", place.name)).removeprefix("the ")
    unit = str(place.attrs.get("units", ""))
    if place.name == "gap":
        return plots.plot_coordination(axes, place.values, variable.values, name=label, unit=unit)
    error = data[f"{name}_error"].values if f"{name}_error" in data else 0.0
    if name in ESTIMATES or name.startswith("mass_density"):
        title, level, logarithmic = ESTIMATES.get(name, MASS_DENSITY)
        return plots.plot_estimate(
            axes,
            place.values,
            variable.values,
            label=label + plots.unit_text(unit),
            name=title,
            error=error,
            level=level,
            logarithmic=logarithmic,
        )
    return plots.plot_profile(
        axes, place.values, variable.values, name=label, unit=unit, error=error, levels=levels, published=published
    )


def _forms(packing: Packing) -> Iterator[Figure]:
    """Give the plots of the form of the grains: in 3D after Zingg; sphericity against roundness of closed shapes."""
    form = {str(name): values.values for name, values in describe(packing, FORM).items()}
    known = np.isfinite(form["roundness"])
    more = "Larger dots represent more grains."
    if packing.dimension == 3:
        svg = plots.svg_of(
            lambda axes: shape_plots.plot_zingg(axes, form["elongation"], form["flatness"]), "zingg", size=(5.2, 4.2)
        )
        caption = f"Form after Zingg 1935: edges of the smallest box around each grain. {more}"
        means = {f"mean_{name}": float(form[name].mean()) for name in FORM[:2]}
        yield Figure("zingg", svg, "Zingg plot", caption, means)
    if known.any():
        drawn = {name: form[name][known] for name in FORM[2:]}
        svg = plots.svg_of(lambda axes: shape_plots.plot_roundness(axes, **drawn), "roundness", size=(5.2, 4.2))
        caption = f"Sphericity and roundness of the grains after Wadell 1932. {more}"
        left = len(known) - int(known.sum())
        if left:
            caption += (
                f" {left} of {len(known)} grains are left out: open surfaces, or meshes too coarse to have a curvature."
            )
        means = {f"mean_{name}": float(values.mean()) for name, values in drawn.items()}
        yield Figure("roundness", svg, "Sphericity and roundness", caption, means)


def _contact_numbers(statistics: "DataTree | None") -> Figure | None:
    """Return the distribution of the numbers of contacts, where there are grains."""
    if statistics is None or "/contact_numbers" not in statistics.groups:
        return None
    names = ("contact_number", "probability", "probability_error")
    number, share, error = (np.asarray(statistics["/contact_numbers"][name].values) for name in names)
    if not len(number):
        return None
    draw = partial(plots.plot_contact_numbers, numbers=number, probability=share, error=error)
    caption = "Number of neighbours of a grain: share of the grains, with the standard error of independent grains."
    numbers = {"contact_number": number.tolist(), "probability": share.tolist(), "error": error.tolist()}
    svg = plots.svg_of(draw, "contact-numbers")
    return Figure("contact_numbers", svg, "distribution of contact numbers", caption, numbers)


def _directions(packing: Packing, statistics: "DataTree | None") -> "Iterator[Figure | None]":
    """Yield the rose of contact normals, and what the measure `fabric` knows of them and of the long axes."""
    fabric = statistics["/fabric"].to_dataset() if statistics is not None and "/fabric" in statistics.groups else None
    if fabric is None or packing.dimension == 3:
        yield _rose(packing, statistics)
    if fabric is not None:
        for name, words in (("contact_normals", "contact normals"), ("long_axes", "long axes of grains")):
            yield _fabric(packing, fabric.sel(vector=name), name, words)


def _fabric(packing: Packing, data: "Dataset", name: str, words: str) -> Figure | None:
    """Return the rose or the equal-area map of a set of vectors, if there are enough of them."""
    count, d = int(data["count"]), packing.dimension
    if count < 2 * shape_plots.SECTORS:
        return None
    density, error = (np.asarray(data[key].values) for key in ("density", "density_error"))
    second = np.asarray(data["second_order"].values)
    deviator = FACTOR[d, 2] * traceless_2(second)
    azimuth = np.column_stack([data["azimuth_from"].values, data["azimuth_to"].values])
    value, spread = (float(data[f"second_order_anisotropy{end}"]) for end in ("", "_error"))
    told = f"{count} {words}; the anisotropy of second order is {value:.3f} \u00b1 {spread:.3f}"
    title = f"{words[:1].upper()}{words[1:]}"
    numbers: dict[str, Any] = {"vectors": count, "anisotropy": value, "anisotropy_error": spread}
    numbers |= {"relative_density": density.tolist(), "error": error.tolist(), "azimuth": azimuth.tolist()}
    if d == 2:
        angle = azimuth.mean(axis=1)
        numbers["angle"] = angle.tolist()
        draw: Any = partial(
            shape_plots.plot_rose, angle=angle, share=density, upright=False, error=error, deviator=deviator
        )
        caption = (
            f"{title}: distribution of {told}. Line: its density to second order; dashed: isotropic packing. Bars: "
            "standard errors."
        )
        if name == "contact_normals":
            numbers["contacts"] = count
    else:
        polar = np.column_stack([data["polar_from"].values, data["polar_to"].values])
        numbers["polar"] = polar.tolist()
        pole = "xyz".index(str(data.attrs["pole"]))
        draw = partial(plot_direction_map, polar=polar, azimuth=azimuth, density=density, deviator=deviator, pole=pole)
        caption = (
            f"{title}: equal-area map (Schmidt net) of {told}. The center is the axis {data.attrs['pole']}; lines are "
            "the density to second order."
        )
    key = name if d == 2 else f"{name}_map"
    svg = plots.svg_of(draw, key.replace("_", "-"), size=(5.0, 4.2), projection="polar")
    return Figure(key, svg, f"directions of {words}", caption, numbers)


def _rose(packing: Packing, statistics: "DataTree | None") -> Figure | None:
    """Return the rose of contact normals, if there are enough contacts."""
    if statistics is None or "/contacts" not in statistics.groups:
        return None
    normals = np.asarray(statistics["/contacts"]["normal"].values)
    if len(normals) < 2 * shape_plots.SECTORS:
        return None
    gravity = gravity_of(packing)
    angle, share = shape_plots.normal_rose(
        normals, dimension=packing.dimension, down=None if gravity is None else gravity[0]
    )
    upright = packing.dimension == 3
    draw = partial(shape_plots.plot_rose, angle=angle, share=share, upright=upright)
    svg = plots.svg_of(draw, "rose", size=(4.6, 4.2), projection="polar")
    origin = "the upright axis" if upright else "x"
    caption = (
        f"Contact normals: distribution of {len(normals)} normals over the angle from {origin}, relative to an "
        "isotropic packing (dashed)."
    )
    numbers = {"angle": angle.tolist(), "relative_density": share.tolist(), "contacts": len(normals)}
    return Figure("contact_normals", svg, "rose of contact normals", caption, numbers)


def _forces(statistics: "DataTree | None") -> Figure | None:
    """Return the distribution of the forces between grains, where it is known."""
    if statistics is None or "/forces" not in statistics.groups:
        return None
    relative, density = (np.asarray(statistics["/forces"][name].values) for name in ("relative_force", "density"))
    if not np.isfinite(density).all():
        return None
    decay = facts.scalar(statistics, "force_decay")
    draw = partial(plots.plot_forces, relative=relative, density=density, decay=np.nan if decay is None else decay)
    caption = (
        "Normal forces between grains over their mean. Dashed: beads under a piston by Mueth, Jaeger and Nagel 1998; "
        "in a bed that carries its own weight forces grow with depth, which makes the distribution wider."
    )
    numbers = {"relative_force": relative.tolist(), "density": density.tolist(), "decay": decay}
    return Figure("contact_forces", plots.svg_of(draw, "forces"), "distribution of contact forces", caption, numbers)


def _density_of(statistics: "DataTree | None", entry: tuple[str, str, str]) -> Figure | None:
    """Return the probability densities over one coordinate, where they are known."""
    group, title, along = entry
    if statistics is None or f"/{group}" not in statistics.groups or along not in statistics[group].coords:
        return None
    data = statistics[group].to_dataset()
    place = np.asarray(data[along].values)
    names = [str(name) for name in data.data_vars if data[name].dims == (along,)]
    curves = {name: np.asarray(data[name].values) for name in names}
    if not len(place) or not any(curve.any() for curve in curves.values()):
        return None
    label = str(data[along].attrs["long_name"]).partition(",")[0]
    draw = partial(plots.plot_densities, curves=curves, place=place, name=label, unit=str(data[along].attrs["units"]))
    numbers = {along: place.tolist()} | {name: curve.tolist() for name, curve in curves.items()}
    caption = f"{title[:1].upper()}{title[1:]}."
    return Figure(along, plots.svg_of(draw, along.replace("_", "-")), title, caption, numbers)
