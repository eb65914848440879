"""Common setup of all pictures: light, background, and a camera that frames a box."""

import contextlib
import io
import os
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, as_count, check_type
from voxgran._base.errors import InputError, shown
from voxgran._base.files import output_suffix
from voxgran._base.lazy import load
from voxgran.containers.model import Container
from voxgran.shapes.tessellate import sphere

Picture: TypeAlias = NDArray[np.uint8]

BACKGROUND = "#eef1f4"
#: longest side of a picture, in pixels: drawing needs some tens of bytes for each of them
MOST_PIXELS = 8192
#: how edges are smoothed: each pixel is the mean of several
SMOOTHING: str | None = "ssaa"
#: material of surfaces
MATERIAL = {"ambient": 0.28, "diffuse": 0.75, "specular": 0.12, "specular_power": 12}

#: smallest text, in pixels, and how many texts above each other fill a picture
SMALLEST, TEXTS = 14, 36

#: colours of lines and of texts
INK, LETTERS = "#5b6670", "#2b3640"
_LIGHTS = (((-0.6, 0.9, 1.0), 0.85), ((1.0, 0.1, 0.6), 0.35), ((0.0, -0.8, 0.4), 0.15))
#: direction from the center to the camera
_VIEW = (0.85, -1.55, 0.75)
#: margin around the box, as a share of the picture
_MARGIN = 0.03
#: direction of the light on many spheres
_HEAP_LIGHT = (-0.55, -0.4, 0.73)
#: shader that draws points as spheres; `offsetVCVSOutput` is the position on the disk, with length 1 at its rim
_BALL_SHADER = """//VTK::Color::Impl
float rim = dot(offsetVCVSOutput.xy, offsetVCVSOutput.xy);
if (rim > 1.0) { discard; }
vec3 outward = vec3(offsetVCVSOutput.xy, sqrt(1.0 - rim));
float shade = 0.42 + 0.58 * max(0.0, dot(outward, vec3(-0.41, 0.61, 0.68)));
diffuseColor *= shade;
ambientColor *= shade;
"""


#: the insides of surfaces in one shade, as a plane has it
_CUT_SHADER = """//VTK::Light::Impl
if (!gl_FrontFacing) { fragOutput0.rgb = 0.9 * (ambientColor + diffuseColor); }
"""


@contextlib.contextmanager
def stage_of(window: tuple[int, int], *, lit: bool = True) -> Iterator[Any]:
    """Provide an off-screen plotter that is closed at the end (context manager); without light and smoothing colours
    are reproduced exactly. The window is in pixels.
    """
    stage = open_stage(window, lit=lit)
    try:
        yield stage
    finally:
        stage.close()


def open_stage(window: tuple[int, int], *, lit: bool = True) -> Any:
    """Return an off-screen plotter, which the caller closes; the window is in pixels."""
    pyvista = load("pyvista")
    stage = pyvista.Plotter(off_screen=True, window_size=list(window), lighting="none")
    stage.set_background(BACKGROUND if lit else "black")
    if lit and SMOOTHING:
        stage.enable_anti_aliasing(SMOOTHING)
    else:
        stage.disable_anti_aliasing()
    for place, strength in _LIGHTS if lit else ():
        stage.add_light(pyvista.Light(position=place, intensity=strength, light_type="camera light", color="white"))
    return stage


def look_at(stage: Any, points: Floats, *, flat: bool = False, turn: float = 0.0, below: float = 0.0) -> None:
    """Frame points (n, 3) with the camera; flat scenes are viewed from above.

    The camera is turned around the vertical axis by an angle in degrees, of which its distance is independent. The
    share `below` of the height at the lower edge is left free, at the upper one where it is below 0.
    """
    axes = view_axes(flat=flat, turn=turn)
    toward = axes[2]
    low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    middle, (wide, tall, deep) = (low + high) / 2 @ axes, (high - low) / 2
    width, height = stage.window_size
    free = 1 - 2 * _MARGIN
    scale = max(tall / (free - abs(below)), wide * height / width / free, 1e-300)
    middle = middle - below * scale * axes[1]
    stage.camera.parallel_projection = True
    stage.camera.focal_point = tuple(middle)
    stage.camera.position = tuple(middle + 10 * (scale + deep) * toward)
    stage.camera.up = tuple(axes[1])
    stage.camera.parallel_scale = scale
    stage.camera_set = True


