"""Scene: a granular scene that can be planned and run, the type that the scene room hands on."""

import os
from dataclasses import dataclass

from voxgran._base.calls import explained_methods
from voxgran._base.progress import OnStep
from voxgran.packing.driver import Recorder
from voxgran.scene.description import SceneDescription
from voxgran.scene.plan import Plan, make_plan
from voxgran.scene.replicates import run_seeds
from voxgran.scene.run import SceneResult, run_one


@explained_methods
@dataclass(frozen=True, slots=True, kw_only=True)
class Scene(SceneDescription):
    """A granular scene, from a TOML file or a mapping; its attributes are those of :class:`SceneDescription`.

    Examples
    --------
    >>> import voxgran as vg
    >>> shape, box = [{"family": "sphere"}], {"kind": "box", "lengths": [4, 4, 4]}
    >>> packing = {"method": "rsa", "count": 10}
    >>> scene = vg.Scene.from_mapping({"shape": shape, "container": box, "packing": packing})
    >>> scene.method, scene.count
    ('rsa', 10)
    """

    def plan(self) -> Plan:
        """Return what a run would compute, skip and cost; nothing is packed, and neither Open3D nor VTK is
        loaded, and numba only for the volume of the spheres of a clump file.

        Raises
        ------
        InputError
            If the scene breaks a rule that shows only now, such as grains that cannot fit.
        TooLargeError
            If it does not fit in memory.

        Examples
        --------
        >>> import voxgran as vg
        >>> shape, box = [{"family": "sphere"}], {"kind": "box", "lengths": [4, 4, 4]}
        >>> packing = {"method": "rsa", "count": 10}
        >>> scene = vg.Scene.from_mapping({"shape": shape, "container": box, "packing": packing})
        >>> scene.plan().grains, round(scene.plan().solid_fraction, 3)
        (10, 0.082)
        """
        return make_plan(self)

    def run(
        self,
        folder: str | os.PathLike[str],
        *,
        resume: bool = False,
        overwrite: bool = False,
        on_step: OnStep | None = None,
        recorder: Recorder | None = None,
    ) -> SceneResult:
        """Pack, check, measure and save.

        Parameters
        ----------
        folder : path-like
            Where results go.
        resume : bool
            Whether to go on from the checkpoint in the folder.
        overwrite : bool
            Whether results that are there may be replaced.
        on_step : callable, optional
            Told of each step.
        recorder : Recorder, optional
            Receives the packing whenever a snapshot is due, as in :func:`voxgran.pack`, in place of the snapshots of
            ``[output]``.

        Raises
        ------
        OutputExistsError
            If the folder holds something and neither `resume` nor `overwrite` is set.
        InUseError
            If another process writes into the folder.
        OutputError
            If something cannot be written.
        InputError
            If the scene breaks a rule that shows only now.
        Interrupted
            On SIGINT, SIGTERM or SIGHUP, after a checkpoint was written.

        Examples
        --------
        >>> import voxgran as vg
        >>> shape, box = [{"family": "sphere"}], {"kind": "box", "lengths": [4, 4, 4]}
        >>> packing, output = {"method": "rsa", "count": 10}, {"report": False}
        >>> given = {"shape": shape, "container": box, "packing": packing, "measure": {"which": ["coordination"]}}
        >>> vg.Scene.from_mapping({**given, "output": output}).run("out").packing.count
        10
        """
        run = run_seeds if self.general.seeds > 1 else run_one
        return run(self, folder, resume=resume, overwrite=overwrite, on_step=on_step, recorder=recorder)
