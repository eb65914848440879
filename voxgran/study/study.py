"""`Study`: a base scene with axes and seeds, the type that the study room hands on."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from voxgran._base import ExplainedAttributes
from voxgran._base.calls import explained, explained_methods
from voxgran._base.errors import InputError
from voxgran._base.files import as_path
from voxgran._base.progress import OnStep
from voxgran.scene.description import SceneDescription
from voxgran.study.cells import Cell
from voxgran.study.engine import Options, Store, planned, run_study
from voxgran.study.plan import StudyPlan
from voxgran.study.result import StudyResult
from voxgran.study.settings import make_settings, settings_of_file


@explained_methods
class Study(ExplainedAttributes):
    """A base scene that is varied along axes, and packed with several seeds.

    Each combination of values is a cell. A cell with a seed is one scene, packed, verified and measured; its results
    are kept under a hash of the scene, of the files that it names and of the version of voxgran.

    Parameters
    ----------
    source : path-like, optional
        A study file; all else is then in it.
    base : Scene, mapping or path-like, optional
        The scene that is varied, or its sections, or its file.
    axes : mapping, optional
        Lists of values by axis. An axis is a path into the scene, such as ``"packing.friction"``, a section such as
        ``"settle"``, or one of ``"method"``, ``"shape"``, ``"sizes"`` and ``"container"``, whose values are names or
        tables, which may have a `label`.
    seeds : int or sequence of int, optional
        How many seeds, from that of the base on, or which. Default: as the base says.
    combine : {"cross", "zip"}
        Whether all combinations of the values are cells, or the first, second, ... values of all axes.
    zip : sequence of sequence of str, optional
        Groups of axes that vary together; groups and other axes are crossed. A group has one dimension, with the name
        of its first axis.
    cells : sequence of mapping, optional
        Cells that are listed: values by axis, and a `label`. They are one more dimension, ``cell``.
    keep : {"numbers", "packings"}
        Whether the packings are kept, too.
    experiments : mapping, optional
        Ranges of measured values, drawn as bands in the figures: by shape, or by value of the axis that is drawn in its
        place, a table with `low`, `high` and `source`.

    Raises
    ------
    MissingFileError
        If a file is not there.
    FileFormatError
        If the file is not TOML.
    UnknownNameError
        If an axis, key, method or family is unknown; the message gives the nearest name.
    InputError
        If a value breaks a rule, or a method is given a parameter that it has not; nothing is computed then.

    Examples
    --------
    >>> import voxgran as vg
    >>> base = {
    ...     "shape": [{"family": "sphere"}],
    ...     "container": {"kind": "box", "lengths": [4, 4, 4]},
    ...     "packing": {"method": "rsa", "count": 10},
    ... }
    >>> study = vg.Study(base=base, axes={"packing.count": [5, 10]}, seeds=3)
    >>> [cell.name for cell in study.cells()]
    ['packing.count 5', 'packing.count 10']
    """

    @explained(hint='Study("study.toml") or Study(base=scene, axes={"packing.count": [20, 50]}, seeds=3)')
    def __init__(
        self,
        source: str | os.PathLike[str] | None = None,
        *,
        base: SceneDescription | Mapping[str, Any] | str | os.PathLike[str] | None = None,
        axes: Mapping[str, Any] | None = None,
        seeds: int | Sequence[int] | None = None,
        combine: str = "cross",
        zip: Sequence[Sequence[str]] | None = None,  # noqa: A002 - the word that the file has
        cells: Sequence[Mapping[str, Any]] | None = None,
        keep: str = "numbers",
        experiments: Mapping[str, Any] | None = None,
    ) -> None:
        if (source is None) == (base is None):
            told = "neither a file nor a base" if source is None else "a file and a base"
            raise InputError(f'a study was given {told}: write Study("study.toml"), or Study(base=scene, axes=...)')
        if source is not None:
            if any(given is not None for given in (axes, seeds, zip, cells, experiments)):
                raise InputError(
                    "a study was given a file and axes, seeds, cells or experiments: write them in the file"
                )
            self._settings = settings_of_file(source)
        else:
            self._settings = make_settings(
                base, axes=axes, seeds=seeds, combine=combine, zip=zip, cells=cells, keep=keep, experiments=experiments
            )

    def __repr__(self) -> str:
        """Return the numbers of cells and seeds."""
        return f"Study({len(self._settings.cells)} cells, {len(self._settings.seeds)} seeds)"

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of each cell."""
        return self._settings.seeds

    def cells(self) -> tuple[Cell, ...]:
        """Return all cells, each with its values and its scene; the last dimension varies fastest.

        Examples
        --------
        >>> import voxgran as vg
        >>> base = {
        ...     "shape": [{"family": "sphere"}],
        ...     "container": {"kind": "box", "lengths": [4, 4, 4]},
        ...     "packing": {"method": "rsa", "count": 10},
        ... }
        >>> [cell.name for cell in vg.Study(base=base, axes={"packing.count": [5, 10]}).cells()]
        ['packing.count 5', 'packing.count 10']
        """
        return self._settings.cells

    def plan(self, folder: str | os.PathLike[str] | None = None) -> StudyPlan:
        """Return what a run would compute and cost; nothing is packed.

        Parameters
        ----------
        folder : path-like, optional
            Folder of the study; what is finished there is not computed again.

        Examples
        --------
        >>> import voxgran as vg
        >>> base = {
        ...     "shape": [{"family": "sphere"}],
        ...     "container": {"kind": "box", "lengths": [4, 4, 4]},
        ...     "packing": {"method": "rsa", "count": 10},
        ... }
        >>> plan = vg.Study(base=base, axes={"packing.count": [5, 10]}, seeds=3).plan()
        >>> len(plan.cells), plan.seeds, plan.total("left")
        (2, (0, 1, 2), 6)
        """
        store = Store(Path(os.devnull) if folder is None else as_path(folder), self._settings.keep == "packings")
        return planned(self._settings, store)

    def run(
        self,
        folder: str | os.PathLike[str] = "out",
        *,
        workers: int | None = None,
        memory: int | str | None = None,
        dask: Any = None,
        retry: bool = False,
        overwrite: bool = False,
        zarr: bool = False,
        on_step: OnStep | None = None,
    ) -> StudyResult:
        """Compute what is not finished, and gather all results.

        Parameters
        ----------
        folder : path-like
            Where results are and go: a study goes on where it was interrupted, and what it has finished stays. Default:
            ``out``, as at the prompt.
        workers : int, optional
            Number of processes, one thread each. Default: one for each processor.
        memory : int or str, optional
            Bytes that they may take together as planned, such as ``"8 GB"``, or a share such as ``"50%"`` of the
            memory of the machine. Default: 80 % of it.
        dask : str or cluster, optional
            Address of a Dask scheduler, or a cluster that has one, whose workers compute in place of processes of this
            machine.
        retry : bool
            Whether runs that failed are computed again.
        overwrite : bool
            Whether all is computed again.
        zarr : bool
            Whether the dataset is written as zarr, too.
        on_step : callable, optional
            Told of each run that is finished.

        Returns
        -------
        StudyResult
            The dataset, also in ``study.nc``, and one row for each run, also in ``table.csv``.

        Raises
        ------
        InputError
            If a value breaks a rule.
        OutputExistsError
            If the folder holds something else than a study.
        InUseError
            If another process computes in the folder.
        OutputError
            If something cannot be written.
        MissingLibraryError
            If distributed or zarr is asked for and not installed.
        ClusterError
            If there is no Dask scheduler, or it goes away; what is finished is kept.
        Interrupted
            On SIGINT, SIGTERM or SIGHUP; what is finished is kept.

        Examples
        --------
        >>> import voxgran as vg
        >>> base = {
        ...     "shape": [{"family": "sphere"}],
        ...     "container": {"kind": "box", "lengths": [4, 4, 4]},
        ...     "packing": {"method": "rsa", "count": 10},
        ... }
        >>> study = vg.Study(base=base, axes={"packing.count": [5, 10]}, seeds=3)
        >>> study.run("study", workers=2).dataset.sizes["seed"]  # doctest: +SKIP
        """
        options = Options(
            workers=workers, memory=memory, dask=dask, retry=retry, overwrite=overwrite, zarr=zarr, on_step=on_step
        )
        return run_study(self._settings, as_path(folder), options)
