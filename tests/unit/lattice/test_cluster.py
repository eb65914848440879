"""Images in blocks on a Dask cluster: the bits of this process."""

import os
import types

import numpy as np
import pytest
from kit import dask_cluster
from scipy.ndimage import gaussian_filter

import voxgran as vg
from voxgran._base.errors import ClusterError, InputError
from voxgran._base.seeds import stream
from voxgran.lattice.image import of_blocks

pytest.importorskip("zarr")
dask = pytest.importorskip("dask")
pytest.importorskip("skimage")
pytest.importorskip("tifffile")


def test_what_is_no_cluster_is_one_sentence():
    distributed = pytest.importorskip("distributed")
    with pytest.raises(InputError, match="dask is 3: it must be the address of a scheduler"):
        vg.open_image(np.zeros((3, 3, 3)), dask=3)
    with pytest.raises(ClusterError, match="there is no Dask scheduler at nowhere") as told:
        vg.open_image(np.zeros((3, 3, 3)), dask="nowhere")
    # other work of this process goes on without one
    with pytest.raises(ValueError, match="No clients found"):
        distributed.default_client()
    assert dask.config.get("scheduler", None) is None
    assert told.value.__cause__ is not None


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_workers_give_the_bits_of_this_process(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grey = gaussian_filter(stream(1, "cluster").random((20, 16, 12)), 2.0)
    vg.save_image((4000 * (grey - 0.4)).astype(np.int16), "grey.tif", voxel_size=1.0)
    here = vg.load_image("grey.tif")
    with dask_cluster(tmp_path) as (_, address), dask.config.set(temporary_directory=str(tmp_path)):
        # a path from here, which workers do not have
        opened = vg.open_image("grey.tif", block=(10, 16, 12), dask=types.SimpleNamespace(scheduler_address=address))
        assert os.getpid() not in of_blocks(opened.values, lambda block, start: os.getpid())
        parted, expected = vg.segment(opened, min_size=8), vg.segment(here, min_size=8)
        assert parted.necks.identical(expected.necks)
        # the client is the one that is there
        vg.save_image(parted.values, "labels.zarr", voxel_size=1.0)
        labels = vg.open_image("labels.zarr", dask=address).values
        for found, true in (
            (labels, expected.values),
            (vg.local_thickness(labels == 0), vg.local_thickness(expected.values == 0)),
        ):
            assert found.compute().tobytes() == np.asarray(true).astype(found.dtype).tobytes()
        del parted, labels, found
        pytest.importorskip("distributed").default_client().close()