def keep_written(stage: Any, write: Callable[[], None]) -> None:
    """Have labels written before a rendering where the window, the camera or what is drawn are others than before."""
    seen: tuple[Any, ...] = ()
    labels: list[str] = []

    def renew(*_: Any) -> None:
        nonlocal seen, labels
        others = set(stage.actors) - set(labels)
        now = (*stage.window_size, stage.camera.parallel_scale, others)
        if now == seen and set(labels) <= set(stage.actors):
            return
        # what is added is not rendered by itself
        seen, stage.suppress_rendering, before = now, True, stage.suppress_rendering
        stage.remove_actor(labels, render=False)
        write()
        labels = [name for name in stage.actors if name not in others]
        stage.suppress_rendering = before

    stage.render_window.AddObserver("StartEvent", renew)


def cut_beyond(stage: Any, bounds: Floats, shares: Sequence[float], *, closed: bool) -> None:
    """Cut what lies beyond planes across the axes, at shares of a box with bounds (2, 3); none is drawn at share 1.

    The inside of a grain that is seen, in which no other lies, is drawn as the plane, where all surfaces are `closed`.
    """
    low, high = bounds
    kinds = load("vtkmodules.vtkCommonDataModel")
    planes = kinds.vtkPlaneCollection()
    for axis, share in enumerate(shares[: len(low)]):
        if share < 1:
            plane = kinds.vtkPlane()
            plane.SetOrigin(*((low + share * (high - low)) * np.eye(3)[axis]))
            plane.SetNormal(*-np.eye(3)[axis])
            planes.AddItem(plane)
    for actor in stage.renderer.actors.values():
        mapper: Any = getattr(actor, "mapper", None)
        if hasattr(mapper, "SetClippingPlanes"):
            mapper.SetClippingPlanes(planes)
            program = actor.GetShaderProperty()
            program.ClearAllFragmentShaderReplacements()
            if closed and planes.GetNumberOfItems() and "grain" in getattr(mapper.GetInput(), "cell_data", ()):
                program.AddFragmentShaderReplacement("//VTK::Light::Impl", True, _CUT_SHADER, False)


def view_axes(*, flat: bool = False, turn: float = 0.0) -> Floats:
    """Return the directions to the right, upward and to the camera as rows, (3, 3); the angle is in degrees."""
    toward = np.array((0.0, 0.0, 1.0) if flat else _VIEW)
    if turn and not flat:
        cosine, sine = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        toward = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ toward
    toward /= np.linalg.norm(toward)
    right = np.cross((0.0, 1.0, 0.0) if flat else (0.0, 0.0, 1.0), toward)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(toward, right), toward])


def shot(stage: Any) -> Picture:
    """Return the rendered picture, (height, width, 3)."""
    stage.suppress_rendering = False
    stage.renderer.reset_camera_clipping_range()
    stage.render()
    image: Picture = np.ascontiguousarray(stage.screenshot(None, return_img=True)[:, :, :3])
    return image


def as_window(window: Any) -> tuple[int, int]:
    """Return width and height of a picture in pixels, checked.

    Raises
    ------
    InputError
        If they are not two whole numbers from 1 to 8192.
    """
    rule = "width and height in pixels, such as (900, 900)"
    check_type(window, (list, tuple), "window", rule)
    if len(window) != 2:
        raise InputError(f"window is {shown(window)}: it must be {rule}; change it")
    width, height = (as_count(side, "window", at_least=1, at_most=MOST_PIXELS) for side in window)
    return width, height


def check_picture_path(path: str | os.PathLike[str], *, overwrite: bool) -> None:
    """Refuse a file that a picture cannot be written to, before the work.

    Raises
    ------
    FileFormatError
        If the suffix is not ``.png``.
    OutputExistsError
        If the file is there and `overwrite` is false.
    """
    output_suffix(path, [".png"], "pictures are kept", overwrite=overwrite)


