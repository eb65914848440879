"""Parameters of rough surfaces: one class for shapes, sheets and walls."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from voxgran._base.arrays import Floats, as_number, as_positive
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.shapes.roughness.autocorrelation import roll_off_of
from voxgran.shapes.roughness.johnson import johnson

#: defaults of heights and correlation lengths, in diameters, and of the shortest wavelength, in correlation lengths
RMS, LENGTH, SHORTEST = 0.02, 0.25, 0.75
#: points of the lattice, and edges of the mesh, per shortest wavelength
POINTS = 4

Method = Literal["spectral", "patir", "whitehouse", "midpoint"]


@parameter_class
class Roughness:
    """Parameters of a rough surface.

    Parameters
    ----------
    method
        random field: spectral (self-affine, of a Hurst exponent), patir (of a given autocorrelation function),
        whitehouse (recursion, exponential autocorrelation) or midpoint (midpoint displacement).
    rms
        root mean square height, which is met exactly; default: 0.02 equivalent diameters.
    correlation_length
        distance at which the autocorrelation falls to 1/e, or one for each axis; default: 0.25 equivalent diameters.
    shortest
        shortest wavelength, along which the mesh has four edges; the spectral field ends there; default: 0.75 of the
        least correlation length.
    hurst
        Hurst exponent of spectral and midpoint; default: 0.8.
    autocorrelation
        autocorrelation function of patir; default: exponential.
    skewness
        skewness of the heights, of spectral and patir.
    kurtosis
        kurtosis of the heights, of spectral and patir; 3 for Gaussian heights.

    Raises
    ------
    InputError
        If a number is out of range, or a parameter is given that its method does not have.
    """

    method: Literal["spectral", "patir", "whitehouse", "midpoint"] = parameter("spectral")
    rms: float | None = parameter(None, unit="length", at_least=0.0)
    correlation_length: float | tuple[float, float] | tuple[float, float, float] | None = parameter(
        None, unit="length", above=0.0
    )
    shortest: float | None = parameter(None, unit="length", above=0.0)
    hurst: float | None = parameter(None, at_least=0.05, at_most=1.0)
    autocorrelation: Literal["exponential", "gaussian", "linear"] | None = parameter(None)
    skewness: float = parameter(0.0)
    kurtosis: float = parameter(3.0)

    def __post_init__(self) -> None:
        """Check the ranges, and that the method has what is given."""
        check_bounds(self)
        named = {
            "hurst": (self.hurst is not None, ("spectral", "midpoint")),
            "autocorrelation": (self.autocorrelation is not None, ("patir",)),
            "skewness": (self.skewness != 0.0, ("spectral", "patir")),
            "kurtosis": (self.kurtosis != 3.0, ("spectral", "patir")),
        }
        for name, (given, methods) in named.items():
            if given and self.method not in methods:
                raise InputError(
                    f"{name} is given and method is {self.method!r}: it is a parameter of {' and '.join(methods)}; "
                    "leave it out"
                )
        johnson(as_number(self.skewness, "skewness"), as_number(self.kurtosis, "kurtosis"))

    def on(self, diameter: float, dimension: int) -> "RoughField":
        """Return the numbers of the random field of a body of an equivalent diameter.

        Raises
        ------
        InputError
            If there are more or fewer correlation lengths than axes, or none of the spectral field has this length.
        """
        given = self.correlation_length
        lengths = (
            (LENGTH * diameter if given is None else given,) * dimension if not isinstance(given, tuple) else given
        )
        if len(lengths) != dimension:
            raise InputError(
                f"correlation_length is {given}: the field has {dimension} axes; give one length, or {dimension}"
            )
        sides = np.array([as_positive(length, "correlation_length") for length in lengths])
        shortest = SHORTEST * float(sides.min()) if self.shortest is None else self.shortest
        least = float(sides.min())
        cut_off = 2 * np.pi * least / shortest
        hurst = 0.8 if self.hurst is None else self.hurst
        spectral = self.method == "spectral"
        return RoughField(
            method=self.method,
            rms=RMS * diameter if self.rms is None else self.rms,
            lengths=sides,
            shortest=shortest,
            hurst=hurst,
            cut_off=cut_off,
            roll_off=roll_off_of(hurst, cut_off, dimension, length=least) if spectral else 0.0,
            autocorrelation=self.autocorrelation or "exponential",
            skewness=float(self.skewness),
            kurtosis=float(self.kurtosis),
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class RoughField:
    """What a random field is drawn from; wave numbers are in inverse correlation lengths."""

    method: Method
    rms: float
    lengths: Floats
    shortest: float
    hurst: float
    roll_off: float
    cut_off: float
    autocorrelation: str
    skewness: float
    kurtosis: float

    @property
    def edge(self) -> float:
        """Longest edge of the mesh, and spacing of the lattice."""
        return self.shortest / POINTS