def png_of(picture: Picture, *, colors: int | None = None) -> bytes:
    """Return a picture as a PNG file.

    With a number of colors, at most 256, the file has a palette of so many: pictures of pale surfaces look the same
    and take half the space.
    """
    # Pillow, a dependency of Matplotlib
    buffer, image = io.BytesIO(), load("PIL.Image").fromarray(picture)
    if colors is None:
        # runs of equal bytes alone: half the time of a search for all repeated parts, and smaller files of pictures
        image.save(buffer, format="png", compress_type=zlib.Z_RLE)
    else:
        image.quantize(colors, dither=0).save(buffer, format="png", optimize=True)
    return buffer.getvalue()


def beads(points: Floats, radii: Floats | float, level: int) -> Any:
    """Return spheres with centers (n, 3) as one mesh; each has the faces of an icosahedron refined `level` times."""
    vertices, faces, _ = sphere(level)
    corners = points[:, None] + np.reshape(radii, (-1, 1, 1)) * vertices
    triangles = faces + len(vertices) * np.arange(len(points))[:, None, None]
    return load("pyvista").PolyData.from_regular_faces(corners.reshape(-1, 3), triangles.reshape(-1, 3))


def add_container(stage: Any, container: Container) -> None:
    """Draw the outline of a container: its sharp edges and its silhouette."""
    mesh = load("pyvista").PolyData.from_regular_faces(*container.mesh())
    if container.dimension == 3:
        stage.add_mesh(mesh, color=INK, opacity=0.05, lighting=False, show_edges=False)
    if container.dimension == 2:
        mesh = mesh.extract_feature_edges(feature_edges=False, manifold_edges=False, non_manifold_edges=False)
        stage.add_mesh(mesh, color=INK, line_width=2, lighting=False)
    else:
        stage.add_silhouette(mesh, color=INK, line_width=2, feature_angle=30.0)


def add_outlines(stage: Any, mesh: Any, **look: Any) -> None:
    """Draw the outlines of flat grains, whose triangles are one mesh, upon them."""
    outlines = mesh.extract_feature_edges(feature_edges=False, manifold_edges=False, non_manifold_edges=False)
    outlines.points[:, 2] += 1e-3 * mesh.length
    stage.add_mesh(outlines, line_width=1.5, lighting=False, **look)


def add_scale_bar(stage: Any, unit: str) -> None:
    """Draw a scale bar of a round length, with its length, at the lower left; the camera must be final, with parallel
    projection.
    """
    width, height = stage.window_size
    pixel = 2 * stage.camera.parallel_scale / height
    length = round_length(0.25 * width * pixel)
    left, low, wide, tick = 0.03 * width, 0.03 * height, length / pixel, 0.008 * height
    right, thick = left + wide, max(2.0, height / 300)
    tiles = [
        (left, low, right, low + thick),
        (left, low, left + thick, low + tick),
        (right - thick, low, right, low + tick),
    ]
    add_tiles(stage, np.array(tiles), np.tile(load("pyvista").Color(INK).float_rgb, (3, 1)))
    text = f"{length:g}" + ("" if unit == "1" else f" {unit}")
    add_label(stage, text, (left, low + 2 * tick))


def text_size(window: tuple[int, int]) -> int:
    """Return the size of texts in a picture, in pixels."""
    return max(SMALLEST, min(window) // TEXTS)


def text_width(text: str, size: int) -> float:
    """Return the width of a text of a size, in pixels."""
    kinds, box = load("vtkmodules.vtkRenderingCore"), [0, 0, 0, 0]
    # without this library there are no letters
    load("vtkmodules.vtkRenderingFreeType")
    style = kinds.vtkTextProperty()
    style.SetFontFamilyToArial()
    style.SetFontSize(size)
    kinds.vtkTextRenderer.GetInstance().GetBoundingBox(style, text, box, 72)
    return float(box[1] - box[0])


def add_label(
    stage: Any,
    text: str,
    place: tuple[float, float],
    *,
    side: str = "left",
    color: Any = LETTERS,
    size: int | None = None,
) -> None:
    """Write a text in front of the scene, of which the left end or the middle of the base line is at a place, in pixels
    from the lower left corner; its size is that of all texts in the picture if none is given.
    """
    actor = load("vtkmodules.vtkRenderingCore").vtkTextActor()
    actor.SetInput(text)
    style = actor.GetTextProperty()
    style.SetFontFamilyToArial()
    style.SetFontSize(size or text_size(stage.window_size))
    style.SetColor(*load("pyvista").Color(color).float_rgb)
    if side == "middle":
        style.SetJustificationToCentered()
    actor.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
    actor.SetPosition(*np.divide(place, stage.window_size))
    stage.add_actor(actor, reset_camera=False)


def add_tiles(stage: Any, tiles: Floats, colors: Floats) -> None:
    """Draw rectangles in front of the scene: left, low, right and high (n, 4), in pixels from the lower left corner,
    with colours (n, 3) in [0, 1].
    """
    corners = tiles[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 2) / stage.window_size
    points = np.column_stack([corners, np.zeros(len(corners))])
    mesh = load("pyvista").PolyData.from_regular_faces(points, np.arange(len(points)).reshape(-1, 4))
    mesh.cell_data["color"] = np.round(255 * colors).astype(np.uint8)
    kinds = load("vtkmodules.vtkRenderingCore")
    frame, mapper, actor = kinds.vtkCoordinate(), kinds.vtkPolyDataMapper2D(), kinds.vtkActor2D()
    frame.SetCoordinateSystemToNormalizedViewport()
    mapper.SetTransformCoordinate(frame)
    mapper.SetInputData(mesh)
    actor.SetMapper(mapper)
    stage.add_actor(actor, reset_camera=False)


def round_length(most: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is not above a length."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= most * (1 + 1e-12)))


def add_spheres(stage: Any, positions: Floats, radii: Floats, colors: Floats) -> None:
    """Draw spheres as shaded points with centers (n, 3), radii (n,) and colors (n, 3) in [0, 1]; fast for large
    numbers.

    The shading of spheres smaller than a few pixels does not show the form of the packing. Therefore the brightness of
    each also depends on the gradient of the density around it, as if the packing were one body.
    """
    cloud = load("pyvista").PolyData(positions)
    shade = 0.95 + 0.45 * _slope(positions) @ np.array(_HEAP_LIGHT)
    cloud.point_data["color"] = np.round(255 * np.clip(colors * shade[:, None], 0, 1)).astype(np.uint8)
    cloud.point_data["radius"] = radii
    actor = stage.add_mesh(cloud, scalars="color", rgb=True, style="points_gaussian", emissive=False, **MATERIAL)
    actor.mapper.scale_array = "radius"
    actor.mapper.scale_factor = 1.0
    # each is drawn on a triangle around its disk; by default it is three times as large
    actor.mapper.SetBoundScale(1.0)
    actor.mapper.SetSplatShaderCode(_BALL_SHADER)


def _slope(positions: Floats, cells: int = 40) -> Floats:
    """Return the negative density gradient (n, 3) at each point on a coarse lattice, scaled to at most length 1."""
    low, length = positions.min(axis=0), float(np.ptp(positions, axis=0).max())
    index = np.minimum((positions - low) / max(length, 1e-300) * cells, cells - 1).astype(np.int64) + 3
    crowd = np.zeros((cells + 6,) * 3)
    np.add.at(crowd, tuple(index.T), 1.0)
    crowd = load("scipy.ndimage").gaussian_filter(crowd, 1.6, mode="constant")
    way = -np.stack(np.gradient(crowd), axis=-1)[tuple(index.T)]
    steep = 0.4 * float(np.quantile(np.linalg.norm(way, axis=1), 0.98))
    long = np.maximum(np.linalg.norm(way, axis=1, keepdims=True), max(steep, 1e-300))
    return np.asarray(way / long)
